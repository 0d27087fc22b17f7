"""What surrounds test pads: copper under the mask, bare traces, lettering, lands; and scenes of nothing else."""

import numpy as np

from tests.vision.studio.board_canvas import Points
from tests.vision.studio.board_shapes import GLYPHS, bar, circle, dense, lettering, rounded, settled, turned
from tests.vision.studio.board_stage import Stage


def bent(stage: Stage, start: tuple[float, float], direction_rad: float, legs: int) -> Points:
    """Return a polyline that turns by 45 or 90 degrees after each leg."""
    points = [np.array(start, float)]
    for _ in range(legs):
        leg = stage.rng.uniform(25, 90)
        points.append(points[-1] + leg * np.array([np.cos(direction_rad), np.sin(direction_rad)]))
        direction_rad += stage.rng.choice([-1, 1]) * stage.rng.choice([np.pi / 4, np.pi / 2], p=[0.8, 0.2])
    return np.array(points)


def under_mask(stage: Stage) -> None:
    """Draw traces and tented vias that show faintly through the mask."""
    rng = stage.rng
    levels = rng.uniform(3, 10)
    for _ in range(rng.integers(0, 7)):
        start = rng.uniform(-120, 120, 2)
        line = bent(stage, (start[0], start[1]), rng.integers(0, 8) * np.pi / 4, int(rng.integers(1, 4)))
        stage.line(line, rng.uniform(5, 12), stage.look.mask + levels)
    for _ in range(rng.integers(0, 4)):
        x, y = rng.uniform(-110, 110, 2)
        stage.fill(circle(x, y, rng.uniform(6, 14)), stage.look.mask + levels)


def trace_from(stage: Stage, direction_rad: float, width: float) -> None:
    """Draw a bare trace that starts at the origin."""
    line = bent(stage, (0.0, 0.0), direction_rad, int(stage.rng.integers(1, 3)))
    stage.line(line, width, stage.look.pad * stage.rng.uniform(0.9, 1.05))


def silk_near(stage: Stage, radius: float, gap: float) -> None:
    """Draw one or two texts or lines as near a pad at the origin as ``gap``."""
    rng = stage.rng
    taken = dense(circle(0, 0, radius), closed=True)
    way = rng.uniform(0, 2 * np.pi)
    for _ in range(rng.integers(1, 3)):
        width = rng.uniform(4, 11)
        lines = text_lines(stage) if rng.uniform() < 0.7 else [rng.uniform(-50, 50, (2, 2))]
        shift = settled(np.vstack([dense(line) for line in lines]), way, taken, gap + width / 2)
        for line in lines:
            stage.line(line + shift, width, stage.look.silk)
        way += rng.uniform(0.7 * np.pi, 1.3 * np.pi)


def text_lines(stage: Stage) -> list[Points]:
    """Return the strokes of one to three letters, upright or turned by a right angle."""
    letters = "".join(stage.rng.choice(list(GLYPHS), int(stage.rng.integers(1, 4))))
    turn = stage.rng.integers(0, 4) * np.pi / 2
    return [turned(line, turn) for line in lettering(letters, stage.rng.uniform(35, 75))]


def far_things(stage: Stage) -> None:
    """Draw a text, a land or a bar well clear of the pads."""
    rng = stage.rng
    taken = stage.keep_out(rng.uniform(25, 45))
    way = rng.uniform(0, 2 * np.pi)
    for _ in range(rng.integers(1, 3)):
        if rng.uniform() < 0.5:
            lines, width = text_lines(stage), rng.uniform(4, 10)
            shift = settled(np.vstack([dense(line) for line in lines]), way, taken, width)
            for line in lines:
                stage.line(line + shift, width, stage.look.silk)
        else:
            ring = rounded(0, 0, (rng.uniform(24, 60), rng.uniform(16, 35)), rng.uniform(0, 5), rng.uniform(0, np.pi))
            stage.metal(ring + settled(dense(ring, closed=True), way, taken, 4.0))
        way += rng.uniform(0.6 * np.pi, 1.4 * np.pi)


def bare(stage: Stage) -> None:
    """Draw mask and what is under it, nothing else."""
    under_mask(stage)


