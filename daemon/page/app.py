"""The page as an ASGI application: what is answered to whom."""

from __future__ import annotations

import asyncio
import base64
import csv
import io
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

import structlog
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from daemon.client import NoAnswer, Refused
from daemon.page.caller import COOKIE, Asker, who_asks
from daemon.page.door import BodyTooLarge, Door
from daemon.page.live_feed import LiveFeed
from daemon.page.lockout import Lockout
from daemon.page.mirror import Station
from daemon.page.orders import PLAN, BadOrder, asked, may
from daemon.page.people import Users, UserTrouble, right_secret
from daemon.page.sessions import LONGEST_S, Sessions
from daemon.page.shown_files import edition, shown_files
from daemon.page.viewer import Viewers
from daemon.platform.spreadsheet import plain_cell

ORDER_S, FRAME_S, CHARTS_S = 30.0, 2.5, 150.0
"""A reset asks every drive, and one that is without power for as long as it may be silent."""
HISTORY_FIELDS = ("of", "test_point", "board_id", "outcome")
CSV_ROWS, POINTS_AT_ONCE = 5_000, 1000
log = structlog.get_logger(__name__)


class Follows(Protocol):
    """What keeps the mirror: see `daemon.page.hub.Hub`."""

    station: Station
    board: dict[str, Any]
    errors: list[dict[str, Any]]
    feed: LiveFeed

    async def run(self) -> None:
        """Follow the station."""

    async def changed(self, within_s: float) -> None:
        """Wait for a change."""


class Asks(Protocol):
    """What asks the daemon: see `daemon.page.ask.Ask`."""

    async def request(self, role: Any, op: str, **fields: Any) -> dict[str, Any]:
        """Return the reply; raise `Refused` or `NoAnswer`."""


@dataclass(frozen=True)
class Settings:
    """How the page is served."""

    names: tuple[str, ...]
    """By which the page may be called, with their ports."""
    tls: bool = False
    kiosk: bool = False
    watchers: tuple[str, ...] = ()
    """Addresses that may look without a session, with `kiosk`."""


