"""A camera behind a socket: its contract, and whatever else may arrive."""

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.camera import StreamCamera
from drivers.camera.jpeg import decode_jpeg
from drivers.deadline import Deadline
from drivers.errors import CameraError, CameraTimeout
from tests.drivers.camera.fakes import HEIGHT, WIDTH, StreamServer, config, jpeg, until


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


async def test_a_picture_brings_what_it_was_decoded_from(stream: StreamCamera, soon: Deadline) -> None:
    frame = await stream.frame_after(time.monotonic(), soon)
    assert frame.jpeg is not None
    assert np.array_equal(decode_jpeg(frame.jpeg, WIDTH, HEIGHT), frame.pixels)


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
    assert frame.jpeg is None
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
    "no JSON": (lambda _q, _r: [[b"\xff\xfe"]], "makes no sense"),
    "no number": (lambda _q, _r: [[b"{}"]], "makes no sense"),
    "no stamp": (lambda q, _r: [[b'{"v":1,"n":%d,"ok":true}' % q["n"]]], "makes no sense"),
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
    await until(lambda: text in (stream.trouble or ""), soon)
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
    whole = jpeg(1)
    assert decode_jpeg(whole, WIDTH, HEIGHT) is not None
    assert decode_jpeg(whole + b"\0\0", WIDTH, HEIGHT) is not None
    assert decode_jpeg(whole[:-100], WIDTH, HEIGHT) is None
    assert decode_jpeg(whole, WIDTH + 1, HEIGHT) is None
    assert decode_jpeg(b"\xff\xd8 nothing \xff\xd9", WIDTH, HEIGHT) is None
    assert decode_jpeg(b"", WIDTH, HEIGHT) is None


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
