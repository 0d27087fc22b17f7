"""Surface of one side of a board: what lies at a place, whose bare metal it is, and how far its edge is.

Painted about the place asked for, from the board's own polygons in drawing order, at 2 um a point; what is larger than
the window is asked again in a wider and coarser one. Places are CAD mm; distances are good to about a point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import Board
from sim_hw.board.netlist import Record
from sim_hw.board.shapes import Shape

Bits = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

COPPER, OPEN, INK, HOLE, BOARD, SOLDER, LEAD = 1, 2, 4, 8, 16, 32, 64
"""Bits of what a place of a board can be; nobody touches solder apart from the metal below it."""
_WINDOWS = ((2.0, 400.0), (4.0, 1_600.0), (16.0, 6_400.0), (60.0, 24_000.0))
"""Points (um) and half widths (um), asked one after another."""
_NEAREST_WINDOWS = 3
"""Metal beyond the third is not near."""
_SHAFT_UM = 300.0
"""Holes up to this are narrower than the needle's shaft above its end. A guess."""
_SHIFT = 4
"""Fractional bits of polygon corners."""
_ALL_BITS = 255
_LAND_BITS = COPPER | OPEN | BOARD
_IS_LAND = np.array([bits & _LAND_BITS == _LAND_BITS for bits in range(256)], dtype=np.uint8)
_IS_METAL = np.array([_IS_LAND[bits] and (not bits & HOLE or bits & LEAD) for bits in range(256)], dtype=np.bool_)


@dataclass(frozen=True)
class Spot:
    """What is at a place. `what` is `metal`, `lead`, `hole`, `laminate`, `ink`, `mask` or `off_board`.

    On metal: `net`, `pin` (`R4.1`; a via is `VIA`) where the board's files say, and `inside_um` to the edge of that
    metal. Elsewhere the same names are those of the nearest metal, `away_um` off, or None where none is near.
    `touches`: everything within the reach asked for; `nets`: nets of all metal in there, more than one being a short.
    """

    what: str
    net: str | None
    pin: str | None
    inside_um: float | None
    away_um: float | None
    touches: tuple[str, ...]
    nets: tuple[str, ...]


@dataclass(frozen=True)
class Share:
    """A share (0..1) of a disc that lies on one thing: `what` as of a Spot, or on one pad's metal.

    A plated hole that is narrower than the needle's shaft counts as its pad's metal: the needle stands on its rim.
    """

    what: str
    share: float
    pad: Record | None = None


@dataclass(frozen=True)
class _View:
    """A painted window about a place; `metal` is bare, `lands` also counts the holes in it, numbered from 1."""

    step_um: float
    half: int
    bits: Bits

    @cached_property
    def metal(self) -> Mask:
        return np.asarray(cv2.LUT(self.bits, _IS_METAL.view(np.uint8)), dtype=np.uint8).view(np.bool_)

    @cached_property
    def lands(self) -> npt.NDArray[np.int32]:
        _, lands = cv2.connectedComponents(cv2.LUT(self.bits, _IS_LAND), connectivity=4)
        return np.asarray(lands, dtype=np.int32)

    def at(self, dx_um: float, dy_um: float) -> tuple[int, int] | None:
        """Return row and column of a place by its distance from the middle; None outside."""
        column, row = self.half + round(dx_um / self.step_um), self.half + round(dy_um / self.step_um)
        size = 2 * self.half + 1
        return (row, column) if 0 <= row < size and 0 <= column < size else None


