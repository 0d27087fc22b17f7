"""One board of a panel whose copper or netlist names every part several times, cut along lines between the boards.

The order of the pads does not tell the boards, which may be turned. But no named copper lies between two boards, and
every name comes equally often on each side of a cut. Where one board stands on its head, a line through the middle of
both also halves every name: of several ways to cut, the one that leaves nets and parts whole is right.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.tools.cad.geometry import Points
from daemon.tools.cad.model import Pin
from daemon.tools.cad.places import SAME_PLACE_MM

_FEW = 4
"""With fewer names than this nothing is told of a panel."""
_MOST = 0.9
"""Share of the names that come several times on a panel, and equally often on both sides of a cut."""
_NARROWEST_MM = 0.05
_UPWARDS, _ACROSS = 1, 0


class NotCutError(ValueError):
    """A panel whose boards no straight line parts."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """Part of a panel: its named pads (N, 2), the number of each pad's name, the boxes (M, 4) of named copper.

    vias: (K, 2). gap_mm: the narrowest gap it was cut out along. ends: x and y where it was cut off.
    """

    places: Points
    names: NDArray[np.intp]
    boxes: Points
    vias: Points
    gap_mm: float = np.inf
    ends: tuple[float, float] = (np.inf, np.inf)

    def count(self) -> float:
        """Return how many boards it holds: how often most names come."""
        counts = np.bincount(self.names)
        return float(np.median(counts[counts > 0]))

    def below(self, axis: int, at: float, gap_mm: float) -> _Piece:
        """Return what lies below (or left of) a cut."""
        pads, copper = self.places[:, axis] < at, self.boxes[:, axis + 2] < at
        ends = (min(at, self.ends[0]), self.ends[1]) if axis == _ACROSS else (self.ends[0], min(at, self.ends[1]))
        vias = self.vias[self.vias[:, axis] < at]
        return _Piece(self.places[pads], self.names[pads], self.boxes[copper], vias, min(gap_mm, self.gap_mm), ends)


def one_board(pins: Sequence[Pin], boxes: Points, says: str) -> list[Pin]:
    """Return the pins of the lowest (then leftmost) board of a panel, all pins of a single board.

    boxes: (M, 4) of all copper with a name, mm. says: who names the pins, as in "b.ipc names". Raise
    `NotCutError` where no straight cuts part a panel's boards.
    """
    parts = list({(p.part, p.pin, round(p.x_mm, 1), round(p.y_mm, 1)): p for p in pins if p.part}.values())
    counts = Counter((p.part, p.pin) for p in parts)
    many = int(np.median(list(counts.values()) or [0]))
    if len(counts) < _FEW or many < 2 or sum(n % many == 0 for n in counts.values()) < _MOST * len(counts):
        return list(pins)
    numbers = {name: k for k, name in enumerate(counts)}
    places = np.array([(p.x_mm, p.y_mm) for p in parts])
    names = np.array([numbers[p.part, p.pin] for p in parts])
    vias = np.array([(p.x_mm, p.y_mm) for p in pins if not p.part]).reshape(-1, 2)
    found = list(_boards(_Piece(places, names, np.vstack((boxes, np.hstack((places, places)))), vias)))
    if not found and _unturned(places, names):
        lowest = {(p.part, p.pin): (p.x_mm, p.y_mm) for p in _lowest(parts)}
        return [p for p in pins if lowest.get((p.part, p.pin)) == (p.x_mm, p.y_mm)]
    if not found:
        raise NotCutError(
            f"{says} every part {many} times, and no straight cut parts the boards of this panel; "
            "give an IPC-D-356 netlist of one board"
        )
    board = min(found, key=lambda b: _demerits(parts, b))
    return [p for p in pins if p.x_mm < board.ends[0] and p.y_mm < board.ends[1]]


def _unturned(places: Points, names: NDArray[np.intp]) -> bool:
    """Say whether every name comes again at the same ways from its lowest (then leftmost) pad: no board is turned."""
    order = np.lexsort((places[:, 0], np.round(places[:, 1], 2), names))
    counts = np.bincount(names)
    many = int(np.median(counts[counts > 0]))
    usual = counts[names[order]] == many
    ways = places[order][usual].reshape(-1, many, 2)
    ways = ways - ways[:, :1]
    same = np.abs(ways - np.median(ways, axis=0)).max(axis=(1, 2)) < SAME_PLACE_MM
    return float(same.sum()) >= _MOST * float((counts > 0).sum())


def _lowest(parts: Sequence[Pin]) -> list[Pin]:
    """Return the lowest (then leftmost) pad of each name: boards that are not turned have the same one."""
    found: dict[tuple[str, str], list[Pin]] = {}
    for pin in parts:
        found.setdefault((pin.part, pin.pin), []).append(pin)
    return [min(group, key=lambda p: (round(p.y_mm, 2), p.x_mm)) for group in found.values()]


def _boards(piece: _Piece) -> Iterator[_Piece]:
    """Yield the first board of a piece for each way to cut it."""
    if piece.count() <= 1.0:
        yield piece
        return
    for axis in (_UPWARDS, _ACROSS):
        if (cut := _best_cut(piece, axis)) is not None:
            yield from _boards(piece.below(axis, *cut))


def _best_cut(piece: _Piece, axis: int) -> tuple[float, float] | None:
    """Return the lowest cut across an axis that leaves most names equally often on each side, and its gap, mm.

    Of cuts that part the names alike the best leaves its share of the vias as well.
    """
    whole = np.bincount(piece.names)
    there = whole > 0
    best, most, part, uneven = None, _MOST - 1e-9, 0.0, 0.0
    for at, gap_mm in _gaps(piece.boxes[:, axis], piece.boxes[:, axis + 2]):
        left = np.bincount(piece.names[piece.places[:, axis] < at], minlength=len(whole))
        shares = left[there] / whole[there]
        share = float(np.median(shares))
        alike = float(np.mean(np.abs(shares - share) < 1e-9))
        off = abs(float(np.mean(piece.vias[:, axis] < at)) - share) if len(piece.vias) else 0.0
        better = share == part and alike > most - 2e-9 and off < uneven - 1e-9
        if 0.0 < share < 1.0 and (alike > most or better):
            best, most, part, uneven = (at, gap_mm), alike + 1e-9, share, off
    return best


def _gaps(lows: Points, highs: Points) -> Iterator[tuple[float, float]]:
    """Yield middle and width of the gaps that no copper spans, upwards."""
    order = np.argsort(lows, kind="stable")
    ends = np.maximum.accumulate(highs[order])[:-1]
    starts = lows[order][1:]
    for k in np.flatnonzero(starts - ends > _NARROWEST_MM):
        yield float((starts[k] + ends[k]) / 2.0), float(starts[k] - ends[k])


def _demerits(parts: Sequence[Pin], board: _Piece) -> tuple[int, int, float, float]:
    """Return what speaks against a board: names it lacks, nets it mixes, parts it tears, a narrow gap."""
    inside = {(float(x), float(y)) for x, y in board.places}
    nets: set[str] = set()
    ends: dict[str, tuple[float, float, float, float]] = {}
    for pin in parts:
        if (pin.x_mm, pin.y_mm) in inside:
            nets.add(pin.net)
            x0, y0, x1, y1 = ends.get(pin.part, (pin.x_mm, pin.y_mm, pin.x_mm, pin.y_mm))
            ends[pin.part] = min(x0, pin.x_mm), min(y0, pin.y_mm), max(x1, pin.x_mm), max(y1, pin.y_mm)
    reach_mm = sum(x1 - x0 + y1 - y0 for x0, y0, x1, y1 in ends.values())
    return -len(set(board.names.tolist())), len(nets), round(reach_mm, 1), -board.gap_mm
