"""A camera on /dev/video*: controls, time stamps, and what may happen to it."""

import asyncio
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera import V4L2Camera
from drivers.camera.jpeg import decode_jpeg
from drivers.camera.v4l2 import V4L2Source
from drivers.deadline import Deadline
from drivers.errors import CameraError, CameraTimeout
from tests.drivers.camera.fakes import HEIGHT, WIDTH, FakeCapture, World, config, until


async def test_settings_are_locked_in_the_right_order_and_read_back(world: World, v4l2: V4L2Camera) -> None:
    """It should set the format first, switch automatics off before the values, and tell what it lacks."""
    order = world.order
    assert order.index(cv2.CAP_PROP_FOURCC) < order.index(cv2.CAP_PROP_FRAME_WIDTH)
    assert order.index(cv2.CAP_PROP_BUFFERSIZE) < order.index(cv2.CAP_PROP_EXPOSURE)
    assert order.index(cv2.CAP_PROP_AUTO_EXPOSURE) < order.index(cv2.CAP_PROP_EXPOSURE)
    assert order.index(cv2.CAP_PROP_AUTO_WB) < order.index(cv2.CAP_PROP_WB_TEMPERATURE)
    settings = v4l2.settings()
    assert settings["exposure_us"] == 1000.0
    assert settings["auto_exposure"] == 0.0
    assert settings["focus"] is None
    assert (settings["width_px"], settings["height_px"]) == (WIDTH, HEIGHT)


async def test_a_clamped_control_is_told(world: World, soon: Deadline) -> None:
    """It should report what the camera really took."""
    world.clamp[cv2.CAP_PROP_EXPOSURE] = 5
    world.missing = set()
    camera = V4L2Camera(config(gain=7, focus=30, white_balance_k=None), world.factory)
    await camera.open(soon)
    settings = camera.settings()
    assert (settings["exposure_us"], settings["gain"], settings["focus"]) == (500.0, 7.0, 30.0)
    await camera.close()


async def test_nobody_waiting_means_no_decoding(world: World, v4l2: V4L2Camera, soon: Deadline) -> None:
    """It should grab on so that the queue stays fresh, but decode only what is wanted."""
    await until(lambda: v4l2.statistics().grabbed >= 10, soon)
    assert world.retrieves == 0
    await v4l2.frame_after(time.monotonic(), soon)
    assert world.retrieves == 1


@pytest.mark.parametrize(("readout_s", "counted_s"), [(None, 1 / 500.0), (0.010, 0.010), (0.0, 0.0)])
def test_the_start_of_the_exposure_is_counted_back_from_the_stamp(
    world: World, readout_s: float | None, counted_s: float
) -> None:
    """It should take exposure and read-out off the kernel's time stamp."""
    source = V4L2Source(config(exposure_us=4000, readout_s=readout_s), world.factory)
    source.open()
    grabbed = source.grab()
    assert grabbed is not None
    stamp_s = world.opened[-1].stamp_s
    assert grabbed.exposure_start_s == pytest.approx(stamp_s - 0.004 - counted_s, abs=1e-6)
    assert grabbed.exposure_s == pytest.approx(0.004)
    source.close()
    assert source.grab() is None
    assert source.retrieve() is None


async def test_without_a_time_stamp_all_buffers_are_counted_back(world: World, soon: Deadline) -> None:
    """It should assume that the picture waited behind all the others."""
    world.stamps = False
    camera = V4L2Camera(config(buffers=4, fps=50.0), world.factory)
    await camera.open(soon)
    t_s = time.monotonic()
    await camera.frame_after(t_s, soon)
    assert time.monotonic() - t_s >= 5 / 50.0
    await camera.close()


@pytest.mark.parametrize("fault", ["present", "stopped"])
async def test_a_lost_camera_is_opened_again(world: World, v4l2: V4L2Camera, soon: Deadline, fault: str) -> None:
    """It should name the trouble while it lasts and go on when it is back."""
    setattr(world, fault, fault == "stopped")
    await until(lambda: len(world.opened) >= 3, soon)
    with pytest.raises(CameraTimeout, match=r"cannot be opened|no more pictures"):
        await v4l2.frame_after(time.monotonic(), Deadline.after(0.05))
    setattr(world, fault, fault != "stopped")
    await v4l2.frame_after(time.monotonic(), soon)
    assert v4l2.statistics().reopened >= 1
    assert world.released >= len(world.opened) - 1


