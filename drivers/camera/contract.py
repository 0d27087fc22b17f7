"""What a camera promises, and what it is told. No I/O."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.deadline import Deadline

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture: `pixels` (H, W, 3) uint8 BGR, read-only; times on CLOCK_MONOTONIC."""

    pixels: Pixels
    exposure_start_s: float
    """Never later than the true start of the exposure of any of its rows."""
    exposure_s: float
    sequence: int
    received_s: float
    """When its last byte had come, before it was decoded."""
    jpeg: bytes | None = None
    """The same picture as the camera coded it; None where it came otherwise, or cannot be shown anywhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """One picture for people to look at: `jpeg` as the camera coded it, else `pixels` as those of a frame."""

    exposure_start_s: float
    jpeg: bytes | None
    pixels: Pixels | None


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """One camera. A control that is None is left as it is; one the camera lacks is reported as None."""

    device: str
    """V4L2: device path. Stream: ZeroMQ endpoint."""
    width_px: int = 1600
    height_px: int = 1200
    encoding: Literal["mjpg", "bgr8"] = "mjpg"
    fps: float = 15.0
    buffers: int = 4
    exposure_us: int | None = 20000
    gain: int | None = None
    focus: int | None = None
    white_balance_k: int | None = 4600
    frame_timeout_s: float = 1.0
    """Without a new picture for so long the camera is opened again."""
    open_timeout_s: float = 10.0
    backoff_s: float = 0.2
    """First wait before opening again after a failure; doubles up to `backoff_max_s`."""
    backoff_max_s: float = 5.0
    readout_s: float | None = None
    """V4L2: time from the end of the first row's exposure to the time stamp; None: one frame period."""
    refuse_identical: bool = True
    """Take two pictures equal to the last bit for a frozen camera: a live sensor has noise."""


@dataclass(frozen=True, slots=True)
class CameraStatistics:
    """What happened since the camera was opened first."""

    grabbed: int = 0
    delivered: int = 0
    late: int = 0
    """Passed over while somebody waited: exposed before the instant that was asked for."""
    missed: int = 0
    """Gaps in the camera's own numbering: pictures that never got here."""
    undecodable: int = 0
    identical: int = 0
    timeouts: int = 0
    reopened: int = 0


class Exposed(Protocol):
    """A picture that has been exposed and is on its way: light and scene may change, its pixels do not."""

    @property
    def over_s(self) -> float:
        """Give when its exposure was known to be over, all rows of it (CLOCK_MONOTONIC)."""

    async def frame(self, deadline: Deadline) -> Frame:
        """Give this picture and no other; raise FrameLost where it did not arrive whole, CameraTimeout where late."""


class Camera(Protocol):
    """A camera that always runs, and gives the first picture exposed after a given instant."""

    async def open(self, deadline: Deadline) -> None:
        """Open, lock the automatics, start running; raise CameraError when it cannot."""

    async def frame_after(self, t_s: float, deadline: Deadline) -> Frame:
        """Give the first frame whose exposure began at or after `t_s`; raise CameraTimeout when none comes."""

    async def exposed_after(self, t_s: float, deadline: Deadline) -> Exposed:
        """Give the same frame as soon as it is exposed, before it is sent and decoded; raise as `frame_after`."""

    async def shown_after(self, t_s: float, deadline: Deadline) -> Shown:
        """Give the same picture to people who look: not decoded where they need not; raise as `frame_after`."""

    def settings(self) -> Mapping[str, float | None]:
        """Give what the camera reads back as its settings."""

    def statistics(self) -> CameraStatistics:
        """Give counters."""

    async def close(self) -> None:
        """Stop running and let go of the camera."""