@dataclass
class Page:
    """What the routes use."""

    settings: Settings
    hub: Follows
    ask: Asks
    users: Users
    clock: Callable[[], float] = time.monotonic
    scrypt: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))
    """Each try costs 16 MB: two at once are enough."""

    def __post_init__(self) -> None:
        """Make what belongs to it."""
        self.sessions = Sessions(self.users, self.clock)
        self.lockout = Lockout(self.clock)
        self.files = shown_files()
        self.edition = edition(self.files)
        self.viewers = Viewers(self.hub, self.asker, self.me)

    # --- who ----------------------------------------------------------------------------------------------

    def asker(self, connection: Any) -> Asker:
        """Return who asks."""
        return who_asks(connection, self.sessions, kiosk=self.settings.kiosk, watchers=self.settings.watchers)

    def me(self, asker: Asker) -> dict[str, Any]:
        """Return what a browser is told of its person."""
        session = asker.session
        return {
            "name": session.name if session else None, "role": asker.role, "token": session.token if session else None,
            "left_s": round(self.sessions.left_s(session)) if session else None, "edition": self.edition,
        }  # fmt: skip

    async def who(self, request: Request) -> Response:
        """Tell a browser who it is."""
        return JSONResponse(self.me(self.asker(request)))

    async def login(self, request: Request) -> Response:
        """Begin a session."""
        body = await _json(request)
        name, secret = body.get("name"), body.get("secret")
        if not isinstance(name, str) or not isinstance(secret, str) or not name or len(name) + len(secret) > 1000:
            return _error(400, "bad_order")
        asker = self.asker(request)
        guesser = (f"name {name}", f"address {asker.address}")
        wait_s = self.lockout.wait_s(*guesser)
        if wait_s > 0:
            return _error(429, "wait", wait_s=round(wait_s))
        self.lockout.wrong(*guesser)
        user = self.users.find(name)
        async with self.scrypt:
            right = await asyncio.to_thread(right_secret, user, secret, here=asker.here)
        if not right or user is None:
            await self._note(name, "refused", f"login from {asker.address}")
            return _error(401, "wrong_secret")
        self.lockout.right(*guesser)
        self.sessions.end(request.cookies.get(COOKIE))
        value, session = self.sessions.begin(user, here=asker.here)
        begun = Asker(session, asker.address, asker.here, asker.kiosk)
        await self._note(user.name, "login", asker.address)
        response = JSONResponse(self.me(begun))
        response.set_cookie(
            COOKIE, value, max_age=int(LONGEST_S), httponly=True, samesite="strict", secure=self.settings.tls
        )
        return response

    async def logout(self, request: Request) -> Response:
        """End a session."""
        asker = self._entitled(request)
        if asker.session is not None:
            self.sessions.end(request.cookies.get(COOKIE))
            await self._note(asker.session.name, "logout", asker.address)
        response = JSONResponse({})
        response.delete_cookie(COOKIE)
        return response

    async def alive(self, request: Request) -> Response:
        """Note that the person does something, so that the session lasts."""
        return JSONResponse(self.me(self._entitled(request)))

    # --- orders -------------------------------------------------------------------------------------------

    async def order(self, request: Request) -> Response:
        """Carry an order to the daemon, with the key of the person's role."""
        asker = self._entitled(request)
        try:
            order, body = asked(await _json(request))
            fields = order.fields(body)
        except BadOrder as exc:
            return _error(400, "bad_order", message=str(exc))
        role = asker.role
        if role is None or not may(role, order.role):
            await self._note(asker.by, "refused", order.op)
            return _error(403, "not_allowed", needs=order.role)
        reply = await self.ask.request(role, order.op, by=asker.by, within_s=ORDER_S, **fields)
        return JSONResponse({"ok": True, "id": reply.get("id") or reply.get("cancelled")})

    def _entitled(self, request: Request) -> Asker:
        """Return who asks, whose session lasts on; raise `_Refusal` without a session or its token."""
        asker = self.asker(request)
        if asker.session is None:
            raise _Refusal(401, "no_session")
        if request.headers.get("x-token") != asker.session.token:
            raise _Refusal(403, "no_token")
        self.sessions.acted(asker.session)
        return asker

    async def _note(self, by: str, what: str, detail: str) -> None:
        """Have the daemon write down what it does not see by itself; it may be away, the person is let in then too."""
        try:
            await self.ask.request("operate", "note", by=by[:64], what=what, detail=detail[:200], within_s=1.0)
        except (NoAnswer, Refused) as exc:
            log.warning("not_written_down", by=by, what=what, error=str(exc))

    # --- what is looked at --------------------------------------------------------------------------------

    async def history(self, request: Request) -> Response:
        """Answer results, newest first."""
        fields = self._history_fields(request)
        return JSONResponse(await self.ask.request("observe", "history", limit=50, **fields))

    async def history_csv(self, request: Request) -> Response:
        """Answer the same as a table for a spreadsheet, the newest some thousand."""
        fields, more = self._history_fields(request), True
        rows: list[dict[str, Any]] = []
        while more and len(rows) < CSV_ROWS:
            reply = await self.ask.request("observe", "history", limit=500, **fields)
            rows += reply["results"]
            more, fields["before"] = reply["more"] and bool(reply["results"]), rows[-1]["seq"] if rows else 0
        return Response(
            _csv(rows), media_type="text/csv; charset=utf-8",
            headers={"content-disposition": 'attachment; filename="history.csv"'},
        )  # fmt: skip

    def _history_fields(self, request: Request) -> dict[str, Any]:
        self._looking(request)
        fields: dict[str, Any] = {name: value for name in HISTORY_FIELDS if (value := request.query_params.get(name))}
        if before := request.query_params.get("before"):
            if not before.isdecimal() or len(before) > 18:
                raise _Refusal(400, "bad_order")
            fields["before"] = int(before)
        return fields

    async def board(self, request: Request) -> Response:
        """Answer the board under test."""
        self._looking(request)
        return JSONResponse(self.hub.board or {})

    async def run(self, request: Request) -> Response:
        """Answer a run over a board with the records of its points, the newest where none is named."""
        self._looking(request)
        run, since = request.query_params.get("id") or "last", 0
        told: dict[str, Any] = {"points": []}
        while True:
            reply = await self.ask.request("observe", "points", run=run, since=since, limit=POINTS_AT_ONCE)
            told["run"] = reply["run"]
            told["points"] += reply["points"]
            if len(reply["points"]) < POINTS_AT_ONCE:
                return JSONResponse(told)
            run, since = reply["run"]["id"], reply["points"][-1]["n"] + 1

    async def plans(self, request: Request) -> Response:
        """Answer which plans there are, to who may run them."""
        role = self._looking(request).role
        if role is None or not may(role, "operate"):
            return _error(403, "not_allowed", needs="operate")
        return JSONResponse(await self.ask.request(role, "plan", action="list"))

    async def plan(self, request: Request) -> Response:
        """Answer the newest version of one plan, to who may run it."""
        role = self._looking(request).role
        if role is None or not may(role, "operate"):
            return _error(403, "not_allowed", needs="operate")
        name = request.query_params.get("name", "")
        if not PLAN.fullmatch(name):
            return _error(400, "bad_order")
        reply = await self.ask.request(role, "plan", action="show", name=name)
        return JSONResponse({"plan": reply["plan"]})

    async def point(self, request: Request) -> Response:
        """Answer the tests of one point, newest first, and what people said of it."""
        self._looking(request)
        fields: dict[str, Any] = {"test_point": request.query_params.get("name", "")}
        if board_id := request.query_params.get("board_id"):
            fields["board_id"] = board_id
        told = await self.ask.request("observe", "point", limit=100, **fields)
        marks = await self.ask.request("observe", "marks")
        return JSONResponse({"tests": told["tests"], "more": told["more"], "marks": marks["marks"]})

    async def marks(self, request: Request) -> Response:
        """Answer which points of the board people have forbidden or approved."""
        self._looking(request)
        return JSONResponse({"marks": (await self.ask.request("observe", "marks"))["marks"]})

    async def charts(self, request: Request) -> Response:
        """Answer the courses of all watches over a month, as its report draws them."""
        self._looking(request)
        month = request.query_params.get("month", "")
        reply = await self.ask.request("observe", "charts", month=month, within_s=CHARTS_S)
        return JSONResponse({"month": reply["month"], "charts": reply["charts"]})

    async def pictures(self, request: Request) -> Response:
        """Answer which pictures of a job are kept."""
        self._looking(request)
        return JSONResponse(await self.ask.request("observe", "pictures", id=request.query_params.get("id", "")))

    async def picture(self, request: Request) -> Response:
        """Answer one picture."""
        self._looking(request)
        asked = {name: request.query_params.get(name, "") for name in ("id", "which")}
        reply = await self.ask.request("observe", "picture", **asked)
        return Response(base64.b64decode(reply["jpeg"]), media_type="image/jpeg")

    async def frame(self, request: Request) -> Response:
        """Answer the next live picture; 204 if none comes."""
        self._looking(request)
        after = request.query_params.get("after", "0")
        picture = await self.hub.feed.after(int(after) if after.isdecimal() and len(after) < 16 else 0, FRAME_S)
        if picture is None:
            return Response(status_code=204)
        return Response(picture.jpeg, media_type="image/jpeg", headers={"x-frame": json.dumps(picture.header)})

    async def config(self, request: Request) -> Response:
        """Answer which settings are in force."""
        self._looking(request)
        reply = await self.ask.request("observe", "config")
        return JSONResponse({"settings": reply["settings"], "refused": reply["refused"]})

    async def audit(self, request: Request) -> Response:
        """Answer who did what."""
        asker = self._looking(request)
        if asker.role is None or not may(asker.role, "maintain"):
            return _error(403, "not_allowed", needs="maintain")
        return JSONResponse(await self.ask.request(asker.role, "audit", limit=200))

    def _looking(self, request: Request) -> Asker:
        asker = self.asker(request)
        if not asker.may_look:
            raise _Refusal(401, "no_session")
        return asker

    async def live(self, socket: WebSocket) -> None:
        """Show the station to one tab."""
        await self.viewers.show(socket)

    async def file(self, request: Request) -> Response:
        """Answer one of the page's own files."""
        shown = self.files.get(request.url.path)
        if shown is None:
            return _error(404, "not_found")
        headers = {"etag": shown.tag, "cache-control": "no-cache"}
        if request.headers.get("if-none-match") == shown.tag:
            return Response(status_code=304, headers=headers)
        headers |= {"content-type": shown.kind, "vary": "accept-encoding"}
        if "gzip" in request.headers.get("accept-encoding", ""):  # nothing secret is in it, or of whoever asks
            return Response(shown.packed, headers={**headers, "content-encoding": "gzip"})
        return Response(shown.content, headers=headers)


