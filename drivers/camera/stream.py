"""A camera behind a ZeroMQ socket that speaks like V4L2: open, controls, set, grab, retrieve, close.

Request: one frame JSON {"v":1,"n":number,"op":...}. Reply: [JSON] or [JSON, payload]; on failure the JSON has
"ok": false and an error with name and message. One request at a time.
"""

import json
import time
from typing import Any, Final

import numpy as np
import zmq

from drivers.camera.contract import CameraConfig
from drivers.camera.jpeg import is_whole
from drivers.camera.running import RunningCamera
from drivers.camera.source import Grabbed, Retrieved, Settings
from drivers.errors import CameraError, CameraTimeout

_VERSION: Final = 1
# On top of the time a request itself may take
_REPLY_MARGIN_S: Final = 2.0
_CONTROLS: Final = ("exposure_us", "gain", "focus", "white_balance_k")
_AUTOMATIC: Final = {
    "exposure_us": "auto_exposure",
    "focus": "auto_focus",
    "white_balance_k": "auto_white_balance",
}
_SENSELESS = "its server's answer makes no sense"


class StreamSource:
    """One connection; lives in the grabbing thread. See `drivers.camera.source.Source`."""

    def __init__(self, config: CameraConfig) -> None:
        self._config = config
        self._context: zmq.Context[zmq.Socket[bytes]] | None = None
        self._socket: zmq.Socket[bytes] | None = None
        self._number = 0

    def open(self) -> Settings:
        """Connect, open the camera there, set the controls and read them back."""
        config = self._config
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        try:
            self._socket.connect(config.device)
        except zmq.ZMQError as exc:
            raise CameraError(f"cannot connect: {exc}", device=config.device) from exc
        size = {"width": config.width_px, "height": config.height_px}
        body = {"op": "open", **size, "encoding": config.encoding, "buffers": config.buffers}
        got, _ = self._ask(body, config.open_timeout_s)
        if (got.get("width"), got.get("height"), got.get("encoding")) != (*size.values(), config.encoding):
            text = f"gives {got.get('width')}x{got.get('height')} {got.get('encoding')}"
            raise CameraError(f"{text} instead of what was asked", device=config.device)
        return self._set_controls(got)

    def _set_controls(self, got: dict[str, Any]) -> Settings:
        there = self._ask({"op": "controls"})[0].get("controls", {})
        for name in _CONTROLS:
            wanted, automatic = getattr(self._config, name), _AUTOMATIC.get(name)
            if wanted is None or name not in there:
                continue
            if automatic in there:
                self._ask({"op": "set", "control": automatic, "value": 0})
            self._ask({"op": "set", "control": name, "value": wanted})
        there = self._ask({"op": "controls"})[0].get("controls", {})
        names = (*_CONTROLS, *_AUTOMATIC.values())
        settings = {name: _value(there.get(name)) for name in names}
        return {
            "width_px": _value(got.get("width")),
            "height_px": _value(got.get("height")),
            "fps": _value(got.get("fps")),
            "buffers": _value(got.get("buffers")),
            **settings,
        }

    def grab(self) -> Grabbed | None:
        """Take the oldest picture there."""
        timeout_s = self._config.frame_timeout_s
        try:
            got, _ = self._ask({"op": "grab", "timeout_ms": round(timeout_s * 1000)}, timeout_s)
            return Grabbed(int(got["sequence"]), float(got["exposure_start_s"]), float(got["exposure_us"]) / 1e6)
        except CameraTimeout:
            return None
        except (KeyError, TypeError, ValueError) as exc:
            raise CameraError(_SENSELESS, device=self._config.device, technical=f"grab reply: {exc!r}") from exc

    def retrieve(self) -> Retrieved | None:
        """Fetch the held picture."""
        got, payload = self._ask({"op": "retrieve"}, self._config.frame_timeout_s)
        received_s = time.monotonic()
        if got.get("encoding") == "mjpg":
            return Retrieved(received_s, jpeg=payload) if is_whole(payload) else None
        shape = (self._config.height_px, self._config.width_px, 3)
        if len(payload) != np.prod(shape):
            return None
        return Retrieved(received_s, pixels=np.frombuffer(payload, np.uint8).reshape(shape))

    def close(self) -> None:
        """Say goodbye if the other side still listens, and close the socket."""
        if self._socket is not None:
            try:
                self._socket.send_multipart([self._encode({"op": "close"})], zmq.DONTWAIT)
                self._socket.setsockopt(zmq.LINGER, 100)
            except zmq.ZMQError:
                pass  # nobody there: nothing to say goodbye to
            self._socket.close()
            self._socket = None
        if self._context is not None:
            self._context.term()
            self._context = None

    def _encode(self, body: dict[str, Any]) -> bytes:
        self._number += 1
        return json.dumps({"v": _VERSION, "n": self._number, **body}).encode()

    def _ask(self, body: dict[str, Any], timeout_s: float = 0.0) -> tuple[dict[str, Any], bytes]:
        """Send one request and give its reply; raise CameraTimeout or CameraError."""
        if self._socket is None:
            raise CameraError("is not connected", device=self._config.device)
        try:
            self._socket.send_multipart([self._encode(body)], zmq.DONTWAIT)
            parts = self._receive(timeout_s + _REPLY_MARGIN_S)
        except zmq.ZMQError as exc:
            raise CameraError(f"{body['op']}: {exc}", device=self._config.device) from exc
        reply, payload = parts
        if reply.get("ok") is True:
            return reply, payload
        error = reply.get("error") or {}
        text = f"{body['op']}: {error.get('name', 'unnamed')}: {error.get('message', 'no message')}"
        if error.get("name") == "timeout":
            raise CameraTimeout(text, device=self._config.device)
        raise CameraError(text, device=self._config.device)

    def _receive(self, timeout_s: float) -> tuple[dict[str, Any], bytes]:
        """Receive the reply to the last request; replies to former ones are thrown away."""
        socket = self._socket
        while socket is not None and socket.poll(round(timeout_s * 1000)):
            parts = socket.recv_multipart()
            try:
                reply = json.loads(parts[0])
                if reply["v"] == _VERSION and reply["n"] == self._number:
                    return reply, parts[1] if len(parts) > 1 else b""
            except (ValueError, KeyError, TypeError) as exc:
                raise CameraError(_SENSELESS, device=self._config.device, technical=f"reply: {exc!r}") from exc
        text = f"no reply within {timeout_s:g} s"
        raise CameraError(text, device=self._config.device, advice="Check that the camera's server runs.")


def _value(control: Any) -> float | None:
    raw = control.get("value") if isinstance(control, dict) else control
    return float(raw) if isinstance(raw, int | float) else None


class StreamCamera(RunningCamera):
    """A camera served over ZeroMQ; `config.device` is the endpoint."""

    def __init__(self, config: CameraConfig) -> None:
        super().__init__(config, lambda: StreamSource(config))
