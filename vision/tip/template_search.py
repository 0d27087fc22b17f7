"""Search for the golden template around its taught place (thesis 5.3.3): where the probe is, roughly.

Only what the probe itself shows is compared, its marking and the light on its metal: what lies beside it may be darker
or brighter than it was at teaching, and counts neither for nor against.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Gray, Plane, parabola
from vision.tip.probe_model import SEARCH_REACH_PX, TEMPLATE_HEIGHT_PX, TEMPLATE_WIDTH_PX, ProbeModel

SHRINK = 4
"""The search runs on a quarter of the size: the edges find the probe to a hundredth of a pixel afterwards."""
TURNS_DEG = (-2.0, 0.0, 2.0)
MOST_MATCHES, WORSE = 3, 0.2
"""A busy background can look more like the template than the probe before it does: other places are kept in hand."""
BORDER_PX = 2.0
"""The border of the probe is left out as well: the lens mixes it with the ground, and the place is a guess."""
NEAR_PX, MOST_RECENTRED, _FINE_STEPS_DEG = 6, 4, (-1.0, 0.0, 1.0)
"""The full size is searched so far about what the shrunk one gave, in turns about the best one."""
TAUGHT_SCORE = 0.95
"""Correlation from which it is the taught probe, or one that is narrower by a sixth at most: before any ground the
taught one comes to 0.97 and more, none to 0.62."""
APART = 2
"""Places closer than this, in shrunk pixels, are one and the same."""


@dataclass(frozen=True, slots=True)
class TemplateMatch:
    """Hold where the template fits best: place of the end in the image, probe angle, correlation -1..1."""

    x_px: float
    y_px: float
    angle_rad: float
    score: float


@dataclass(frozen=True, slots=True)
class _Template:
    """Hold the template at one turn, shrunk: `weights` sum to 1, `pattern` has mean 0, variance 1 over the probe."""

    weights: Plane
    pattern: Plane


def region(model: ProbeModel) -> tuple[int, int, int, int]:
    """Return the part of the image that everything is measured in: x, y, width, height in px."""
    side, up = model.shape.cylinder_half_px + 14.0, model.shape.length_px
    c, s = np.cos(model.angle_rad), np.sin(model.angle_rad)
    u, v = np.array([-up, -up, 12.0, 12.0]), np.array([-side, side, -side, side])
    xs, ys = model.tip_px[0] + u * c - v * s, model.tip_px[1] + u * s + v * c
    x, y, width, height = model.search_roi_px
    x1, y1 = min(int(xs.min()) - SEARCH_REACH_PX // 2, x), min(int(ys.min()) - SEARCH_REACH_PX // 2, y)
    x2 = max(int(xs.max()) + SEARCH_REACH_PX // 2, x + width)
    y2 = max(int(ys.max()) + SEARCH_REACH_PX // 2, y + height)
    # The cylinder may leave the image at the top or the left: its calipers stop there.
    return min(max(x1, 0), x), min(max(y1, 0), y), x2 - min(max(x1, 0), x), y2 - min(max(y1, 0), y)


def search(
    plane: Gray, model: ProbeModel, origin: tuple[int, int], turns_deg: tuple[float, ...] = TURNS_DEG
) -> list[TemplateMatch]:
    """Search the golden template around its taught place by masked normalised correlation (eq. 5.3), turned a little.

    plane: the region's pixels, free of salt and pepper; origin: its top-left pixel in the image. Returns up to
    MOST_MATCHES places, the best first, each clearly apart from the better ones.
    """
    x, y, width, height = model.search_roi_px
    cut = plane[y - origin[1] : y - origin[1] + height, x - origin[0] : x - origin[0] + width]
    small = _shrink(cut)
    squared = np.square(small)
    score = np.stack([_correlate(small, squared, _template(model, turn)) for turn in turns_deg], axis=2)
    found: list[TemplateMatch] = []
    for _ in range(MOST_MATCHES):
        row, column, turn = (int(at) for at in np.unravel_index(int(np.argmax(score)), score.shape))
        best = float(score[row, column, turn])
        if found and best < found[0].score - WORSE:
            break
        dx, dy = SHRINK * column - SEARCH_REACH_PX, SHRINK * row - SEARCH_REACH_PX
        # The template was turned about its own end, so the end moves with the template and nothing else.
        angle = model.angle_rad + float(np.radians(turns_deg[turn]))
        found.append(TemplateMatch(model.tip_px[0] + dx, model.tip_px[1] + dy, angle, best))
        score[max(row - APART, 0) : row + APART + 1, max(column - APART, 0) : column + APART + 1] = -2.0
    return found


def place(plane: Gray, model: ProbeModel, origin: tuple[int, int], match: TemplateMatch) -> TemplateMatch:
    """Return where the template fits best in the pixels themselves, near a match that `search` found.

    The marking is far from the end, so that a degree of turn is pixels there: the turn is refined as well.
    """
    turn = float(np.degrees(match.angle_rad - model.angle_rad))
    for _ in range(MOST_RECENTRED):
        tried = [_place_turned(plane, model, origin, match, turn + step) for step in _FINE_STEPS_DEG]
        k = max(range(len(tried)), key=lambda n: tried[n].score)
        if k == 1:
            break
        turn += _FINE_STEPS_DEG[k]
    best, off = tried[k], parabola(np.array([one.score for one in tried], dtype=np.float32), k)
    beside, share = (tried[k + 1], off) if off > 0.0 else (tried[k - 1], -off)
    return TemplateMatch(
        best.x_px + share * (beside.x_px - best.x_px),
        best.y_px + share * (beside.y_px - best.y_px),
        best.angle_rad + share * (beside.angle_rad - best.angle_rad),
        best.score,
    )


def end_beside_whole(
    plane: Gray, model: ProbeModel, origin: tuple[int, int], match: TemplateMatch, turn_deg: float
) -> tuple[float, float]:
    """Return (x, y), px, by which what lies below the marking fits elsewhere than the whole template, at one turn.

    It is the same in all pictures of one probe, until that is bent.
    """
    whole = _place_turned(plane, model, origin, match, turn_deg)
    end = _place_turned(plane, model, origin, match, turn_deg, end_only=True)
    return end.x_px - whole.x_px, end.y_px - whole.y_px


def _place_turned(
    plane: Gray,
    model: ProbeModel,
    origin: tuple[int, int],
    match: TemplateMatch,
    turn_deg: float,
    *,
    end_only: bool = False,
) -> TemplateMatch:
    corner = model.corner_px[0] - origin[0], model.corner_px[1] - origin[1]
    left = max(round(match.x_px - model.tip_px[0]) + corner[0] - NEAR_PX, 0)
    top = max(round(match.y_px - model.tip_px[1]) + corner[1] - NEAR_PX, 0)
    cut = plane[top : top + TEMPLATE_HEIGHT_PX + 2 * NEAR_PX + 1, left : left + TEMPLATE_WIDTH_PX + 2 * NEAR_PX + 1]
    shown = cut.astype(np.float32)
    score = _correlate(shown, np.square(shown), _template(model, turn_deg, 1, end_only))
    row, column = (int(at) for at in np.unravel_index(int(np.argmax(score)), score.shape))
    dx = left + column - corner[0] + parabola(score[row], column)
    dy = top + row - corner[1] + parabola(score[:, column], row)
    angle = model.angle_rad + float(np.radians(turn_deg))
    return TemplateMatch(model.tip_px[0] + dx, model.tip_px[1] + dy, angle, float(score[row, column]))


def _shrink(plane: Gray, by: int = SHRINK) -> Plane:
    size = (plane.shape[1] // by, plane.shape[0] // by)
    return cv2.resize(plane, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _correlate(small: Plane, squared: Plane, template: _Template) -> Plane:
    """Return the correlation (rows, columns) of every place of the template in `small`."""
    mean = cv2.matchTemplate(small, template.weights, cv2.TM_CCORR)
    square = cv2.matchTemplate(squared, template.weights, cv2.TM_CCORR)
    likeness = cv2.matchTemplate(small, template.pattern, cv2.TM_CCORR)
    # A flat place has no pattern: one level of variance keeps it from being blown up into one.
    return np.asarray(likeness / np.sqrt(np.maximum(square - np.square(mean), 1.0)), dtype=np.float32)


@lru_cache(maxsize=64)
def _template(model: ProbeModel, turn_deg: float, shrink: int = SHRINK, end_only: bool = False) -> _Template:  # noqa: FBT001, FBT002  # a cache's key
    """Return the model's template turned about the probe's end; models are compared by identity."""
    turned, cover = _turned(model, turn_deg, shrink, end_only=end_only)
    weights = np.where(cover > 0.5, 1.0, 0.0)
    weights /= weights.sum()
    pattern = turned - np.sum(weights * turned)
    pattern = weights * pattern / np.sqrt(np.sum(weights * np.square(pattern)) + 1e-6)
    return _Template(weights.astype(np.float32), pattern.astype(np.float32))


def _turned(model: ProbeModel, turn_deg: float, shrink: int, *, end_only: bool) -> tuple[Plane, Plane]:
    """Return the template and the probe's cover (0..1) of it, turned about the probe's end and shrunk."""
    tip = model.tip_px[0] - model.corner_px[0], model.tip_px[1] - model.corner_px[1]
    matrix = cv2.getRotationMatrix2D(tip, -turn_deg, 1.0)
    size = (TEMPLATE_WIDTH_PX, TEMPLATE_HEIGHT_PX)
    inside = np.zeros(size[::-1], dtype=np.uint8)
    cv2.fillPoly(inside, [np.rint(_inner_px(model, end_only=end_only)).astype(np.int32)], (255,))
    turned = cv2.warpAffine(model.template, matrix, size, borderMode=cv2.BORDER_REPLICATE)
    cover = cv2.warpAffine(inside, matrix, size)
    shown, share = (_shrink(np.asarray(plane, dtype=np.uint8), shrink) for plane in (turned, cover))
    return shown, share / 255.0


def _inner_px(model: ProbeModel, *, end_only: bool) -> NDArray[np.float64]:
    """Return the polygon (N, 2) in the template's pixels of the probe, or its end, without its border."""
    outline = model.outline
    kept = outline.u_px > -model.h_px + BORDER_PX if end_only else np.ones(outline.u_px.shape, dtype=np.bool_)
    left, right, rows = outline.left_px[kept] + BORDER_PX, outline.right_px[kept] - BORDER_PX, outline.u_px[kept]
    u, v = np.concatenate([rows, rows[::-1]]), np.concatenate([left, right[::-1]])
    c, s = np.cos(model.angle_rad), np.sin(model.angle_rad)
    x, y = model.tip_px[0] - model.corner_px[0], model.tip_px[1] - model.corner_px[1]
    return np.stack([x + u * c - v * s, y + u * s + v * c], axis=1)
