"""A V4L2 camera through OpenCV."""

import os
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera.contract import CameraConfig
from drivers.camera.jpeg import is_whole
from drivers.camera.running import RunningCamera
from drivers.camera.source import Grabbed, Retrieved, Settings
from drivers.errors import CameraError

# V4L2's automatic exposure menu, as UVC cameras have it: 1 manual, 3 aperture priority
_EXPOSURE_MANUAL: Final = 1
# EXPOSURE_ABSOLUTE counts 100 us
_EXPOSURE_STEP_US: Final = 100
# A grab that fails sooner than this share of the time-out was not waiting for a picture
_ENDED_SHARE: Final = 0.5
# A kernel time stamp older than this, or from the future, is not one of CLOCK_MONOTONIC
_PLAUSIBLE_AGE_S: Final = 30.0
_FOURCC: Final = {"mjpg": "MJPG", "bgr8": "YUYV"}
# OpenCV's answer for a property the camera lacks
_MISSING: Final = -1.0


class Capture(Protocol):
    """What is used of cv2.VideoCapture."""

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Tell whether it is open."""

    def set(self, propId: int, value: float, /) -> bool:  # noqa: N803 - OpenCV's name
        """Set a property."""

    def get(self, propId: int, /) -> float:  # noqa: N803 - OpenCV's name
        """Read a property."""

    def grab(self) -> bool:
        """Take the oldest buffer."""

    def retrieve(self) -> tuple[bool, Any]:
        """Decode it."""

    def release(self) -> None:
        """Close."""


CaptureFactory = Callable[[str], Capture]


def open_capture(device: str) -> Capture:
    """Open a device path with OpenCV's V4L2 backend, nothing else."""
    # What OpenCV would write to stderr with every try, the driver tells once an outage
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    return cv2.VideoCapture(device, cv2.CAP_V4L2)


