"""Crowded, shiny and worn boards: fields of vias, pin rows, solder, dents, oxide, dark mask; and ink like pads.

Each recipe draws one scene round the board's origin and lists its true pads; the empty ones list none.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from tests.vision.studio.board_canvas import Level, Points, Shade, capped, lifted, scaled
from tests.vision.studio.board_pads import SITE_RADIUS_PX, VIA_RADIUS_PX, hole_in, site_or_hole
from tests.vision.studio.board_shapes import bar, circle, dense, rounded, settled, strokes, turned
from tests.vision.studio.board_stage import Stage
from tests.vision.studio.board_surround import far_things, silk_near, text_lines, under_mask

Recipe = Callable[[Stage], None]


def round_glyph(letter: str) -> list[Points]:
    """Return the strokes of a letter whose counters are round: O, D, 8 or Q, in a box of height 1 round the origin."""
    turn = np.linspace(0.0, 2 * np.pi, 40)
    oval = np.column_stack((0.42 * np.cos(turn), 0.5 * np.sin(turn)))
    if letter == "O":
        return [oval]
    if letter == "Q":
        return [oval, np.array([(0.1, 0.2), (0.4, 0.55)])]
    if letter == "8":
        small = np.column_stack((0.27 * np.cos(turn), 0.25 * np.sin(turn)))
        return [small - np.array([0.0, 0.25]), small + np.array([0.0, 0.25])]
    bow = np.linspace(-np.pi / 2, np.pi / 2, 24)
    back = np.column_stack((-0.15 + 0.5 * np.cos(bow), 0.5 * np.sin(bow)))
    return [np.vstack((back, [(-0.35, 0.5), (-0.35, -0.5)], back[:1]))]


def either_radius(stage: Stage, *, site: float = 0.5) -> float:
    """Return the radius of a site, in that share of the scenes, else of a via."""
    return float(stage.rng.uniform(*(SITE_RADIUS_PX if stage.rng.uniform() < site else VIA_RADIUS_PX)))


def via_field(stage: Stage) -> None:
    """Vias in a lattice that fills the view."""
    rng, radius = stage.rng, stage.rng.uniform(*VIA_RADIUS_PX)
    pitch, way = 2 * radius + rng.uniform(4, 18), rng.uniform(0, np.pi)
    skew, share = rng.choice([0.0, 0.5]), rng.uniform(0.28, 0.42)
    for row in range(-6, 7):
        for column in range(-6, 7):
            at = turned(np.array([[pitch * (column + skew * (row % 2)), pitch * row]]), way)[0]
            if np.hypot(*at) < 105:
                stage.round_pad(float(at[0]), float(at[1]), radius, hole=(float(at[0]), float(at[1]), share * radius))


def pin_row(stage: Stage) -> None:
    """One or two rows of pins with wide holes, a line of ink along them."""
    rng, radius = stage.rng, either_radius(stage, site=0.3)
    pitch, way, rows = 2 * radius + rng.uniform(2.5, 9), rng.uniform(0, np.pi), int(rng.integers(1, 3))
    share = rng.uniform(0.35, 0.5)
    first = -int(rng.integers(2, 6))
    for row in range(rows):
        for column in range(first, first + 9):
            x, y = turned(np.array([[pitch * column, pitch * row]]), way)[0]
            off = rng.normal(0, 0.03 * radius, 2)
            stage.round_pad(float(x), float(y), radius, hole=(float(x + off[0]), float(y + off[1]), share * radius))
    for side in (-1.0, rows):
        ends = np.array([[-110.0, side * pitch], [110.0, side * pitch]])
        ends[:, 1] -= np.sign(side) * (0.5 * pitch - 2.0 - rng.uniform(0, 1)) if rng.uniform() < 0.5 else 0.0
        for piece in strokes(turned(ends, way), 2.5):
            stage.fill(piece, stage.look.silk * rng.uniform(1.0, 1.3))


def relief(rng: np.random.Generator, strength: float, grain_px: float) -> Shade:
    """Return a shade that makes what is below uneven: hills of about `grain_px`, rms `strength` of the level."""

    def shade(under: Level, _x: Level, _y: Level) -> Level:
        coarse = rng.standard_normal((under.shape[0] // 8 + 1, under.shape[1] // 8 + 1), dtype=np.float32)
        hills = cv2.GaussianBlur(coarse, (0, 0), max(grain_px, 0.5), borderType=cv2.BORDER_REFLECT_101)
        hills = cv2.resize(hills / max(float(hills.std()), 1e-6), under.shape[::-1], interpolation=cv2.INTER_CUBIC)
        return np.asarray(under * np.clip(1.0 + np.float32(strength) * hills, 0.3, 3.0), np.float32)

    return shade


def hasl(stage: Stage) -> None:
    """Levelled solder: hills, a bright side, a glint or two."""
    rng = stage.rng
    for x, y, radius in ((0.0, 0.0, either_radius(stage)), (60.0, 40.0, either_radius(stage))):
        hole = hole_in(stage, x, y, radius, off=(0.0, 0.08)) if rng.uniform() < 0.4 else None
        stage.round_pad(x, y, radius)
        body = stage.outline(circle(x, y, radius))
        stage.canvas.paint([body], relief(rng, rng.uniform(0.12, 0.35), rng.uniform(1.0, 0.35 * radius)))
        glints(stage, x, y, radius, int(rng.integers(0, 3)), (0.08, 0.25))
        if hole:
            stage.fill(circle(*hole), stage.look.hole)
            stage.pads[-1] = replace(stage.pads[-1], hole=hole)


def glints(stage: Stage, x: float, y: float, radius: float, count: int, share: tuple[float, float]) -> None:
    """Lay that many bright spots on a pad, each of a radius in that share of the pad's."""
    for _ in range(count):
        size = radius * stage.rng.uniform(*share)
        away, way = stage.rng.uniform(0, 0.95 * radius - size), stage.rng.uniform(0, 2 * np.pi)
        spot = circle(x + away * np.cos(way), y + away * np.sin(way), size, ragged=0.1, rng=stage.rng)
        stage.fill(spot, stage.rng.uniform(240, 360))


