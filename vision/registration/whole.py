"""A whole side of a board in coarse cells, and where on it a picture fits, in every turn by quarters."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration import spectra
from vision.registration.drawing import (
    IndexedSide,
    LayerShifts,
    PackedPlanes,
    Planes,
    average_packed,
    coarser,
    draw_labels,
    index_side,
)
from vision.registration.layers import SideLayers

TEXEL_UM, FINE, SEARCH = 32.0, 3, 2
MOST_CELLS = 500
"""Across a side, in the search; larger boards are searched in larger cells."""
APART = 3
"""Cells; nearer places are one."""
MARGIN_UM = 7000.0
"""Bench about the board: a picture at its edge shows some."""


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A side and what is round it: `wide` in 96 um cells, `search` in 192 um cells or more; box_um of the outline."""

    wide: PackedPlanes
    search: Planes
    box_um: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Place:
    """Where on a side a picture fits: CAD's place of the picture's middle, by how many quarters turned, how well."""

    x_um: float
    y_um: float
    quarters: int
    ratio: float


def draw_whole(side: IndexedSide | SideLayers) -> Whole:
    """Draw a whole side; some tenths of a second."""
    indexed = index_side(side) if isinstance(side, SideLayers) else side
    x0, y0, x1, y1 = indexed.box_um
    size = max(x1 - x0, y1 - y0) + 2 * MARGIN_UM
    search = max(SEARCH, round(size / (TEXEL_UM * FINE) / MOST_CELLS))
    factor = FINE * search
    texels = int(np.ceil(size / TEXEL_UM / factor / 2) * 2) * factor
    corner = ((x0 + x1 - texels * TEXEL_UM) / 2, (y0 + y1 - texels * TEXEL_UM) / 2)
    labels = draw_labels(indexed, corner, TEXEL_UM, texels, LayerShifts())
    wide = average_packed(labels, corner, TEXEL_UM, FINE)
    return Whole(wide, coarser(wide, search), indexed.box_um)


def find_places(whole: Whole, shown: Plane, seen: NDArray[np.bool_], count: int) -> list[Place]:
    """Return where a square picture, in cells as wide as `whole.search`'s, fits best, turned by any quarter."""
    return find_in(spectra.transform_all(whole.search, shown.shape[0]), whole, shown, seen, count)


def find_in(
    search: spectra.Spectra, whole: Whole, shown: Plane, seen: NDArray[np.bool_], count: int, apart: int = APART
) -> list[Place]:
    """Return the same as `find_places`, by spectra of `whole.search` for windows as large as the picture.

    apart: in cells; a place as near to a better one is the same.
    """
    found: list[Place] = []
    field, half = whole.search, shown.shape[0] // 2
    for quarters in range(4):
        turned, visible = np.rot90(shown, quarters), np.rot90(seen, quarters)
        ratio = spectra.correlation_ratio(search, np.ascontiguousarray(turned), np.ascontiguousarray(visible),
                                          metal=False)  # fmt: skip
        for _ in range(count):
            row, column = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
            best = float(ratio[row, column])
            x_um = field.grid.origin_um[0] + (int(column) + half - 0.5) * field.grid.cell_um
            y_um = field.grid.origin_um[1] + (int(row) + half - 0.5) * field.grid.cell_um
            found.append(Place(x_um, y_um, quarters, best))
            cv2.circle(ratio, (int(column), int(row)), apart, 0.0, -1)
    return sorted(found, key=lambda place: -place.ratio)
