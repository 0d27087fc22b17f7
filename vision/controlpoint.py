"""Find the control point: the middle of four thin arms printed crosswise (thesis appendix C).

Each arm is a dark line with two parallel edges; halfway between them runs the arm. Arms that cross at 72..95 degrees
(perspective bends the right angle) meet at the centre. Two arms are enough: the needle may hide the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.caliper import Floats, derivative, refine_peaks, robust_fit, sample
from vision.image import Plane, check_bgr, check_exposure, check_point, despike, gray
from vision.notfound import NotFound, Reason

# Angle between two arms, degrees, as the oblique view shows it; given as 72..95, and its supplement.
ARM_ANGLE_DEG = (72.0, 108.0)
# Arms are looked for from this share of the reach outwards, so that a disc or ring about the centre may be there.
INNER_SHARE = 0.25
# An arm shows on at least this share of its length.
LEAST_ARM_SHARE = 0.5
# Darker than its surroundings by at least this many levels.
LEAST_DEPTH = 12.0
WIDEST_ARM_PX = 14
CENTRE_ROUNDS = 4
# How far an arm's middle line may miss the centre, and its points scatter about it.
LARGEST_RESIDUAL_PX, LARGEST_SCATTER_PX = 0.35, 0.8


@dataclass(frozen=True, slots=True)
class Arm:
    """Hold one arm: a point on its middle line, its direction away from the centre, its width, the share seen."""

    x_px: float
    y_px: float
    angle_rad: float
    width_px: float
    share: float


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """Hold the centre (x_px, y_px), 1-sigma of each coordinate, and the arms it was made from."""

    x_px: float
    y_px: float
    sigma_px: float
    arms: tuple[Arm, ...]


def find_control_point(
    white_bgr: Any, around_px: tuple[float, float], reach_px: float = 60.0, arm_px: float = 60.0
) -> ControlPoint | NotFound:
    """Find a four-arm control point whose centre lies within `reach_px` of `around_px` (x, y).

    white_bgr: (H, W, 3) uint8 BGR. arm_px: length of an arm from the centre, in px. Good to about 0.1 px. NotFound
    with too_dark, saturated, out_of_frame or no_control_point; ValueError for a wrong array or number.
    """
    image = check_bgr(white_bgr)
    around = check_point(around_px, "around_px")
    if not (5.0 <= reach_px <= 500.0 and 15.0 <= arm_px <= 500.0):
        raise ValueError(f"reach_px must be 5..500 and arm_px 15..500 px, got {reach_px} and {arm_px}")
    half = int(reach_px + arm_px) + 2
    x, y = int(np.rint(around[0])) - half, int(np.rint(around[1])) - half
    size = 2 * half + 1
    if x < 0 or y < 0 or x + size > image.shape[1] or y + size > image.shape[0]:
        fact = f"the window x {x}..{x + size}, y {y}..{y + size} px leaves the picture"
        return NotFound(Reason.OUT_OF_FRAME, f"{fact}: bring the control point nearer to the tip")
    plane = gray(image[y : y + size, x : x + size])
    problem = check_exposure(plane, dark_level=40.0, dark_percentile=90.0, clipped_share=0.7)
    if problem is not None:
        return problem
    raw = despike(plane).astype(np.float32)
    start = _crossing(raw, arm_px, reach_px)
    if start is None:
        return _none("no two dark lines cross there")
    found = _refine(raw, start, arm_px)
    if isinstance(found, NotFound):
        return found
    arms = tuple(Arm(arm.x_px + x, arm.y_px + y, arm.angle_rad, arm.width_px, arm.share) for arm in found.arms)
    return ControlPoint(found.x_px + x, found.y_px + y, found.sigma_px, arms)


def _none(fact: str) -> NotFound:
    return NotFound(Reason.NO_CONTROL_POINT, f"{fact}: is the printed cross in view, flat, clean and in focus?")


def _ridges(raw: Plane) -> tuple[Plane, Plane]:
    """Return how much every pixel looks like a thin dark line (levels), and the line's direction (rad, 0..pi)."""
    closed = cv2.morphologyEx(raw, cv2.MORPH_CLOSE, np.ones((WIDEST_ARM_PX + 3, WIDEST_ARM_PX + 3), np.uint8))
    depth = cv2.GaussianBlur(closed - raw, (0, 0), 1.5)
    smooth = cv2.GaussianBlur(depth, (0, 0), 1.5)
    slope_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0)
    slope_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    # Structure tensor: the direction in which the slope is least is the line's.
    xx, yy, xy = (cv2.GaussianBlur(part, (0, 0), 3.0) for part in (slope_x**2, slope_y**2, slope_x * slope_y))
    across = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return np.asarray(depth, dtype=np.float32), np.asarray((across + np.pi / 2.0) % np.pi, dtype=np.float32)


