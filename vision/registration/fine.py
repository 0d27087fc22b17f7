"""The last two stages: the place to a hundredth of a cell about the target, and the target's own metal edge alone."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.registration.answer import Edges, Registration, Rival, Target
from vision.registration.drawing import Grid, LayerShifts, Material, Planes
from vision.registration.edges import LEAST_NEAR, judge_edges
from vision.registration.rectify import Picture, Pose
from vision.registration.reference import Reference
from vision.registration.refine import Fit, Problem, refine, slopes
from vision.registration.sheet import Levels, Sheet, make_sheet, without
from vision.registration.wide import Agreement

Joined = tuple[tuple[float, float], NDArray[np.float64], tuple[float, float]]
"""The target's place, its covariance, and by how much it lies off the rest."""

FINE_STEPS, OWN_STEPS, MOST_CELLS = 2, 2, 1000
LEAST_REST, LEAST_MIDDLE = 250, 100
"""Edge cells besides the target's that say where the board is, near and farther off."""
LEAST_EXPLAINED = 0.65
"""Of the variance at the edges fitted: a good fit explains 0.75 and more, one of a few blotches half."""
OWN_MARGIN_UM = 120.0
"""The target's own edge is looked for within this of its outline."""
BARE, SOLDERED = (Material.METAL,), (Material.METAL, Material.SOLDER)
SMOOTH_UM = 30.0
DISAGREE_SIGMAS = 3.0
SHIFTS_UM, SOLDERED_UM = 1.5, 4.0
"""What is not known of the layers' shifts; of a place that ink, mask and solder tell; um for each axis."""
FLOOR_UM = 1.1
"""What no fit knows of: the raster of CAD's drawing, the lens, the metal's own unevenness; um for each axis."""
LENS_CELLS, MIDDLE_LENS_CELLS = 1.0, 0.4
"""A lens smears about a pixel, which is about a fine cell."""


def judge(
    reference: Reference,
    picture: Picture,
    start: Fit,
    target: Target | None,
    rivals: tuple[Rival, ...],
    agreement: Agreement,
) -> Registration | None:
    """Measure a hypothesis finely and collect all that is known of it; None where too little can be seen."""
    per_um = 1.0 / picture.um_per_px(*start.pose.apply(*reference.about_um))
    fine = _problem(reference.fine, picture, per_um, LENS_CELLS)
    middle = _problem(reference.middle, picture, per_um, MIDDLE_LENS_CELLS)
    broad = _problem(reference.wide, picture, per_um, 0.0)
    rest = _rest_fit((fine, middle, broad), start.pose, target)
    if rest is None:
        return None
    near = _near_edges(middle, rest, BARE)
    if near.cells < LEAST_NEAR:
        # Of an assembled or tented board little bare metal is seen. Ink says nothing here: it may lie off the copper.
        near = next((edges for edges in (_near_edges(p, rest, SOLDERED) for p in (middle, broad))
                     if edges.cells >= LEAST_NEAR), near)  # fmt: skip
    own, at_target = None, None
    if target is not None:
        close = _close_up(fine if _inside(fine.sheet.planes.grid, target) else middle, target)
        own = refine(close, rest.pose)
        at_target = _target_edges(close, rest if own is None else own)
    nominal = reference.about_um if target is None else (target.x_um, target.y_um)
    return _answer(picture, rest, nominal, _joined(rest, own, nominal), agreement, (near, at_target), rivals, reference)


def _problem(sheet: Sheet, picture: Picture, per_um: float, blur_cells: float) -> Problem:
    per_cell = sheet.planes.grid.cell_um * per_um
    return Problem(sheet, picture, per_cell, FINE_STEPS, blur_cells, most=MOST_CELLS, turning=False, honest=True)


