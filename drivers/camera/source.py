"""What the grabbing thread needs of a camera; each kind of camera is one such source. Blocking calls only."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.camera.contract import Pixels

Settings = Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class Grabbed:
    """A picture that was taken from the camera's queue but not decoded yet."""

    sequence: int
    exposure_start_s: float
    exposure_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Retrieved:
    """The grabbed picture as it came, and when its bytes were there (CLOCK_MONOTONIC, s)."""

    received_s: float
    jpeg: bytes | None = None
    """Coded, whole by its marks."""
    pixels: Pixels | None = None
    """Where it came uncoded: (H, W, 3) uint8 BGR."""


class Source(Protocol):
    """A camera as one thread uses it. Errors are CameraError only."""

    def open(self) -> Settings:
        """Open, set everything, start the stream; give what was read back."""

    def grab(self) -> Grabbed | None:
        """Take the oldest picture of the queue, all of it exposed, waiting for one; None when none came in time."""

    def retrieve(self) -> Retrieved | None:
        """Fetch the grabbed picture; None when it is torn."""

    def close(self) -> None:
        """Let go of the camera; safe to call at any time."""