def solder_dome(stage: Stage) -> None:
    """A drop of solder: it darkens towards its rim and mirrors the lamps."""
    rng = stage.rng
    for x, y, radius in ((0.0, 0.0, either_radius(stage, site=0.75)), (55.0, -45.0, either_radius(stage))):
        pad = stage.round_pad(x, y, radius)
        fall = rng.uniform(0.2, 0.55)
        for share in np.linspace(1.0, 0.15, 18):
            ring = stage.outline(circle(pad.x, pad.y, radius * float(share)))
            level = stage.look.pad * (1.0 - fall * float(share) ** 3)
            stage.canvas.paint([ring], lambda under, _x, _y, level=level: np.full_like(under, level))
        glints(stage, x, y, 0.8 * radius, int(rng.integers(1, 5)), (0.15, 0.38))


def witness_dark(stage: Stage) -> None:
    """A site with a probe's dent as dark as a hole, anywhere on it; there is no drill."""
    radius = stage.rng.uniform(*SITE_RADIUS_PX)
    stage.round_pad(0, 0, radius)
    for _ in range(stage.rng.integers(1, 3)):
        away, way = radius * stage.rng.uniform(0.0, 0.5), stage.rng.uniform(0, 2 * np.pi)
        size = stage.rng.uniform(1.6, 4.0)
        dent = circle(away * np.cos(way), away * np.sin(way), size, ragged=0.15, rng=stage.rng)
        stage.canvas.paint([stage.outline(dent)], capped(stage.look.mask * stage.rng.uniform(0.7, 1.5)))


def scratched(stage: Stage) -> None:
    """A pad with long scratches, bright and dark."""
    radius = either_radius(stage)
    stage.round_pad(0, 0, radius)
    for _ in range(stage.rng.integers(1, 4)):
        ends = stage.rng.uniform(-0.9, 0.9, (2, 2)) * radius
        factor = stage.rng.uniform(0.45, 0.8) if stage.rng.uniform() < 0.6 else stage.rng.uniform(1.2, 1.6)
        for piece in strokes(ends, stage.rng.uniform(0.8, 2.2)):
            stage.canvas.paint([stage.outline(piece)], scaled(factor))


