"""The kinds of test pad of thesis fig. 5.17 a..h, and the neighbours that make them hard to tell.

Each recipe draws one scene round the board's origin, where the middle of the target pad is, and lists its true pads.
"""

from collections.abc import Callable

import numpy as np

from tests.vision.studio.board_canvas import Points, capped, scaled
from tests.vision.studio.board_shapes import circle, dense, rounded, settled, strokes
from tests.vision.studio.board_stage import Stage
from tests.vision.studio.board_surround import far_things, silk_near, trace_from, under_mask

VIA_RADIUS_PX = (5.0, 8.0)
SITE_RADIUS_PX = (14.0, 21.0)
HOLE_SHARE = (0.30, 0.45)

Recipe = Callable[[Stage], None]
Hole = tuple[float, float, float]


def hole_in(stage: Stage, x: float, y: float, radius: float, *, off: tuple[float, float]) -> Hole:
    """Return a drill hole, off the middle by a share of the radius, that leaves at least 1.2 px of ring."""
    hole = radius * stage.rng.uniform(*HOLE_SHARE)
    away = min(radius * stage.rng.uniform(*off), radius - hole - 1.2)
    way = stage.rng.uniform(0, 2 * np.pi)
    return x + away * np.cos(way), y + away * np.sin(way), hole


def via_hole_centred(stage: Stage) -> None:
    radius = stage.rng.uniform(*VIA_RADIUS_PX)
    stage.round_pad(0, 0, radius, hole=hole_in(stage, 0, 0, radius, off=(0.0, 0.03)))


def via_hole_off(stage: Stage) -> None:
    radius = stage.rng.uniform(*VIA_RADIUS_PX)
    stage.round_pad(0, 0, radius, hole=hole_in(stage, 0, 0, radius, off=(0.12, 0.30)))


def via_filled(stage: Stage) -> None:
    """Solder stands in the hole: a dome or a shallow dimple, no darker than nine tenths of the rim."""
    radius = stage.rng.uniform(*VIA_RADIUS_PX)
    stage.round_pad(0, 0, radius)
    dome = circle(0, 0, radius * stage.rng.uniform(0.3, 0.6))
    stage.canvas.paint([stage.outline(dome)], scaled(stage.rng.uniform(0.90, 1.10)))


def site(stage: Stage) -> None:
    stage.round_pad(0, 0, stage.rng.uniform(*SITE_RADIUS_PX))


def site_hole(stage: Stage) -> None:
    radius = stage.rng.uniform(*SITE_RADIUS_PX)
    stage.round_pad(0, 0, radius, hole=hole_in(stage, 0, 0, radius, off=(0.0, 0.10)))


def site_mark(stage: Stage) -> None:
    """A needle has been here: a duller middle, a dent beside it, scratches."""
    radius = stage.rng.uniform(*SITE_RADIUS_PX)
    stage.round_pad(0, 0, radius)
    if stage.rng.uniform() < 0.5:
        wear(stage, circle(0, 0, radius * stage.rng.uniform(0.4, 0.7)), stage.rng.uniform(0.65, 0.85))
    for _ in range(stage.rng.integers(1, 3)):
        away, way = radius * stage.rng.uniform(0.0, 0.55), stage.rng.uniform(0, 2 * np.pi)
        dent = circle(away * np.cos(way), away * np.sin(way), stage.rng.uniform(1.2, 2.8), ragged=0.2, rng=stage.rng)
        wear(stage, dent, stage.rng.uniform(0.55, 0.8))
    for _ in range(stage.rng.integers(0, 3)):
        ends = stage.rng.uniform(-0.6, 0.6, (2, 2)) * radius
        for piece in strokes(ends, stage.rng.uniform(0.6, 1.4)):
            wear(stage, piece, stage.rng.uniform(0.6, 0.85))


def wear(stage: Stage, ring: Points, share: float) -> None:
    """Dull what is inside a ring down to a share of the pad's brightness."""
    stage.canvas.paint([stage.outline(ring)], capped(stage.look.pad * share))


def tangent_sites(stage: Stage) -> None:
    """Two or three sites whose white rims touch; their middles may be duller."""
    radius = stage.rng.uniform(14.0, 19.0)
    way = stage.rng.uniform(0, 2 * np.pi)
    spots = [(0.0, 0.0, radius)]
    turns = (0.0, stage.rng.choice([np.pi, np.pi / 2, 2 * np.pi / 3])) if stage.rng.uniform() < 0.4 else (0.0,)
    for turn in turns:
        other = np.clip(radius + stage.rng.uniform(-1.0, 1.0), *SITE_RADIUS_PX)
        apart = radius + other - stage.rng.uniform(0.0, 1.2)
        spots.append((apart * np.cos(way + turn), apart * np.sin(way + turn), float(other)))
    dull = stage.rng.uniform(0.70, 0.95)
    rim = stage.rng.uniform(1.5, 3.5)
    for x, y, size in spots:
        stage.round_pad(x, y, size)
    for x, y, size in spots:
        stage.canvas.paint([stage.outline(circle(x, y, size - rim))], scaled(dull))


