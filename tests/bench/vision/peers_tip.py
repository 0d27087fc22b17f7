"""The tip finders others would use, taught on the golden picture: what they get wrong there is taken off later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.bench.vision.scenes import Frame, Point, TipKit, TipScene

Plane = NDArray[np.uint8]
Floats = NDArray[np.float64]
# The end is looked for this far round its taught place, as ours is.
REACH_PX = 28
TURN_LIMIT_DEG = 4.5
# The golden template of the thesis: 116 x 220 px from just below the end upwards.
TEMPLATE_PX, BELOW_PX = (116, 220), 8
TURNS_DEG = tuple(float(turn) for turn in range(-4, 5))
LEAST_SCORE = 0.5
# Across the taper, between its end and the marking.
SCAN_LINES = 60


@dataclass(frozen=True)
class Pose:
    """The end and the needle's direction towards it."""

    x: float
    y: float
    angle_rad: float


def plane_of(bgr: Frame) -> Plane:
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def along(pose: Pose, u: float | Floats, v: float | Floats) -> tuple[Floats, Floats]:
    """Return image points u px beyond the end along the needle, v px across it."""
    c, s = np.cos(pose.angle_rad), np.sin(pose.angle_rad)
    return np.asarray(pose.x + u * c - v * s), np.asarray(pose.y + u * s + v * c)


def _moved(pose: Pose, offset: Point) -> Point:
    x, y = along(pose, offset[0], offset[1])
    return float(x), float(y)


def taught(find: Callable[[Frame, TipKit], Pose | None]) -> Callable[[TipScene], Point | None]:
    """Return a finder that takes off the error (along and across the needle) it makes on the golden picture."""

    @cache
    def offset(kit: TipKit) -> Point:
        pose = find(kit.golden_bgr, kit)
        if pose is None:
            return 0.0, 0.0
        dx, dy = kit.tip_px[0] - pose.x, kit.tip_px[1] - pose.y
        c, s = np.cos(pose.angle_rad), np.sin(pose.angle_rad)
        return float(dx * c + dy * s), float(dy * c - dx * s)

    def found(scene: TipScene) -> Point | None:
        pose = find(scene.white_bgr, scene.kit)
        return None if pose is None else _moved(pose, offset(scene.kit))

    return found


@cache
def _templates(kit: TipKit) -> tuple[list[Plane], Point]:
    """Return the template turned about the end by each of TURNS_DEG, and the end's place in it."""
    golden = cv2.medianBlur(plane_of(kit.golden_bgr), 7)
    (width, height), (x, y) = TEMPLATE_PX, kit.tip_px
    lean = (height - BELOW_PX) / np.tan(kit.angle_rad)
    corner = round(x - lean / 2 - width / 2), round(y - height + BELOW_PX)
    cut = np.s_[corner[1] : corner[1] + height, corner[0] : corner[0] + width]
    size = golden.shape[::-1]
    turned = [cv2.warpAffine(golden, cv2.getRotationMatrix2D((x, y), -turn, 1.0), size)[cut] for turn in TURNS_DEG]
    return [np.ascontiguousarray(part) for part in turned], (x - corner[0], y - corner[1])


def _vertex(before: float, at: float, after: float) -> float:
    bow = before - 2 * at + after
    return 0.0 if abs(bow) < 1e-9 else float(np.clip(0.5 * (before - after) / bow, -1, 1))


def match(bgr: Frame, kit: TipKit, turns: tuple[int, ...] = tuple(range(len(TURNS_DEG)))) -> Pose | None:
    """Find the golden template in nine turns; parabolas through the best score give sub-pixel place and turn."""
    templates, end = _templates(kit)
    x0, y0 = (round(kit.tip_px[i] - end[i]) - REACH_PX for i in (0, 1))
    x1, y1 = x0 + TEMPLATE_PX[0] + 2 * REACH_PX, y0 + TEMPLATE_PX[1] + 2 * REACH_PX
    image = cv2.medianBlur(plane_of(bgr[y0:y1, x0:x1]), 7)
    scores = [cv2.matchTemplate(image, templates[turn], cv2.TM_CCOEFF_NORMED) for turn in turns]
    best = int(np.argmax([score.max() for score in scores]))
    score = scores[best]
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    if score[row, column] < LEAST_SCORE or not (0 < row < score.shape[0] - 1 and 0 < column < score.shape[1] - 1):
        return None
    x = column + _vertex(*score[row, column - 1 : column + 2])
    y = row + _vertex(*score[row - 1 : row + 2, column])
    turn = TURNS_DEG[turns[best]]
    if 0 < best < len(turns) - 1:
        turn += _vertex(*(float(scores[best + step].max()) for step in (-1, 0, 1)))
    return Pose(x0 + x + end[0], y0 + y + end[1], kit.angle_rad + float(np.radians(turn)))


