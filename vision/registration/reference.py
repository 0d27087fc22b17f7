"""The reference of one target: CAD drawn about it, in the cells that registration works with.

It takes some tens of milliseconds, so it is made while the head travels; it is data alone, and may be made in a
worker thread or another process.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import parabola
from vision.registration.drawing import (
    IndexedSide,
    LayerShifts,
    Material,
    PackedPlanes,
    Planes,
    average,
    draw_labels,
    index_side,
)
from vision.registration.layers import SideLayers
from vision.registration.sheet import Sheet, make_sheet
from vision.registration.spectra import Spectra, transform

FINE_TEXEL_UM, FINE_TEXELS, FINE_FACTOR = 2.0, 1056, 6
MIDDLE_TEXEL_UM, MIDDLE_TEXELS, MIDDLE_FACTOR = 16.0, 384, 3
WIDE_TEXEL_UM, WIDE_TEXELS, WIDE_FACTOR = 16.0, 1680, 6
"""Every window has an even number of cells: its middle lies between cells, as in all the others."""
ALIAS_WINDOW_UM, ALIAS_REACH_UM, ALIAS_LEAST = 3000.0, 6700.0, 0.55
MOST_ALIASES = 24
AS_DRAWN = LayerShifts()


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """CAD about a place, as shares of materials in cells of three sizes, and where CAD looks like itself.

    about_um: the place, board frame. fine: 12 um cells to +-1.06 mm; middle: 48 um cells to +-3 mm; wide: 96 um cells
    to +-13.4 mm. spectra: of the wide cells. aliases_um: (N, 2), shifts by which the neighbourhood of the place looks
    like itself, best first. shifts: of the layers, drawn in.
    """

    about_um: tuple[float, float]
    fine: Sheet
    middle: Sheet
    wide: Sheet
    spectra: Spectra
    aliases_um: NDArray[np.float64]
    shifts: LayerShifts

    @property
    def has_parts(self) -> bool:
        """Whether parts stand near."""
        return bool(self.wide.planes.cover[Material.UNKNOWN].any())


def prepare(side: IndexedSide | SideLayers, about_um: tuple[float, float], shifts: LayerShifts = AS_DRAWN) -> Reference:
    """Draw what CAD says about a place of the board (um, board frame), with ink and openings shifted by `shifts`."""
    indexed = index_side(side) if isinstance(side, SideLayers) else side

    def drawn(texel_um: float, texels: int, factor: int) -> Planes:
        half = texel_um * texels / 2
        corner = (about_um[0] - half, about_um[1] - half)
        return average(draw_labels(indexed, corner, texel_um, texels, shifts), corner, texel_um, factor)

    wide = drawn(WIDE_TEXEL_UM, WIDE_TEXELS, WIDE_FACTOR)
    return Reference(
        about_um,
        make_sheet(drawn(FINE_TEXEL_UM, FINE_TEXELS, FINE_FACTOR)),
        make_sheet(drawn(MIDDLE_TEXEL_UM, MIDDLE_TEXELS, MIDDLE_FACTOR)),
        make_sheet(wide),
        transform(wide, about_um),
        find_aliases(wide, about_um),
        shifts,
    )


USUAL_LEVEL = np.zeros(len(Material), dtype=np.float32)
"""What materials look like under a red lamp, about, as a share of the way from mask to metal: only to find out where
CAD looks like itself, and what stands out. Levels of a picture are always estimated from it."""
USUAL_LEVEL[Material.METAL] = 1.0
USUAL_LEVEL[Material.SOLDER] = 0.8
USUAL_LEVEL[Material.INK] = 0.5
USUAL_LEVEL[Material.LAMINATE] = 0.2
USUAL_LEVEL[Material.COVERED_COPPER] = 0.12
USUAL_LEVEL[Material.HOLE] = -0.1
USUAL_LEVEL[Material.OFF_BOARD] = -0.1


def usual_picture(planes: Planes) -> NDArray[np.float32]:
    """Return the usual look of CAD, (rows, columns): 0 mask, 1 metal."""
    return np.asarray(np.tensordot(USUAL_LEVEL, planes.cover, axes=1), dtype=np.float32)


def usual_picture_of(planes: PackedPlanes) -> NDArray[np.float32]:
    """Return the same of packed planes."""
    look = np.zeros(planes.shares.shape[1:], dtype=np.float32)
    for material in Material:
        if USUAL_LEVEL[material]:
            look += USUAL_LEVEL[material] * planes.plane(material)
    return look


def find_aliases(planes: Planes, about_um: tuple[float, float]) -> NDArray[np.float64]:
    """Return the shifts (N, 2), um, at which CAD about a place looks like itself, best first."""
    look = usual_picture(planes)
    reach = int(ALIAS_REACH_UM / planes.grid.cell_um)
    half = int(ALIAS_WINDOW_UM / planes.grid.cell_um)
    row = round((about_um[1] - planes.grid.origin_um[1]) / planes.grid.cell_um + 0.5)
    column = round((about_um[0] - planes.grid.origin_um[0]) / planes.grid.cell_um + 0.5)
    window = look[row - half : row + half, column - half : column + half]
    field = look[row - half - reach : row + half + reach, column - half - reach : column + half + reach]
    if float(np.ptp(window)) < 0.05:
        return np.empty((0, 2))
    likeness: NDArray[np.float32] = np.nan_to_num(
        np.asarray(cv2.matchTemplate(field, window, cv2.TM_CCOEFF_NORMED), dtype=np.float32), posinf=0.0, neginf=0.0
    )
    likeness[reach - 2 : reach + 3, reach - 2 : reach + 3] = 0.0
    tops = (likeness == cv2.dilate(likeness, np.ones((5, 5)))) & (likeness >= ALIAS_LEAST)
    rows, columns = np.nonzero(tops)
    order = np.argsort(-likeness[rows, columns])[:MOST_ALIASES]
    places = [_top(likeness, int(rows[k]), int(columns[k]), reach) for k in order]
    return np.asarray(np.array(places).reshape(-1, 2) * planes.grid.cell_um)


def _top(values: NDArray[np.float32], row: int, column: int, reach: int) -> tuple[float, float]:
    """Return (x, y) of a peak from the middle, in cells, between cells by a parabola."""
    return (
        column - reach + parabola(values[row], column),
        row - reach + parabola(values[:, column], row),
    )
