import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import zmq
import zmq.asyncio

from sim_hw.board.board import load_board
from sim_hw.board.nest import InNest, Mark
from sim_hw.camera.server import CameraServer
from sim_hw.plant.clock import SimClock
from sim_hw.plant.faults import Faults
from tests.sim_hw.scene_double import DEMO, FakePlant, HandClock

PATIENCE_S = 30.0


class Client:
    """A DEALER that says one thing at a time."""

    def __init__(self, socket: zmq.asyncio.Socket) -> None:
        self.socket = socket
        self.number = 0

    async def send(self, op: str, **more: Any) -> None:
        self.number += 1
        await self.socket.send(json.dumps({"v": 1, "n": self.number, "op": op, **more}).encode())

    async def ask(self, op: str, **more: Any) -> tuple[dict[str, Any], bytes]:
        await self.send(op, **more)
        async with asyncio.timeout(PATIENCE_S):
            head, *payload = await self.socket.recv_multipart()
        answer = json.loads(head)
        assert answer["n"] == self.number
        assert answer["v"] == 1
        assert abs(answer["clock_s"] - time.monotonic()) < PATIENCE_S
        return answer, payload[0] if payload else b""

    async def refused(self, op: str, **more: Any) -> str:
        answer, _ = await self.ask(op, **more)
        assert answer["ok"] is False
        assert answer["error"]["message"]
        return str(answer["error"]["name"])

    async def frame(self) -> tuple[dict[str, Any], bytes]:
        grabbed, _ = await self.ask("grab", timeout_ms=5000)
        assert grabbed["ok"], grabbed
        head, payload = await self.ask("retrieve")
        assert head["ok"], head
        assert head["sequence"] == grabbed["sequence"]
        return head, payload


class Rig:
    """A camera served for one test."""

    def __init__(self, tmp_path: Path, clock: Any = None) -> None:
        self.endpoint = f"ipc://{tmp_path}/camera"
        self.plant, self.faults = FakePlant(), Faults()
        self.clock = clock or SimClock()
        board = load_board(DEMO, "top")
        self.plant.aim(board, "TP4")
        self.server = CameraServer(self.plant, board, self.clock, self.endpoint, self.faults, seed=2)

    @contextlib.asynccontextmanager
    async def running(self, clients: int = 1) -> AsyncIterator[list[Client]]:
        serving = asyncio.create_task(self.server.serve())
        context = zmq.asyncio.Context()
        async with asyncio.timeout(PATIENCE_S):
            await self.server.ready.wait()
        sockets = [context.socket(zmq.DEALER) for _ in range(clients)]
        for socket in sockets:
            socket.connect(self.endpoint)
        try:
            yield [Client(socket) for socket in sockets]
        finally:
            for socket in sockets:
                socket.close(linger=0)
            context.term()
            serving.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await serving


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


@pytest.fixture
def by_hand(tmp_path: Path) -> Rig:
    return Rig(tmp_path, HandClock())