class _Refusal(Exception):
    """A request is answered with this."""

    def __init__(self, status: int, name: str) -> None:
        super().__init__(name)
        self.status, self.name = status, name


def make_app(page: Page) -> Door:
    """Return the application with its door; its lifespan follows the station."""

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        following = asyncio.create_task(page.hub.run(), name="hub")
        try:
            yield
        finally:
            following.cancel()
            with suppress(asyncio.CancelledError):
                await following

    def post(path: str, answer: Any) -> Route:
        return Route(path, answer, methods=["POST"])

    app = Starlette(
        routes=[
            Route("/me", page.who), Route("/history", page.history), Route("/history.csv", page.history_csv),
            Route("/board", page.board), Route("/run", page.run), Route("/plans", page.plans),
            Route("/plan", page.plan), post("/plan", page.order),
            Route("/point", page.point), Route("/marks", page.marks), Route("/config", page.config),
            Route("/charts", page.charts),
            Route("/pictures", page.pictures), Route("/picture", page.picture), Route("/frame.jpg", page.frame),
            Route("/audit", page.audit),
            post("/login", page.login),
            post("/logout", page.logout), post("/alive", page.alive), post("/order", page.order),
            WebSocketRoute("/live", page.live), Route("/{path:path}", page.file),
        ],
        exception_handlers={
            BodyTooLarge: _on_too_large, _Refusal: _on_refusal, Refused: _on_refused, NoAnswer: _on_no_answer,
            UserTrouble: _on_user_trouble,
        },
        lifespan=lifespan,
    )  # fmt: skip
    return Door(app, page.settings.names, tls=page.settings.tls)


