"""What the first artist lays under the needle: figure 5.17's pads, boards without any, and where they may lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.bench.vision.scenes import MOST_HIDDEN, Point
from tests.vision.scene import AXIS_DEG, Canvas, Needle, Pad

Rng = np.random.Generator
Draw = Callable[[Point, np.random.Generator, float], tuple[Pad, ...]]
VIEW_RATIO = 0.87
# Which of two pads is nearer must be plain: a station refuses to choose between equals.
CLEAR_PX = 5.0
MOST_TRIES = 2000


def around(at: Point, rng: Rng, most: float) -> Point:
    angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(0, most)
    return at[0] + distance * np.cos(angle), at[1] + distance * np.sin(angle)


def shift(rng: Rng, most: float) -> Point:
    return rng.uniform(-most, most), rng.uniform(-most, most)


def _touching(at: Point, rng: Rng, level: float) -> tuple[Pad, ...]:
    """Return two sites side by side: on the board they touch in direction phi."""
    x, y = around(at, rng, 20.0)
    radius, phi, minor = rng.uniform(14, 20), rng.uniform(0, 2 * np.pi), np.radians(AXIS_DEG)
    u, v = VIEW_RATIO * (2 * radius + 0.3) * np.cos(phi), (2 * radius + 0.3) * np.sin(phi)
    dx, dy = u * np.cos(minor) - v * np.sin(minor), u * np.sin(minor) + v * np.cos(minor)
    return Pad(x, y, radius, level=level), Pad(x + dx, y + dy, radius, level=level)


def _one(least: float, most: float, hole: tuple[float, float] = (0, 0), off: float = 0.0) -> Draw:
    def draw(at: Point, g: Rng, level: float) -> tuple[Pad, ...]:
        size = g.uniform(*hole) if hole[1] else 0.0
        return (Pad(*around(at, g, 20.0), g.uniform(least, most), size, shift(g, off), level=level),)

    return draw


# Figure 5.17 of the thesis.
PADS: dict[str, Draw] = {
    "via with hole": _one(5, 8, (2.0, 2.6), 0.5),
    "via without hole": _one(5, 8),
    "via joined to a net": lambda at, g, level: (
        Pad(*around(at, g, 20.0), g.uniform(5, 8), trace_deg=g.uniform(0, 360), level=level),
    ),
    "site with hole": _one(14, 21, (3.0, 6.0), 1.5),
    "site without hole": _one(14, 21),
    "two touching sites": _touching,
}


def hidden_share(pad: Pad, needle: Needle) -> float:
    """Return the share of the pad's area behind the needle, 0..1."""
    grid = np.linspace(-1, 1, 41)
    u, v = (field[np.hypot(*np.meshgrid(grid, grid)) <= 1] * pad.radius_px for field in np.meshgrid(grid, grid))
    minor, axis = np.radians(AXIS_DEG), np.radians(needle.angle_deg)
    x = pad.x + pad.ratio * u * np.cos(minor) - v * np.sin(minor) - needle.tip[0]
    y = pad.y + pad.ratio * u * np.sin(minor) + v * np.cos(minor) - needle.tip[1]
    along, across = x * np.cos(axis) + y * np.sin(axis), y * np.cos(axis) - x * np.sin(axis)
    slope = (needle.rim_width_px - needle.end_width_px) / 2 / needle.taper_px
    half = np.minimum(needle.end_width_px / 2 - slope * along, needle.cylinder_width_px / 2)
    return float(np.mean((along <= 0) & (np.abs(across) <= half)))


def _silk(canvas: Canvas, rng: Rng, at: Point) -> None:
    for _ in range(5):
        where = around(at, rng, 60.0)
        bar = canvas.bar(where, rng.choice([0, 45, 90, 120]), rng.uniform(40, 90), 12)
        canvas.paint(bar, rng.uniform(90, 140))


def _stroke_end(canvas: Canvas, rng: Rng, at: Point) -> None:
    x, y = around(at, rng, 12.0)
    level, angle = rng.uniform(100, 140), rng.uniform(0, 360)
    middle = x + 25 * np.cos(np.radians(angle)), y + 25 * np.sin(np.radians(angle))
    canvas.paint(canvas.bar(middle, angle, 50, 12), level)
    canvas.paint(canvas.ellipse(x, y, 6.0, 1.0, 0.0), level)


def _rectangles(canvas: Canvas, rng: Rng, at: Point) -> None:
    for _ in range(3):
        where = around(at, rng, 45.0)
        bar = canvas.bar(where, rng.uniform(0, 180), rng.uniform(26, 60), rng.uniform(14, 30))
        canvas.paint(bar, rng.uniform(140, 230))


def nothing(canvas: Canvas, rng: Rng, at: Point) -> None:
    """Leave the board as it is."""


EMPTY: dict[str, Callable[[Canvas, Rng, Point], None]] = {
    "bare board": nothing,
    "silkscreen only": _silk,
    "end of a stroke": _stroke_end,
    "rectangles only": _rectangles,
    "pad beyond reach": nothing,
}


def far(at: Point, rng: Rng) -> Point:
    angle = rng.uniform(0, 2 * np.pi)
    return at[0] + 37 * np.cos(angle), at[1] + 37 * np.sin(angle)


def placed(
    draw: Draw, needle: Needle, level: float, rng: Rng, conditions: frozenset[str]
) -> tuple[tuple[Pad, ...], float]:
    """Return pads of a kind as the needle leaves them: not touched, or with up to a third of the first one hidden."""
    least, most = (0.03, MOST_HIDDEN) if "hidden" in conditions else (0.0, 0.0 if "needle" in conditions else 1.0)
    for _ in range(MOST_TRIES):
        pads = sorted(draw(needle.tip, rng, level), key=lambda pad: _distance(pad.target, needle.tip))
        if len(pads) > 1 and _distance(pads[1].target, needle.tip) < _distance(pads[0].target, needle.tip) + CLEAR_PX:
            continue
        hidden = hidden_share(pads[0], needle)
        hole = replace(pads[0], x=pads[0].target[0], y=pads[0].target[1], radius_px=max(pads[0].hole_px, 0.1))
        # A hole behind the needle is not the target: then the pad's centre is, and which of both is a matter of words.
        if least <= hidden <= most and (most == 1.0 or not pads[0].hole_px or hidden_share(hole, needle) == 0.0):
            return tuple(pads), 0.0 if most == 1.0 else hidden
    raise RuntimeError(f"no place for a pad with {conditions} was found in {MOST_TRIES} tries")


def _distance(one: Point, other: Point) -> float:
    return float(np.hypot(one[0] - other[0], one[1] - other[1]))