def silk(stage: Stage) -> None:
    """Draw lettering, bars with round ends and circle outlines."""
    rng = stage.rng
    for _ in range(rng.integers(1, 3)):
        lines, width, shift = text_lines(stage), rng.uniform(4, 11), rng.uniform(-45, 45, 2)
        for line in lines:
            stage.line(line + shift, width, stage.look.silk)
    for _ in range(rng.integers(1, 4)):
        width, way, (x, y) = rng.uniform(5, 16), rng.uniform(0, np.pi), rng.uniform(-60, 60, 2)
        reach = width * rng.uniform(2.2, 6.0) / 2
        ends = ((x - reach * np.cos(way), y - reach * np.sin(way)), (x + reach * np.cos(way), y + reach * np.sin(way)))
        stage.fill(bar(*ends, width), stage.look.silk)
    for _ in range(rng.integers(0, 3)):
        outer, (x, y) = rng.uniform(12, 40), rng.uniform(-50, 50, 2)
        stage.annulus(x, y, outer, max(outer - rng.uniform(3, 7), 0.6 * outer), stage.look.silk)


def smd(stage: Stage) -> None:
    """Draw rectangles, rounded rectangles and ovals in rows of one size, as a component's lands are."""
    rng = stage.rng
    start = rng.uniform(-35, 35, 2)
    rings = [ring + start for ring in land_row(stage)]
    taken = np.vstack([dense(ring, closed=True) for ring in rings])
    if rng.uniform() < 0.5:
        others = land_row(stage)
        solid = np.vstack([dense(ring, closed=True) for ring in others])
        middle = taken.mean(axis=0)
        shift = settled(solid, rng.uniform(0, 2 * np.pi), taken - middle, rng.uniform(4, 14)) + middle
        rings += [ring + shift for ring in others]
    for ring in rings:
        stage.metal(ring)


def land_row(stage: Stage) -> list[Points]:
    """Return one to four equal lands side by side, their common middle at the origin."""
    rng = stage.rng
    width = rng.uniform(16, 32)
    length = max(rng.uniform(26, 60), (1.6 if rng.uniform() < 0.6 else 1.0) * width)
    oval = length >= 1.6 * width and rng.uniform() < 0.4
    corner = width / 2 if oval else rng.uniform(0, 0.25) * width
    way, pitch, count = rng.uniform(0, np.pi), width + rng.uniform(5, 14), int(rng.integers(1, 5))
    steps = pitch * (np.arange(count) - (count - 1) / 2)
    return [rounded(-step * np.sin(way), step * np.cos(way), (length, width), corner, way) for step in steps]


def traces(stage: Stage) -> None:
    """Draw bare traces with corners and T-joints."""
    rng = stage.rng
    for _ in range(rng.integers(2, 5)):
        width, start, way = rng.uniform(3.5, 11), rng.uniform(-45, 45, 2), rng.integers(0, 8) * np.pi / 4
        line = bent(stage, (start[0], start[1]), way, int(rng.integers(1, 4)))
        level = stage.look.pad * rng.uniform(0.9, 1.05)
        stage.line(line, width, level)
        if rng.uniform() < 0.6:
            foot = (line[0] + line[1]) / 2
            side = way + rng.choice([-1, 1]) * np.pi / 2
            stage.line(bent(stage, (foot[0], foot[1]), side, 1), width, level)


def odd_size(stage: Stage) -> None:
    """Draw round pads of a radius that is no test point's: 10..12 px, or beyond 27 px."""
    rng = stage.rng
    radius = rng.uniform(10.0, 12.0) if rng.uniform() < 0.5 else rng.uniform(27.5, 42.0)
    hole = (0.0, 0.0, radius * rng.uniform(0.3, 0.45)) if rng.uniform() < 0.5 else None
    stage.round_pad(0, 0, radius, hole=hole, listed=False)
    if rng.uniform() < 0.5:
        way, apart = rng.uniform(0, 2 * np.pi), 2 * radius + rng.uniform(5, 20)
        stage.round_pad(float(apart * np.cos(way)), float(apart * np.sin(way)), radius, listed=False)


EMPTY_RECIPES = {"bare": bare, "silk": silk, "smd": smd, "traces": traces, "odd_size": odd_size}


def draw_empty(stage: Stage, kind: str) -> None:
    """Draw a scene without any test pad."""
    if kind != "bare":
        under_mask(stage)
    EMPTY_RECIPES[kind](stage)
