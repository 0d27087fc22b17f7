"""Camera server on a ZeroMQ ROUTER: open, controls, set, grab, retrieve, close.

Requests are one JSON frame `{"v":1,"n":..,"op":..}`; replies `[json]` or `[json, pixels]`. Frames carry the
CLOCK_MONOTONIC time at which their exposure began. Pixels are drawn at `retrieve`, in a worker thread.
"""

import asyncio
import json
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import cv2
import numpy as np
import zmq
import zmq.asyncio

from sim_hw.board.board import Board
from sim_hw.camera.controls import Controls
from sim_hw.camera.memory import give_back_memory
from sim_hw.camera.queue import Captured, FrameQueue
from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX
from sim_hw.scene.scene import Scene, SceneFaults, ScenePlant, Shot, watch
from sim_hw.scene.sensor import Image

MODEL = "reprobe simulated camera"
JPEG_QUALITY = 92
MAX_BUFFERS = 10
_TORN_SHARE = 0.6
"""Share of the bytes of a torn frame that arrive."""
_TICK_S = 0.02
_IDLE_S = 0.1


class Clock(Protocol):
    """Simulated time against CLOCK_MONOTONIC."""

    def now_s(self) -> float: ...  # noqa: D102  # the names say it
    def wall_of(self, t_s: float) -> float: ...  # noqa: D102
    def wall_delay(self, dt_s: float) -> float: ...  # noqa: D102


class CountedFaults(SceneFaults, Protocol):
    """Faults that may clear themselves after some uses."""

    def use(self, name: str) -> bool: ...  # noqa: D102


class _Refused(Exception):
    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


Answer = tuple[dict[str, Any], bytes | None]


