"""Refinement of a hypothesis: Gauss-Newton on shift and turn, over edge cells alone, robustly weighted.

The picture is brought to CAD's cells as they lie by the hypothesis; what is left between it and the expected picture
is explained by a small shift and turn (inverse compositional alignment, Baker and Matthews 2004).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration.rectify import Picture, Pose
from vision.registration.sheet import Levels, Sheet, middle

TURN_PRIOR_DEG = 0.3
CUT_SIGMAS = 2.5
LEAST_CELLS = 12
MOST_CELLS = 1.5
"""No step goes farther: beyond that the slopes say nothing."""
_EDGE_SHARE = 0.06
"""A cell is at an edge where the expected picture changes by so much of the contrast from cell to cell."""
_TILE_UM = 240.0
"""Errors within such a tile go together (relief, weave, a lamp's gradient); beyond it they do not."""
_NO_COVARIANCE = np.full((2, 2), np.nan)

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A hypothesis refined: pose, levels, share of the variance at edges explained, covariance (2, 2) um2."""

    pose: Pose
    levels: Levels
    explained: float
    covariance_um2: Array
    cells: int


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What to fit. blur_cells: of the lens. weights (rows, columns): of cells. most: edge cells used, strided.

    turning: the turn is fitted as well, which is about `turn_deg`. honest: the covariance is wanted.
    still_cells: a step as short ends it.
    """

    sheet: Sheet
    picture: Picture
    px_per_cell: float
    steps: int
    blur_cells: float = 0.0
    weights: NDArray[np.float32] | None = None
    most: int = 1500
    turning: bool = True
    turn_deg: float = 0.0
    honest: bool = False
    still_cells: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class _EdgeCells:
    """Edge cells: place from the pose's centre (um), change along x and y (grey per cell), expected, shown, weight."""

    x_um: Array
    y_um: Array
    along_x: Plane
    along_y: Plane
    expected: Plane
    shown: Plane
    weight: Array


def refine(problem: Problem, start: Pose) -> Fit | None:
    """Refine a pose; None where too little can be seen."""
    pose, last = start, None
    for k in range(problem.steps):
        last = _step(problem, pose, final=k == problem.steps - 1)
        if last is None:
            return None
        moved = math.hypot(last.pose.x_um - pose.x_um, last.pose.y_um - pose.y_um)
        pose = last.pose
        if moved < problem.still_cells * problem.sheet.planes.grid.cell_um:
            break
    return last


def _step(problem: Problem, pose: Pose, *, final: bool) -> Fit | None:
    sheet = problem.sheet
    shown, usable = problem.picture.on(sheet.planes.grid, pose, problem.px_per_cell)
    levels = sheet.estimate(shown, usable)
    usable &= sheet.known
    expected = sheet.expect(levels, problem.blur_cells)
    cells = _edge_cells(problem, pose, levels, expected, shown, usable)
    if cells is None:
        return None
    return _solve(problem, pose, levels, cells, final=final)


def slopes(plane: Plane) -> tuple[Plane, Plane]:
    """Return the change per cell along x and y by central differences."""
    kernel = np.array([[-0.5, 0.0, 0.5]], dtype=np.float32)
    along_x = cv2.filter2D(plane, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    along_y = cv2.filter2D(plane, cv2.CV_32F, kernel.T, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(along_x, dtype=np.float32), np.asarray(along_y, dtype=np.float32)


def _edge_cells(
    problem: Problem, pose: Pose, levels: Levels, expected: Plane, shown: Plane, usable: NDArray[np.bool_]
) -> _EdgeCells | None:
    along_x, along_y = slopes(expected)
    least = max(_EDGE_SHARE * levels.contrast, 0.3)
    edges = usable & (along_x * along_x + along_y * along_y > least * least)
    if problem.weights is not None:
        edges &= problem.weights > 0.0
    flat = np.flatnonzero(edges)
    if len(flat) < LEAST_CELLS:
        return None
    flat = flat[:: max(1, len(flat) // problem.most)]
    rows, columns = np.divmod(flat, edges.shape[1])
    grid = problem.sheet.planes.grid
    return _EdgeCells(
        grid.origin_um[0] + columns * grid.cell_um - pose.about_um[0],
        grid.origin_um[1] + rows * grid.cell_um - pose.about_um[1],
        along_x.ravel()[flat],
        along_y.ravel()[flat],
        expected.ravel()[flat],
        shown.ravel()[flat],
        np.ones(len(flat)) if problem.weights is None else problem.weights.ravel()[flat].astype(np.float64),
    )


def _solve(problem: Problem, pose: Pose, levels: Levels, cells: _EdgeCells, *, final: bool) -> Fit | None:
    cell_um = problem.sheet.planes.grid.cell_um
    design = _design(cells, cell_um, turning=problem.turning)
    residual = (cells.shown - cells.expected).astype(np.float64)
    spread = 1.4826 * middle(np.abs(residual - middle(residual))) + 0.5
    weight = cells.weight / (1.0 + (residual / (CUT_SIGMAS * spread)) ** 2) ** 2
    weighted = design * weight[:, None]
    normal = design.T @ weighted
    normal[np.diag_indices_from(normal)] += 1e-9
    pull = weighted.T @ residual
    if problem.turning:
        firm = (spread / TURN_PRIOR_DEG) ** 2
        normal[4, 4] += firm
        pull[4] -= firm * (pose.turn_deg - problem.turn_deg)
    try:
        inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    found = inverse @ pull
    # Slopes are along CAD's axes; the pose is told in the frame as assumed.
    axes = pose.matrix[:2, :2]
    move = axes @ np.clip(found[:2], -MOST_CELLS * cell_um, MOST_CELLS * cell_um)
    turn = pose.turn_deg + float(np.clip(found[4], -0.5, 0.5)) if problem.turning else pose.turn_deg
    moved = replace(pose, x_um=pose.x_um + float(move[0]), y_um=pose.y_um + float(move[1]), turn_deg=turn)
    covariance = _NO_COVARIANCE
    if problem.honest and (final or math.hypot(*move) < problem.still_cells * cell_um):
        scores = weighted * (residual - design @ found)[:, None]
        covariance = np.asarray(axes @ _sandwich(inverse, scores, cells) @ axes.T, dtype=np.float64)
    variance = float(cells.shown.var())
    explained = 1.0 - float(np.mean(residual * residual)) / variance if variance > 0.0 else 0.0
    return Fit(moved, levels, explained, covariance, len(residual))


def _design(cells: _EdgeCells, cell_um: float, *, turning: bool) -> Array:
    """Return (N, 4 or 5): what a um along x, along y, a grey of offset, a share of gain, and a degree do."""
    design = np.empty((len(cells.x_um), 5 if turning else 4))
    design[:, 0], design[:, 1] = -cells.along_x / cell_um, -cells.along_y / cell_um
    design[:, 2], design[:, 3] = 1.0, cells.expected - cells.expected.mean()
    if turning:
        design[:, 4] = math.radians(1.0) * (design[:, 1] * cells.x_um - design[:, 0] * cells.y_um)
    return design


def _sandwich(inverse: Array, scores: Array, cells: _EdgeCells) -> Array:
    """Return the covariance (2, 2) of the shift: scores are summed by tiles, for errors of neighbours go together."""
    tile = (np.floor(cells.x_um / _TILE_UM) * 4096 + np.floor(cells.y_um / _TILE_UM)).astype(np.int64)
    _, index = np.unique(tile, return_inverse=True)
    count = int(index.max()) + 1
    sums = np.stack([np.bincount(index, scores[:, k], minlength=count) for k in range(scores.shape[1])], axis=1)
    middle = sums.T @ sums * (count / max(count - 1, 1))
    return np.asarray((inverse @ middle @ inverse)[:2, :2])
