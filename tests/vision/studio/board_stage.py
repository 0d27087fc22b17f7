"""The board being drawn: its materials under red light, and the things that are laid on it one over the other."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from tests.vision.studio.board_canvas import Canvas, Level, Points, flat, lifted, ramp, scaled
from tests.vision.studio.board_shapes import circle, dense, strokes
from tests.vision.studio.board_view import View


@dataclass(frozen=True)
class Look:
    """Grey levels of the materials before the lamp's gain, and how worn the board is."""

    mask: float
    pad: float
    silk: float
    hole: float
    slope: float
    """Change of brightness across a pad's radius, as a share."""
    ragged_px: float
    grain: float
    """Standard deviation of the materials' texture, as a share of their level."""
    hard: bool


@dataclass(frozen=True)
class Pad:
    """A round test pad in flat px; ``hole`` is (x, y, radius) where one is drawn."""

    x: float
    y: float
    radius: float
    hole: tuple[float, float, float] | None = None

    @property
    def target(self) -> tuple[float, float]:
        return self.hole[:2] if self.hole else (self.x, self.y)


@dataclass
class Stage:
    """One scene in the making. Drawing order is stacking order."""

    rng: np.random.Generator
    view: View
    look: Look
    canvas: Canvas
    pads: list[Pad] = field(default_factory=list)

    def outline(self, ring: Points) -> Points:
        return self.view.project(ring)

    def fill(self, ring: Points, level: float) -> None:
        self.canvas.paint([self.outline(ring)], flat(level))

    def lift(self, ring: Points, levels: float) -> None:
        self.canvas.paint([self.outline(ring)], lifted(levels))

    def annulus(self, x: float, y: float, outer: float, inner: float, level: float) -> None:
        rings = [self.outline(circle(x, y, outer)), self.outline(circle(x, y, inner)[::-1])]
        self.canvas.paint(rings, flat(level))

    def metal(self, ring: Points, *, share: float = 1.0) -> None:
        """Lay bare copper or solder: it catches the lamp a little unevenly."""
        seen = self.outline(ring)
        middle = seen.mean(axis=0)
        reach = max(float(np.ptp(seen, axis=0).max()) / 2, 4.0)
        way = self.rng.uniform(0.0, 2 * np.pi)
        slope = self.look.slope * self.rng.uniform(0.3, 1.0) / reach
        level = self.look.pad * share
        self.canvas.paint(
            [seen], ramp(level, (float(middle[0]), float(middle[1])), (slope * np.cos(way), slope * np.sin(way)))
        )

    def line(self, points: Points, width: float, level: float) -> None:
        for piece in strokes(points, width):
            self.fill(piece, level)

    def pad_ring(self, x: float, y: float, radius: float) -> Points:
        return circle(x, y, radius, ragged=self.look.ragged_px, rng=self.rng)

    def round_pad(
        self, x: float, y: float, radius: float, *, hole: tuple[float, float, float] | None = None, listed: bool = True
    ) -> Pad:
        """Draw a round pad with an optional hole (x, y, radius); ``listed`` puts it among the true pads."""
        self.metal(self.pad_ring(x, y, radius))
        if hole:
            self.fill(circle(*hole, ragged=self.look.ragged_px / 2, rng=self.rng), self.look.hole)
        pad = Pad(x, y, radius, hole)
        if listed:
            self.pads.append(pad)
        return pad

    def keep_out(self, margin: float) -> Points:
        """Return points round every listed pad, ``margin`` outside its rim."""
        return np.vstack([dense(circle(p.x, p.y, p.radius + margin), closed=True) for p in self.pads])

    def dirty(self) -> None:
        """Strew dirt and glints over the pads: only on a hard board."""
        for pad in self.pads:
            for _ in range(self.rng.integers(0, 4)):
                away, way = pad.radius * np.sqrt(self.rng.uniform(0, 1.1)), self.rng.uniform(0, 2 * np.pi)
                x, y = pad.x + away * np.cos(way), pad.y + away * np.sin(way)
                speck = circle(x, y, self.rng.uniform(0.4, 1.3), ragged=0.15, rng=self.rng)
                self.canvas.paint([self.outline(speck)], scaled(self.rng.uniform(0.2, 0.6)))
            for _ in range(self.rng.integers(0, 3)):
                away, way = pad.radius * np.sqrt(self.rng.uniform(0, 1.0)), self.rng.uniform(0, 2 * np.pi)
                spot = circle(pad.x + away * np.cos(way), pad.y + away * np.sin(way), self.rng.uniform(0.4, 1.4))
                self.fill(spot, self.rng.uniform(230, 330))

    def finished(self, frame: Level) -> None:
        """Give the patch its grain and write it into the frame."""
        self.canvas.laid_into(frame)
        y0, x0 = max(self.canvas.y0_px, 0), max(self.canvas.x0_px, 0)
        side = self.canvas.cells.shape[0] // self.canvas.scale
        patch = frame[y0 : y0 + side, x0 : x0 + side]
        patch *= 1.0 + grain(self.rng, patch.shape, self.look.grain)


def grain(rng: np.random.Generator, shape: tuple[int, ...], spread: float) -> Level:
    """Return texture of about 1.5 px and of about 9 px, with standard deviation ``spread`` together."""
    if spread <= 0:
        return np.zeros(shape, np.float32)
    texture = np.zeros(shape, np.float32)
    for sigma_px, weight in ((1.5, 0.7), (9.0, 0.7)):
        layer = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), sigma_px)
        texture += np.float32(weight * spread / max(float(layer.std()), 1e-6)) * layer
    return texture