def extreme(bgr: Frame, kit: TipKit) -> Pose | None:
    """Threshold the corridor of the needle by Otsu and take the largest part's last point along the needle."""
    x, y = (round(part) for part in kit.tip_px)
    x0, y0, x1, y1 = x - 120, y - 175, x + 60, y + REACH_PX + 20
    plane = cv2.medianBlur(plane_of(bgr[y0:y1, x0:x1]), 5)
    taper = Pose(kit.tip_px[0] - x0, kit.tip_px[1] - y0, kit.angle_rad)
    corners = [along(taper, u, v) for u, v in ((REACH_PX, -18), (REACH_PX, 18), (-115, 42), (-115, -42))]
    corridor = np.zeros(plane.shape, np.uint8)
    cv2.fillPoly(corridor, [np.rint(np.array(corners)).astype(np.int32)], (255,))
    level, _ = cv2.threshold(plane[corridor > 0], 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    mask = ((plane > level) & (corridor > 0)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count < 2:
        return None
    label = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    rows, columns = np.nonzero(labels == label)
    if rows.size < 600:
        return None
    points = np.stack([columns, rows], axis=1).astype(np.float64)
    middle = points.mean(axis=0)
    axis = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    axis *= np.sign(axis @ (np.cos(kit.angle_rad), np.sin(kit.angle_rad)))
    angle = float(np.arctan2(axis[1], axis[0]))
    if abs(np.degrees(angle - kit.angle_rad)) > 3 * TURN_LIMIT_DEG:
        angle = kit.angle_rad
    c, s = np.cos(angle), np.sin(angle)
    reach = points @ (c, s)
    last = points[reach > reach.max() - 1.0].mean(axis=0)
    return Pose(float(last[0]) + x0, float(last[1]) + y0, angle)


def _segments(plane: Plane) -> Floats:
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(plane)[0]
    return np.zeros((0, 4)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 4)


def _pairs(bgr: Frame, kit: TipKit) -> list[tuple[float, float, Pose]]:
    """Return (opening rad, length px, apex) of every two lines that could be the taper's sides."""
    x, y = (round(part) for part in kit.tip_px)
    x0, y0 = x - 130, y - 175
    segments = _segments(np.ascontiguousarray(plane_of(bgr[y0 : y + 50, x0 : x + 90])))
    direction = segments[:, 2:] - segments[:, :2]
    length = np.hypot(direction[:, 0], direction[:, 1])
    # A line has no sense: fold onto the needle's direction.
    lean = (np.arctan2(direction[:, 1], direction[:, 0]) - kit.angle_rad + np.pi / 2) % np.pi - np.pi / 2
    middle = (segments[:, 2:] + segments[:, :2]) / 2 + (x0, y0) - kit.tip_px
    u = middle @ (np.cos(kit.angle_rad), np.sin(kit.angle_rad))
    fits = (length > 20) & (u < 0) & (u > -140)
    found = []
    for i in np.flatnonzero(fits & (lean > -0.1)):
        for j in np.flatnonzero(fits & (lean < 0.1)):
            opening, axis = float(lean[i] - lean[j]), float(lean[i] + lean[j]) / 2
            if not 0.12 < opening < 0.6 or abs(axis) > np.radians(TURN_LIMIT_DEG):
                continue
            met = _meet(segments[i], segments[j])
            apex = Pose(met[0] + x0, met[1] + y0, kit.angle_rad + axis)
            if np.hypot(apex.x - kit.tip_px[0], apex.y - kit.tip_px[1]) < REACH_PX + 25:
                found.append((opening, float(length[i] + length[j]), apex))
    return found


@cache
def _opening_of(kit: TipKit) -> float:
    """Return the taper's opening in the golden picture: of the long pairs the widest (the rest are highlights)."""
    pairs = _pairs(kit.golden_bgr, kit)
    longest = max((length for _, length, _ in pairs), default=0.0)
    return max((opening for opening, length, _ in pairs if length > 0.6 * longest), default=0.25)


def lsd(bgr: Frame, kit: TipKit) -> Pose | None:
    """Take the longest two lines (cv2 LSD) that open as the taught taper; where they meet is the apex."""
    taper = [pair for pair in _pairs(bgr, kit) if abs(pair[0] - _opening_of(kit)) < 0.04]
    return max(taper, key=lambda pair: pair[1])[2] if taper else None


def _meet(one: Floats, other: Floats) -> Point:
    """Return where the lines through two segments (x1, y1, x2, y2) cross."""
    lines = [np.cross([*s[:2], 1.0], [*s[2:], 1.0]) for s in (one, other)]
    x, y, w = np.cross(lines[0], lines[1])
    return float(x / w), float(y / w)


def _profile(plane: NDArray[np.float32], pose: Pose, u: Floats, v: Floats) -> Floats:
    xs, ys = along(pose, u, v)
    return np.asarray(cv2.remap(plane, xs.astype(np.float32), ys.astype(np.float32), cv2.INTER_LINEAR), np.float64)


def _peaks(slope: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return the sub-sample place and height of each row's maximum; `at` are the samples' places."""
    best = np.clip(np.argmax(slope, axis=1), 1, slope.shape[1] - 2)
    row = np.arange(len(best))
    shift = [_vertex(*slope[r, b - 1 : b + 2]) for r, b in zip(row, best, strict=True)]
    return at[best] + np.array(shift) * (at[1] - at[0]), slope[row, best]


def _line(u: Floats, v: Floats) -> tuple[float, float] | None:
    """Fit v = a + b u, dropping the worst by the median, None when less than half agree within 2 px."""
    keep = np.ones(u.size, bool)
    for _ in range(4):
        b, a = np.polyfit(u[keep], v[keep], 1)
        miss = np.abs(v - a - b * u)
        keep = miss < max(2.5 * float(np.median(miss)), 0.5)
    return (float(a), float(b)) if np.mean(miss < 2.0) > 0.5 else None


@cache
def _rim_of(kit: TipKit) -> float:
    """Return how far above the end the marking's lower rim lies in the golden picture."""
    plane = cv2.GaussianBlur(plane_of(kit.golden_bgr).astype(np.float32), (0, 0), 1.0)
    u = np.arange(-190.0, -60.0, 0.5)
    level = np.mean([_profile(plane, Pose(*kit.tip_px, kit.angle_rad), u[None, :], np.full((1, u.size), v))[0]
                     for v in (-4.0, -2.0, 0.0, 2.0, 4.0)], axis=0)  # fmt: skip
    return float(-u[int(np.argmax(np.gradient(level)))])


ACROSS = np.arange(-36.0, 36.01, 0.5)


def _sides(plane: NDArray[np.float32], pose: Pose, u: Floats, near: Floats, reach_px: float) -> Floats | None:
    """Return the taper's two edges as lines (2, 2), rows a, b of v = a + b u, looked for near known ones."""
    slope = np.gradient(
        _profile(plane, pose, np.repeat(u[:, None], ACROSS.size, 1), np.tile(ACROSS, (u.size, 1))), axis=1
    )
    lines = []
    for sign, (a, b) in zip((1.0, -1.0), near, strict=True):
        allowed = np.abs(ACROSS[None, :] - (a + b * u)[:, None]) < reach_px
        lines.append(_line(u, _peaks(np.where(allowed, sign * slope, 0.0), ACROSS)[0]))
    return None if lines[0] is None or lines[1] is None else np.array(lines)


def _stations(rim_px: float) -> Floats:
    # Nearer to the marking a needle may be a bare cylinder already.
    return np.linspace(-0.72 * rim_px, -18.0, SCAN_LINES)


def _smoothed(bgr: Frame) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(cv2.medianBlur(plane_of(bgr), 3).astype(np.float32), (0, 0), 0.8))


@cache
def _sides_of(kit: TipKit) -> Floats:
    """Return the two edges in the golden picture, (2, 2)."""
    wide = np.array([[-14.0, 0.0], [14.0, 0.0]])
    pose = Pose(*kit.tip_px, kit.angle_rad)
    sides = _sides(_smoothed(kit.golden_bgr), pose, _stations(_rim_of(kit)), wide, 14.0)
    return wide if sides is None else sides


def edge_fit(bgr: Frame, kit: TipKit) -> Pose | None:
    """Fit both taper edges on 60 scan lines, cross their bisector with the marking's lower rim, go h px on."""
    start = match(bgr, kit, (1, 4, 7))
    if start is None:
        return None
    plane, rim, pose = _smoothed(bgr), _rim_of(kit), start
    for reach in (9.0, 5.0):
        sides = _sides(plane, pose, _stations(rim), _sides_of(kit), reach)
        if sides is None:
            return None
        a, b = sides.mean(axis=0) - _sides_of(kit).mean(axis=0)
        x, y = along(pose, 0.0, a)
        pose = Pose(float(x), float(y), pose.angle_rad + float(np.arctan(b)))
    w = np.arange(-rim - 20.0, -rim + 20.0, 0.5)
    across = np.arange(-4.0, 4.01, 1.0)
    rows = _profile(plane, pose, np.tile(w, (across.size, 1)), np.repeat(across[:, None], w.size, 1))
    places, heights = _peaks(np.gradient(rows, axis=1), w)
    if np.median(heights) < 5.0:
        return None
    x, y = along(pose, float(np.median(places)) + rim, 0.0)
    return Pose(float(x), float(y), pose.angle_rad)


Finder = Callable[[TipScene], Point | None]
PEERS: dict[str, Finder] = {
    "cv2.matchTemplate + parabola": taught(match),
    "threshold extreme": taught(extreme),
    "cv2 LSD apex": taught(lsd),
    "edge fit, 60 scan lines": taught(edge_fit),
}
