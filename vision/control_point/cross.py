"""Centre of a crossing: where the middle lines of its arms meet, each fitted to all of its stations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from vision.control_point.print import EXPECTED, Fitted, Flags, Point, PrintedLine, Sides, why_no_print
from vision.control_point.proposals import ARM_ANGLE_DEG, Crossing
from vision.control_point.strip import RoughArm, measure_strip, rough_arms
from vision.core import Floats, Plane, robust_fit

ROUNDS = 4
SETTLED_PX = 0.05
"""A shift this small leaves the stations where they are."""
NEAREST, FARTHEST, LONGEST_GAP = 0.06, 1.7, 0.45
"""Arms are measured from this share of arm_px to this one, as far as they go on without a gap longer than that."""
LEAST_ARM, LEAST_LENGTH, LEAST_END = 0.2, 0.5, 0.75
"""An arm shows on at least the first of these lengths, on each line one shows on the second and up to the third,
arm_px."""
LEAST_SHARE = 0.65
"""Of the better arm on each line, so much of its expected length shows."""
LARGEST_MISS_PX, LARGEST_TURN = 3.0, 0.06
"""Two arms on one line: how far their own middle lines may miss each other at the centre (px), and turn (rad)."""
STATIONS_TIED = 3.0
"""Toner's ragged edges and the blur tie neighbouring stations together: of so many, one is independent."""
SYSTEMATIC_SIGMA_PX = 0.02
LARGEST_SIGMA_PX = 0.5


@dataclass(frozen=True, slots=True)
class MeasuredArm:
    """Hold one arm: direction away from the centre (rad), width (px), share of its expected length that is seen."""

    angle_rad: float
    width_px: float
    share: float


@dataclass(frozen=True, slots=True)
class Cross:
    """Hold a measured centre, the 1-sigma of each coordinate, its arms, and how many stations speak for it."""

    x_px: float
    y_px: float
    sigma_px: float
    arms: tuple[MeasuredArm, ...]
    stations: int


def measure_crosses(raw: Plane, crossing: Crossing, arm_px: float) -> list[Cross] | str:
    """Measure the control points at a proposed crossing of `raw` (H, W) float32; a fact instead where there is none.

    More than one comes back where arms on one line contradict each other and none of them can be ruled out.
    """
    at, angles = (crossing.x_px, crossing.y_px), crossing.angles_rad
    arms = rough_arms(raw, at, (angles[0], angles[0] + np.pi, angles[1], angles[1] + np.pi), arm_px)
    options = [_lines_of(at, angles[0], *arms[:2]), _lines_of(at, angles[1], *arms[2:])]
    if not all(options):
        return "two dark lines seem to cross, but their edges are not parallel"
    found: list[Cross] = []
    fact = ""
    # Both arms of a line together first; one by itself only where the other spoils it.
    for whole in (True, False):
        for first, second in product(*options):
            if whole == (first.whole and second.whole):
                result = _settle(raw, (first, second), arm_px)
                if isinstance(result, Cross):
                    found.append(result)
                else:
                    fact = fact or result
        if found:
            break
    return found or fact


def _lines_of(at: Point, angle: float, ahead: RoughArm | None, behind: RoughArm | None) -> list[PrintedLine]:
    """Return the line of both arms together where they agree, and that of each by itself."""
    lines = []
    if behind is not None:
        # Seen from the other end, right is left: offsets change their sign and slants do not.
        behind = RoughArm(-behind.offset_px, behind.slant, behind.width_px)
    if ahead is not None and behind is not None:
        miss, turn = ahead.offset_px - behind.offset_px, ahead.slant - behind.slant
        if abs(miss) < LARGEST_MISS_PX and abs(turn) < LARGEST_TURN:
            offset, slant = (ahead.offset_px + behind.offset_px) / 2.0, (ahead.slant + behind.slant) / 2.0
            both = RoughArm(offset, slant, (ahead.width_px + behind.width_px) / 2.0)
            lines.append(_placed(at, angle, both, (True, True), whole=True))
    whole = not lines
    if ahead is not None:
        lines.append(_placed(at, angle, ahead, (True, False), whole=whole))
    if behind is not None:
        lines.append(_placed(at, angle, behind, (False, True), whole=whole))
    return lines


def _placed(at: Point, angle: float, rough: RoughArm, sides: Sides, *, whole: bool) -> PrintedLine:
    foot = at[0] - rough.offset_px * np.sin(angle), at[1] + rough.offset_px * np.cos(angle)
    return PrintedLine(foot, float(angle + np.arctan(rough.slant)), rough.width_px, sides, whole)


def _meet(first: PrintedLine, second: PrintedLine) -> Point:
    normals = np.array([[-np.sin(line.angle), np.cos(line.angle)] for line in (first, second)])
    x, y = np.linalg.solve(normals, np.sum(normals * np.array([first.foot, second.foot]), axis=1))
    return float(x), float(y)


