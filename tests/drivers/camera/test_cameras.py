"""The same promises of every camera: frame after an instant, time-outs that say why, opening again."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from structlog.testing import capture_logs

from drivers.camera import CameraConfig, StreamCamera, V4L2Camera, running
from drivers.camera.running import RunningCamera
from drivers.camera.v4l2 import V4L2Source
from drivers.deadline import Deadline
from drivers.errors import CameraError, CameraTimeout
from tests.drivers.camera.fakes import HEIGHT, WIDTH, FakeCapture, StreamServer, World, jpeg


def config(device: str = "/dev/video9", **change: object) -> CameraConfig:
    settings: dict[str, object] = {
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "fps": 500.0,
        "exposure_us": 1000,
        "frame_timeout_s": 0.2,
        "backoff_s": 0.01,
        "backoff_max_s": 0.02,
        **change,
    }
    return CameraConfig(device, **settings)  # type: ignore[arg-type]


async def until(holds: Callable[[], bool], deadline: Deadline) -> None:
    """Let the grabbing thread run until something holds."""
    while not holds():
        assert not deadline.expired
        await asyncio.sleep(0.001)


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
async def v4l2(world: World, soon: Deadline) -> AsyncIterator[V4L2Camera]:
    camera = V4L2Camera(config(), world.factory)
    await camera.open(soon)
    yield camera
    await camera.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[StreamServer]:
    server = StreamServer(f"ipc://{tmp_path}/camera")
    yield server
    server.close()


@pytest.fixture
async def stream(server: StreamServer, soon: Deadline) -> AsyncIterator[StreamCamera]:
    camera = StreamCamera(config(server.endpoint, exposure_us=20000))
    await camera.open(soon)
    yield camera
    await camera.close()


@pytest.fixture(params=["v4l2", "stream"])
def camera(request: pytest.FixtureRequest) -> RunningCamera:
    return request.getfixturevalue(request.param)


# ---------------------------------------------------------------- every camera
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
    assert camera._wishes == []


async def test_a_cancelled_caller_leaves_nothing_behind(camera: RunningCamera, soon: Deadline) -> None:
    """It should forget the wish."""
    task = asyncio.create_task(camera.frame_after(time.monotonic() + 100.0, soon))
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert camera._wishes == []


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


# ---------------------------------------------------------------- V4L2
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


async def test_a_decoded_capture_and_a_wrong_size(world: World, soon: Deadline) -> None:
    """It should take BGR pictures as they are and refuse a camera that gives another size."""
    world.raw_jpeg = False
    camera = V4L2Camera(config(encoding="bgr8"), world.factory)
    await camera.open(soon)
    assert (await camera.frame_after(time.monotonic(), soon)).pixels.shape == (HEIGHT, WIDTH, 3)
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


# ---------------------------------------------------------------- stream
async def test_the_stream_is_set_up_as_asked(server: StreamServer, stream: StreamCamera) -> None:
    """It should open, switch automatics off before values, skip what is missing, and read back."""
    assert server.ops[:2] == ["open", "controls"]
    assert server.sets == [
        ("auto_exposure", 0),
        ("exposure_us", 20000),
        ("auto_white_balance", 0),
        ("white_balance_k", 4600),
    ]
    settings = stream.settings()
    assert (settings["exposure_us"], settings["auto_exposure"], settings["focus"]) == (20000.0, 0.0, None)
    assert (settings["fps"], settings["gain"]) == (15.0, 3.0)


async def test_raw_pictures_pass_the_stream(server: StreamServer, soon: Deadline) -> None:
    """It should take BGR rows, and no picture of a wrong length."""
    rows = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)

    def raw(request: dict[str, Any], replies: list[list[bytes]]) -> list[list[bytes]]:
        if request["op"] != "retrieve":
            return replies
        head = replies[0][0].replace(b"mjpg", b"bgr8")
        return [[head, rows.tobytes()[: -1 if server.number < 5 else None]]]

    server.spoil = raw
    camera = StreamCamera(config(server.endpoint, encoding="bgr8"))
    await camera.open(soon)
    frame = await camera.frame_after(time.monotonic(), soon)
    assert np.array_equal(frame.pixels, rows)
    await camera.close()


def _error(name: str) -> Callable[[Any, Any], list[list[bytes]]]:
    def spoil(request: dict[str, Any], replies: list[list[bytes]]) -> list[list[bytes]]:
        head = json.loads(replies[0][0])
        if request["op"] == "grab":
            head |= {"ok": False, "error": {"name": name, "message": "as told"}}
        return [[json.dumps(head).encode()]]

    return spoil


STREAM_FAULTS = {
    "time-out": (_error("timeout"), "no picture within"),
    "refused": (_error("no_stream"), "no_stream: as told"),
    "no JSON": (lambda _q, _r: [[b"\xff\xfe"]], "without sense"),
    "no number": (lambda _q, _r: [[b"{}"]], "without sense"),
    "no stamp": (lambda q, _r: [[b'{"v":1,"n":%d,"ok":true}' % q["n"]]], "without sense"),
    "silent": (lambda _q, _r: [], "no reply within"),
}


@pytest.mark.parametrize("fault", STREAM_FAULTS, ids=str)
async def test_a_broken_stream_is_named_and_comes_back(
    server: StreamServer, stream: StreamCamera, soon: Deadline, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    """It should never let a foreign error out of the thread, and open again afterwards."""
    monkeypatch.setattr("drivers.camera.stream._REPLY_MARGIN_S", 0.1)
    spoil, text = STREAM_FAULTS[fault]
    server.spoil = lambda request, replies: spoil(request, replies) if request["op"] == "grab" else replies
    await until(lambda: text in (stream._trouble or ""), soon)
    with pytest.raises(CameraTimeout, match=text):
        await stream.frame_after(time.monotonic(), Deadline.after(0.01))
    server.spoil = None
    await stream.frame_after(time.monotonic(), soon)
    assert stream.statistics().reopened >= 1


async def test_replies_to_former_requests_are_thrown_away(
    server: StreamServer, stream: StreamCamera, soon: Deadline
) -> None:
    """It should match replies by number."""
    server.spoil = lambda _q, replies: [[b'{"v":1,"n":1,"ok":true}'], *replies]
    await stream.frame_after(time.monotonic(), soon)


async def test_a_stream_that_gives_another_size_is_refused(server: StreamServer, soon: Deadline) -> None:
    """It should name both sizes."""
    server.spoil = lambda _q, replies: [[replies[0][0].replace(b'"width": 64', b'"width": 32')]]
    with pytest.raises(CameraError, match="gives 32x48"):
        await StreamCamera(config(server.endpoint)).open(soon)


async def test_an_endpoint_that_is_none_is_a_camera_error(soon: Deadline) -> None:
    """It should translate ZeroMQ's error."""
    with pytest.raises(CameraError, match="cannot connect"):
        await StreamCamera(config("nowhere://x")).open(soon)