async def _json(request: Request) -> dict[str, Any]:
    """Return the body; one that is no object is an empty one."""
    try:
        body = json.loads(await request.body())
    except (ValueError, RecursionError):
        return {}
    return body if isinstance(body, dict) else {}


def _csv(rows: list[dict[str, Any]]) -> str:
    columns = ("finished_at", "op", "test_point", "board_id", "outcome", "error_before_um", "error_after_um", "id")
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow((*columns, "error"))
    for row in rows:
        writer.writerow(
            [plain_cell(row.get(column)) for column in columns] + [(row.get("error") or {}).get("name", "")]
        )
    return text.getvalue()


def _error(status: int, name: str, **facts: Any) -> Response:
    return JSONResponse({"ok": False, "error": {"name": name, **facts}}, status)


async def _on_refusal(_request: Request, exc: Exception) -> Response:
    return _error(exc.status, exc.name) if isinstance(exc, _Refusal) else _error(500, "internal")


async def _on_too_large(_request: Request, _exc: Exception) -> Response:
    return _error(413, "too_large")


async def _on_refused(_request: Request, exc: Exception) -> Response:
    return JSONResponse({"ok": False, "error": exc.error if isinstance(exc, Refused) else {}}, 409)


async def _on_no_answer(_request: Request, _exc: Exception) -> Response:
    return _error(503, "no_answer")


async def _on_user_trouble(_request: Request, exc: Exception) -> Response:
    log.error("users_unreadable", error=str(exc))
    return _error(500, "users_unreadable")
