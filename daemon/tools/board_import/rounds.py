"""Exact places and sizes of round pads, from the flashes that painted them; fiducials among those of no net."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from daemon.tools.board_import.frame import Painted, SideCad
from daemon.tools.board_import.pads import Pad
from daemon.tools.board_import.place_index import SAME_PLACE_UM, PlaceIndex

SAME_SIZE_UM, SAME_SIZE = 20.0, 0.04
EDGE_UM = 8.0
MOST_JOINED = 0.4
"""Share of a round pad's edge beyond which more metal may lie for it to be seen as round."""
LEAST_FIDUCIAL_UM, LARGEST_FIDUCIAL_UM = 450.0, 3300.0
FIDUCIAL_OPENING = 1.4
"""The opening about a fiducial is at least this times as wide as its copper."""
ALIKE = 3
"""So many alike are fiducials without being called so: two may be anything."""


class RoundFlashes:
    """Round flashes of one layer, found by place."""

    def __init__(self, layer: Painted, side: SideCad) -> None:
        rounds = [s.round_mm for s in layer.shapes if s.round_mm is not None and s.dark]
        self.middles = side.frame.to_um(np.array([(x, y) for x, y, _ in rounds])) if rounds else np.empty((0, 2))
        self.diameters = np.array([d * 1e3 for *_, d in rounds])
        self._index = PlaceIndex((float(x), float(y)) for x, y in self.middles)

    def at(self, x: float, y: float) -> list[tuple[float, float, float]]:
        """Return x, y and diameter, um, of the flashes with their middles at a place."""
        near = self._index.at(x, y)
        return [(float(self.middles[i, 0]), float(self.middles[i, 1]), float(self.diameters[i])) for i in near]


def exact_round(
    layers: Sequence[RoundFlashes], x: float, y: float, diameter: float
) -> tuple[float, float, float] | None:
    """Return x, y, diameter of the flash that painted a round thing seen with about that place and size."""
    found = [
        f for layer in layers for f in layer.at(x, y) if abs(f[2] - diameter) <= max(SAME_SIZE_UM, SAME_SIZE * f[2])
    ]
    return min(found, key=lambda f: abs(f[2] - diameter), default=None)


def stands_out(pad: Pad, flash: tuple[float, float, float]) -> bool:
    """Whether a flash shows as something round: bare along its edge, with no metal beyond it on most sides.

    A trace that leaves a pad inside of its opening takes little of the edge; in a bare surface there is no edge.
    """
    x, y, diameter = flash
    turns = np.arange(72) * (np.pi / 36)
    step = max(EDGE_UM, 2 * pad.window.pitch)

    def bare(radius: float) -> float:
        where = [pad.window.at(x + radius * np.cos(a), y + radius * np.sin(a)) for a in turns]
        return sum(w is not None and bool(pad.metal[w]) for w in where) / len(turns)

    return bare(diameter / 2 - step) > 0.95 and bare(diameter / 2 + step) < MOST_JOINED


def unnamed_places(copper: RoundFlashes, named: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[int]:
    """Return which of the copper's round flashes no netlist entry lies on, each place once."""
    if not len(copper.middles):
        return []
    away = KDTree(named).query(copper.middles)[0] if len(named) else np.full(len(copper.middles), np.inf)
    chosen: list[int] = []
    seen: set[tuple[int, int]] = set()
    for i in np.nonzero(np.asarray(away) > 2 * SAME_PLACE_UM)[0]:
        cell = (round(copper.middles[i, 0] / SAME_PLACE_UM), round(copper.middles[i, 1] / SAME_PLACE_UM))
        if cell not in seen:
            seen.add(cell)
            chosen.append(int(i))
    return chosen


def is_fiducial_like(pad: Pad, diameter: float | None, mask: RoundFlashes) -> float | None:
    """Return the diameter of a round, lone, undrilled pad in a much larger round opening; None for all else."""
    if diameter is None or pad.hole is not None or pad.others.any():
        return None
    if not LEAST_FIDUCIAL_UM <= diameter <= LARGEST_FIDUCIAL_UM:
        return None
    opened = max((d for *_, d in mask.at(pad.x, pad.y)), default=0.0)
    return diameter if opened >= FIDUCIAL_OPENING * diameter else None


def alike(diameters: Sequence[float | None]) -> list[bool]:
    """Say of each whether it is one of `ALIKE` or more of its diameter."""
    counts = Counter(round(d, -1) for d in diameters if d is not None)
    return [d is not None and counts[round(d, -1)] >= ALIKE for d in diameters]
