"""A fake V4L2 capture and a tiny stream server, both driven by the test."""

import asyncio
import json
import threading
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import zmq

from drivers.camera import CameraConfig
from drivers.deadline import Deadline

WIDTH, HEIGHT = 64, 48


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


def picture(number: int) -> np.ndarray:
    """A picture that differs from every other."""
    rng = np.random.default_rng(number)
    return rng.integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)


def jpeg(number: int) -> bytes:
    good, data = cv2.imencode(".jpg", picture(number))
    assert good
    return data.tobytes()


class FakeCapture:
    """What the adapter uses of cv2.VideoCapture, with a clock that gives a frame every `period_s`."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.props: dict[int, float] = dict(world.props)
        self.number = 0
        world.opened.append(self)

    def isOpened(self) -> bool:  # noqa: N802
        return self.world.present

    def set(self, propId: int, value: float, /) -> bool:  # noqa: N803
        self.world.break_at("set")
        self.world.order.append(propId)
        if propId in self.world.missing:
            return False
        self.props[propId] = min(value, self.world.clamp.get(propId, value))
        return True

    def get(self, propId: int, /) -> float:  # noqa: N803
        if propId == cv2.CAP_PROP_POS_MSEC:
            return self.stamp_s * 1000.0
        return -1.0 if propId in self.world.missing else self.props.get(propId, 0.0)

    def grab(self) -> bool:
        self.world.break_at("grab")
        self.world.hanging = not self.world.let_go.is_set()
        self.world.let_go.wait()
        time.sleep(self.world.period_s)
        self.number += not self.world.frozen
        self.stamp_s = time.monotonic() - 0.001 if self.world.stamps else 0.0
        self.world.grabs += 1
        return self.world.present and not self.world.stopped

    def retrieve(self) -> tuple[bool, Any]:
        self.world.retrieves += 1
        self.world.fetched.wait()
        self.world.break_at("retrieve")
        if self.world.torn:
            return True, np.frombuffer(jpeg(self.number)[:-200], np.uint8)[None]
        if self.world.raw_jpeg:
            return True, np.frombuffer(jpeg(self.number), np.uint8)[None]
        return True, picture(self.number)

    def release(self) -> None:
        self.world.released += 1
        self.world.break_at("release")


class World:
    """The camera's surroundings, which a test may spoil at any time."""

    def __init__(self) -> None:
        self.let_go = threading.Event()
        """Cleared, every grab hangs as in a driver of the system that waits for its device."""
        self.let_go.set()
        self.hanging = False
        self.fetched = threading.Event()
        """Cleared, a picture that was grabbed is not there yet."""
        self.fetched.set()
        self.breaks: dict[str, Exception] = {}
        """What raises something that no camera's library promises to raise, by the name of the call."""
        self.present = True
        self.stopped = self.frozen = self.torn = False
        self.stamps = self.raw_jpeg = True
        self.period_s = 0.002
        self.missing: set[int] = {cv2.CAP_PROP_FOCUS, cv2.CAP_PROP_AUTOFOCUS}
        self.clamp: dict[int, float] = {}
        self.props: dict[int, float] = {}
        self.order: list[int] = []
        self.opened: list[FakeCapture] = []
        self.grabs = self.retrieves = self.released = 0

    def break_at(self, call: str) -> None:
        if call in self.breaks:
            raise self.breaks[call]

    def factory(self, _device: str) -> FakeCapture:
        self.break_at("open")
        return FakeCapture(self)


class StreamServer:
    """A ROUTER that answers as the contract says; `spoil` may replace a reply."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self.ops: list[str] = []
        self.sets: list[tuple[str, float]] = []
        self.spoil: Any = None
        self.controls = {
            "exposure_us": 10000,
            "gain": 3,
            "white_balance_k": 4000,
            "auto_exposure": 1,
            "auto_white_balance": 1,
        }
        self.number = 0
        self._stop = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        self._ready.wait(10)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _serve(self) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        socket = context.socket(zmq.ROUTER)
        socket.setsockopt(zmq.LINGER, 0)
        socket.bind(self.endpoint)
        self._ready.set()
        while not self._stop.is_set():
            if socket.poll(20):
                identity, raw = socket.recv_multipart()
                for reply in self._answer(json.loads(raw)):
                    socket.send_multipart([identity, *reply])
        socket.close()
        context.term()

    def _answer(self, request: dict[str, Any]) -> list[list[bytes]]:
        self.ops.append(request["op"])
        body, payload = self._body(request)
        head = {"v": 1, "n": request["n"], "ok": True, "clock_s": time.monotonic()}
        replies = [[json.dumps({**head, **body}).encode(), *payload]]
        return self.spoil(request, replies) if self.spoil else replies

    def _body(self, request: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
        match request["op"]:
            case "open":
                return {k: request[k] for k in ("width", "height", "encoding", "buffers")} | {"fps": 15}, []
            case "controls":
                return {"controls": {name: {"value": v} for name, v in self.controls.items()}}, []
            case "set":
                self.sets.append((request["control"], request["value"]))
                self.controls[request["control"]] = request["value"]
                return {"control": request["control"], "value": request["value"]}, []
            case "grab":
                time.sleep(0.002)
                self.number += 1
                stamp = {"exposure_start_s": time.monotonic(), "exposure_us": 20000}
                return {"sequence": self.number, **stamp}, []
            case "retrieve":
                return {"encoding": "mjpg"}, [jpeg(self.number)]
        return {}, []