class CameraServer:
    """Serve one camera on `endpoint` until cancelled; `ready` is set once it is bound."""

    def __init__(
        self,
        plant: ScenePlant,
        board: Board,
        clock: Clock,
        endpoint: str,
        faults: CountedFaults,
        seed: int,
        tiles: int | None = None,
    ) -> None:
        self.ready = asyncio.Event()
        self.scene = Scene(plant, board, faults, seed, tiles)
        self._plant = plant
        self._clock = clock
        self._endpoint = endpoint
        self._faults = faults
        self._controls = Controls()
        self._stream: FrameQueue | None = None
        self._encoding = "mjpg"
        self._drawn: tuple[Captured, Image] | None = None
        self._frozen: Image | None = None
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="camera")
        self._operations = {
            "open": self._open,
            "controls": self._list_controls,
            "set": self._set,
            "grab": self._grab,
            "retrieve": self._retrieve,
            "close": self._close,
        }

    async def serve(self) -> None:
        """Answer requests until cancelled."""
        context = zmq.asyncio.Context()
        socket = context.socket(zmq.ROUTER)
        try:
            socket.bind(self._endpoint)
            self.ready.set()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._tick())
                group.create_task(self._draw_ahead())
                while True:
                    identity, *parts = await socket.recv_multipart()
                    group.create_task(self._serve_one(socket, identity, parts))
        finally:
            socket.close(linger=0)
            context.term()
            self._worker.shutdown(wait=False, cancel_futures=True)

    async def _tick(self) -> None:
        """Let buffers fill while nobody asks: the plant remembers only the last seconds."""
        while True:
            if self._stream is not None:
                self._stream.advance(self._clock.now_s())
            await asyncio.sleep(_TICK_S)

    async def _draw_ahead(self) -> None:
        """Draw the board tile by tile while nobody asks, so that a look at a new place is not slow.

        The worker is not woken again before the head goes elsewhere, or what lies there changes.
        """
        loop = asyncio.get_running_loop()
        drawn, done = False, None
        while True:  # one tile at a time: a request waits for one at most
            goal = self._plant.state_at(self._plant.rest_s())
            sight = (goal, self._plant.board_pose, self.scene.lying)
            if sight != done:
                if await loop.run_in_executor(self._worker, self.scene.draw_ahead, goal):
                    drawn = True
                    continue
                done = sight
            if drawn:
                await loop.run_in_executor(self._worker, give_back_memory)
                drawn = False
            await asyncio.sleep(_IDLE_S)

    async def _serve_one(self, socket: zmq.asyncio.Socket, identity: bytes, parts: list[bytes]) -> None:
        if self._faults.use("silent"):
            return
        head: dict[str, Any] = {"v": 1, "n": None, "ok": True}
        payload: bytes | None = None
        try:
            request = _parsed(parts)
            head["n"] = request.get("n")
            if self._faults.use("unplugged"):
                self._stream = None
                raise _Refused("unplugged", "the camera is not there; plug it in and open it again")
            operation = self._operations.get(str(request.get("op")))
            if operation is None:
                raise _Refused("bad_request", f"unknown op; known: {', '.join(self._operations)}")
            answer, payload = await operation(request)
            head.update(answer)
        except _Refused as refused:
            head.update(ok=False, error={"name": refused.name, "message": str(refused)})
        head["clock_s"] = time.monotonic()
        reply = [identity, json.dumps(head).encode()]
        await socket.send_multipart(reply if payload is None else [*reply, payload])

    async def _open(self, request: dict[str, Any]) -> Answer:
        self._encoding = "bgr8" if request.get("encoding") == "bgr8" else "mjpg"
        buffers = min(max(_whole(request, "buffers", 4), 1), MAX_BUFFERS)
        self._stream = FrameQueue(
            buffers,
            self._clock.now_s(),
            self._period_s,
            lambda t_s: self._controls.expose(self._plant.state_at(t_s)),
            lambda start_s, exposure_s: watch(self._plant, start_s, exposure_s),
        )
        answer = {
            "width": WIDTH_PX,
            "height": HEIGHT_PX,
            "encoding": self._encoding,
            "buffers": buffers,
            "fps": round(1.0 / self._period_s(), 3),
            "model": MODEL,
        }
        return answer, None

    def _period_s(self) -> float:
        return float(self._plant.knobs.camera_frame_period_s)

    async def _list_controls(self, _request: dict[str, Any]) -> Answer:
        return {"controls": self._controls.listing()}, None

    async def _set(self, request: dict[str, Any]) -> Answer:
        name, value = request.get("control"), request.get("value")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _Refused("bad_request", "`value` must be a number")
        if self._stream is not None:
            self._stream.advance(self._clock.now_s())  # what was exposed before keeps the old value
        try:
            taken = self._controls.set(str(name), value)
        except KeyError:
            raise _Refused("bad_request", f"the camera has no control {name!r}; ask `controls`") from None
        return {"control": name, "value": taken}, None

    async def _grab(self, request: dict[str, Any]) -> Answer:
        stream = self._streaming()
        until_s = time.monotonic() + _whole(request, "timeout_ms", 1000) / 1e3
        while True:
            now_s = self._clock.now_s()
            frame = stream.dequeue(now_s)
            if frame is not None:
                return self._described(frame), None
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                raise _Refused("timeout", "no buffer was filled in time")
            wait_s = self._clock.wall_delay(stream.next_event_s() - now_s) + 2e-4
            await asyncio.sleep(min(wait_s, left_s))
            if self._stream is not stream:
                raise _Refused("closed", "the stream was closed or reopened meanwhile")

    async def _retrieve(self, _request: dict[str, Any]) -> Answer:
        frame = self._streaming().held
        if frame is None:
            raise _Refused("no_frame", "no buffer is held; grab one first")
        encoding = self._encoding
        loop = asyncio.get_running_loop()
        payload = await loop.run_in_executor(self._worker, self._pixels, frame, encoding)
        if self._faults.use("torn"):
            payload = payload[: int(len(payload) * _TORN_SHARE)]
        return {**self._described(frame), "width": WIDTH_PX, "height": HEIGHT_PX, "encoding": encoding}, payload

    async def _close(self, _request: dict[str, Any]) -> Answer:
        self._stream = None
        return {}, None

    def _streaming(self) -> FrameQueue:
        if self._stream is None:
            raise _Refused("not_open", "the stream is not running; open it first")
        return self._stream

    def _described(self, frame: Captured) -> dict[str, Any]:
        return {
            "sequence": frame.sequence,
            "exposure_start_s": self._clock.wall_of(frame.start_s),
            "exposure_us": round(frame.taken.exposure_s * 1e6),
        }

    def _pixels(self, frame: Captured, encoding: str) -> bytes:
        """Return the bytes of a frame; runs in the worker thread."""
        image = self._image(frame)
        if encoding == "bgr8":
            return image.tobytes()
        options = [
            cv2.IMWRITE_JPEG_QUALITY,
            JPEG_QUALITY,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
        ]
        return bytes(cv2.imencode(".jpg", image, options)[1])

    def _image(self, frame: Captured) -> Image:
        """Return a frame as the driver delivers it."""
        image = self._taken(frame)
        if self._faults.use("mirrored"):
            return np.asarray(cv2.flip(image, 1), dtype=np.uint8)
        return image

    def _taken(self, frame: Captured) -> Image:
        if self._faults.use("black"):
            return np.zeros((HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)
        if not self._faults.use("frozen"):
            self._frozen = None
        elif self._frozen is not None:
            return self._frozen
        if self._drawn is None or self._drawn[0] is not frame:
            taken = frame.taken
            shot = Shot(
                sequence=frame.sequence,
                exposure_s=taken.exposure_s,
                states=frame.states,
                gain=taken.gain,
                balance=taken.balance,
                focus_px=taken.focus_px,
            )
            self._drawn = (frame, self.scene.render(shot))
        if self._faults.on("frozen"):
            self._frozen = self._drawn[1]
        return self._drawn[1]


def _parsed(parts: list[bytes]) -> dict[str, Any]:
    try:
        request = json.loads(parts[0])
    except (ValueError, IndexError):
        raise _Refused("bad_request", "a request is one JSON frame") from None
    if not isinstance(request, dict) or request.get("v") != 1:
        raise _Refused("bad_request", 'a request is a JSON object with "v": 1')
    return request


def _whole(request: dict[str, Any], name: str, default: int) -> int:
    value = request.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _Refused("bad_request", f"`{name}` must be a number")
    return int(value)
