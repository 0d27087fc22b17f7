"""Outlines of bare metal as CAD has them, and whether a picture shows them: for drawings, not for decisions."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr, check_bgr, red_signal
from vision.registration.answer import NotRegistered, Registration
from vision.registration.drawing import IndexedSide, LayerShifts, Material, draw_labels
from vision.registration.edges import CONFIRMED, CONTRADICTED
from vision.registration.rectify import HIDDEN_MARGIN_PX, Pose

Array = NDArray[np.float64]

TEXEL_UM = 12.0
ASIDE_PX = 3.0
"""How far beside an edge the picture is asked, px."""
EVERY_PX = 3.0
LEAST_STEP = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class EdgeMarks:
    """Points (N, 2), px, on metal edges where registration puts them: seen, not so, hidden, and of doubtful slope."""

    confirmed: Array
    contradicted: Array
    hidden: Array
    weak: Array


def mark_edges(
    side: IndexedSide,
    red_bgr: Bgr,
    board_to_px: Array,
    about_um: tuple[float, float],
    answer: Registration | NotRegistered,
    hidden_px: tuple[Array, ...] = (),
    half_um: float = 5000.0,
) -> EdgeMarks:
    """Lay CAD's metal on the picture as the answer, or what came nearest to one, has it lie."""
    found = answer.best if isinstance(answer, NotRegistered) else answer
    pose = Pose() if found is None else Pose(*found.shift_um, found.turn_deg, about_um)
    shifts = LayerShifts() if found is None else found.shifts
    plane = np.asarray(cv2.GaussianBlur(red_signal(check_bgr(red_bgr)), (0, 0), 1.0), dtype=np.float32)
    points, inwards = _edges(side, board_to_px @ pose.matrix, about_um, shifts, half_um)
    rows, columns = plane.shape
    border = ASIDE_PX + 1.0
    inside = ((points >= border) & (points < np.array((columns, rows)) - border)).all(axis=1)
    points, inwards = points[inside], inwards[inside]
    hidden = np.zeros(len(points), dtype=bool)
    for polygon in hidden_px:
        cover = np.zeros(plane.shape, dtype=np.uint8)
        corners = [np.round(polygon).astype(np.int32)]
        cv2.fillPoly(cover, corners, 1)
        cv2.polylines(cover, corners, isClosed=True, color=1, thickness=2 * HIDDEN_MARGIN_PX + 1)
        hidden |= cover[np.round(points[:, 1]).astype(int), np.round(points[:, 0]).astype(int)] > 0
    rise = _at(plane, points + inwards * ASIDE_PX) - _at(plane, points - inwards * ASIDE_PX)
    step = _step(found, rise)
    yes, no = ~hidden & (rise > CONFIRMED * step), ~hidden & (rise < CONTRADICTED * step)
    return EdgeMarks(points[yes], points[no], points[hidden], points[~hidden & ~yes & ~no])


def _step(found: Registration | None, rise: Array) -> float:
    """Return the step from mask to metal; where nothing was registered, what the picture's clearest edges show."""
    if found is not None and "metal" in found.levels and "mask" in found.levels:
        return max(LEAST_STEP, found.levels["metal"] - found.levels["mask"])
    return max(LEAST_STEP, float(np.percentile(rise, 90)) if len(rise) else 0.0)


def _edges(
    side: IndexedSide, to_px: Array, about_um: tuple[float, float], shifts: LayerShifts, half_um: float
) -> tuple[Array, Array]:
    """Return points on the edges of bare metal, px, and the direction into the metal, both (N, 2)."""
    texels = round(2 * half_um / TEXEL_UM)
    corner = about_um[0] - half_um, about_um[1] - half_um
    metal = (draw_labels(side, corner, TEXEL_UM, texels, shifts) == Material.METAL).astype(np.uint8)
    smooth = cv2.GaussianBlur(metal.astype(np.float32), (0, 0), 2.0)
    slope = np.dstack((cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)))
    contours, _ = cv2.findContours(metal, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cells = [contour[:, 0, :] for contour in contours if len(contour) >= 8]
    if not cells:
        return np.empty((0, 2)), np.empty((0, 2))
    at = np.vstack(cells)[:: max(1, round(EVERY_PX))]
    at = at[((at > 1) & (at < texels - 2)).all(axis=1)]  # the window's border is no edge
    um = (at + 0.5) * TEXEL_UM + np.asarray(corner)
    way = slope[at[:, 1], at[:, 0]].astype(np.float64)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    points, beyond = _apply(to_px, um), _apply(to_px, um + way * TEXEL_UM)
    inwards = beyond - points
    inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
    return points, inwards


def _at(plane: NDArray[np.float32], points: Array) -> Array:
    columns, rows = np.round(points).astype(int).T
    return np.asarray(plane[rows, columns], dtype=np.float64)


def _apply(homography: Array, points: Array) -> Array:
    mapped = np.column_stack((points, np.ones(len(points)))) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])