def ringed(stage: Stage) -> None:
    """A pad inside a ring of ink, or rings of ink beside it."""
    rng, radius = stage.rng, either_radius(stage)
    ink = stage.look.silk * rng.uniform(1.0, 1.4)
    if rng.uniform() < 0.5:
        outer = radius + rng.uniform(5, 14)
        stage.annulus(0, 0, outer, outer - rng.uniform(2, 4), ink)
    site_or_hole(stage, radius)
    taken = stage.keep_out(0.0)
    for _ in range(rng.integers(1, 3)):
        outer = float(rng.uniform(6, 21))
        way = rng.uniform(0, 2 * np.pi)
        shift = settled(dense(circle(0, 0, outer), closed=True), way, taken, rng.uniform(4, 20) + 14)
        stage.annulus(*shift, outer, outer - rng.uniform(2, 4), ink)


def thermal(stage: Stage) -> None:
    """A pad whose spokes run over a gap into a plane under the mask, or a bare one."""
    rng, radius = stage.rng, either_radius(stage)
    gap, width, turn = rng.uniform(2.5, 6), rng.uniform(0.35, 0.6) * radius, rng.uniform(0, np.pi)
    plane = stage.look.mask + rng.uniform(8, 22)
    stage.fill(rounded(0, 0, (170, 150), 4, turn), plane)
    stage.fill(circle(0, 0, radius + gap), stage.look.mask)
    for spoke in range(4):
        way = turn + spoke * np.pi / 2
        end = ((radius + gap) * np.cos(way), (radius + gap) * np.sin(way))
        stage.fill(bar((0, 0), end, width), plane if rng.uniform() < 0.7 else stage.look.pad * 0.9)
    site_or_hole(stage, radius)


def lettered(stage: Stage) -> None:
    """A pad among small letters and ink dots as large as vias."""
    rng, radius = stage.rng, either_radius(stage)
    site_or_hole(stage, radius)
    silk_near(stage, radius, rng.uniform(2.0, 6.0))
    small_print(stage, stage.keep_out(rng.uniform(12, 20)))


def small_print(stage: Stage, taken: Points) -> None:
    """Draw letters with round counters, and a dot, clear of what is taken."""
    rng, way = stage.rng, stage.rng.uniform(0, 2 * np.pi)
    ink = stage.look.silk * rng.uniform(0.9, 1.5)
    for _ in range(rng.integers(2, 5)):
        height, width = rng.uniform(11, 34), rng.uniform(2.0, 4.0)
        lines = [
            turned(line * height, rng.integers(0, 4) * np.pi / 2) for line in round_glyph(rng.choice(list("OD8Q")))
        ]
        shift = settled(np.vstack([dense(line) for line in lines]), way, taken, width)
        for line in lines:
            stage.line(line + shift, width, ink)
        taken = np.vstack((taken, *[dense(line) + shift for line in lines]))
        way += rng.uniform(0.2, 2.0)


def dark_mask(stage: Stage) -> None:
    """Black or matt blue mask, nearly no light comes back from it."""
    darker(stage, stage.rng.uniform(1.0, 9.0))
    site_or_hole(stage, either_radius(stage))
    if stage.rng.uniform() < 0.6:
        far_things(stage)


def darker(stage: Stage, mask: float) -> None:
    """Give the board another mask."""
    stage.look = replace(stage.look, mask=mask, hole=0.6 * mask)
    stage.canvas.cells[:] = mask


def oxide(stage: Stage) -> None:
    """Tarnished copper: dark and mottled, still brighter than the mask."""
    rng = stage.rng
    stage.look = replace(stage.look, pad=stage.look.mask + rng.uniform(28, 70))
    for x, y in ((0.0, 0.0), (-50.0, 55.0)):
        radius = either_radius(stage)
        site = stage.round_pad(x, y, radius)
        ring = stage.outline(circle(x, y, radius))
        stage.canvas.paint([ring], relief(rng, rng.uniform(0.10, 0.25), rng.uniform(0.8, 3.0)))
        if rng.uniform() < 0.4:
            hole = hole_in(stage, x, y, radius, off=(0.0, 0.08))
            stage.fill(circle(*hole), stage.look.hole)
            stage.pads[-1] = replace(site, hole=hole)


