"""Live pictures go out while somebody looks, and cost nothing while nobody does."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import zmq
import zmq.asyncio
from structlog.testing import capture_logs

from daemon.server.auth import Authenticator
from daemon.server.live_publisher import LivePublisher, LiveView
from daemon.station.sight import Sight
from daemon.wire.live import LiveAim, LiveHeader
from drivers.camera import Shown
from drivers.deadline import Deadline
from drivers.errors import CameraError
from tests.daemon.server.revoking_guard import RevokingGuard

WITHIN_S = 20.0


class FakeCamera:
    """A camera that has a picture whenever it is asked; each is brighter by one."""

    def __init__(self) -> None:
        self.taken = 0
        self.trouble: CameraError | None = None
        self.jpeg: bytes | None = None

    async def shown_after(self, t_s: float, deadline: Deadline) -> Shown:  # noqa: ARG002  # it is never late
        if self.trouble is not None:
            trouble, self.trouble = self.trouble, None
            raise trouble
        self.taken += 1
        return Shown(t_s, self.jpeg, np.full((48, 64, 3), self.taken % 200, np.uint8))


class Live:
    """A publisher, and sockets of those who look."""

    def __init__(self, folder: Path) -> None:
        self.camera, self.guard = FakeCamera(), RevokingGuard("observe")
        self.context = zmq.asyncio.Context()
        self.endpoint = f"ipc://{folder}/live"
        self.sight: Sight | None = None
        view: Any = LiveView(
            lambda: self.camera, lambda: "idle", lambda: (64, 48), lambda: (32.5, 24.0), lambda: self.sight
        )
        self.publisher = LivePublisher(self.context, self.endpoint, 1000.0, view, self.guard)
        self.running = asyncio.create_task(self.publisher.run())

    def look(self) -> zmq.asyncio.Socket:
        socket = self.context.socket(zmq.SUB)
        socket.subscribe(b"frame")
        socket.connect(self.endpoint)
        return socket

    async def picture(self, socket: zmq.asyncio.Socket) -> tuple[LiveHeader, bytes]:
        async with asyncio.timeout(WITHIN_S):
            _, header, jpeg = await socket.recv_multipart()
        return LiveHeader.model_validate_json(header), jpeg


@pytest.fixture
async def live(tmp_path: Path) -> AsyncIterator[Live]:
    made = Live(tmp_path)
    yield made
    made.running.cancel()
    await asyncio.wait({made.running})
    made.publisher.close()
    made.context.destroy(linger=0)


async def test_who_looks_gets_pictures_with_what_they_show(live: Live) -> None:
    socket = live.look()
    first, jpeg = await live.picture(socket)
    second, _ = await live.picture(socket)
    assert (first.width_px, first.height_px, first.state, first.tip_px) == (64, 48, "idle", (32.5, 24.0))
    assert second.n > first.n
    assert second.exposed_at >= first.exposed_at
    pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (48, 64, 3)
    socket.close(linger=0)


async def test_a_picture_goes_out_as_the_camera_coded_it(live: Live) -> None:
    """It is not coded a second time: that would cost more than all the rest of showing it."""
    live.camera.jpeg = b"as it came"
    socket = live.look()
    _, jpeg = await live.picture(socket)
    assert jpeg == b"as it came"
    socket.close(linger=0)


async def test_without_anybody_who_looks_no_picture_is_taken(live: Live) -> None:
    first, second = live.look(), live.look()
    await live.picture(first)
    await live.picture(second)
    first.close(linger=0)
    await live.picture(second)
    second.close(linger=0)
    taken = -1
    async with asyncio.timeout(WITHIN_S):
        while taken != live.camera.taken:  # until it has heard that the last one went
            taken = live.camera.taken
            await asyncio.sleep(0.2)
    again = live.look()
    await live.picture(again)
    assert live.camera.taken > taken
    again.close(linger=0)


async def test_a_camera_without_a_picture_is_asked_again(live: Live) -> None:
    live.camera.trouble = CameraError("unplugged", device="camera")
    socket = live.look()
    header, _ = await live.picture(socket)
    assert header.n == 1
    socket.close(linger=0)


async def test_an_address_that_somebody_took_while_lookers_were_sent_away_is_told(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should not be waited for in silence: whoever lost its key was parted from, and all others with it."""
    monkeypatch.setattr("daemon.server.served_address.GIVE_UP_S", 0.0)

    def refuse(socket: zmq.Socket[Any], _endpoint: str) -> Any:
        socket.close(linger=0)
        raise zmq.ZMQError(zmq.EADDRINUSE)

    socket = live.look()
    await live.picture(socket)
    monkeypatch.setattr("daemon.server.served_address.bind", refuse)
    live.guard.removed += 1
    async with asyncio.timeout(WITHIN_S):
        while live.publisher.trouble is None:  # noqa: ASYNC110  # what is waited for has no event of its own
            await asyncio.sleep(0.01)
    assert live.endpoint in live.publisher.trouble
    assert not live.publisher.is_served
    monkeypatch.undo()
    live.publisher.open()
    assert live.publisher.is_served
    socket.close(linger=0)


@pytest.mark.parametrize(("since_s", "told"), [(0.0, True), (1e12, False)], ids=["seen_before", "seen_after"])
async def test_a_picture_says_what_a_look_has_shown_where_it_was_taken(
    live: Live, since_s: float, *, told: bool
) -> None:
    """It should not say it of a picture that was taken before: the head stood elsewhere."""
    live.sight = Sight((31.0, 24.0), (32.5, 24.125), 1.1, 20.03, since_s)
    socket = live.look()
    header, _ = await live.picture(socket)
    aim = LiveAim(at_px=(31.0, 24.0), target_px=(32.5, 24.12), tolerance_px=1.1, off_um=20.0)
    assert header.aim == (aim if told else None)
    socket.close(linger=0)


def test_a_header_is_one_line_of_json() -> None:
    header = LiveHeader(n=1, exposed_at="t", width_px=1, height_px=1, state="idle", tip_px=None)
    assert json.loads(header.model_dump_json())["tip_px"] is None


async def test_an_address_in_use_is_told_once_and_served_as_soon_as_it_is_free() -> None:
    view: Any = LiveView(FakeCamera, lambda: "idle", lambda: (64, 48), lambda: None)
    context = zmq.asyncio.Context()
    with capture_logs() as said, socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        publisher = LivePublisher(context, endpoint, 1000.0, view, Authenticator("observe"))
        served_at_first = publisher.is_served
        running = asyncio.create_task(publisher.run(serve_again_s=0.01))
        await asyncio.sleep(0.05)
        taken.close()
        async with asyncio.timeout(WITHIN_S):
            while not publisher.is_served:  # noqa: ASYNC110  # what is waited for has no event of its own
                await asyncio.sleep(0.01)
        running.cancel()
        await asyncio.wait({running})
        publisher.close()
    context.destroy(linger=0)
    assert not served_at_first
    told = [entry["event"] for entry in said if entry["event"].startswith("live_")]
    assert told == ["live_not_served", "live_served"], "each once"
