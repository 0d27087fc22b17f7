"""What else could find the target, in the same frame: TDEA and the constellation, HoughCircles, and OpenCV's matchers.

OpenCV's matchers are given the same drawn CAD (its usual look, 48 um cells) and a picture brought to the board's grid.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.bench.see.artist import Shot
from tests.bench.see.boards import Side
from vision import find_test_points
from vision.core import red_signal
from vision.geometry import match_target
from vision.registration import IndexedSide, LayerShifts, Target
from vision.registration.drawing import Planes, average, draw_labels
from vision.registration.reference import usual_picture

REACH_UM, AGREE_UM = 700.0, 120.0
SEARCH_UM = 3300.0
RIGHT_UM = 100.0


def compare(side: Side, target: Target, shot: Shot, indexed: IndexedSide) -> dict[str, Any]:
    """Return milliseconds, and who found the target."""
    row: dict[str, Any] = {}
    truth = shot.truth_px(target.x_um, target.y_um)
    per_um = _px_per_um(shot.assumed, target)
    nominal = _px(shot.assumed, target.x_um, target.y_um)
    reach = (REACH_UM + AGREE_UM) * per_um
    radius = float(np.ptp(target.outline_um, axis=0).mean()) / 2 * per_um
    seen = _timed(row, "tdea_ms", lambda: find_test_points(shot.frame, around_px=nominal, reach_px=reach,
                                                           expected_radius_px=radius))  # fmt: skip
    if _round(target):
        row["old"] = _old_way(side, target, shot, seen, truth, per_um)
    plane = red_signal(shot.frame)
    _timed(row, "hough_ms", lambda: _hough(plane, nominal, reach, radius))
    for name, found in _matchers(row, plane, shot.assumed, _drawn(indexed, target)).items():
        real = _px(shot.assumed, target.x_um + found[0], target.y_um + found[1])
        row[f"{name}_off_px"] = round(float(np.hypot(real[0] - truth[0], real[1] - truth[1])), 2)
    return row


def _timed(row: dict[str, Any], name: str, work: Callable[[], Any]) -> Any:
    start = time.process_time()
    result = work()
    row[name] = 1e3 * (time.process_time() - start)
    return result


def _round(target: Target) -> bool:
    """Whether the patch of metal is about a disc: what today's way can look for."""
    width, height = np.ptp(target.outline_um, axis=0)
    area = cv2.contourArea(target.outline_um.astype(np.float32))
    return bool(abs(width - height) < 60.0 and 0.72 < area / (width * height) < 0.83)


def _old_way(side: Side, target: Target, shot: Shot, seen: Any, truth: tuple[float, float], per_um: float) -> str:
    """Choose among TDEA's pads by CAD's constellation, as a station without registration does."""
    back = np.linalg.inv(shot.assumed)
    size = float(np.ptp(target.outline_um, axis=0).mean())
    alike = [target] + [
        other for other in side.targets
        if other is not target and _round(other)
        and abs(float(np.ptp(other.outline_um, axis=0).mean()) - size) < 0.15 * size
    ]  # fmt: skip
    here = np.array((target.x_um, target.y_um))
    cad = np.array([(other.x_um, other.y_um) for other in alike]) - here
    pads = [(pad.x_px, pad.y_px) for pad in seen.taken]
    doubtful = [(item.object.x_px, item.object.y_px) for item in seen.undecided]

    def places(pixels: list[tuple[float, float]]) -> NDArray[np.float64]:
        if not pixels:
            return np.empty((0, 2))
        return np.asarray(cv2.perspectiveTransform(np.array([pixels]), back)[0] - here)

    match = match_target(places(pads), cad, max_shift_um=REACH_UM, tolerance_um=AGREE_UM, reach_um=REACH_UM,
                         doubtful_um=places(doubtful))  # fmt: skip
    if not match:
        return "refused"
    found = pads[match.index]
    return "right" if np.hypot(found[0] - truth[0], found[1] - truth[1]) < RIGHT_UM * per_um else "wrong"


def _hough(plane: NDArray[np.uint8], around: tuple[float, float], reach: float, radius: float) -> Any:
    x, y, half = round(around[0]), round(around[1]), round(reach + 2 * radius)
    part = plane[max(0, y - half) : y + half, max(0, x - half) : x + half]
    smooth = cv2.medianBlur(np.ascontiguousarray(part), 5)
    return cv2.HoughCircles(smooth, cv2.HOUGH_GRADIENT, 1.0, max(4.0, radius), param1=100, param2=12,
                            minRadius=max(2, round(0.8 * radius)), maxRadius=round(1.25 * radius) + 1)  # fmt: skip


def _drawn(indexed: IndexedSide, target: Target) -> Planes:
    """Return CAD in 48 um cells to +-6.7 mm about the target."""
    corner = (target.x_um - 6720.0, target.y_um - 6720.0)
    return average(draw_labels(indexed, corner, 16.0, 840, LayerShifts()), corner, 16.0, 3)


def _matchers(
    row: dict[str, Any], plane: NDArray[np.uint8], assumed: NDArray[np.float64], cad: Planes
) -> dict[str, tuple[float, float]]:
    """Return the shift (um) by each of OpenCV's matchers."""
    cell = cad.grid.cell_um
    look = usual_picture(cad)
    middle, half, reach = cad.grid.rows // 2, round(3000.0 / cell), round(SEARCH_UM / cell)
    window = cad.grid.part(slice(middle - half, middle + half), slice(middle - half, middle + half))
    shown = cv2.warpPerspective(
        cv2.blur(plane, (4, 4)), assumed @ window.to_um, (2 * half, 2 * half),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    ).astype(np.float32)  # fmt: skip
    field = look[middle - half - reach : middle + half + reach, middle - half - reach : middle + half + reach]
    likeness = _timed(row, "match_template_ms", lambda: cv2.matchTemplate(field, shown, cv2.TM_CCOEFF_NORMED))
    _, _, _, at = cv2.minMaxLoc(likeness)
    found = {"match_template": ((reach - at[0]) * cell, (reach - at[1]) * cell)}
    same = look[middle - half : middle + half, middle - half : middle + half]
    (dx, dy), _ = _timed(row, "phase_ms", lambda: cv2.phaseCorrelate(same, shown / 200.0,
                                                                     cv2.createHanningWindow((2 * half, 2 * half),
                                                                                             cv2.CV_32F)))  # fmt: skip
    found["phase"] = (dx * cell, dy * cell)
    warp = np.eye(2, 3, dtype=np.float32)
    try:
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-4)
        _timed(row, "ecc_ms", lambda: cv2.findTransformECC(same, shown, warp, cv2.MOTION_EUCLIDEAN, criteria))
        found["ecc"] = (float(warp[0, 2]) * cell, float(warp[1, 2]) * cell)
    except cv2.error:
        found["ecc"] = (np.inf, np.inf)
    return found


def _px(h: NDArray[np.float64], x_um: float, y_um: float) -> tuple[float, float]:
    x, y, w = h @ (x_um, y_um, 1.0)
    return float(x / w), float(y / w)


def _px_per_um(h: NDArray[np.float64], target: Target) -> float:
    one, other = _px(h, target.x_um, target.y_um), _px(h, target.x_um + 100.0, target.y_um)
    return float(np.hypot(one[0] - other[0], one[1] - other[1])) / 100.0
