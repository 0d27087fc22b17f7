"""Measuring path: by which of the harness' channels something was read, so that they are known to reach the instrument.

A wire of the harness that is broken makes its net read open at every point, with contact proved and the needle good.
So a net is accused only where its channel has read a current at another point, after it read what accuses: a wire that
breaks in the middle of a run had read well before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class MeasuringPath:
    """What the channels have read, in which order."""

    count: int = 0
    """Of readings that were told."""
    _last: dict[tuple[tuple[int, ...], str], tuple[int, float]] = field(default_factory=dict)
    """Channels that were closed and the point that was touched -> number and ohms of the last; infinite: no ohms."""

    def read(self, channels: Sequence[int], point: str, ohm: float) -> None:
        """Hear that a current flowed with the needle on a point; `ohm`: infinite where no resistance was measured."""
        self.count += 1
        self._last[tuple(channels), point] = self.count, ohm

    def is_proved(self, channels: Sequence[int], accused: str, since: int, most_ohm: float = math.inf) -> bool:
        """Whether the channels have read at another point than the accused one, and no more than so many ohms.

        `since`: `count` when the accused one was last read; what was read before says nothing of now.
        """
        return any(
            read == tuple(channels) and point != accused and number > since and ohm <= most_ohm
            for (read, point), (number, ohm) in self._last.items()
        )