class Surface:
    """Answer what is where on a side of a board as it was made: ink and openings may be shifted against copper."""

    def __init__(
        self,
        board: Board,
        ink_shift_mm: tuple[float, float] = (0.0, 0.0),
        mask_shift_mm: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        layers, none = board.layers, (0.0, 0.0)
        self._layers = tuple(
            (bit, shapes, np.array([shape.box_mm for shape in shapes]).reshape(-1, 4), shift)
            for bit, shapes, shift in (
                (COPPER, layers.copper, none),
                (OPEN, layers.mask, mask_shift_mm),
                (INK, layers.silk, ink_shift_mm),
                (HOLE, layers.holes, none),
                (BOARD, layers.outline, none),
                (LEAD, layers.leads, none),
            )
        )
        self._pads = board.pads
        self._places_mm = np.array([(pad.x_mm, pad.y_mm) for pad in board.pads]).reshape(-1, 2)

    def at(self, x_mm: float, y_mm: float, reach_um: float = 0.0) -> Spot:
        """Return what is at a place and, within `reach_um` round it, what else."""
        look = _Look(self, x_mm, y_mm)
        first = look.view(0)
        what = _what(int(first.bits[first.half, first.half]))
        touches, nets = look.touched(reach_um)
        if what in ("metal", "lead"):
            inside_um, pad = look.on_metal()
            return Spot(what, *_names(pad), inside_um, None, touches, nets)
        away_um, pad = look.beside_metal()
        return Spot(what, *_names(pad), None, away_um, touches, nets)

    def under(self, x_mm: float, y_mm: float, radius_um: float) -> tuple[Share, ...]:
        """Return what a disc about a place lies on, the largest share first."""
        return _Look(self, x_mm, y_mm).shares(radius_um)

    def pad_of(self, view: _View, x_mm: float, y_mm: float, land: int) -> Record | None:
        """Return the pad the files place on a land of a window: a part's pin before a via, then the nearest."""
        if land <= 0 or not len(self._pads):
            return None
        away_um = (self._places_mm - (x_mm, y_mm)) * 1e3
        around = np.flatnonzero(np.abs(away_um).max(axis=1) <= view.half * view.step_um)
        best: tuple[bool, float, int] | None = None
        for k in around.tolist():
            place = view.at(float(away_um[k, 0]), float(away_um[k, 1]))
            if place is not None and view.lands[place] == land:
                rank = (self._pads[k].is_via, float(np.hypot(*away_um[k])), k)
                best = rank if best is None else min(best, rank)
        return None if best is None else self._pads[best[2]]

    def view(self, x_mm: float, y_mm: float, step_um: float, half_um: float, bits_asked: int = _ALL_BITS) -> _View:
        """Paint a window about a place, with those bits that are asked for."""
        half = round(half_um / step_um)
        size = 2 * half + 1
        bits = np.zeros((size, size), dtype=np.uint8)
        reach_mm = half_um / 1e3
        for bit, shapes, boxes, (dx_mm, dy_mm) in self._layers:
            if not bit & bits_asked:
                continue
            left, low = x_mm - reach_mm - dx_mm, y_mm - reach_mm - dy_mm
            hit = (boxes[:, 0] <= left + 2 * reach_mm) & (boxes[:, 2] >= left)
            hit &= (boxes[:, 1] <= low + 2 * reach_mm) & (boxes[:, 3] >= low)
            chosen = [shapes[k] for k in np.flatnonzero(hit).tolist()]
            if chosen:
                cv2.bitwise_or(bits, _painted(chosen, bit, (left, low), step_um, size), dst=bits)
        return _View(step_um, half, bits)


class _Look:
    """One place asked for: its windows, painted when they are needed."""

    def __init__(self, surface: Surface, x_mm: float, y_mm: float) -> None:
        self._surface, self._x_mm, self._y_mm = surface, x_mm, y_mm
        self._views: dict[int, _View] = {}
        self._owners: dict[tuple[float, int], Record | None] = {}

    def view(self, k: int) -> _View:
        """Return the k-th window, the finest first; in the others metal alone counts, and most polygons are ink."""
        if k not in self._views:
            bits = _ALL_BITS & ~INK if k else _ALL_BITS
            self._views[k] = self._surface.view(self._x_mm, self._y_mm, *_WINDOWS[k], bits)
        return self._views[k]

    def touched(self, reach_um: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return what lies within reach, and the nets of the metal there."""
        view = self.view(0)
        far = min(view.half, math.ceil(reach_um / view.step_um) + 1)
        middle = (slice(view.half - far, view.half + far + 1),) * 2
        along = np.arange(-far, far + 1) * view.step_um
        near = along[:, None] ** 2 + along[None, :] ** 2 <= max(reach_um, 0.5 * view.step_um) ** 2
        kinds = {_what(int(bits)) for bits in np.unique(view.bits[middle][near])}
        metal = near & view.metal[middle]
        lands = np.unique(view.lands[middle][metal]).tolist() if metal.any() else []
        nets = {pad.net if (pad := self._owner(view, land)) is not None else "" for land in lands}
        return tuple(sorted(kinds)), tuple(sorted(nets))

    def shares(self, radius_um: float) -> tuple[Share, ...]:
        """Return what a disc about the place lies on."""
        view = self.view(0)
        along = (np.arange(2 * view.half + 1) - view.half) * view.step_um
        disc = along[:, None] ** 2 + along[None, :] ** 2 <= max(radius_um, 0.5 * view.step_um) ** 2
        metal = disc & (view.metal | _narrow_holes(view))
        counts: dict[tuple[str, Record | None], int] = {}
        for land in np.unique(view.lands[metal]).tolist():
            key = ("metal", self._owner(view, land))
            counts[key] = counts.get(key, 0) + int((metal & (view.lands == land)).sum())
        for bits in np.unique(view.bits[disc & ~metal]).tolist():
            key = (_what(bits), None)
            counts[key] = counts.get(key, 0) + int((disc & ~metal & (view.bits == bits)).sum())
        whole = int(disc.sum())
        found = [Share(what, count / whole, pad) for (what, pad), count in counts.items()]
        return tuple(sorted(found, key=lambda one: -one.share))

    def on_metal(self) -> tuple[float, Record | None]:
        """Return how far inside the metal the place is, and whose metal it is."""
        pad = self._owner(self.view(0), int(self.view(0).lands[self.view(0).half, self.view(0).half]))
        for k, (step_um, half_um) in enumerate(_WINDOWS):
            inside_um = _distance_um(self.view(k))
            if inside_um < half_um - step_um:
                return inside_um, pad
        return _WINDOWS[-1][1], pad

    def beside_metal(self) -> tuple[float | None, Record | None]:
        """Return how far the nearest metal is, and whose it is; None where none is near."""
        for k in range(_NEAREST_WINDOWS):
            view = self.view(k)
            rows, columns = np.nonzero(view.metal)
            if len(rows):
                squares = (rows - view.half) ** 2 + (columns - view.half) ** 2
                nearest = int(np.argmin(squares))
                away_um = math.sqrt(float(squares[nearest])) * view.step_um
                return away_um, self._owner(view, int(view.lands[rows[nearest], columns[nearest]]))
        return None, None

    def _owner(self, view: _View, land: int) -> Record | None:
        """Return the pad on a land, which may lie beyond the window: then by what is seen of it in wider ones."""
        key = (view.step_um, land)
        if key not in self._owners:
            self._owners[key] = self._owner_looked_up(view, land)
        return self._owners[key]

    def _owner_looked_up(self, view: _View, land: int) -> Record | None:
        found = self._surface.pad_of(view, self._x_mm, self._y_mm, land)
        for k, (step_um, _) in enumerate(_WINDOWS):
            if found is not None:
                break
            if step_um > view.step_um:
                wide = self.view(k)
                found = self._surface.pad_of(wide, self._x_mm, self._y_mm, _same_land(view, land, wide))
        return found


def _narrow_holes(view: _View) -> Mask:
    """Return the holes in lands that are narrower than the needle's shaft."""
    holes = ((view.bits & HOLE != 0) & (view.lands > 0)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(holes, connectivity=4)
    across = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * view.step_um
    narrow = [k for k in range(1, count) if across[k] <= _SHAFT_UM + view.step_um]
    return np.isin(labels, narrow)


def _same_land(view: _View, land: int, wide: _View) -> int:
    """Return the number that a land of a window has in a wider one; 0 where it is lost there."""
    rows, columns = np.nonzero(view.lands == land)
    scale = view.step_um / wide.step_um
    there = wide.lands[
        np.round((rows - view.half) * scale).astype(int) + wide.half,
        np.round((columns - view.half) * scale).astype(int) + wide.half,
    ]
    counts = np.bincount(there[there > 0], minlength=1)
    return int(np.argmax(counts)) if counts.any() else 0


def _painted(shapes: Sequence[Shape], bit: int, corner_mm: tuple[float, float], step_um: float, size: int) -> Bits:
    """Paint shapes in their order, rows running with y; a point counts where its centre is inside, to half a point."""
    layer = np.zeros((size, size), dtype=np.uint8)
    points = (np.concatenate([shape.outline_mm for shape in shapes]) - corner_mm) * (1e3 / step_um)
    fixed = np.round(points * (1 << _SHIFT)).astype(np.int32)  # of all at once: most have few corners
    start = 0
    for shape in shapes:
        end = start + len(shape.outline_mm)
        cv2.fillPoly(layer, [fixed[start:end]], bit if shape.dark else 0, cv2.LINE_8, _SHIFT)
        start = end
    return layer


def _distance_um(view: _View) -> float:
    """Return how far the middle is from the edge of the metal it lies on; at least half a point."""
    squares = np.arange(-view.half, view.half + 1, dtype=np.int32) ** 2
    beyond = (squares[:, None] + squares[None, :])[~view.metal]
    depth = float(np.sqrt(np.float32(beyond.min()))) if len(beyond) else math.inf
    return max(0.5, depth - 0.5) * view.step_um


def _what(bits: int) -> str:
    if not bits & BOARD:
        return "off_board"
    if bits & LEAD:
        return "lead"
    if bits & OPEN:
        if bits & HOLE:
            return "hole"
        return "metal" if bits & COPPER else "laminate"
    return "ink" if bits & INK else "mask"


def _names(pad: Record | None) -> tuple[str | None, str | None]:
    return (None, None) if pad is None else (pad.net, pad.name)
