"""The wide check: hypotheses compared in pairs over all of the picture that is near, and how much of it is explained.

What is seen and not in CAD counts as much as what is in CAD and not seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration.drawing import Grid, Material
from vision.registration.rectify import Picture, Pose
from vision.registration.reference import USUAL_LEVEL
from vision.registration.sheet import FEW, UNKNOWN_SHARE, Levels, Sheet, middle

WIDE_UM, WIDEST_UM = 6500.0, 12_000.0
"""Half the window in which hypotheses are compared, and half of that in which ties are."""
DIFFERS = 0.22
"""Of the step from mask to metal: places of which two hypotheses expect things so different are asked."""
VOTES_PER_MM2, MOST_ODDS = 30.0, 400.0
AGREES, BRIGHTER, STANDS_OUT, BRIGHT = 0.18, 0.25, 0.18, 0.45
"""Of the step: as expected; brighter than mask for sure, as any metal is; to be seen at all; bright as
metal."""

INK_SHARE, LEAST_WANTED = 0.3, 12
"""A cell with more ink is none of metal; fewer cells of metal than this miss nothing that would count."""
WHITE = 255.0
"""No picture shows more."""

SOLDER_WEIGHT = 0.5
"""Of a cell of solder: some of it throws the lamp elsewhere."""

LARGE_CELLS, BORDER_CELLS = 13, 3
"""What is brighter than CAD has it over a square as wide is no pad, no letter and no track; and its border."""
_NEXT = np.ones((3, 3), dtype=np.uint8)

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """The wide picture on `grid`, cells of the board frame as assumed, and which of them are seen."""

    grid: Grid
    levels: Plane
    seen: Mask

    @property
    def cell_mm2(self) -> float:
        """Area of a cell."""
        return (self.grid.cell_um / 1e3) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What one hypothesis expects of the wide picture; NaN where it says nothing or nothing is seen."""

    pose: Pose
    levels: Levels
    expected: Plane


def window(middle_um: tuple[float, float], cell_um: float, half_um: float = WIDE_UM) -> Grid:
    """Return the cells about a place of the board frame as assumed on which hypotheses are compared."""
    half = round(half_um / cell_um)
    corner = (middle_um[0] - (half - 0.5) * cell_um, middle_um[1] - (half - 0.5) * cell_um)
    return Grid(corner, cell_um, 2 * half, 2 * half)


def look(
    picture: Picture, middle_um: tuple[float, float], cell_um: float, per_cell: float, half_um: float = WIDE_UM
) -> Shown:
    """Return the wide picture about a place."""
    grid = window(middle_um, cell_um, half_um)
    return Shown(grid, *picture.on(grid, Pose(), per_cell))


def draw_view(sheet: Sheet, shown: Shown, pose: Pose, levels: Levels) -> View:
    """Lay CAD on the wide picture by a pose, with the levels of `wide_levels`."""
    expected = sheet.expect(levels)
    if not sheet.wholly:
        # Of solder too small to be measured nothing is expected.
        expected[~(sheet.told if levels.measured[Material.SOLDER] else sheet.known)] = np.nan
    laid = lay(expected, sheet, shown, pose, outside=np.nan)
    laid[~shown.seen] = np.nan
    return View(pose, levels, laid)


def wide_levels(sheet: Sheet, shown: Shown, pose: Pose, near: Levels) -> Levels:
    """Return the levels known from near, and for a material that is not there the median over the wide picture.

    Near is better: the light is the same, and smaller cells hold narrow things (ink) alone.
    """
    told = sheet.told.ravel()
    missing = {m: cells[told[cells]] for m, cells in sheet.pure.items() if not near.measured[m]}
    # Behind parts there may be none left of what CAD has.
    missing = {m: cells for m, cells in missing.items() if len(cells) >= FEW}
    if not missing:
        return _with_metal(near)
    grey, measured = near.grey.copy(), near.measured.copy()
    to_shown = (np.linalg.inv(shown.grid.to_um) @ pose.matrix @ sheet.planes.grid.to_um).astype(np.float32)
    visible = np.where(shown.seen, shown.levels, np.float32(-1e6))
    for material, cells in missing.items():
        rows, columns = np.divmod(cells, sheet.planes.grid.columns)
        x = to_shown[0, 0] * columns + to_shown[0, 1] * rows + to_shown[0, 2]
        y = to_shown[1, 0] * columns + to_shown[1, 1] * rows + to_shown[1, 2]
        found = np.asarray(cv2.remap(visible, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR,
                              borderMode=cv2.BORDER_CONSTANT, borderValue=-1e6), dtype=np.float32).ravel()  # fmt: skip
        values = found[found > -1.0]
        if len(values) >= FEW:
            grey[material], measured[material] = middle(values), True
    return _with_metal(Levels(grey, measured))


def _with_metal(levels: Levels) -> Levels:
    """Return levels in which metal too small for any cell is as bright as the brightest that is seen, never darker.

    So is that of an assembled board, whose little bare metal may lie behind parts. Where none is seen at all it is as
    bright as the usual is beside such ink or solder: of a view of ink alone no more is asked than of any other.
    """
    hidden, measured = levels.measured[Material.SOLDER], levels.measured
    if (measured[Material.METAL] and not hidden) or not measured.any():
        return levels
    grey = levels.grey.copy()
    grey[Material.METAL] = max(grey[Material.METAL], levels.grey[measured].max())
    if not measured[Material.METAL]:
        by_others = [levels.mask + (levels.grey[m] - levels.mask) / USUAL_LEVEL[m]
                     for m in (Material.INK, Material.SOLDER) if measured[m]]  # fmt: skip
        grey[Material.METAL] = max([grey[Material.METAL], *(min(float(level), WHITE) for level in by_others)])
    return Levels(grey, measured)


