"""Health of the needle: what the reference pad last said of it, and whether points that gave no pass speak against it.

Debris on the needle makes every net after it look open. So two points in a row without a pass put the needle under
suspicion, and the reference pad is asked before anybody is accused. A pass at any point clears it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from daemon.station.measuring_path import MeasuringPath


@dataclass(frozen=True)
class Tare:
    """What the reference pad read of leads and needle, and how long ago."""

    ohm: float
    age_s: float


@dataclass
class NeedleHealth:
    """Of one needle, over jobs; a run may begin with one of its own."""

    now_s: Callable[[], float] = time.monotonic
    first_ohm: float | None = None
    """What the reference pad read the first time."""
    last_ohm: float | None = None
    """The same the last time; leads included."""
    checks: int = 0
    brushings: int = 0
    points_unseen: int = 0
    """Points, one after the other, at which the eye did not find the board at all."""
    path: MeasuringPath = field(default_factory=MeasuringPath)
    """By which channels of the harness something was read."""
    _good_at_s: float | None = field(default=None, repr=False)
    _read_of: object = field(default=None, repr=False)
    """By which needle, instrument and pad that was."""
    _without_pass: tuple[str, float] | None = field(default=None, repr=False)

    @property
    def tare_ohm(self) -> float:
        """What leads and needle added to every resistance when the pad was last read; 0 while nobody knows."""
        return self.last_ohm if self.last_ohm is not None and self._good_at_s is not None else 0.0

    def tare(self, of: object, within_s: float) -> Tare | None:
        """Return what leads and needle add, read of just these no longer ago than that; None: nobody knows."""
        if self._good_at_s is None or self.last_ohm is None or self._read_of != of:
            return None
        age_s = self.now_s() - self._good_at_s
        return Tare(self.last_ohm, age_s) if age_s <= within_s else None

    def read(self, ohm: float, *, good: bool, of: object = None) -> None:
        """Hear what the reference pad read; `of`: by which needle and instrument, on which pad."""
        self.checks += 1
        self.last_ohm = ohm
        self._good_at_s, self._read_of = self.now_s() if good else None, of
        if self.first_ohm is None:
            self.first_ohm = ohm

    def good_within(self, seconds: float, of: object = None) -> bool:
        """Whether just these were good on the reference pad, no longer ago than that; `of` None: whichever it was."""
        good = self._good_at_s is not None and self.now_s() - self._good_at_s <= seconds
        return good and of in (None, self._read_of)

    def passed(self) -> None:
        """Hear of a pass: this needle makes contact."""
        self._without_pass = None

    def gave_no_pass(self, point: str) -> None:
        """Hear of a point that did not pass, whatever the reason."""
        self._without_pass = point, self.now_s()

    def suspected_at(self, point: str) -> bool:
        """Whether another point before gave no pass, and the needle has not been found good since."""
        if self._without_pass is None or self._without_pass[0] == point:
            return False
        return self._good_at_s is None or self._good_at_s < self._without_pass[1]
