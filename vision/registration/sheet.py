"""A sheet of CAD: planes of materials with what is wanted of them again and again, worked out once.

Levels are never given: they are the medians over cells of one material, estimated from the picture for each hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration.drawing import Material, Planes

PURE, MIXED, FEW = 0.85, 0.35, 6
MOST_CELLS = 400
"""A median over so many cells is good to a twentieth of their spread."""
_BLUR = 0.11
"""Outer weight of the three that an oblique cell is smeared over."""
UNKNOWN_SHARE = 0.05
KNOWN: tuple[Material, ...] = tuple(material for material in Material if material is not Material.UNKNOWN)

Mask = NDArray[np.bool_]
Cells = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Level (materials,) of each material, grey; measured (materials,): where there was enough of it."""

    grey: NDArray[np.float32]
    measured: Mask

    @property
    def mask(self) -> float:
        """Level of the solder mask."""
        return float(self.grey[Material.MASK])

    @property
    def step(self) -> float:
        """From mask to metal; at most 0 where nothing speaks for metal."""
        return float(self.grey[Material.METAL] - self.grey[Material.MASK])

    @property
    def contrast(self) -> float:
        """Between the brightest and the darkest material seen."""
        return float(np.ptp(self.grey[self.measured])) if self.measured.any() else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Planes of one window, and what is wanted of them.

    present: materials there are; stack (n, cells): their planes. pure, mixed: by material, cells of it alone, and of
    it and mask alone. told (rows, columns): where CAD says what is to be seen; known: where it says how that looks,
    which it does not of solder. wholly: all of it is known.
    """

    planes: Planes
    present: tuple[Material, ...]
    stack: NDArray[np.float32]
    pure: dict[Material, Cells]
    mixed: dict[Material, Cells]
    told: Mask
    known: Mask
    wholly: bool

    def estimate(self, shown: Plane, seen: Mask) -> Levels:
        """Return the levels; a material without pure cells borrows from mixed ones, or else from mask.

        Solder's is the median of a wide spread.
        """
        picture, good = shown.ravel(), (seen & self.known).ravel()
        grey = np.zeros(len(Material), dtype=np.float32)
        measured = np.zeros(len(Material), dtype=bool)
        told = (seen & self.told).ravel() if Material.SOLDER in self.present else good
        for material, cells in self.pure.items():
            values = picture[cells][(told if material is Material.SOLDER else good)[cells]]
            if len(values) >= FEW:
                grey[material], measured[material] = middle(values), True
        if not measured[Material.MASK]:
            grey[Material.MASK] = _dark(picture[good])
        mask = grey[Material.MASK]
        for material in self.present:
            if not measured[material]:
                grey[material] = mask
                cells = self.mixed.get(material, np.empty(0, dtype=np.intp))
                cells = cells[good[cells]]
                if len(cells) >= FEW:
                    share = self.planes.cover[material].ravel()[cells]
                    grey[material], measured[material] = mask + middle((picture[cells] - mask) / share), True
        return Levels(grey, measured)

    def expect(self, levels: Levels, blur_cells: float = 0.0) -> Plane:
        """Return the picture (rows, columns) that CAD expects, smeared as an oblique view and a lens do."""
        mixed = (levels.grey[list(self.present)] @ self.stack).reshape(self.known.shape)
        if not self.wholly:
            mixed += np.float32(levels.mask) * self.planes.cover[Material.UNKNOWN]
        if blur_cells > 0.0:
            size = 2 * round(2.2 * blur_cells) + 1
            return np.asarray(cv2.GaussianBlur(mixed, (size, size), blur_cells), dtype=np.float32)
        kernel = np.array([_BLUR, 1.0 - 2.0 * _BLUR, _BLUR])
        return np.asarray(cv2.sepFilter2D(mixed, cv2.CV_32F, kernel, kernel), dtype=np.float32)


def make_sheet(planes: Planes) -> Sheet:
    """Work out what is wanted of planes."""
    cover = planes.cover
    # Mask is always one of them: under parts alone there is nothing else.
    present = tuple(m for m in KNOWN if m is Material.MASK or float(cover[m].max()) > 0.0)
    pure: dict[Material, Cells] = {material: _some(cover[material] > PURE) for material in present}
    short = [material for material in present if len(pure[material]) < FEW * 4 and material is not Material.MASK]
    mixed: dict[Material, Cells] = {
        m: _some((cover[m] > MIXED) & (cover[m] + cover[Material.MASK] > PURE)) for m in short
    }
    told = cover[Material.UNKNOWN] < UNKNOWN_SHARE
    known = told & (cover[Material.SOLDER] < UNKNOWN_SHARE) if Material.SOLDER in present else told
    stack = np.ascontiguousarray(cover[list(present)].reshape(len(present), -1))
    return Sheet(planes, present, stack, pure, mixed, told, known, bool(known.all()))


def without(sheet: Sheet, hidden: Mask) -> Sheet:
    """Return a sheet of which CAD cannot say how some cells look."""
    return replace(sheet, told=sheet.told & ~hidden, known=sheet.known & ~hidden, wholly=False)


def _some(where: Mask) -> Cells:
    cells = np.flatnonzero(where)
    # A copy: a view of each tenth would keep them all
    return np.array(cells[:: max(1, len(cells) // MOST_CELLS)], dtype=np.intp)


def middle(values: NDArray[np.float32] | NDArray[np.float64]) -> float:
    """Return the median (the upper of two)."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _dark(values: NDArray[np.float32]) -> float:
    return float(np.partition(values, len(values) // 5)[len(values) // 5]) if len(values) else 0.0
