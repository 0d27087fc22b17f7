"""Search the golden template around its taught place (thesis 5.3.3): where the needle is, roughly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from vision.image import Gray, median
from vision.probe_model import SEARCH_REACH_PX, TEMPLATE_HEIGHT_PX, TEMPLATE_WIDTH_PX, ProbeModel
from vision.tip_strip import CALIPER_STEP_PX, CYLINDER_LENGTH_PX, RIM_CLEARANCE_PX

# Template search: fourth-size with these turns first, then half-size near the best.
SEARCH_TURNS_DEG = (-2.4, 0.0, 2.4)


@dataclass(frozen=True, slots=True)
class Match:
    """Hold where the template fits best: place of the end in the frame, needle angle, correlation -1..1."""

    x_px: float
    y_px: float
    angle_rad: float
    score: float


def region(model: ProbeModel) -> tuple[int, int, int, int]:
    """Return the part of the frame that everything is measured in: x, y, width, height in px."""
    shape = model.shape
    up = shape.end_to_rim_px + shape.marking_px + RIM_CLEARANCE_PX + CYLINDER_LENGTH_PX + CALIPER_STEP_PX
    side = shape.cylinder_half_px + 14.0
    c, s = np.cos(model.angle_rad), np.sin(model.angle_rad)
    u, v = np.array([-up, -up, 12.0, 12.0]), np.array([-side, side, -side, side])
    xs, ys = model.tip_px[0] + u * c - v * s, model.tip_px[1] + u * s + v * c
    x, y, width, height = model.search_roi_px
    x1, y1 = min(int(xs.min()) - SEARCH_REACH_PX // 2, x), min(int(ys.min()) - SEARCH_REACH_PX // 2, y)
    x2 = max(int(xs.max()) + SEARCH_REACH_PX // 2, x + width)
    y2 = max(int(ys.max()) + SEARCH_REACH_PX // 2, y + height)
    # The cylinder may leave the picture at the top or the left: its calipers stop there.
    return min(max(x1, 0), x), min(max(y1, 0), y), x2 - min(max(x1, 0), x), y2 - min(max(y1, 0), y)


def search(plane: Gray, model: ProbeModel, origin: tuple[int, int]) -> Match:
    """Search the golden template around its taught place, coarse to fine, by masked normalised correlation."""
    x, y, width, height = model.search_roi_px
    cut = plane[y - origin[1] : y - origin[1] + height, x - origin[0] : x - origin[0] + width]
    around = median(np.ascontiguousarray(cut), 7)
    best, best_turn, best_at = -2.0, 0.0, (0.0, 0.0)
    small = _shrink(around, 4)
    for turn in SEARCH_TURNS_DEG:
        score, at = _correlate(small, model, turn, 4)
        if score > best:
            best, best_turn, best_at = score, turn, at
    margin = 6.0
    left, top = (int(max(0.0, 4.0 * at - margin)) // 2 * 2 for at in best_at)
    near = around[top : top + TEMPLATE_HEIGHT_PX + 2 * int(margin), left : left + TEMPLATE_WIDTH_PX + 2 * int(margin)]
    score, at = _correlate(_shrink(near, 2), model, best_turn, 2)
    corner_x, corner_y = x + left + 2.0 * at[0], y + top + 2.0 * at[1]
    dx, dy = corner_x - model.corner_px[0], corner_y - model.corner_px[1]
    # The template was turned about its own end, so the end moves with the template and nothing else.
    return Match(model.tip_px[0] + dx, model.tip_px[1] + dy, model.angle_rad + float(np.radians(best_turn)), score)


def _shrink(plane: Gray, by: int) -> Gray:
    size = (plane.shape[1] // by, plane.shape[0] // by)
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _correlate(region: Gray, model: ProbeModel, turn_deg: float, by: int) -> tuple[float, tuple[float, float]]:
    """Return the best masked correlation of the template, turned and shrunk, and its corner (x, y) in `region`."""
    template, cover = _turned(model, turn_deg, by)
    result = cv2.matchTemplate(region, template, cv2.TM_CCOEFF_NORMED, mask=cover)
    result = np.where(np.isfinite(result) & (np.abs(result) <= 1.01), result, -1.0).astype(np.float32)
    _, score, _, at = cv2.minMaxLoc(result)
    return float(score), (float(at[0]), float(at[1]))


@lru_cache(maxsize=16)
def _turned(model: ProbeModel, turn_deg: float, by: int) -> tuple[Gray, Gray]:
    """Return template and mask (0/1), turned about the needle's end and shrunk; models are compared by identity."""
    tip = model.tip_px[0] - model.corner_px[0], model.tip_px[1] - model.corner_px[1]
    matrix = cv2.getRotationMatrix2D(tip, -turn_deg, 1.0)
    size = (TEMPLATE_WIDTH_PX, TEMPLATE_HEIGHT_PX)
    template = cv2.warpAffine(model.template, matrix, size, borderMode=cv2.BORDER_REPLICATE)
    mask = cv2.warpAffine(model.template_mask, matrix, size)
    cover = _shrink(np.asarray(mask, dtype=np.uint8), by) > 127
    return _shrink(np.asarray(template, dtype=np.uint8), by), cover.astype(np.uint8)
