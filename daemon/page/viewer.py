"""Viewers: one WebSocket a tab, which gets the whole station first and then the parts that change.

A tab that reads slowly gets fewer changes, never older ones: what is sent is always the station as it is now. A session
that ends, by time or by hand, takes its tabs' pictures away within a second.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

import anyio
from starlette.websockets import WebSocket, WebSocketDisconnect

from daemon.page.caller import Asker
from daemon.page.mirror import Station, parts_changed

BEAT_S = 1.0
"""A tab hears something that often; three times without, and it says that it has lost the page."""
SEND_S = 10.0
MOST = 64
"""Tabs at once."""


class Shows(Protocol):
    """What keeps the mirror."""

    station: Station

    async def changed(self, within_s: float) -> None:
        """Wait for a change."""


class Viewers:
    """All tabs."""

    def __init__(self, hub: Shows, asker: Callable[[Any], Asker], me: Callable[[Asker], dict[str, Any]]) -> None:
        self._hub, self._asker, self._me = hub, asker, me
        self.count = 0

    async def show(self, socket: WebSocket) -> None:
        """Serve one tab to its end."""
        if self.count >= MOST:
            await socket.close(1013)
            return
        self.count += 1
        try:
            await socket.accept()
            async with anyio.create_task_group() as group:
                group.start_soon(self._show_until_gone, socket, group.cancel_scope)
                await _until_gone(socket)
                group.cancel_scope.cancel()
        finally:
            self.count -= 1

    async def _show_until_gone(self, socket: WebSocket, both: anyio.CancelScope) -> None:
        # A tab that is gone, or reads nothing for long, is no error; it comes again by itself.
        with suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            await self._show(socket)
        both.cancel()

    async def _show(self, socket: WebSocket) -> None:
        sent: Station | None = None
        was: tuple[Any, ...] = ()
        while True:
            asker = self._asker(socket)
            now = (asker.session.name if asker.session else None, asker.role)
            message: dict[str, Any] = {}
            if now != was:  # who looks has changed: everything anew, or nothing at all
                was, sent = now, None
                message["me"] = self._me(asker)
            station = self._hub.station
            if asker.may_look:
                if changes := parts_changed(sent, station):
                    message["station"] = changes
                sent = station
            async with asyncio.timeout(SEND_S):
                await socket.send_text(json.dumps(message))
            if self._hub.station is station:
                await self._hub.changed(BEAT_S)


async def _until_gone(socket: WebSocket) -> None:
    """Read what a tab sends, which is nothing, until it is closed."""
    with suppress(WebSocketDisconnect, KeyError):
        while True:
            await socket.receive_text()
