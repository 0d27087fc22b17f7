"""Door of the page: every request and WebSocket is looked at here before anything answers it.

Host must be one of the page's names (another one is DNS rebinding: 421), what changes something or opens a WebSocket
must come from the page itself (Origin, 403), bodies are small, and each answer carries the headers that keep foreign
script out.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY: Final = 16_384
LONGER: Final = {"/plan": 1_200_000}
"""Path -> what may come there: a plan has up to 5,000 tests. Nobody reads it before it is known who sends it."""
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}
LASTING: Final = {"strict-transport-security": "max-age=31536000"}


class Door:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp, names: Iterable[str], *, tls: bool) -> None:
        """Take the names, with port where it is not the scheme's own, by which the page may be called."""
        self._app = app
        self._names = frozenset(name.lower() for name in names)
        self._schemes = ("https",) if tls else ("http", "https")
        self._headers = HEADERS | (LASTING if tls else {})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let in what may come in."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refused = self._against(scope)
        if refused is not None:
            await self._refuse(refused, scope, receive, send)
            return
        if scope["type"] == "http":
            receive = _bounded(receive, LONGER.get(scope["path"], MAX_BODY))
        await self._app(scope, receive, self._dressed(send))

    def _against(self, scope: Scope) -> int | None:
        """Return the status by which a request is refused; None if it may come in."""
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._names:
            return 421
        if scope["type"] == "http" and scope["method"] in ("GET", "HEAD"):
            return None
        if scope["type"] == "http" and scope["method"] != "POST":
            return 405
        origins = headers.getlist("origin")
        if len(origins) != 1 or origins[0].lower() not in {f"{s}://{hosts[0].lower()}" for s in self._schemes}:
            return 403
        return None

    async def _refuse(self, status: int, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket" and "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 4403})
            return
        words = {403: "not from this page", 405: "not so", 421: "not the name of this page"}
        response = PlainTextResponse(words[status], status)
        if scope["type"] == "websocket":
            await send({"type": "websocket.http.response.start", "status": status, "headers": response.raw_headers})
            await send({"type": "websocket.http.response.body", "body": response.body})
            return
        await response(scope, receive, self._dressed(send))

    def _dressed(self, send: Send) -> Send:
        async def dressed(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(self._headers)
                headers.setdefault("cache-control", "no-store")
            await send(message)

        return dressed


class BodyTooLarge(Exception):
    """More came than any request of the page has; the application answers it with 413."""


def _bounded(receive: Receive, most: int) -> Receive:
    got = 0

    async def bounded() -> Message:
        nonlocal got
        message = await receive()
        got += len(message.get("body", b""))
        if got > most:
            raise BodyTooLarge
        return message

    return bounded
