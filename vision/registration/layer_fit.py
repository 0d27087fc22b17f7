"""Shifts of ink and mask openings against copper, measured in a picture whose board has been registered.

Boards are printed in steps that miss each other: ink by up to 0.25 mm, openings by up to 0.1 mm. Fitted as one body
with the copper they pull the place off the metal, and what is seen agrees badly with CAD.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr, Plane, parabola
from vision.registration.answer import NotRegistered, Registration
from vision.registration.drawing import IndexedSide, LayerShifts, Material, average, draw_labels
from vision.registration.rectify import Picture, Pose
from vision.registration.refine import slopes
from vision.registration.register import open_picture
from vision.registration.sheet import Sheet, make_sheet

TEXEL_UM, TEXELS, FACTOR = 16.0, 384, 2
INK_REACH_UM = 300.0
INK_PRIOR_UM, OPENINGS_PRIOR_UM = 150.0, 60.0
LEAST_INK_MM2 = 0.3
"""Less ink than this says nothing of where the ink lies."""
LOOSE = (1.0, 0.6, 0.4, 0.3, 0.2, 0.15)
"""What a cell may miss before it counts less, of the step from mask to metal, in each step: first all metal edges are
off, at last only what is not CAD's."""
MOST_INK_UM = 270.0
_STEP_UM = 16.0
_GREY_SIGMA = 6.0
"""Against which the priors weigh: what a cell's grey misses the expected one by, relief and all."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LayerFit:
    """What one look says of the layers. sigma_um: of ink and openings, inf where there is too little of them."""

    shifts: LayerShifts
    ink_sigma_um: float
    openings_sigma_um: float


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    side: IndexedSide
    about_um: tuple[float, float]
    picture: Picture
    px_per_cell: float

    def drawn(self, shifts: LayerShifts) -> Sheet:
        half = TEXEL_UM * TEXELS / 2
        corner = (self.about_um[0] - half, self.about_um[1] - half)
        labels = draw_labels(self.side, corner, TEXEL_UM, TEXELS, shifts)
        return make_sheet(average(labels, corner, TEXEL_UM, FACTOR))


def fit_layers(
    side: IndexedSide,
    about_um: tuple[float, float],
    red_bgr: Bgr,
    board_to_px: Array,
    found: Registration,
    hidden_px: Sequence[NDArray[np.float64]] = (),
) -> LayerFit | NotRegistered:
    """Measure the layers' shifts about a place in a picture where `found` says how the board lies.

    `found` is what `place_known` let pass: at a wrong place the ink would be bent until it fits. One look in ten is a
    letter off: take `median_shifts` of several. About 0.2 s a look: done once for a board that was laid in.
    """
    picture = open_picture(red_bgr, board_to_px, hidden_px)
    if isinstance(picture, NotRegistered):
        return picture
    pose = Pose(*found.shift_um, found.turn_deg, about_um)
    per_cell = TEXEL_UM * FACTOR / picture.um_per_px(*pose.apply(*about_um))
    scene = _Scene(side, about_um, picture, per_cell)
    ink = _ink_by_correlation(scene, scene.drawn(LayerShifts()), pose)
    shifts, sigmas = LayerShifts(ink_um=ink), (np.inf, np.inf)
    for loose in LOOSE:
        pose, shifts, sigmas = _step(scene, pose, shifts, loose)
    return LayerFit(shifts, *sigmas)


def median_shifts(fits: Sequence[LayerFit]) -> LayerShifts:
    """Return the median of several looks' shifts, each of those that could say; none where no look could."""
    ink = [fit.shifts.ink_um for fit in fits if np.isfinite(fit.ink_sigma_um)]
    openings = [fit.shifts.openings_um for fit in fits if np.isfinite(fit.openings_sigma_um)]
    return LayerShifts(_median(ink), _median(openings))


def _median(shifts: list[tuple[float, float]]) -> tuple[float, float]:
    if not shifts:
        return (0.0, 0.0)
    x, y = np.median(np.array(shifts), axis=0)
    return float(x), float(y)


def _look(scene: _Scene, sheet: Sheet, pose: Pose) -> tuple[Plane, NDArray[np.bool_]]:
    shown, seen = scene.picture.on(sheet.planes.grid, pose, scene.px_per_cell)
    return shown, seen & sheet.known