def _rest_fit(problems: tuple[Problem, Problem, Problem], start: Pose, target: Target | None) -> Fit | None:
    """Fit all but the target near it; where there is too little else, what is farther off as well.

    Copper below mask may be all that is near, and hardly seen: it says less than what stands out farther off.
    """
    fine, middle, broad = problems
    for problem, least in ((fine, LEAST_REST), (middle, LEAST_MIDDLE)):
        weights = None
        if target is not None:
            weights = np.where(_rim(problem.sheet.planes.grid, target), np.float32(0.0), np.float32(1.0))
        fit = refine(replace(problem, weights=weights), start)
        if fit is not None and fit.cells >= least and fit.explained >= LEAST_EXPLAINED:
            return fit
    fit = refine(middle, start)
    if fit is not None and fit.explained >= LEAST_EXPLAINED:
        return fit
    return max((f for f in (fit, refine(broad, start)) if f is not None), key=lambda f: f.explained, default=None)


def _inside(grid: Grid, target: Target) -> bool:
    """Whether all of the target's rim lies within the cells."""
    reach = OWN_MARGIN_UM + grid.cell_um
    low = target.outline_um.min(axis=0) - reach >= grid.origin_um
    far = np.asarray(grid.origin_um) + np.array((grid.columns, grid.rows)) * grid.cell_um
    return bool(low.all() and (target.outline_um.max(axis=0) + reach <= far).all())


def _close_up(problem: Problem, target: Target) -> Problem:
    """Return the problem of the target's own metal edge: cells near its rim, weighted by how steep the edge is."""
    sheet = _cut(problem.sheet, target)
    metal_x, metal_y = slopes(sheet.planes.cover[Material.METAL])
    steep = np.minimum(1.0, 4.0 * np.hypot(metal_x, metal_y))
    weights = np.where(_rim(sheet.planes.grid, target), steep, 0.0).astype(np.float32)
    return replace(problem, sheet=sheet, steps=OWN_STEPS, weights=weights)


def _cut(sheet: Sheet, target: Target) -> Sheet:
    """Return the part of a sheet about a target."""
    reach, grid = OWN_MARGIN_UM + 60.0, sheet.planes.grid
    low = (target.outline_um.min(axis=0) - reach - grid.origin_um) / grid.cell_um
    high = (target.outline_um.max(axis=0) + reach - grid.origin_um) / grid.cell_um
    rows = slice(max(0, min(int(low[1]), grid.rows - 8)), min(grid.rows, max(int(high[1]) + 1, 8)))
    columns = slice(max(0, min(int(low[0]), grid.columns - 8)), min(grid.columns, max(int(high[0]) + 1, 8)))
    part = make_sheet(Planes(grid.part(rows, columns), sheet.planes.cover[:, rows, columns]))
    return part if sheet.wholly else without(part, ~sheet.told[rows, columns])


def _rim(grid: Grid, target: Target) -> NDArray[np.bool_]:
    """Return the cells within a margin of the target's outline."""
    reach = max(1, round(OWN_MARGIN_UM / grid.cell_um))
    # Drawn with a border, so that an outline which ends at the window's edge is no rim there.
    inside = np.zeros((grid.rows + 2 * reach, grid.columns + 2 * reach), dtype=np.uint8)
    corners = np.clip((target.outline_um - np.asarray(grid.origin_um)) / grid.cell_um + reach, -1e4, 1e4)
    cv2.fillPoly(inside, [np.round(corners * 16.0).astype(np.int32)], 1, cv2.LINE_8, 4)
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
    rim = cv2.dilate(inside, kernel) != cv2.erode(inside, kernel)
    return np.asarray(rim[reach:-reach, reach:-reach])


