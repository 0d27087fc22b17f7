"""The same promises of every camera: frame after an instant, time-outs that say why, opening again."""

import asyncio
import json
import time

import cv2
import numpy as np
import pytest
from structlog.testing import capture_logs

from drivers.camera import StreamCamera, V4L2Camera, running
from drivers.camera.contract import Pixels
from drivers.camera.jpeg import decode_jpeg
from drivers.camera.running import RunningCamera
from drivers.deadline import Deadline
from drivers.errors import CameraError, CameraTimeout
from tests.drivers.camera.fakes import HEIGHT, WIDTH, StreamServer, World, config, until


async def test_a_frame_is_exposed_after_the_wanted_instant(camera: RunningCamera, soon: Deadline) -> None:
    """It should give whole, read-only BGR pictures, each exposed after its instant and after the former."""
    last = 0
    for _ in range(5):
        t_s = time.monotonic()
        frame = await camera.frame_after(t_s, soon)
        assert frame.exposure_start_s >= t_s
        assert frame.pixels.shape == (HEIGHT, WIDTH, 3)
        assert frame.pixels.dtype == np.uint8
        assert not frame.pixels.flags.writeable
        assert frame.sequence > last
        last = frame.sequence


async def test_a_picture_that_is_only_shown_is_not_decoded(
    camera: RunningCamera, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should give it as it was coded, and decode it as soon as somebody else wants the same one."""
    decoded: list[bytes] = []

    def decode(data: bytes, width_px: int, height_px: int) -> Pixels | None:
        decoded.append(data)
        return decode_jpeg(data, width_px, height_px)

    monkeypatch.setattr(running, "decode_jpeg", decode)
    t_s = time.monotonic()
    alone = await camera.shown_after(t_s, soon)
    assert alone.exposure_start_s >= t_s
    assert (alone.pixels, decoded) == (None, [])
    assert alone.jpeg is not None
    assert decode_jpeg(alone.jpeg, WIDTH, HEIGHT) is not None
    later_s = time.monotonic() + 0.02
    beside, frame = await asyncio.gather(camera.shown_after(later_s, soon), camera.frame_after(later_s, soon))
    assert beside.exposure_start_s == frame.exposure_start_s
    assert (beside.jpeg, beside.jpeg in decoded) == (frame.jpeg, True)


async def test_a_picture_of_a_frozen_camera_is_shown_once(world: World, v4l2: V4L2Camera, soon: Deadline) -> None:
    world.frozen = True
    await v4l2.shown_after(time.monotonic(), soon)
    with pytest.raises(CameraTimeout, match="frozen"):
        await v4l2.shown_after(time.monotonic(), Deadline.after(0.2))
    world.frozen = False
    assert (await v4l2.shown_after(time.monotonic(), soon)).jpeg is not None
    assert v4l2.trouble is None


async def test_a_torn_picture_is_shown_to_nobody_and_one_without_tables_is_decoded(
    world: World, v4l2: V4L2Camera, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.torn = True
    with pytest.raises(CameraTimeout, match="torn"):
        await v4l2.shown_after(time.monotonic(), Deadline.after(0.2))
    world.torn = False
    monkeypatch.setattr(running, "shown_anywhere", lambda _data: None)
    shown = await v4l2.shown_after(time.monotonic(), soon)
    assert shown.jpeg is None
    assert shown.pixels is not None


async def test_several_callers_are_served_at_once(camera: RunningCamera, soon: Deadline) -> None:
    """It should give each the first frame after its own instant."""
    now_s = time.monotonic()
    frames = await asyncio.gather(*(camera.frame_after(now_s + 0.02 * n, soon) for n in range(4)))
    assert all(frame.exposure_start_s >= now_s + 0.02 * n for n, frame in enumerate(frames))
    assert camera.statistics().delivered == 4


async def test_no_frame_in_time_is_a_camera_time_out(camera: RunningCamera) -> None:
    """It should end at the deadline, be a TimeoutError too, and leave nothing behind."""
    with pytest.raises(CameraTimeout, match="no picture exposed after") as caught:
        await camera.frame_after(time.monotonic() + 100.0, Deadline.after(0.03))
    assert isinstance(caught.value, TimeoutError)
    assert caught.value.advice
    assert camera.waiting == 0


async def test_a_cancelled_caller_leaves_nothing_behind(camera: RunningCamera, soon: Deadline) -> None:
    """It should forget the wish."""
    task = asyncio.create_task(camera.frame_after(time.monotonic() + 100.0, soon))
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert camera.waiting == 0


async def test_a_closed_camera_says_so(camera: RunningCamera, soon: Deadline) -> None:
    """It should refuse a picture, give waiting callers an error, and open again."""
    waiting = asyncio.create_task(camera.frame_after(time.monotonic() + 100.0, soon))
    await asyncio.sleep(0)
    await camera.close()
    await camera.close()
    with pytest.raises(CameraError, match="closed"):
        await waiting
    with pytest.raises(CameraError, match="not open"):
        await camera.frame_after(0.0, soon)
    await camera.open(soon)
    await camera.frame_after(time.monotonic(), soon)


async def test_a_camera_is_opened_once(camera: RunningCamera, soon: Deadline) -> None:
    """It should refuse a second opening."""
    with pytest.raises(CameraError, match="open already"):
        await camera.open(soon)


async def test_an_outage_is_one_error_and_one_word_when_pictures_come_again(world: World, soon: Deadline) -> None:
    """It should not report the same outage with every try, nor call an opened camera without pictures back."""
    with capture_logs() as said:
        camera = V4L2Camera(config(), world.factory)
        await camera.open(soon)
        await camera.frame_after(time.monotonic(), soon)
        world.stopped = True
        await until(lambda: camera.statistics().reopened >= 3, soon)
        world.stopped = False
        await camera.frame_after(time.monotonic(), soon)
        await camera.close()
    spoken = [(entry["log_level"], entry["event"]) for entry in said if entry["log_level"] != "debug"]
    assert spoken == [("error", "camera.lost"), ("info", "camera.back")]


async def test_frames_passed_over_while_somebody_waits_are_counted_as_late(v4l2: V4L2Camera, soon: Deadline) -> None:
    """It should count those exposed before the wanted instant."""
    with pytest.raises(CameraTimeout):
        await v4l2.frame_after(time.monotonic() + 60.0, Deadline.after(0.05))
    assert v4l2.statistics().late > 0
    assert v4l2.statistics().missed == 0


async def test_a_camera_that_hangs_is_left_behind_and_hurts_nobody_when_it_wakes(
    world: World, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should close in time, open anew beside the hanging one, and not be disturbed by its end."""
    camera = V4L2Camera(config(), world.factory)
    await camera.open(soon)
    waiting = asyncio.create_task(camera.frame_after(time.monotonic() + 60.0, soon))
    world.let_go.clear()
    await until(lambda: world.hanging, soon)
    with capture_logs() as said, monkeypatch.context() as hurried:
        hurried.setattr(running, "CLOSE_WITHIN_S", 0.05)
        await camera.close()
    assert [entry["event"] for entry in said] == ["camera.hangs"]
    with pytest.raises(CameraError, match="was closed"):
        await waiting
    await camera.open(soon)
    waiting = asyncio.create_task(camera.frame_after(time.monotonic() + 0.1, soon))
    await asyncio.sleep(0)
    world.let_go.set()
    assert (await waiting).sequence > 0
    await until(lambda: world.released == 1, soon)
    await camera.close()
    assert world.released == 2


ODD = (ValueError("a shape nobody thought of"), MemoryError(), cv2.error("assertion failed"), RuntimeError("gone"))


@pytest.mark.parametrize("odd", ODD, ids=lambda odd: type(odd).__name__)
@pytest.mark.parametrize("call", ["open", "set", "grab", "retrieve", "release"])
async def test_an_error_nobody_promised_is_an_outage_that_ends_when_its_cause_does(
    world: World, soon: Deadline, call: str, odd: Exception
) -> None:
    """It should open again and give pictures, whatever was raised and wherever."""
    camera = V4L2Camera(config(), world.factory)
    await camera.open(soon)
    await camera.frame_after(time.monotonic(), soon)
    world.breaks[call] = odd
    world.stopped = call not in ("grab", "retrieve")
    waiting = asyncio.create_task(camera.frame_after(time.monotonic(), soon))
    await until(lambda: camera.trouble is not None, soon)
    world.breaks.clear()
    world.stopped = False
    assert (await waiting).sequence > 0
    await camera.frame_after(time.monotonic(), soon)  # the first one may have been taken before the outage
    assert camera.trouble is None
    await camera.close()


@pytest.mark.parametrize("call", ["open", "set"])
async def test_an_error_nobody_promised_at_the_first_opening_is_a_camera_error(
    world: World, soon: Deadline, call: str
) -> None:
    """It should end the opening at once, not by its deadline, and leave the camera closed."""
    world.breaks[call] = ValueError("a shape nobody thought of")
    camera = V4L2Camera(config(), world.factory)
    with pytest.raises(CameraError, match="ValueError: a shape nobody thought of"):
        await camera.open(soon)
    world.breaks.clear()
    await camera.open(soon)
    await camera.frame_after(time.monotonic(), soon)
    await camera.close()


@pytest.mark.parametrize("error", ["in words", 7, ["a", "list"]])
async def test_a_refusal_of_another_shape_is_an_outage_too(
    stream: StreamCamera, server: StreamServer, soon: Deadline, error: object
) -> None:
    """It should not die of a server that says its error in another form."""
    await stream.frame_after(time.monotonic(), soon)
    server.spoil = lambda request, _replies: [[json.dumps({"v": 1, "n": request["n"], "error": error}).encode()]]
    waiting = asyncio.create_task(stream.frame_after(time.monotonic(), soon))
    await until(lambda: stream.trouble is not None, soon)
    server.spoil = None
    assert (await waiting).sequence > 0