def test_a_jpeg_cut_short_is_no_picture() -> None:
    """It should refuse what the decoder would fill up with grey."""
    from drivers.camera.source import decode_jpeg

    whole = jpeg(1)
    assert decode_jpeg(whole, WIDTH, HEIGHT) is not None
    assert decode_jpeg(whole + b"\0\0", WIDTH, HEIGHT) is not None
    assert decode_jpeg(whole[:-100], WIDTH, HEIGHT) is None
    assert decode_jpeg(whole, WIDTH + 1, HEIGHT) is None
    assert decode_jpeg(b"\xff\xd8 nothing \xff\xd9", WIDTH, HEIGHT) is None
    assert decode_jpeg(b"", WIDTH, HEIGHT) is None


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


async def test_frames_that_were_lost_on_the_way_are_counted_as_missed(
    server: StreamServer, stream: StreamCamera, soon: Deadline
) -> None:
    """It should see the gaps in the camera's own numbers."""

    def every_third(_request: dict[str, Any], replies: list[list[bytes]]) -> list[list[bytes]]:
        body = json.loads(replies[0][0])
        if "sequence" in body:
            body["sequence"] *= 3
        return [[json.dumps(body).encode(), *replies[0][1:]]]

    await stream.frame_after(time.monotonic(), soon)
    server.spoil = every_third
    await until(lambda: stream.statistics().missed > 4, soon)


async def test_a_camera_that_hangs_is_left_behind_and_hurts_nobody_when_it_wakes(
    world: World, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should close in time, open anew beside the hanging one, and not be disturbed by its end."""
    monkeypatch.setattr(running, "CLOSE_WITHIN_S", 0.05)
    camera = V4L2Camera(config(), world.factory)
    await camera.open(soon)
    waiting = asyncio.create_task(camera.frame_after(time.monotonic() + 60.0, soon))
    world.let_go.clear()
    await until(lambda: world.hanging, soon)
    with capture_logs() as said:
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
