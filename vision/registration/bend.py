"""Bend of a map to pixels far from the tip, learned from the board itself.

A pose map is fitted to a walk of a millimetre and says little of perspective: 6 mm from the tip it may be 0.4 mm off,
and registration compares that far. Once the board is registered about the tip, patches of CAD all over the view are
found where they are seen. What comes out is a homography from pixels as mapped to pixels as seen, nearly the identity
at the tip; it belongs to camera, map and the height at which the tip hovers, and holds for all looks from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr, Plane, check_bgr, parabola, red_signal
from vision.registration.answer import Registration
from vision.registration.drawing import IndexedSide, LayerShifts, Material, draw_labels
from vision.registration.rectify import Pose
from vision.registration.reference import USUAL_LEVEL

Array = NDArray[np.float64]

REACH_UM, TEXEL_UM, CELL_UM = 9000.0, 12.0, 24.0
PATCH_UM, SEARCHES_UM = 900.0, (400.0, 200.0, 100.0, 60.0)
"""Half a patch; how far each pass looks for it. By two passes the far parts stayed up to half a percent off."""
PITCH_UM, LEAST_PLACES = 1200.0, 16
LEAST_SPREAD_PX = 450.0
"""Width and height of what the patches span: from less the far parts cannot be told."""
LEAST_LIKENESS, MOST_UNKNOWN = 0.6, 0.3
LEAST_STRUCTURE = 0.004
"""Mean square slope, per cell, of CAD's usual look along the direction in which it changes least."""
SMOOTH_PX = 0.8
NEAR_UM = 500.0
"""About the tip the map is right."""
MOST_RMS_PX = 1.5
CUT, LEAST_CUT_PX = 3.0, 1.0
LEAST_KEPT = 0.6
UNIT_PX = 1000.0


@dataclass(frozen=True)
class _Window:
    """CAD's usual look in cells about a place, what of it nobody knows, and its corner."""

    look: Plane
    unknown: Plane
    corner_um: tuple[float, float]

    def cell(self, place_um: Array) -> tuple[int, int]:
        column, row = (round((float(place_um[k]) - self.corner_um[k]) / CELL_UM - 0.5) for k in (0, 1))
        return row, column


def find_bend(
    side: IndexedSide,
    red_bgr: Bgr,
    board_to_px: Array,
    start: tuple[tuple[float, float], Registration],
    hidden_px: Sequence[Array] = (),
) -> Array | None:
    """Return the homography (3, 3) from pixels as mapped to pixels as seen; None where too little can be measured.

    board_to_px: by the map alone. start: the place below the tip, and how the board was registered about it.
    hidden_px: what stands before the board. It takes a tenth to a fifth of a second.
    """
    about_um, found = start
    window = _draw(side, about_um, found.shifts)
    signal = red_signal(check_bgr(red_bgr)).astype(np.float32)
    plane = np.asarray(cv2.GaussianBlur(signal, (0, 0), SMOOTH_PX), dtype=np.float32)
    laid = Pose(*found.shift_um, found.turn_deg, about_um).matrix
    assumed: Array = board_to_px @ laid
    whole, rms_px = assumed, np.inf
    places = _choose(window)
    for search_um in SEARCHES_UM:
        seen = _find(window, plane, whole, places, search_um, hidden_px)
        if len(seen) < LEAST_PLACES:
            return None
        whole, rms_px = _fit(assumed, seen, about_um)
    if rms_px > MOST_RMS_PX:
        return None
    bend = whole @ np.linalg.inv(board_to_px @ _near_pose(whole, board_to_px, about_um))
    return np.asarray(bend / bend[2, 2])