def via_on_net(stage: Stage) -> None:
    """A via that one or two bare traces leave."""
    radius = stage.rng.uniform(*VIA_RADIUS_PX)
    way = stage.rng.uniform(0, 2 * np.pi)
    ways = (way, way + stage.rng.choice([np.pi, np.pi / 2, 3 * np.pi / 4])) if stage.rng.uniform() < 0.5 else (way,)
    width = radius * stage.rng.uniform(0.45, 0.85)
    for direction in ways:
        trace_from(stage, direction, width)
    hole = hole_in(stage, 0, 0, radius, off=(0.0, 0.08)) if stage.rng.uniform() < 0.7 else None
    stage.round_pad(0, 0, radius, hole=hole)


def site_near_silk(stage: Stage) -> None:
    """Lettering and lines that come up to the pad's edge or touch it."""
    radius = stage.rng.uniform(*SITE_RADIUS_PX)
    silk_near(stage, radius, stage.rng.uniform(-0.5, 4.0))
    site_or_hole(stage, radius)


def site_or_hole(stage: Stage, radius: float) -> None:
    hole = hole_in(stage, 0, 0, radius, off=(0.0, 0.10)) if stage.rng.uniform() < 0.4 else None
    stage.round_pad(0, 0, radius, hole=hole)


def site_near_smd(stage: Stage) -> None:
    """Rectangular lands on two to four sides of a site."""
    radius = stage.rng.uniform(*SITE_RADIUS_PX)
    site_or_hole(stage, radius)
    taken: Points = stage.keep_out(0.0)
    count = int(stage.rng.integers(2, 5))
    start = stage.rng.uniform(0, 2 * np.pi)
    for k in range(count):
        size = (stage.rng.uniform(22, 50), stage.rng.uniform(16, 30))
        angle = stage.rng.choice([0.0, np.pi / 2]) + stage.rng.normal(0, 0.02)
        ring = rounded(0, 0, size, stage.rng.uniform(0, 4), angle)
        way = start + k * 2 * np.pi / count + stage.rng.uniform(-0.3, 0.3)
        shift = settled(dense(ring, closed=True), way, taken, stage.rng.uniform(3.0, 9.0))
        stage.metal(ring + shift, share=stage.rng.uniform(0.9, 1.1))
        taken = np.vstack((taken, dense(ring + shift, closed=True)))


def row(stage: Stage) -> None:
    """Four to six vias, or sites, in a row; the target is any of them."""
    small = stage.rng.uniform() < 0.5
    radius = stage.rng.uniform(*(VIA_RADIUS_PX if small else SITE_RADIUS_PX))
    pitch = 2 * radius + (stage.rng.uniform(8, 20) if small else stage.rng.uniform(4, 14))
    count = int(stage.rng.integers(4, 7))
    first = -int(stage.rng.integers(0, count))
    way = stage.rng.uniform(0, 2 * np.pi)
    holed = stage.rng.uniform() < 0.6
    for k in range(count):
        x, y = pitch * (first + k) * np.cos(way), pitch * (first + k) * np.sin(way)
        hole = hole_in(stage, x, y, radius, off=(0.0, 0.12)) if holed else None
        stage.round_pad(float(x), float(y), radius, hole=hole)


RECIPES: dict[str, Recipe] = {
    "via_hole_centred": via_hole_centred,
    "via_hole_off": via_hole_off,
    "via_filled": via_filled,
    "site": site,
    "site_hole": site_hole,
    "site_mark": site_mark,
    "tangent_sites": tangent_sites,
    "via_on_net": via_on_net,
    "site_near_silk": site_near_silk,
    "site_near_smd": site_near_smd,
    "row": row,
}


def draw_pads(stage: Stage, kind: str) -> None:
    """Draw one scene of a kind, with traces under the mask and a few things farther off."""
    under_mask(stage)
    RECIPES[kind](stage)
    if kind not in {"row", "via_on_net", "site_near_silk", "site_near_smd"} and stage.rng.uniform() < 0.6:
        far_things(stage)
    if stage.look.hard:
        stage.dirty()
