"""Live publisher: the camera's pictures on a socket of their own, for people who look.

Nothing is taken while nobody listens. A picture goes out as the camera coded it; one that comes uncoded is encoded
once, however many listen. Who is slow loses pictures, never the daemon. Jobs come first: a picture waits for the camera
as a look does, and takes none away.
An address that cannot be served keeps nobody from work: it is told once, and tried again now and then.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

import cv2
import zmq
import zmq.asyncio

from daemon.server.auth import Authenticator
from daemon.server.served_address import SERVE_AGAIN_S, ServedAddress
from daemon.station.sight import Sight
from daemon.wire.live import TOPIC, LiveAim, LiveHeader
from drivers.camera import Shown
from drivers.camera.contract import Camera, Pixels
from drivers.deadline import Deadline
from drivers.errors import CameraError

HELD = 2
"""Pictures kept for a subscriber that is slow."""
FRAME_WITHIN_S, AGAIN_S = 2.0, 1.0
QUALITY = 80


@dataclass(frozen=True)
class LiveView:
    """What the publisher asks of the daemon, each time anew."""

    camera: Callable[[], Camera | None]
    state: Callable[[], str]
    size_px: Callable[[], tuple[int, int]]
    """Width and height of the camera's pictures."""
    tip_px: Callable[[], tuple[float, float] | None]
    sight: Callable[[], Sight | None] = lambda: None


class LivePublisher:
    """Publish pictures while somebody listens."""

    def __init__(
        self, context: zmq.asyncio.Context, endpoint: str, fps: float, view: LiveView, guard: Authenticator
    ) -> None:
        self._context, self._every_s = context, 1.0 / fps
        self._view, self._guard = view, guard
        self._removals = guard.removals
        self._count = 0
        self._wanted = False
        self._address = ServedAddress("live", "live pictures", endpoint, self._socket)
        self.open()

    @property
    def is_served(self) -> bool:
        """Whether somebody could look."""
        return self._address.socket is not None

    @property
    def trouble(self) -> str | None:
        """Why nobody can look; None where somebody can."""
        return self._address.trouble

    def open(self) -> None:
        """Serve, unless that is so already; nothing is raised."""
        self._address.open()

    def _socket(self) -> zmq.asyncio.Socket:
        socket: zmq.asyncio.Socket = self._context.socket(zmq.XPUB)
        socket.setsockopt(zmq.SNDHWM, HELD)
        socket.setsockopt(zmq.LINGER, 0)
        self._guard.protect(socket)
        self._wanted = False
        return socket

    async def run(self, serve_again_s: float = SERVE_AGAIN_S) -> None:
        """Publish until cancelled."""
        while True:
            self.open()
            socket = self._address.socket
            if socket is None:
                await asyncio.sleep(serve_again_s)
                continue
            await self._hear(socket, wait=not self._wanted)
            if self._wanted:
                await self._one()

    async def _hear(self, socket: zmq.asyncio.Socket, *, wait: bool) -> None:
        """Take what subscribers say: the library tells of the first that comes and of the last that goes."""
        while wait or await socket.poll(0):
            said: bytes = await socket.recv()
            self._wanted = said[:1] == b"\x01"
            wait = False

    async def _one(self) -> None:
        """Publish one picture, and wait for the time of the next."""
        begun_s = time.monotonic()
        camera = self._view.camera()
        try:
            if camera is None:
                raise CameraError("no device is open", device="camera")
            shown = await camera.shown_after(begun_s, Deadline.after(FRAME_WITHIN_S))
        except CameraError:  # the station says so itself; here there is just no picture
            await asyncio.sleep(AGAIN_S)
            return
        jpeg = shown.jpeg or await asyncio.to_thread(_encoded, shown.pixels)
        await self._part_from_who_lost_a_key()
        if (socket := self._address.socket) is None:
            return
        await socket.send_multipart([TOPIC, self._header(shown).model_dump_json().encode(), jpeg], zmq.NOBLOCK)
        await asyncio.sleep(max(0.0, begun_s + self._every_s - time.monotonic()))

    def _header(self, shown: Shown) -> LiveHeader:
        self._count += 1
        width_px, height_px = self._view.size_px()
        exposed_at = datetime.now(UTC).timestamp() - (time.monotonic() - shown.exposure_start_s)
        return LiveHeader(
            n=self._count, exposed_at=datetime.fromtimestamp(exposed_at, UTC).isoformat(timespec="milliseconds"),
            width_px=width_px, height_px=height_px, state=self._view.state(), tip_px=self._view.tip_px(),
            aim=_aim(self._view.sight(), shown),
        )  # fmt: skip

    async def _part_from_who_lost_a_key(self) -> None:
        """Part from every subscriber when a key was taken back; who may, comes again."""
        if self._guard.removals != self._removals:
            self._removals = self._guard.removals
            self.close()
            await self._address.open_again()

    def close(self) -> None:
        """Close the socket, if there is one."""
        self._address.close(linger_ms=0)


def _aim(sight: Sight | None, shown: Shown) -> LiveAim | None:
    """Return what a look showed, for a picture that was taken where it looked."""
    if sight is None or shown.exposure_start_s < sight.since_s:
        return None
    rounded = {name: tuple(round(v, 2) for v in getattr(sight, name)) for name in ("at_px", "target_px")}
    return LiveAim(**rounded, tolerance_px=round(sight.tolerance_px, 2), off_um=round(sight.off_um, 1))


def _encoded(pixels: Pixels | None) -> bytes:
    if pixels is None:
        return b""
    ok, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data.tobytes()) if ok else b""