def _draw(side: IndexedSide, about_um: tuple[float, float], shifts: LayerShifts) -> _Window:
    texels = 2 * round(REACH_UM / TEXEL_UM)
    corner = about_um[0] - REACH_UM, about_um[1] - REACH_UM
    labels = draw_labels(side, corner, TEXEL_UM, texels, shifts)
    size = (texels // 2, texels // 2)
    look = cv2.resize(USUAL_LEVEL[labels], size, interpolation=cv2.INTER_AREA)
    unknown = cv2.resize((labels == Material.UNKNOWN).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return _Window(np.asarray(look, dtype=np.float32), np.asarray(unknown, dtype=np.float32), corner)


def _choose(window: _Window) -> list[Array]:
    """Return the middles of patches, on a grid, in which CAD has something that tells both directions."""
    half = round((PATCH_UM + SEARCHES_UM[0]) / CELL_UM) + 1
    step, size = round(PITCH_UM / CELL_UM), round(PATCH_UM / CELL_UM)
    slope_x, slope_y = (cv2.Sobel(window.look, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
    products = [a * b for a, b in ((slope_x, slope_x), (slope_x, slope_y), (slope_y, slope_y))]
    xx, xy, yy = (cv2.boxFilter(product, -1, (2 * size, 2 * size)) for product in products)
    weaker = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    cells = range(half, window.look.shape[0] - half, step)
    corner = np.asarray(window.corner_um)
    return [
        corner + (np.array((column, row)) + 0.5) * CELL_UM
        for row in cells
        for column in cells
        if float(weaker[row, column]) > LEAST_STRUCTURE
    ]


def _find(
    window: _Window,
    plane: Plane,
    board_to_px: Array,
    places: list[Array],
    search_um: float,
    hidden_px: Sequence[Array],
) -> list[tuple[Array, Array]]:
    """Return the places that are seen, each with the pixel at which it is seen."""
    x_um, y_um = (corner + CELL_UM / 2 for corner in window.corner_um)
    to_um = np.array([[CELL_UM, 0.0, x_um], [0.0, CELL_UM, y_um], [0.0, 0.0, 1.0]])
    rows, columns = window.look.shape
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    shown = cv2.warpPerspective(plane, board_to_px @ to_um, (columns, rows), flags=flags, borderValue=0.0)
    clear = np.full(plane.shape, 255, dtype=np.uint8)
    for polygon in hidden_px:
        cv2.fillPoly(clear, [np.round(polygon).astype(np.int32)], 0)
    seen = cv2.warpPerspective(clear, board_to_px @ to_um, (columns, rows), flags=flags, borderValue=0.0)
    half, reach = round(PATCH_UM / CELL_UM), round(search_um / CELL_UM)
    found = []
    for place in places:
        row, column = window.cell(place)
        patch = np.s_[row - half : row + half, column - half : column + half]
        wide = np.s_[row - half - reach : row + half + reach, column - half - reach : column + half + reach]
        if float(window.unknown[patch].mean()) > MOST_UNKNOWN or float(seen[wide].min()) < 250.0:
            continue
        likeness = cv2.matchTemplate(np.ascontiguousarray(shown[wide]), window.look[patch].copy(), cv2.TM_CCOEFF_NORMED)
        top = _top(np.asarray(likeness, dtype=np.float32), reach)
        if top is not None:
            found.append((place, _apply(board_to_px, (place + np.array(top) * CELL_UM)[None])[0]))
    return found


def _top(likeness: Plane, reach: int) -> tuple[float, float] | None:
    """Return the shift (x, y), cells, at which a patch is most like what is seen; None where it is at the rim."""
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(likeness)), likeness.shape))
    inside = 0 < row < likeness.shape[0] - 1 and 0 < column < likeness.shape[1] - 1
    if not inside or not float(likeness[row, column]) >= LEAST_LIKENESS:
        return None
    dx, dy = parabola(likeness[row], column), parabola(likeness[:, column], row)
    return column + dx - reach, row + dy - reach


def _fit(assumed: Array, seen: list[tuple[Array, Array]], about_um: tuple[float, float]) -> tuple[Array, float]:
    """Fit the map from CAD to pixels to what was seen, strangers left out; return it and its rms, px."""
    places, there = (np.array([pair[k] for pair in seen]) for k in (0, 1))
    tip = _apply(assumed, np.array([about_um]))[0]
    start, end = (_apply(assumed, places) - tip) / UNIT_PX, (there - tip) / UNIT_PX
    kept, bend, off = np.ones(len(start), dtype=bool), np.eye(3), np.zeros(len(start))
    for _ in range(5):
        bend = _solve(start[kept], end[kept])
        off = np.linalg.norm(_apply(bend, start) - end, axis=1) * UNIT_PX
        kept = off <= max(LEAST_CUT_PX, CUT * 1.48 * float(np.median(off)))
    scaled = np.array([[1 / UNIT_PX, 0.0, -tip[0] / UNIT_PX], [0.0, 1 / UNIT_PX, -tip[1] / UNIT_PX], [0.0, 0.0, 1.0]])
    whole: Array = np.asarray(np.linalg.inv(scaled) @ bend @ scaled @ assumed)
    count = int(np.count_nonzero(kept))
    wide = bool((np.ptp(there[kept], axis=0) >= LEAST_SPREAD_PX).all())
    enough = wide and count >= max(LEAST_PLACES, LEAST_KEPT * len(seen))
    return whole, float(np.sqrt(np.mean(off[kept] ** 2))) if enough else np.inf


def _solve(start: Array, end: Array) -> Array:
    """Return the homography by linear least squares, which serves near to the identity."""
    (x, y), (u, v) = start.T, end.T
    one, nil = np.ones_like(x), np.zeros_like(x)
    rows = np.vstack(
        (
            np.column_stack((x, y, one, nil, nil, nil, -u * x, -u * y)),
            np.column_stack((nil, nil, nil, x, y, one, -v * x, -v * y)),
        )
    )
    found, *_ = np.linalg.lstsq(rows, np.concatenate((u, v)), rcond=1e-9)
    return np.append(found, 1.0).reshape(3, 3)


def _near_pose(whole: Array, board_to_px: Array, about_um: tuple[float, float]) -> Array:
    """Return how the board lies by what is seen about the tip, where the map is right: a turn and a shift, (3, 3)."""
    turns = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    ring = np.asarray(about_um) + NEAR_UM * np.column_stack((np.cos(turns), np.sin(turns)))
    back: Array = np.asarray(np.linalg.inv(board_to_px))
    there = _apply(back, _apply(whole, ring))
    one, other = ring - ring.mean(axis=0), there - there.mean(axis=0)
    turn = np.arctan2(float((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum()), float((one * other).sum()))
    c, s = float(np.cos(turn)), float(np.sin(turn))
    shift = there.mean(axis=0) - np.array([[c, -s], [s, c]]) @ ring.mean(axis=0)
    return np.array([[c, -s, shift[0]], [s, c, shift[1]], [0.0, 0.0, 1.0]])


def _apply(homography: Array, points: Array) -> Array:
    mapped = np.column_stack((points, np.ones(len(points)))) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])