class V4L2Source:
    """One opening of the device; see `drivers.camera.source.Source`."""

    def __init__(self, config: CameraConfig, factory: CaptureFactory) -> None:
        self._config = config
        self._factory = factory
        self._capture: Capture | None = None
        self._sequence = 0
        self._exposure_s = (config.exposure_us or 0) / 1e6
        self._period_s = 1.0 / config.fps
        self._select_s = max(1, round(config.frame_timeout_s))

    def open(self) -> Settings:
        """Open the device, set format and controls (automatics off first), read everything back."""
        # OpenCV waits in select; this is read when a device is opened
        os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] = str(self._select_s)
        capture = self._factory(self._config.device)
        self._capture = capture
        if not capture.isOpened():
            advice = "Check that the device path exists, its group is yours, and nothing else has it open."
            raise CameraError("cannot be opened", device=self._config.device, advice=advice)
        self._set_format(capture)
        settings = self._set_controls(capture)
        if settings["exposure_us"]:
            self._exposure_s = settings["exposure_us"] / 1e6
        fps = settings["fps"]
        if fps:
            self._period_s = 1.0 / fps
        return settings

    def _set_format(self, capture: Capture) -> None:
        config = self._config
        fourcc = cv2.VideoWriter.fourcc(*_FOURCC[config.encoding])
        # The size is taken over when both are set; each of these restarts the stream, so they come first
        capture.set(cv2.CAP_PROP_FOURCC, fourcc)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, config.width_px)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, config.height_px)
        capture.set(cv2.CAP_PROP_FPS, config.fps)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, config.buffers)
        if config.encoding == "mjpg":
            # Raw JPEG: decoded here, where a torn one is seen
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        got = (round(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        if got != (config.width_px, config.height_px):
            text = f"gives {got[0]}x{got[1]} instead of {config.width_px}x{config.height_px}"
            advice = "Choose a size the camera lists (v4l2-ctl --list-formats-ext)."
            raise CameraError(text, device=config.device, advice=advice)
        # Asked for a format the camera lacks, OpenCV quietly takes another, which then looks like torn JPEG
        given = round(capture.get(cv2.CAP_PROP_FOURCC))
        if config.encoding == "mjpg" and given != fourcc:
            advice = "Ask for bgr8, or choose a camera that lists MJPG (v4l2-ctl --list-formats)."
            raise CameraError(f"gives {_name(given)} instead of MJPG", device=config.device, advice=advice)

    def _set_controls(self, capture: Capture) -> Settings:
        config = self._config
        if config.exposure_us is not None:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _EXPOSURE_MANUAL)
            capture.set(cv2.CAP_PROP_EXPOSURE, round(config.exposure_us / _EXPOSURE_STEP_US))
        if config.gain is not None:
            capture.set(cv2.CAP_PROP_GAIN, config.gain)
        if config.focus is not None:
            capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
            capture.set(cv2.CAP_PROP_FOCUS, config.focus)
        if config.white_balance_k is not None:
            capture.set(cv2.CAP_PROP_AUTO_WB, 0)
            capture.set(cv2.CAP_PROP_WB_TEMPERATURE, config.white_balance_k)
        exposure = _read(capture, cv2.CAP_PROP_EXPOSURE)
        auto = _read(capture, cv2.CAP_PROP_AUTO_EXPOSURE)
        return {
            "width_px": _read(capture, cv2.CAP_PROP_FRAME_WIDTH),
            "height_px": _read(capture, cv2.CAP_PROP_FRAME_HEIGHT),
            "fps": _read(capture, cv2.CAP_PROP_FPS),
            "buffers": _read(capture, cv2.CAP_PROP_BUFFERSIZE),
            "exposure_us": None if exposure is None else exposure * _EXPOSURE_STEP_US,
            "gain": _read(capture, cv2.CAP_PROP_GAIN),
            "focus": _read(capture, cv2.CAP_PROP_FOCUS),
            "white_balance_k": _read(capture, cv2.CAP_PROP_WB_TEMPERATURE),
            "auto_exposure": None if auto is None else float(round(auto) != _EXPOSURE_MANUAL),
            "auto_white_balance": _read(capture, cv2.CAP_PROP_AUTO_WB),
            "auto_focus": _read(capture, cv2.CAP_PROP_AUTOFOCUS),
        }

    def grab(self) -> Grabbed | None:
        """Take the oldest buffer; OpenCV's select ends the wait. Raise CameraError when the stream itself has ended."""
        if self._capture is None:
            return None
        began_s = time.monotonic()
        if not self._capture.grab():
            if time.monotonic() - began_s < _ENDED_SHARE * self._select_s:
                raise CameraError("gives no more pictures: unplugged, or its stream broke", device=self._config.device)
            return None
        self._sequence += 1
        now_s = time.monotonic()
        stamp_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        readout_s = self._period_s if self._config.readout_s is None else self._config.readout_s
        if not now_s - _PLAUSIBLE_AGE_S < stamp_s <= now_s:
            # No kernel time: the buffer may have waited behind all the others
            stamp_s = now_s - self._config.buffers * self._period_s
        return Grabbed(self._sequence, stamp_s - readout_s - self._exposure_s, self._exposure_s)

    def retrieve(self) -> Retrieved | None:
        """Fetch the grabbed buffer."""
        received_s = time.monotonic()
        image = self._buffer()
        if image is None:
            return None
        config = self._config
        if config.encoding == "mjpg" and (image.ndim != 3 or image.shape[2] != 3):
            data = image.tobytes()
            return Retrieved(received_s, jpeg=data) if is_whole(data) else None
        if image.shape != (config.height_px, config.width_px, 3):
            return None
        # A copy: the library may use its buffer again
        return Retrieved(received_s, pixels=np.array(image, np.uint8))

    def _buffer(self) -> NDArray[Any] | None:
        """Return the grabbed buffer as it came; None where there is none."""
        if self._capture is None:
            return None
        try:
            good, image = self._capture.retrieve()
        except cv2.error:
            return None
        return image if good else None

    def close(self) -> None:
        """Release the device."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def _read(capture: Capture, prop: int) -> float | None:
    value = capture.get(prop)
    return None if value == _MISSING else value


def _name(fourcc: int) -> str:
    """Return a pixel format's four letters."""
    return (fourcc & 0xFFFFFFFF).to_bytes(4, "little").decode("ascii", "replace")


class V4L2Camera(RunningCamera):
    """A camera on /dev/video*; `factory` makes the capture (tests give their own)."""

    def __init__(self, config: CameraConfig, factory: CaptureFactory = open_capture) -> None:
        super().__init__(config, lambda: V4L2Source(config, factory))