def _crossing(raw: Plane, arm_px: float, reach_px: float) -> tuple[float, float, float, float] | None:
    """Return a rough centre (x, y) and the directions (rad, 0..pi) of the two lines through it, or None.

    Line pixels vote for a line (direction, offset); the strongest pair at the right angle that meets within reach wins.
    """
    depth, direction = _ridges(raw)
    threshold = max(LEAST_DEPTH, 0.35 * float(np.max(depth)))
    rows, columns = np.nonzero(depth > threshold)
    if rows.size < arm_px:
        return None
    half = (raw.shape[0] - 1) / 2.0
    angle = direction[rows, columns]
    bins, span = 60, 2 * int(np.hypot(half, half)) + 2
    votes = np.zeros((bins, span), dtype=np.float32)
    for turn in (-1, 0, 1):
        index = (np.rint(angle / np.pi * bins).astype(np.intp) + turn) % bins
        theta = index * np.pi / bins
        offset = (rows - half) * np.cos(theta) - (columns - half) * np.sin(theta)
        np.add.at(votes, (index, np.rint(offset).astype(np.intp) + span // 2), 1.0)
    votes = np.asarray(cv2.blur(votes, (5, 1)), dtype=np.float32)
    lines = _strongest(votes, 8)
    best, answer = 0.0, None
    for first, strength1 in lines:
        for second, strength2 in lines:
            met = _meet(first, second, half, bins, span)
            if met is None or np.hypot(met[0] - half, met[1] - half) > reach_px:
                continue
            if min(strength1, strength2) > best:
                best, answer = min(strength1, strength2), met
    return answer


def _strongest(votes: Plane, count: int) -> list[tuple[tuple[int, int], float]]:
    """Return the best cells, each clearing its neighbourhood (the first axis goes round)."""
    left = votes.copy()
    found: list[tuple[tuple[int, int], float]] = []
    for _ in range(count):
        row, column = divmod(int(np.argmax(left)), left.shape[1])
        strength = float(left[row, column])
        if strength <= 0.0:
            break
        found.append(((row, column), strength))
        for turn in range(-4, 5):
            left[(row + turn) % left.shape[0], max(column - 10, 0) : column + 11] = 0.0
    return found


def _meet(
    first: tuple[int, int], second: tuple[int, int], half: float, bins: int, span: int
) -> tuple[float, float, float, float] | None:
    """Return where two voted lines meet and their directions, None unless they cross like arms."""
    angle1, angle2 = first[0] * np.pi / bins, second[0] * np.pi / bins
    between = np.degrees(abs(angle1 - angle2))
    if not (ARM_ANGLE_DEG[0] - 3.0 <= between <= ARM_ANGLE_DEG[1] + 3.0):
        return None
    matrix = np.array([[-np.sin(angle1), np.cos(angle1)], [-np.sin(angle2), np.cos(angle2)]])
    x, y = np.linalg.solve(matrix, np.array([first[1] - span // 2, second[1] - span // 2], dtype=np.float64))
    return float(x + half), float(y + half), float(angle1), float(angle2)


def _refine(raw: Plane, start: tuple[float, float, float, float], arm_px: float) -> ControlPoint | NotFound:
    """Measure the middle lines of the arms with calipers and intersect them, from a better centre each round."""
    x, y = start[0], start[1]
    angles = [angle + turn for angle in start[2:] for turn in (0.0, np.pi)]
    found: ControlPoint | None = None
    for _ in range(CENTRE_ROUNDS):
        arms = [arm for angle in angles if (arm := _arm(raw, x, y, angle, arm_px)) is not None]
        found = _intersection(arms)
        if found is None:
            return _none(f"only {len(arms)} of its arms can be measured, or they do not cross at a right angle")
        moved = np.hypot(found.x_px - x, found.y_px - y)
        x, y = found.x_px, found.y_px
        if not (0 <= x < raw.shape[1] and 0 <= y < raw.shape[0]):
            return _none("its arms meet outside the window")
        angles = _better(angles, arms)
        if moved < 0.01:
            break
    return found if found is not None else _none("its arms do not meet")


def _better(angles: list[float], arms: list[Arm]) -> list[float]:
    """Return the arms' measured directions in place of the assumed ones."""
    return [
        min((arm.angle_rad for arm in arms), key=lambda own: abs(np.angle(np.exp(1j * (own - angle)))), default=angle)
        if any(abs(np.angle(np.exp(1j * (arm.angle_rad - angle)))) < 0.2 for arm in arms)
        else angle
        for angle in angles
    ]


def _arm(raw: Plane, x: float, y: float, angle: float, arm_px: float) -> Arm | None:
    """Measure one arm by its two edges at calipers across it; None where too little of it is seen."""
    along = np.arange(INNER_SHARE * arm_px, 0.95 * arm_px, 2.0)
    reach = WIDEST_ARM_PX + 6
    across = np.arange(-reach, reach + 1, dtype=np.float64)
    c, s = np.cos(angle), np.sin(angle)
    xs = x + along[:, None] * c - across[None, :] * s
    ys = y + along[:, None] * s + across[None, :] * c
    rows = cv2.blur(sample(raw, xs, ys), (1, 3))
    slope = derivative(np.asarray(rows, dtype=np.float32), 1.0)
    middle, width = _edge_pairs(slope)
    good = (width > 1.5) & (width < WIDEST_ARM_PX)
    if np.count_nonzero(good) < max(LEAST_ARM_SHARE * along.size, 5):
        return None
    typical = float(np.median(width[good]))
    good &= np.abs(width - typical) < 1.5
    if np.count_nonzero(good) < max(LEAST_ARM_SHARE * along.size, 5):
        return None
    centre = float(np.mean(along))
    fit = robust_fit(np.stack([np.ones(int(good.sum())), along[good] - centre], axis=1), middle[good], ceiling=0.5)
    share = float(np.count_nonzero(fit.weights > 0.3)) / along.size
    if share < LEAST_ARM_SHARE or fit.scale > LARGEST_SCATTER_PX:
        return None
    offset, slant = (float(number) for number in fit.parameters)
    return Arm(
        float(x + centre * c - offset * s),
        float(y + centre * s + offset * c),
        float(angle + np.arctan(slant)),
        typical,
        share,
    )


def _edge_pairs(slope: Plane) -> tuple[Floats, Floats]:
    """Return middle and width of the dark line on each caliper (N,): falling edge, then rising; width 0 if none."""
    centre = slope.shape[1] // 2
    falls = np.maximum(-slope, 0.0)
    rises = np.maximum(slope, 0.0)
    best = np.zeros(slope.shape[0])
    at_fall = np.zeros(slope.shape[0], dtype=np.intp)
    at_rise = np.zeros(slope.shape[0], dtype=np.intp)
    index = np.arange(slope.shape[0])
    for gap in range(2, WIDEST_ARM_PX + 1):
        pair = np.minimum(falls[:, :-gap], rises[:, gap:])
        pair[:, : max(centre - gap // 2 - WIDEST_ARM_PX // 2 - 3, 1)] = 0.0
        pair[:, centre - gap // 2 + WIDEST_ARM_PX // 2 + 3 :] = 0.0
        peak = np.argmax(pair, axis=1)
        better = pair[index, peak] > best
        best = np.where(better, pair[index, peak], best)
        at_fall = np.where(better, peak, at_fall)
        at_rise = np.where(better, peak + gap, at_rise)
    last = slope.shape[1] - 2
    first = refine_peaks(falls.astype(np.float32), np.clip(at_fall, 1, last))
    second = refine_peaks(rises.astype(np.float32), np.clip(at_rise, 1, last))
    seen = best > max(0.3 * float(np.percentile(best, 80)), LEAST_DEPTH / 6.0)
    return (first + second) / 2.0 - centre, np.where(seen, second - first, 0.0)


def _intersection(arms: list[Arm]) -> ControlPoint | None:
    """Return the point nearest to all arms' middle lines; an arm that misses it (the needle's edge) is left out."""
    left = list(arms)
    while any(_crosses(one, other) for one in left for other in left):
        normals = np.array([[-np.sin(arm.angle_rad), np.cos(arm.angle_rad)] for arm in left])
        offsets = np.sum(normals * np.array([[arm.x_px, arm.y_px] for arm in left]), axis=1)
        solution: NDArray[np.float64] = np.linalg.lstsq(normals, offsets, rcond=None)[0]
        residual = np.abs(normals @ solution - offsets)
        if float(residual.max()) <= LARGEST_RESIDUAL_PX:
            scatter = float(np.sqrt(np.mean(residual**2)))
            return ControlPoint(float(solution[0]), float(solution[1]), float(np.hypot(scatter, 0.05)), tuple(left))
        odd = _oddest(left, residual)
        if odd is None:
            return None
        left.pop(odd)
    return None


def _oddest(arms: list[Arm], residual: Floats) -> int | None:
    """Return which of the arms that miss the centre is no arm, by its width and gaps; None if they cannot be told."""
    typical = float(np.median([arm.width_px for arm in arms]))
    oddness = np.array([abs(arm.width_px - typical) + 3.0 * (1.0 - arm.share) for arm in arms])
    order = np.argsort(np.where(residual > LARGEST_RESIDUAL_PX / 2.0, oddness, -1.0))[::-1]
    if oddness[order[0]] < 0.4 or (len(arms) > 2 and oddness[order[0]] - oddness[order[1]] < 0.3):
        return None
    return int(order[0])


def _crosses(one: Arm, other: Arm) -> bool:
    between = float(np.degrees(abs(one.angle_rad - other.angle_rad)) % 180.0)
    return ARM_ANGLE_DEG[0] <= between <= ARM_ANGLE_DEG[1]