def lay(plane: Plane, sheet: Sheet, shown: Shown, pose: Pose, outside: float) -> Plane:
    """Return a plane of CAD's cells on the wide picture's."""
    to_cad = np.linalg.inv(pose.matrix @ sheet.planes.grid.to_um) @ shown.grid.to_um
    size = (shown.grid.columns, shown.grid.rows)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(plane, to_cad[:2], size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)
    return np.asarray(laid, dtype=np.float32)


@dataclass(frozen=True, slots=True)
class Agreement:
    """Share of structure, CAD's or seen, that is as expected; share of CAD's metal that is seen bright, 1 of none."""

    all: float
    metal: float


def agreement(sheet: Sheet, shown: Shown, view: View) -> Agreement:
    """Compare the wide picture with what a hypothesis expects; what lies beside the board is not asked."""
    step, mask = view.levels.step, view.levels.mask
    if step <= 0.0:
        return Agreement(0.0, 0.0)
    cover = sheet.planes.cover
    asked = np.isfinite(view.expected)
    asked &= ~beside_board(sheet, shown, view.pose)
    seen, expected = shown.levels[asked] - np.float32(mask), view.expected[asked] - np.float32(mask)
    metal = lay(cover[Material.METAL], sheet, shown, view.pose, outside=0.0)[asked] > 0.5
    weight, solder = None, np.zeros_like(metal)
    if Material.SOLDER in sheet.present:
        # What is brighter than expected shines into the next cell.
        about = np.asarray(cv2.dilate(cover[Material.SOLDER], _NEXT), dtype=np.float32)
        solder = lay(about, sheet, shown, view.pose, outside=0.0)[asked] > UNKNOWN_SHARE
        weight = np.where(solder, SOLDER_WEIGHT, 1.0)
    if weight is not None or not sheet.wholly:
        # A label, a part that is larger than CAD has it: it stands before the board, and says nothing of it.
        before = _standing_before(asked, seen - expected > AGREES * step)
        weight = np.where(before, 0.0, 1.0 if weight is None else weight)
    structure = np.maximum(np.abs(seen), np.abs(expected)) > STANDS_OUT * step
    brighter = seen > BRIGHTER * step
    fits = (np.abs(seen - expected) < AGREES * step) | ((metal | solder) & brighter)
    bright = np.where(solder, brighter, seen > BRIGHT * step)
    wanted = expected > BRIGHT * step
    if Material.INK in sheet.present:
        # Ink may be as bright, and is no metal.
        wanted &= lay(cover[Material.INK], sheet, shown, view.pose, outside=0.0)[asked] < INK_SHARE
    missed = _share(wanted & ~bright, wanted, weight) if np.count_nonzero(wanted) >= LEAST_WANTED else 0.0
    return Agreement(_share(structure & fits, structure, weight), 1.0 - missed)


def beside_board(sheet: Sheet, shown: Shown, pose: Pose) -> Mask:
    """Return which cells of the wide picture a hypothesis has beside the board."""
    if Material.OFF_BOARD not in sheet.present:
        return np.zeros(shown.seen.shape, dtype=bool)
    return lay(sheet.planes.cover[Material.OFF_BOARD], sheet, shown, pose, outside=1.0) >= 0.5


def _standing_before(asked: Mask, strange: Mask) -> Mask:
    """Return which cells of those asked belong to something large that is brighter than CAD has it there."""
    plane = np.zeros(asked.shape, dtype=np.uint8)
    plane[asked] = strange
    core = cv2.erode(plane, np.ones((LARGE_CELLS, LARGE_CELLS), dtype=np.uint8))
    size = LARGE_CELLS + 2 * BORDER_CELLS
    return np.asarray(cv2.dilate(core, np.ones((size, size), dtype=np.uint8)))[asked] > 0


def _share(some: Mask, whole: Mask, weight: Plane | None) -> float:
    """Return what share of cells some of them are, 0 of none."""
    if weight is None:
        count, of = float(np.count_nonzero(some)), float(np.count_nonzero(whole))
    else:
        count, of = float(weight[some].sum()), float(weight[whole].sum())
    return count / of if of else 0.0


def log_odds(one: View, other: View, shown: Shown) -> float:
    """Return by how much the picture speaks for `one` against `other`, natural logarithm."""
    step = max(one.levels.step, other.levels.step)
    # Not a number compares as false: where either says nothing, nothing is asked.
    asked = np.flatnonzero(np.abs(one.expected - other.expected) > DIFFERS * step)
    if len(asked) == 0 or step <= 0.0:
        return 0.0
    levels = shown.levels.ravel()[asked]
    nearer = np.abs(levels - one.expected.ravel()[asked]) < np.abs(levels - other.expected.ravel()[asked])
    votes = VOTES_PER_MM2 * len(asked) * shown.cell_mm2
    odds = votes * (2.0 * float(np.mean(nearer)) - 1.0) * float(np.log(2.0))
    return float(np.clip(odds, -MOST_ODDS, MOST_ODDS))