def _settle(raw: Plane, lines: tuple[PrintedLine, PrintedLine], arm_px: float) -> Cross | str:
    """Measure both lines from a better centre each round; a fact where they are no print's."""
    at = start = _meet(*lines)
    fitted: tuple[Fitted, Fitted] | None = None
    for _ in range(ROUNDS):
        between = float(np.degrees(abs(lines[0].angle - lines[1].angle)) % 180.0)
        if not ARM_ANGLE_DEG[0] <= between <= ARM_ANGLE_DEG[1]:
            return f"its arms cross at {min(between, 180.0 - between):.0f} degrees"
        first, second = (_fit(raw, at, line, arm_px) for line in lines)
        if first is None or second is None:
            return "only one line of it can be measured"
        fitted = first, second
        lines = _better(at, lines[0], first), _better(at, lines[1], second)
        before, at = at, _meet(*lines)
        if not np.hypot(at[0] - start[0], at[1] - start[1]) < 0.3 * arm_px:
            return "its arms do not meet where they cross"
        if np.hypot(at[0] - before[0], at[1] - before[1]) < SETTLED_PX:
            break
    assert fitted is not None  # noqa: S101 -- ROUNDS is at least 1
    return _judged(raw, at, lines, fitted, arm_px)


def _better(at: Point, line: PrintedLine, found: Fitted) -> PrintedLine:
    offset, slant = (float(number) for number in found.fit.parameters)
    foot = at[0] - offset * np.sin(line.angle), at[1] + offset * np.cos(line.angle)
    return replace(line, foot=foot, angle=line.angle + float(np.arctan(slant)), width=found.strip.width_px)


def _fit(raw: Plane, at: Point, line: PrintedLine, arm_px: float) -> Fitted | None:
    """Fit the middle line of the arms of one line: offset at `at`, and slant."""
    away = np.arange(max(NEAREST * arm_px, line.width / 2.0 + 1.0), FARTHEST * arm_px, 1.0)
    along = np.concatenate([-away[::-1] if line.sides[1] else away[:0], away if line.sides[0] else away[:0]])
    strip = measure_strip(raw, at, line.angle, line.width, along)
    if strip is None:
        return None
    used = strip.good & _unbroken(strip.along, strip.good, LONGEST_GAP * arm_px)
    ways = [used & (strip.along * way > 0.0) for way in (1.0, -1.0)]
    # A few stations on one side are chance: the probe's edges, or a letter beside.
    used = np.any([mine for mine in ways if np.count_nonzero(mine) >= LEAST_ARM * arm_px] or [used & False], axis=0)
    longest = max(np.count_nonzero(mine) for mine in ways)
    if longest < LEAST_LENGTH * arm_px or np.abs(strip.along[used]).max() < LEAST_END * arm_px:
        return None
    x = strip.along[used]
    fit = robust_fit(np.stack([np.ones_like(x), x], axis=1), strip.middle[used], ceiling=0.5, rounds=4)
    return Fitted(strip, fit, used)


def _unbroken(along: Floats, good: Flags, longest_gap: float) -> Flags:
    """Tell which stations are reached from the centre without a gap of bad ones longer than `longest_gap`."""
    reached = np.zeros_like(good)
    for side in (1.0, -1.0):
        mine = np.flatnonzero(good & (along * side > 0.0))
        if mine.size == 0:
            continue
        mine = mine[np.argsort(np.abs(along[mine]))]
        gaps = np.flatnonzero(np.diff(np.abs(along[mine])) > longest_gap)
        reached[mine[: int(gaps[0]) + 1] if gaps.size else mine] = True
    return reached


def _judged(
    raw: Plane, at: Point, lines: tuple[PrintedLine, PrintedLine], fitted: tuple[Fitted, Fitted], arm_px: float
) -> Cross | str:
    fact = why_no_print(raw, at, lines, fitted, arm_px)
    if fact:
        return fact
    normals = np.array([[-np.sin(line.angle), np.cos(line.angle)] for line in lines])
    each = np.linalg.inv(normals) * np.array([_offset_sigma(one) for one in fitted])
    sigma = float(np.hypot(np.sqrt(np.sum(each**2) / 2.0), SYSTEMATIC_SIGMA_PX))
    shown = min(max(_share(one, way, arm_px) for way in (1.0, -1.0)) for one in fitted)
    if not (sigma <= LARGEST_SIGMA_PX and shown >= LEAST_SHARE):
        return f"of its arms only {100.0 * shown:.0f} % is seen, which leaves {sigma:.2f} px of doubt"
    arms = tuple(
        MeasuredArm(line.angle + turn, one.strip.width_px, share)
        for line, one in zip(lines, fitted, strict=True)
        for turn, way in ((0.0, 1.0), (np.pi, -1.0))
        if (share := _share(one, way, arm_px)) > 0.0
    )
    return Cross(at[0], at[1], sigma, arms, int(sum(np.count_nonzero(one.used) for one in fitted)))


def _offset_sigma(one: Fitted) -> float:
    return float(np.sqrt(STATIONS_TIED * one.fit.covariance[0, 0]))


def _share(one: Fitted, way: float, arm_px: float) -> float:
    """Return the share of an arm's expected length on which it is measured."""
    away = one.strip.along * way
    expected = (away > EXPECTED[0] * arm_px) & (away < EXPECTED[1] * arm_px)
    return float(np.mean(one.used[expected])) if expected.any() else 0.0