def _image(payload: bytes) -> np.ndarray[Any, Any]:
    image = cv2.imdecode(np.frombuffer(payload, dtype=np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image


async def test_open_tells_what_was_really_set(rig: Rig) -> None:
    async with rig.running() as (client,):
        answer, _ = await client.ask("open", width=640, height=480, encoding="yuyv", buffers=99)
    del answer["clock_s"], answer["model"]
    wanted = {"width": 1600, "height": 1200, "encoding": "mjpg", "buffers": 10, "fps": 15.0}
    assert answer == {"v": 1, "n": 1, "ok": True, **wanted}


async def test_a_frame_carries_its_exposure_and_its_pixels_in_both_encodings(rig: Rig) -> None:
    async with rig.running() as (client,):
        before_s = time.monotonic()
        await client.ask("set", control="auto_exposure", value=0)
        await client.ask("open", width=1600, height=1200, encoding="mjpg", buffers=4)
        head, jpeg = await client.frame()
        await client.ask("open", width=1600, height=1200, encoding="bgr8", buffers=4)
        raw_head, raw = await client.frame()
    assert before_s <= head["exposure_start_s"] <= time.monotonic()
    assert head["exposure_us"] == 20_000
    assert (head["width"], head["height"], head["encoding"]) == (1600, 1200, "mjpg")
    picture = np.frombuffer(raw, dtype=np.uint8).reshape(1200, 1600, 3)
    assert (raw_head["encoding"], raw_head["sequence"]) == ("bgr8", 0)
    assert np.abs(_image(jpeg).astype(int) - picture).mean() < 6.0
    assert 20 < picture.mean() < 90


async def test_a_paused_reader_gets_old_frames_first(by_hand: Rig) -> None:
    clock = by_hand.clock
    async with by_hand.running() as (client,):
        await client.ask("open", encoding="mjpg", buffers=3)
        clock.t_s = 20.0
        stale = [(await client.ask("grab"))[0] for _ in range(3)]
        assert [answer["sequence"] for answer in stale] == [0, 1, 2]
        assert all(answer["exposure_start_s"] < 1001.0 for answer in stale)
        clock.t_s = 20.3
        fresh, _ = await client.ask("grab")
    assert fresh["exposure_start_s"] == pytest.approx(1020.0, abs=0.35)
    assert fresh["sequence"] > 200


async def test_a_frame_shows_what_was_true_when_it_was_exposed(by_hand: Rig) -> None:
    async with by_hand.running() as (client,):
        await client.ask("set", control="auto_exposure", value=0)
        by_hand.plant.motion = lambda t_s, head: head if t_s < 0.5 else type(head)(white=0.0)
        await client.ask("open", encoding="bgr8", buffers=2)
        by_hand.clock.t_s = 1.0
        _, bright = await client.frame()
    assert np.frombuffer(bright, dtype=np.uint8).mean() > 20


async def test_grab_waits_no_longer_than_asked(by_hand: Rig) -> None:
    async with by_hand.running() as (client,):
        await client.ask("open", encoding="mjpg", buffers=4)
        assert await client.refused("grab", timeout_ms=30) == "timeout"


async def test_a_new_open_resets_the_queue_and_ends_the_wait_of_the_old_one(by_hand: Rig) -> None:
    async with by_hand.running(clients=2) as (first, second):
        await first.ask("open", encoding="mjpg", buffers=4)
        await first.send("grab", timeout_ms=20_000)
        by_hand.clock.t_s = 0.01
        await second.ask("open", encoding="mjpg", buffers=4)
        async with asyncio.timeout(PATIENCE_S):
            answer = json.loads((await first.socket.recv_multipart())[0])
        assert answer["error"]["name"] == "closed"
        by_hand.clock.t_s = 0.2
        grabbed, _ = await second.ask("grab")
    assert grabbed["sequence"] == 0
    assert grabbed["exposure_start_s"] == pytest.approx(1000.01)


async def test_controls_are_listed_clamped_and_only_the_known_ones_are_taken(rig: Rig) -> None:
    async with rig.running() as (client,):
        listed, _ = await client.ask("controls")
        answer, _ = await client.ask("set", control="exposure_us", value=10**7)
        assert (answer["control"], answer["value"]) == ("exposure_us", 100_000)
        assert await client.refused("set", control="zoom", value=1) == "bad_request"
        assert await client.refused("set", control="gain", value="much") == "bad_request"
    assert set(listed["controls"]) == {
        "exposure_us",
        "gain",
        "focus",
        "white_balance_k",
        "auto_exposure",
        "auto_white_balance",
        "auto_focus",
    }
    assert set(listed["controls"]["gain"]) == {"value", "minimum", "maximum", "step"}


async def test_a_shorter_exposure_is_a_darker_frame(rig: Rig) -> None:
    means = []
    async with rig.running() as (client,):
        for name in ("auto_exposure", "auto_white_balance", "auto_focus"):
            await client.ask("set", control=name, value=0)
        for exposure_us in (20_000, 5_000):
            await client.ask("set", control="exposure_us", value=exposure_us)
            await client.ask("open", encoding="bgr8", buffers=2)
            head, raw = await client.frame()
            assert head["exposure_us"] == exposure_us
            means.append(float(np.frombuffer(raw, dtype=np.uint8).mean()))
    assert means[1] == pytest.approx(means[0] / 4.0, rel=0.35)


async def test_what_cannot_be_answered_is_refused_by_name(rig: Rig) -> None:
    async with rig.running() as (client,):
        assert await client.refused("grab") == "not_open"
        assert await client.refused("retrieve") == "not_open"
        assert await client.refused("dance") == "bad_request"
        await client.ask("open")
        assert await client.refused("retrieve") == "no_frame"
        assert await client.refused("grab", timeout_ms="long") == "bad_request"
        await client.ask("close")
        assert await client.refused("grab") == "not_open"
        for nonsense in (b"\xff\xfe", b"[1]", b'{"v":2,"n":1,"op":"open"}'):
            await client.socket.send(nonsense)
            async with asyncio.timeout(PATIENCE_S):
                answer = json.loads((await client.socket.recv_multipart())[0])
            assert answer["error"]["name"] == "bad_request"


async def test_frozen_shows_the_same_picture_while_frames_go_on(rig: Rig) -> None:
    async with rig.running() as (client,):
        await client.ask("open", encoding="bgr8", buffers=2)
        rig.faults.switch("frozen", on=True)
        first, one = await client.frame()
        second, same = await client.frame()
        rig.faults.switch("frozen", on=False)
        _, other = await client.frame()
    assert second["sequence"] > first["sequence"]
    assert one == same
    assert other != same


async def test_black_is_black(rig: Rig) -> None:
    async with rig.running() as (client,):
        await client.ask("open", encoding="bgr8", buffers=2)
        rig.faults.switch("black", on=True)
        _, raw = await client.frame()
    assert not any(raw)


@pytest.mark.parametrize("encoding", ["mjpg", "bgr8"])
async def test_a_torn_frame_lacks_its_end(rig: Rig, encoding: str) -> None:
    async with rig.running() as (client,):
        await client.ask("open", encoding=encoding, buffers=2)
        _, whole = await client.frame()
        rig.faults.switch("torn", on=True, count=1)
        _, torn = await client.frame()
        _, healed = await client.frame()
    assert len(torn) < 0.8 * len(whole)
    assert not torn.endswith(b"\xff\xd9")
    assert abs(len(healed) - len(whole)) < 0.1 * len(whole)


async def test_an_unplugged_camera_says_so_and_must_be_opened_again(rig: Rig) -> None:
    async with rig.running() as (client,):
        await client.ask("open", encoding="mjpg", buffers=2)
        rig.faults.switch("unplugged", on=True)
        assert await client.refused("grab") == "unplugged"
        assert await client.refused("open") == "unplugged"
        rig.faults.switch("unplugged", on=False)
        assert await client.refused("grab") == "not_open"
        await client.ask("open", encoding="mjpg", buffers=2)
        await client.frame()


async def test_a_silent_camera_does_not_answer_and_comes_back(rig: Rig) -> None:
    async with rig.running() as (client,):
        rig.faults.switch("silent", on=True, count=1)
        await client.send("controls")
        answer, _ = await client.ask("controls")  # the first answer to come is that of the second request
    assert answer["ok"]


async def test_the_loop_stays_free_while_a_frame_is_drawn(rig: Rig) -> None:
    beats = 0

    async def beat() -> None:
        nonlocal beats
        while True:
            beats += 1
            await asyncio.sleep(0.001)

    async with rig.running() as (client,):
        await client.ask("open", encoding="mjpg", buffers=2)
        grabbed, _ = await client.ask("grab", timeout_ms=5000)
        assert grabbed["ok"]
        async with asyncio.TaskGroup() as group:
            beating = group.create_task(beat())
            await client.ask("retrieve")
            beating.cancel()
    assert beats > 5


async def test_a_mirrored_camera_delivers_its_frames_flipped_left_to_right(tmp_path: Path) -> None:
    rig = Rig(tmp_path, HandClock())
    async with rig.running() as (client,):
        await client.ask("open", encoding="bgr8", buffers=2)
        rig.clock.t_s = 1.0
        _, plain = await client.frame()
        rig.faults.switch("mirrored", on=True)
        _, mirrored = await client.ask("retrieve")
        rig.faults.switch("mirrored", on=False)
        _, healed = await client.ask("retrieve")
    frames = [np.frombuffer(pixels, dtype=np.uint8).reshape(1200, 1600, 3) for pixels in (plain, mirrored, healed)]
    assert not np.array_equal(frames[0], frames[1])
    assert np.array_equal(frames[0], frames[1][:, ::-1])
    assert np.array_equal(frames[0], frames[2])


async def test_the_worker_rests_until_the_head_goes_elsewhere_or_another_board_lies_there(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    goals: list[Any] = []
    monkeypatch.setattr(rig.server.scene, "draw_ahead", goals.append)

    async def until(count: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(goals) < count:  # noqa: ASYNC110 - nothing tells
                await asyncio.sleep(0.01)
        await asyncio.sleep(0.3)  # a few looks at what is to be done
        assert len(goals) == count

    async with rig.running():
        await until(1)
        rig.plant.head = replace(rig.plant.head, tip_x_um=rig.plant.head.tip_x_um + 100.0)
        await until(2)
        nest = InNest.made(load_board(DEMO, "bottom"))
        rig.server.scene.put(nest)
        await until(3)
        nest.marks.append(Mark(1.0, 1.0, 30.0))
        await until(4)