@pytest.mark.parametrize(("fault", "text"), [("frozen", "frozen"), ("torn", "torn")])
async def test_a_frozen_or_torn_picture_is_never_given(
    world: World, v4l2: V4L2Camera, soon: Deadline, fault: str, text: str
) -> None:
    """It should wait for a good one, and say at the deadline what came instead."""
    await v4l2.frame_after(time.monotonic(), soon)
    setattr(world, fault, True)
    await asyncio.sleep(0)

    async def take_pictures() -> None:
        while True:  # one good picture may be under way when the fault begins
            await v4l2.frame_after(time.monotonic(), Deadline.after(0.1))

    with pytest.raises(CameraTimeout, match=text):
        await take_pictures()
    setattr(world, fault, False)
    await v4l2.frame_after(time.monotonic(), soon)


async def test_identical_pictures_may_be_allowed(world: World, soon: Deadline) -> None:
    """It should give them when told so."""
    world.frozen = True
    camera = V4L2Camera(config(refuse_identical=False), world.factory)
    await camera.open(soon)
    for _ in range(2):
        await camera.frame_after(time.monotonic(), soon)
    await camera.close()


async def test_a_picture_brings_what_it_was_decoded_from(v4l2: V4L2Camera, soon: Deadline) -> None:
    frame = await v4l2.frame_after(time.monotonic(), soon)
    assert frame.jpeg is not None
    decoded = decode_jpeg(frame.jpeg, WIDTH, HEIGHT)
    assert decoded is not None
    assert np.array_equal(decoded, frame.pixels)


async def test_a_decoded_capture_and_a_wrong_size(world: World, soon: Deadline) -> None:
    """It should take BGR pictures as they are and refuse a camera that gives another size."""
    world.raw_jpeg = False
    camera = V4L2Camera(config(encoding="bgr8"), world.factory)
    await camera.open(soon)
    frame = await camera.frame_after(time.monotonic(), soon)
    assert (frame.pixels.shape, frame.jpeg) == ((HEIGHT, WIDTH, 3), None)
    await camera.close()
    world.clamp[cv2.CAP_PROP_FRAME_WIDTH] = 32
    with pytest.raises(CameraError, match="gives 32x48 instead of 64x48"):
        await V4L2Camera(config(), world.factory).open(soon)


async def test_another_format_than_was_asked_for_is_refused(world: World, soon: Deadline) -> None:
    """It should say which one the camera gives: read as JPEG it would look like torn pictures for ever."""
    world.clamp[cv2.CAP_PROP_FOURCC] = cv2.VideoWriter.fourcc(*"BGR3")
    with pytest.raises(CameraError, match="gives BGR3 instead of MJPG"):
        await V4L2Camera(config(), world.factory).open(soon)
    camera = V4L2Camera(config(encoding="bgr8"), world.factory)  # here the library makes BGR of what there is
    await camera.open(soon)
    await camera.close()


@pytest.mark.parametrize(("waits_s", "text"), [(0.0, "no more pictures"), (1.0, "no picture within 1 s")])
async def test_a_stream_that_broke_is_told_from_one_that_is_silent(
    world: World, soon: Deadline, waits_s: float, text: str
) -> None:
    """It should not call a time-out what failed at once."""
    camera = V4L2Camera(config(frame_timeout_s=1.0), world.factory)
    await camera.open(soon)
    await camera.frame_after(time.monotonic(), soon)
    world.period_s, before = waits_s, world.grabs
    await until(lambda: world.grabs > before, soon)  # those after this one wait so long
    world.stopped = True
    await until(lambda: camera.statistics().reopened >= 1, soon)
    with pytest.raises(CameraTimeout, match=text):
        await camera.frame_after(time.monotonic(), Deadline.after(0.05))
    assert bool(camera.statistics().timeouts) == (waits_s > 0)
    world.period_s = 0.02
    await camera.close()


async def test_a_missing_device_is_a_camera_error(
    soon: Deadline, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """It should come from the real OpenCV backend as CameraError, without words of the library's own."""
    with pytest.raises(CameraError, match="cannot be opened"):
        await V4L2Camera(config(str(tmp_path / "video0"))).open(soon)
    assert "VIDEOIO" not in capfd.readouterr().err


async def test_a_camera_that_opens_too_slowly_is_a_time_out(world: World) -> None:
    """It should give up at the deadline and release the device when it comes."""

    def slow(device: str) -> FakeCapture:
        time.sleep(0.1)
        return world.factory(device)

    with pytest.raises(CameraTimeout, match="open in time"):
        await V4L2Camera(config(), slow).open(Deadline.after(0.02))
    assert world.released == 1