def ink_dots(stage: Stage) -> None:
    """Dots of ink (pin 1, polarity) of a pad's size, most often with lettering of the same print and lands."""
    rng = stage.rng
    stage.look = replace(stage.look, silk=stage.look.silk * rng.uniform(1.0, 1.6))
    spots = np.zeros((0, 2))
    for _ in range(rng.integers(1, 3)):
        radius = either_radius(stage)
        x, y = rng.uniform(-20, 20, 2) if not len(spots) else rng.uniform(-60, 60, 2)
        ring = circle(float(x), float(y), radius, ragged=0.15, rng=rng)
        stage.fill(ring, stage.look.silk)
        spots = np.vstack((spots, ring))
    way = rng.uniform(0, 2 * np.pi)
    lines, width = text_lines(stage), rng.uniform(3, 7)
    shift = settled(np.vstack([dense(line) for line in lines]), way, spots, width + 3)
    for line in lines:
        stage.line(line + shift, width, stage.look.silk)
    for _ in range(rng.integers(0, 3)):
        way += rng.uniform(1.0, 2.5)
        land = rounded(0, 0, (rng.uniform(20, 45), rng.uniform(14, 26)), rng.uniform(0, 3), rng.uniform(0, np.pi))
        stage.metal(land + settled(dense(land, closed=True), way, spots, rng.uniform(4, 12)))


def ink_rings(stage: Stage) -> None:
    """Circles of ink, thin and thick, alone or with lettering; the board shows in them."""
    rng = stage.rng
    ink = stage.look.silk * rng.uniform(0.9, 1.7)
    outer = either_radius(stage, site=0.8)
    stage.annulus(0, 0, outer, outer - rng.uniform(1.8, min(5.0, 0.5 * outer)), ink)
    if rng.uniform() < 0.6:
        small_print(stage, dense(circle(0, 0, outer + 6), closed=True))


def letters(stage: Stage) -> None:
    """Small round letters alone."""
    small_print(stage, np.zeros((1, 2)))


def tented(stage: Stage) -> None:
    """Vias under the mask: they rise by a share of the mask's own light, and their middles are dimples."""
    rng = stage.rng
    rise = stage.look.mask * rng.uniform(0.15, 0.8)
    for _ in range(rng.integers(1, 5)):
        x, y = (float(v) for v in rng.uniform(-45, 45, 2))
        radius = either_radius(stage, site=0.3)
        stage.lift(circle(x, y, radius), rise)
        if rng.uniform() < 0.7:
            stage.canvas.paint([stage.outline(circle(x, y, 0.35 * radius))], lifted(-rise * rng.uniform(0.3, 1.0)))


def parts(stage: Stage) -> None:
    """Bodies of parts: dark blocks with a dimple or a dot of print, round cans with a bright top."""
    rng = stage.rng
    for _ in range(rng.integers(1, 4)):
        x, y = (float(v) for v in rng.uniform(-45, 45, 2))
        level = float(rng.uniform(0.6, 2.2)) * stage.look.mask
        if rng.uniform() < 0.6:
            size, way = (rng.uniform(40, 90), rng.uniform(30, 60)), rng.uniform(0, np.pi)
            stage.fill(rounded(x, y, size, 2, way), level)
            spot = circle(x + rng.uniform(-10, 10), y + rng.uniform(-10, 10), rng.uniform(4, 9))
            stage.fill(spot, level * rng.uniform(0.5, 1.0) if rng.uniform() < 0.5 else stage.look.silk)
        else:
            outer = float(rng.uniform(24, 45))
            stage.fill(circle(x, y, outer), level)
            stage.fill(circle(x, y, outer * rng.uniform(0.86, 0.93)), level * rng.uniform(1.2, 2.2))


CROWDED_RECIPES: dict[str, Recipe] = {
    "via_field": via_field,
    "pin_row": pin_row,
    "hasl": hasl,
    "solder_dome": solder_dome,
    "witness_dark": witness_dark,
    "scratched": scratched,
    "ringed": ringed,
    "thermal": thermal,
    "lettered": lettered,
    "dark_mask": dark_mask,
    "oxide": oxide,
}
INK_RECIPES: dict[str, Recipe] = {
    "ink_dots": ink_dots,
    "ink_rings": ink_rings,
    "letters": letters,
    "tented": tented,
    "parts": parts,
}


def draw_crowded(stage: Stage, kind: str) -> None:
    """Draw one scene of a crowded, shiny, worn or printed kind."""
    if kind != "dark_mask":
        under_mask(stage)
    (CROWDED_RECIPES | INK_RECIPES)[kind](stage)
    if stage.look.hard:
        stage.dirty()