def _near_edges(middle: Problem, fit: Fit, materials: tuple[Material, ...]) -> Edges:
    """Judge the edges near; the level of metal too small for these cells is the one of the fine cells."""
    sheet = middle.sheet
    shown, seen = middle.picture.on(sheet.planes.grid, fit.pose, middle.px_per_cell)
    levels = sheet.estimate(shown, seen)
    if fit.levels.measured[Material.METAL] and not levels.measured[Material.METAL]:
        levels.grey[Material.METAL] = fit.levels.grey[Material.METAL]
    step = levels.step if materials == BARE else levels.contrast
    return judge_edges(sheet, shown, sheet.expect(levels), seen, step, materials=materials)


def _target_edges(close: Problem, fit: Fit) -> Edges:
    """Judge the target's edges, both pictures smoothed: a lens out of focus takes no pad away."""
    sheet = close.sheet
    shown, seen = close.picture.on(sheet.planes.grid, fit.pose, close.px_per_cell)
    levels = sheet.estimate(shown, seen)
    where = None if close.weights is None else close.weights > 0.0
    sigma = SMOOTH_UM / sheet.planes.grid.cell_um
    smooth = np.asarray(cv2.GaussianBlur(shown, (0, 0), sigma), dtype=np.float32)
    expected = sheet.expect(levels, float(np.hypot(close.blur_cells, sigma)))
    return judge_edges(sheet, smooth, expected, seen, levels.step, where)


def _joined(rest: Fit, own: Fit | None, nominal: tuple[float, float]) -> Joined:
    """Return the target's place, its covariance and by how much it lies off the rest.

    Both fits are joined by their covariances as long as they agree; else the target's own counts alone.
    """
    floor = np.eye(2) * FLOOR_UM**2
    by_rest = rest.covariance_um2 + floor
    there = np.array(rest.pose.apply(*nominal))
    if own is None:
        return (float(there[0]), float(there[1])), by_rest, (0.0, 0.0)
    alone = np.array(own.pose.apply(*nominal))
    by_own = own.covariance_um2 + floor
    off = alone - there
    strange = float(off @ np.linalg.solve(by_rest + by_own, off)) > DISAGREE_SIGMAS**2
    if strange:
        place, covariance = alone, by_own
    else:
        one, other = np.linalg.inv(own.covariance_um2 + floor / 4), np.linalg.inv(rest.covariance_um2 + floor / 4)
        place = np.linalg.solve(one + other, one @ alone + other @ there)
        covariance = np.linalg.inv(one + other) + floor
    return (float(place[0]), float(place[1])), np.asarray(covariance), (float(off[0]), float(off[1]))


def _answer(
    picture: Picture,
    rest: Fit,
    nominal: tuple[float, float],
    joined: Joined,
    agreement: Agreement,
    edges: tuple[Edges, Edges | None],
    rivals: tuple[Rival, ...],
    reference: Reference,
) -> Registration:
    place, covariance, off = joined
    if reference.shifts != LayerShifts():
        # How far the layers lie off their copper is known no better than this.
        covariance = covariance + np.eye(2) * SHIFTS_UM**2
    if edges[0].soldered:
        covariance = covariance + np.eye(2) * SOLDERED_UM**2
    slope = picture.slope(*place)
    in_px = slope @ covariance @ slope.T
    at = rest.pose.apply(*nominal)
    return Registration(
        shift_um=(at[0] - nominal[0], at[1] - nominal[1]),
        turn_deg=rest.pose.turn_deg,
        target_um=place,
        target_px=picture.to_px(*place),
        covariance_um2=covariance,
        sigma_um=float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])),
        sigma_px=float(np.sqrt(np.linalg.eigvalsh(in_px)[-1])),
        off_rest_um=off,
        agreement=agreement.all,
        metal_seen=agreement.metal,
        near=edges[0],
        at_target=edges[1],
        log_odds=min((rival.log_odds for rival in rivals), default=400.0),
        rivals=rivals,
        levels=_named(rest.levels),
        shifts=reference.shifts,
        assembled=reference.has_parts,
    )


def _named(levels: Levels) -> dict[str, float]:
    return {m.name.lower(): float(levels.grey[m]) for m in Material if levels.measured[m]}