def _ink_by_correlation(scene: _Scene, sheet: Sheet, pose: Pose) -> tuple[float, float]:
    """Return where the ink correlates best with what is seen away from metal and openings, within 0.3 mm."""
    cover = sheet.planes.cover
    cell = sheet.planes.grid.cell_um
    if float(cover[Material.INK].sum()) * (cell / 1e3) ** 2 < LEAST_INK_MM2:
        return (0.0, 0.0)
    shown, usable = _look(scene, sheet, pose)
    apart_from = (Material.METAL, Material.SOLDER, Material.LAMINATE, Material.HOLE, Material.OFF_BOARD)
    opened = cover[list(apart_from)].sum(axis=0)
    reach = round(INK_REACH_UM / cell)
    apart = cv2.dilate((opened > 0.02).astype(np.uint8), np.ones((9, 9), dtype=np.uint8)) > 0
    usable &= ~apart
    if np.count_nonzero(usable) < 400:
        return (0.0, 0.0)
    level = np.where(usable, shown - np.float32(np.median(shown[usable])), np.float32(0.0)).astype(np.float32)
    weight = usable.astype(np.float32)
    ink = cover[Material.INK]
    inner = np.s_[reach:-reach, reach:-reach]
    # The ink's window slides under the picture: the shift is where its mean level stands out most.
    sums = np.asarray(cv2.matchTemplate(level, ink[inner], cv2.TM_CCORR))
    counts = np.asarray(cv2.matchTemplate(weight, ink[inner], cv2.TM_CCORR))
    score = (sums / np.sqrt(np.maximum(counts, 1.0))).astype(np.float32)
    row, column = (int(v) for v in np.unravel_index(int(np.argmax(score)), score.shape))
    x = (column - reach + parabola(score[row], column)) * cell
    y = (row - reach + parabola(score[:, column], row)) * cell
    return float(x), float(y)


def _step(
    scene: _Scene, pose: Pose, shifts: LayerShifts, loose: float
) -> tuple[Pose, LayerShifts, tuple[float, float]]:
    """Take one Gauss-Newton step on the board's shift, the openings' and the ink's."""
    sheet = scene.drawn(shifts)
    shown, usable = _look(scene, sheet, pose)
    levels = sheet.estimate(shown, usable)
    expected = sheet.expect(levels)
    along_x, along_y = (slope / sheet.planes.grid.cell_um for slope in slopes(expected))
    parts = [-along_x, -along_y]
    for layer in ("openings_um", "ink_um"):
        for axis in (0, 1):
            ahead, behind = (scene.drawn(_moved(shifts, layer, axis, step)).expect(levels) for step in (1, -1))
            parts.append((ahead - behind) / np.float32(2.0 * _STEP_UM))
    design = np.stack([part[usable] for part in parts], axis=1).astype(np.float64)
    residual = (shown - expected)[usable].astype(np.float64)
    design -= design.mean(axis=0)
    residual -= float(np.median(residual))
    weight = 1.0 / (1.0 + (residual / max(loose * levels.step, _GREY_SIGMA)) ** 2) ** 2
    normal = design.T @ (design * weight[:, None])
    known = np.array([0.0, 0.0, *[1.0 / OPENINGS_PRIOR_UM**2] * 2, *[1.0 / INK_PRIOR_UM**2] * 2]) * _GREY_SIGMA**2
    now = np.array([0.0, 0.0, *shifts.openings_um, *shifts.ink_um])
    whole = normal + np.diag(known + 1e-9)
    move = np.linalg.solve(whole, design.T @ (residual * weight) - known * now)
    move = np.clip(move, -60.0, 60.0)
    # What every layer does together is the board's own shift.
    axes = pose.matrix[:2, :2] @ move[:2]
    pose = replace(pose, x_um=pose.x_um + float(axes[0]), y_um=pose.y_um + float(axes[1]))
    after = now + move
    fresh = LayerShifts((float(after[4]), float(after[5])), (float(after[2]), float(after[3])))
    return pose, fresh, _sigmas(sheet, normal, fresh)


def _moved(shifts: LayerShifts, layer: str, axis: int, step: int) -> LayerShifts:
    x, y = getattr(shifts, layer)
    by = step * _STEP_UM
    return replace(shifts, **{layer: (x + by, y) if axis == 0 else (x, y + by)})


def _sigmas(sheet: Sheet, normal: Array, shifts: LayerShifts) -> tuple[float, float]:
    """Return the sigma of ink and openings, um; inf where the picture has too little of them."""
    area = (sheet.planes.grid.cell_um / 1e3) ** 2
    ink_mm2 = float(sheet.planes.cover[Material.INK].sum()) * area
    known = np.linalg.pinv(normal + np.eye(6) * 1e-6) * _GREY_SIGMA**2
    # Neighbouring cells miss together.
    inflated = 4.0
    openings = inflated * float(np.sqrt(max(known[2, 2], known[3, 3])))
    ink = inflated * float(np.sqrt(max(known[4, 4], known[5, 5])))
    known_ink = ink_mm2 >= LEAST_INK_MM2 and float(np.hypot(*shifts.ink_um)) < MOST_INK_UM
    return (
        ink if known_ink and ink < INK_PRIOR_UM / 3 else np.inf,
        openings if openings < OPENINGS_PRIOR_UM / 3 else np.inf,
    )
