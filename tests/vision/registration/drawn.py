"""A board made up by a seed, its CAD known exactly, drawn by the studio's own painting: camera, needle and lens."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.vision.studio.board_canvas import filled, shrunk
from tests.vision.studio.board_needle import Needle, draw_needle, random_needle
from tests.vision.studio.board_view import FRAME_HW, tilted_view
from tests.vision.studio.lens import develop
from vision.registration import Hole, Polygon, SideLayers, Target

Points = NDArray[np.float64]
TIP_PX = (700.0, 600.0)
UM_PER_PX = 12.0
TEXEL_UM = 10.0
GROWTH_TEXELS = 0.4
"""What filling paints too much on each side."""
MASK, COVERED, INK, LAMINATE, METAL, HOLE, BENCH = 34.0, 47.0, 112.0, 55.0, 180.0, 12.0, 16.0
WIDTH_UM, HEIGHT_UM = 36_000.0, 28_000.0


def circle(x: float, y: float, diameter: float) -> Points:
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return np.column_stack((x + diameter / 2 * np.cos(angle), y + diameter / 2 * np.sin(angle)))


def box(x: float, y: float, width: float, height: float) -> Points:
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]]) - (width / 2, height / 2)


def stroke(a: tuple[float, float], b: tuple[float, float], width: float) -> Points:
    start, end = np.array(a), np.array(b)
    along = (end - start) / np.linalg.norm(end - start)
    aside = width / 2 * np.array([-along[1], along[0]])
    return np.array([start - aside, end - aside, end + aside, start + aside])


def some_board(seed: int, *, parts: int = 34, vias: int = 50, letters: int = 40) -> tuple[SideLayers, list[Target]]:
    """Return a side and the targets on it: pads of two-pad parts and open vias, all in places of their own."""
    rng = np.random.default_rng(seed)
    copper, openings, ink, holes, targets = [], [], [], [], []
    taken: list[tuple[float, float]] = []

    def place(gap: float) -> tuple[float, float]:
        while True:
            # On whole texels, or the drawing itself would be off by up to half of one.
            x, y = 100 * rng.integers(20, WIDTH_UM // 100 - 20), 100 * rng.integers(20, HEIGHT_UM // 100 - 20)
            if all(np.hypot(x - a, y - b) > gap for a, b in taken):
                taken.append((float(x), float(y)))
                return float(x), float(y)

    for _ in range(parts):
        x, y = place(2600)
        wide, high, apart = rng.choice([500, 700, 1000]), rng.choice([500, 800, 1300]), rng.choice([900, 1300, 1800])
        upright = rng.random() < 0.5
        for side in (-1, 1):
            at = (x, y + side * apart / 2) if upright else (x + side * apart / 2, y)
            shape = box(*at, wide, high)
            copper.append(Polygon(shape))
            openings.append(Polygon(box(*at, wide + 100, high + 100)))
            targets.append(Target(*at, shape))
        ink.append(Polygon(stroke((x - 1100, y - 1300), (x + 1100, y - 1300), 150)))
    for _ in range(vias):
        x, y = place(1500)
        copper.append(Polygon(circle(x, y, 700)))
        openings.append(Polygon(circle(x, y, 800)))
        holes.append(Hole(x, y, 300))
        targets.append(Target(x, y, circle(x, y, 700)))
    for _ in range(letters):
        x, y = place(900)
        for _ in range(3):
            dx, dy = rng.uniform(-450, 450, 2)
            ink.append(Polygon(stroke((x - dx, y - dy - 200), (x + dx, y + dy + 200), 150)))
    for _ in range(40):
        (x, y), (dx, dy) = rng.uniform((0, 0), (WIDTH_UM, HEIGHT_UM)), rng.uniform(-6000, 6000, 2)
        copper.append(Polygon(stroke((x, y), (x + dx, y + dy), 250)))
    outline = Polygon(box(WIDTH_UM / 2, HEIGHT_UM / 2, WIDTH_UM, HEIGHT_UM))
    layers = SideLayers(tuple(copper), tuple(openings), tuple(ink), tuple(holes), (outline,))
    inner = [t for t in targets if 9000 < t.x_um < WIDTH_UM - 9000 and 8000 < t.y_um < HEIGHT_UM - 8000]
    return layers, inner


def pin_row(pins: int) -> tuple[SideLayers, list[Target]]:
    """Return a side with one row of equal pins through the middle of a long plain board, and its pins."""
    copper, openings, holes, targets = [], [], [], []
    length = (pins + 1) * 2540.0
    for k in range(pins):
        x, y = (k + 1) * 2540.0, HEIGHT_UM / 2
        copper.append(Polygon(circle(x, y, 1700)))
        openings.append(Polygon(circle(x, y, 1800)))
        holes.append(Hole(x, y, 1000))
        targets.append(Target(x, y, circle(x, y, 1700)))
    outline = Polygon(box(length / 2, HEIGHT_UM / 2, length, HEIGHT_UM))
    return SideLayers(tuple(copper), tuple(openings), (), tuple(holes), (outline,)), targets


@dataclass(frozen=True)
class Lie:
    """How the board really lies against what is assumed; turned about its middle."""

    x_um: float = 0.0
    y_um: float = 0.0
    turn_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class Shot:
    frame: NDArray[np.uint8]
    assumed: NDArray[np.float64]
    real: NDArray[np.float64]
    needle: Needle | None

    def truth_px(self, target: Target) -> Points:
        mapped = self.real @ (target.x_um, target.y_um, 1.0)
        return np.asarray(mapped[:2] / mapped[2])

    def truth_um(self, target: Target) -> Points:
        mapped = np.linalg.inv(self.assumed) @ (*self.truth_px(target), 1.0)
        return np.asarray(mapped[:2] / mapped[2])

    @property
    def hidden_px(self) -> list[Points]:
        return [] if self.needle is None else [self.needle.outline()]


def shoot(
    layers: SideLayers | None,
    at: Target,
    lie: Lie,
    rng: np.random.Generator,
    *,
    needle: bool = False,
    dirt: int = 0,
    bodies_level: float = 90.0,
    gain: float = 1.0,
) -> Shot:
    """Look with the tip over where a target is assumed; `layers` None: no board lies there."""
    view = tilted_view(TIP_PX, float(rng.uniform(-0.4, 0.4)), np.deg2rad(30.0), float(rng.uniform(0, 2 * np.pi)))
    to_flat = np.array([[1.0, 0.0, -at.x_um], [0.0, -1.0, at.y_um], [0.0, 0.0, UM_PER_PX]])
    assumed = view.matrix @ to_flat
    real = assumed @ _pose(lie)
    level = np.full(FRAME_HW, BENCH, dtype=np.float32)
    if layers is not None:
        texture = _soiled(paint(layers, bodies_level), rng, dirt)
        corner = TEXEL_UM / 2 - 1000.0
        texel = np.array([[TEXEL_UM, 0.0, corner], [0.0, TEXEL_UM, corner], [0.0, 0.0, 1.0]])
        size = (FRAME_HW[1], FRAME_HW[0])
        seen = cv2.warpPerspective(texture, real @ texel, size, flags=cv2.INTER_LINEAR, borderValue=BENCH)
        coarse = rng.normal(1.0, 0.03, (FRAME_HW[0] // 8, FRAME_HW[1] // 8)).astype(np.float32)
        level = seen.astype(np.float32) * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    shown = None
    if needle:
        shown = random_needle(rng, (TIP_PX[0] + rng.uniform(-8, 8), TIP_PX[1] + rng.uniform(-8, 8)))
        draw_needle(level, shown)
    frame = develop(level, gain=gain, blur_px=0.9, noise=3.0, spikes=0.0, falloff=0.1, colour="red", rng=rng)
    return Shot(frame, assumed, real, shown)


def _pose(lie: Lie) -> NDArray[np.float64]:
    c, s = np.cos(np.radians(lie.turn_deg)), np.sin(np.radians(lie.turn_deg))
    x, y = WIDTH_UM / 2, HEIGHT_UM / 2
    return np.array([[c, -s, x - c * x + s * y + lie.x_um], [s, c, y - s * x - c * y + lie.y_um], [0.0, 0.0, 1.0]])


@lru_cache(maxsize=6)
def paint(layers: SideLayers, bodies_level: float = 90.0) -> NDArray[np.uint8]:
    """Return the board as light, rows along y, 1 mm of bench around: material by material."""
    far = np.vstack([polygon.points_um for polygon in layers.outline]).max(axis=0)
    columns, rows = (int(v) for v in np.ceil((far + 2000.0) / TEXEL_UM))
    copper, opened, ink, bodies, outline = (
        _plane(polygons, rows, columns)
        for polygons in (layers.copper, layers.openings, layers.ink, layers.bodies, layers.outline)
    )
    drilled = tuple(Polygon(circle(h.x_um, h.y_um, h.diameter_um)) for h in layers.holes)
    holes = _plane(drilled, rows, columns)
    level = np.full((rows, columns), MASK, dtype=np.uint8)
    level[copper] = COVERED
    level[ink] = INK
    level[opened] = LAMINATE
    level[opened & copper] = METAL
    level[holes & opened] = HOLE
    level[bodies] = bodies_level
    level[~outline] = BENCH
    return level


def _plane(polygons: tuple[Polygon, ...], rows: int, columns: int) -> NDArray[np.bool_]:
    whole = np.zeros((rows, columns), dtype=bool)
    for polygon in polygons:
        texels = (polygon.points_um + 1000.0) / TEXEL_UM - 0.5
        # One polygon at a time, for later ones lie over earlier ones; and only in its own box.
        low = np.maximum(np.floor(texels.min(axis=0)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(texels.max(axis=0)).astype(int) + 3, (columns, rows))
        if (high <= low).any():
            continue
        ring = shrunk(_counter_clockwise(texels - low), GROWTH_TEXELS)
        inside = filled([ring], (int(high[1] - low[1]), int(high[0] - low[0]))) > 0
        whole[low[1] : high[1], low[0] : high[0]][inside] = polygon.dark
    return whole


def _soiled(level: NDArray[np.uint8], rng: np.random.Generator, dirt: int) -> NDArray[np.uint8]:
    rows, columns = level.shape
    soiled = level.copy()
    for _ in range(dirt):
        at = (int(rng.integers(columns)), int(rng.integers(rows)))
        axes = (int(rng.integers(6, 60)), int(rng.integers(6, 60)))
        cv2.ellipse(soiled, at, axes, float(rng.uniform(0, 180)), 0, 360, float(rng.uniform(5, 200)), -1)
    return soiled


def _counter_clockwise(ring: Points) -> Points:
    x, y = ring.T
    return ring if float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) > 0 else ring[::-1]


def without(layers: SideLayers, target: Target) -> SideLayers:
    """Return the side as it is when one pad is missing: neither its copper nor its opening is there."""

    def elsewhere(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(p for p in polygons if np.hypot(*(p.points_um.mean(axis=0) - (target.x_um, target.y_um))) > 20.0)

    return replace(layers, copper=elsewhere(layers.copper), openings=elsewhere(layers.openings))


def moved(layers: SideLayers, target: Target, dx: float, dy: float) -> SideLayers:
    """Return the side with one pad, its opening and its hole, shifted against all the rest."""

    def shifted(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        at = (target.x_um, target.y_um)
        return tuple(
            replace(p, points_um=p.points_um + np.array((dx, dy)))
            if np.hypot(*(p.points_um.mean(axis=0) - at)) < 20.0
            else p
            for p in polygons
        )

    return replace(layers, copper=shifted(layers.copper), openings=shifted(layers.openings))
