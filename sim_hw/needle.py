"""The probe as the camera sees it: a solid of revolution, upright in the world, riding on the head.

It stands still in the picture (camera and probe ride on the same head), so it is drawn once for each place of
its end and then laid over every frame. Blunt end, taper, black marking with ragged rims, shiny cylinder, barrel.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.optics import Optics

Field = npt.NDArray[np.float64]

END_RADIUS_UM = 25.0
RIM2_PX = 127.0  # from the end up to the marking's lower rim, along the needle, as seen
MARKING_PX = 45.0
MARKING_WIDTH_PX = 40.0
CYLINDER_WIDTH_PX = 42.0
CYLINDER_PX = 285.0
BARREL_WIDTH_PX = 75.0
_TOP_UM = 24_000.0  # beyond the upper border of the picture
_STEP_UM = 5.0
_RAGGED_UM = 14.0
_BOWED_PX = 260.0  # a bent probe is straight from here upwards


@dataclass(frozen=True)
class NeedlePicture:
    """A cut-out: upper left corner in the frame, coverage 0..1 and both looks as grey levels, float32 (H, W)."""

    left: int
    top: int
    alpha: npt.NDArray[np.float32]
    white: npt.NDArray[np.float32]
    red: npt.NDArray[np.float32]


class Needle:
    """Draw the probe for given places of its end."""

    def __init__(self, optics: Optics, seed: int) -> None:
        self._seed = seed
        self.heights_um = np.arange(0.0, _TOP_UM, _STEP_UM)
        upright = np.array([0.0, 0.0, 1.0])
        axis_px = optics.project(self.heights_um[:, None] * upright)
        self.tip_px = axis_px[0]
        direction = axis_px[-1] - axis_px[0]
        self.up = direction / np.linalg.norm(direction)  # image direction from the end up along the needle
        #: A bend moves the end this way in the image: the needle's upward direction turned by -90 degrees.
        self.bend_direction = np.array([self.up[1], -self.up[0]])
        self._axis_s = (axis_px - axis_px[0]) @ self.up
        view = optics.rotation.T @ (optics.tip_um / np.linalg.norm(optics.tip_um))
        self.away = np.array([view[0], view[1], 0.0]) / math.hypot(view[0], view[1])
        sideways = np.cross(upright, self.away)
        lift = self.heights_um[:, None] * upright
        aside = optics.project(lift + 100.0 * sideways) - axis_px
        self.across = aside[0] / np.linalg.norm(aside[0])
        self._px_per_um = np.linalg.norm(aside, axis=1) / 100.0
        nearer = optics.project(lift - 100.0 * self.away) - axis_px
        self._drop_per_um = -(nearer @ self.up) / 100.0  # how much lower the near side of a ring appears
        self._shape()

    def _height_at(self, s_px: float) -> float:
        return float(np.interp(s_px, self._axis_s, self.heights_um))

    def _shape(self) -> None:
        """Choose lengths and radii so that the picture has the numbers at the top of this file."""

        def radius_um(width_px: float, height_um: float) -> float:
            return width_px / 2.0 / float(np.interp(height_um, self.heights_um, self._px_per_um))

        def ring_seen_at(s_px: float, body_um: float) -> float:
            seen = self._axis_s - body_um * self._drop_per_um
            return float(np.interp(s_px, seen, self.heights_um))

        body_um = radius_um(MARKING_WIDTH_PX, self._height_at(RIM2_PX + 17.0))
        self.rim2_um = ring_seen_at(RIM2_PX, body_um)
        self.rim1_um = ring_seen_at(RIM2_PX + MARKING_PX, body_um)
        self.barrel_um = ring_seen_at(RIM2_PX + MARKING_PX + CYLINDER_PX, body_um)
        cylinder_um = radius_um(CYLINDER_WIDTH_PX, self.rim1_um + 500.0)
        barrel_um = radius_um(BARREL_WIDTH_PX, self.barrel_um + 1500.0)
        stations = (
            (0.0, END_RADIUS_UM),
            (self.rim2_um - 150.0, body_um),
            (self.rim1_um, body_um),
            (self.rim1_um + 30.0, cylinder_um),
            (self.barrel_um - 60.0, cylinder_um),
            (self.barrel_um + 120.0, barrel_um),
            (_TOP_UM, barrel_um),
        )
        radius = np.interp(self.heights_um, [h for h, _ in stations], [r for _, r in stations])
        self.radius_um = np.asarray(radius)
        self._half_px = self.radius_um * self._px_per_um
        self._drop_px = self.radius_um * self._drop_per_um
        # The outline of a cone is the envelope of its rings, a little wider than the ring at the same place.
        lean = np.gradient(self._half_px, self._axis_s) * self._drop_px / self._half_px
        self._outline_px = self._half_px / np.sqrt(1.0 - np.clip(lean, 0.0, 0.5) ** 2)

    def draw(self, shift_px: tuple[float, float] = (0.0, 0.0), bent_px: float = 0.0) -> NeedlePicture:
        """Return the cut-out with the end shifted in the picture; `bent_px` bows the end sideways."""
        end = self.tip_px + shift_px
        reach = float(self._half_px.max()) + 6.0 + abs(bent_px)
        upper = end + self.up * (end[1] + reach) / -self.up[1]
        left = max(0, math.floor(min(upper[0], end[0]) - reach))
        right = math.ceil(end[0] + reach)
        bottom = math.ceil(end[1] + 8.0)
        columns, rows = np.meshgrid(np.arange(left, right, dtype=np.float64), np.arange(0.0, bottom))
        x, y = columns - end[0], rows - end[1]
        if bent_px:
            bow = bent_px * np.clip(1.0 - (x * self.up[0] + y * self.up[1]) / _BOWED_PX, 0.0, None) ** 2
            x, y = x - bow * self.bend_direction[0], y - bow * self.bend_direction[1]
        determinant = self.up[0] * self.across[1] - self.up[1] * self.across[0]
        s = (x * self.across[1] - y * self.across[0]) / determinant
        v = (self.up[0] * y - self.up[1] * x) / determinant
        return self._shade(left, s, v)

    def _surface(self, s: Field, v: Field) -> tuple[Field, Field, Field]:
        """Return the height of the surface point seen (um), its place across -1..1 and the coverage 0..1."""
        outline = np.interp(s, self._axis_s, self._outline_px)
        end_px = self._drop_px[0] * np.sqrt(np.clip(1.0 - (v / self._half_px[0]) ** 2, 0.0, 1.0))
        alpha = np.clip(outline - np.abs(v) + 0.5, 0.0, 1.0) * np.clip(s + end_px + 0.5, 0.0, 1.0)
        seen, half = s, outline
        for _ in range(4):
            half = np.interp(seen, self._axis_s, self._half_px)
            drop = np.interp(seen, self._axis_s, self._drop_px)
            seen = s + drop * np.sqrt(np.clip(1.0 - (v / half) ** 2, 0.0, 1.0))
        return np.interp(seen, self._axis_s, self.heights_um), np.clip(v / half, -1.0, 1.0), alpha

    def _shade(self, left: int, s: Field, v: Field) -> NeedlePicture:
        heights, q, alpha = self._surface(s, v)
        seen_px = heights * self._axis_s[1] / _STEP_UM
        facing = np.sqrt(np.clip(1.0 - q**2, 0.0, 1.0))
        brushed = self._brushed(heights, q)
        dimming = 1.0 - 0.18 * np.clip(s / 700.0, 0.0, 1.0)
        glossy = np.exp(-(((q - 0.28) / 0.17) ** 2))
        second = np.exp(-(((q + 0.55) / 0.12) ** 2))
        white = (82.0 + 42.0 * facing + 118.0 * glossy + 34.0 * second) * dimming * brushed
        red = (30.0 + 14.0 * facing + 82.0 * np.exp(-(((q + 0.30) / 0.13) ** 2)) + 16.0 * glossy) * dimming * brushed
        black = self._marking(heights, q)
        white = white * (1.0 - black) + black * (17.0 + 9.0 * facing + 9.0 * glossy)
        red = red * (1.0 - black) + black * (10.0 + 5.0 * facing)
        groove = np.exp(-(((heights - self.barrel_um + 90.0) / 70.0) ** 2))
        shade = (1.0 - 0.55 * groove) * (0.62 + 0.38 * np.clip(seen_px / 3.0, 0.0, 1.0))
        return NeedlePicture(
            left,
            0,
            alpha.astype(np.float32),
            (white * shade).astype(np.float32),
            (red * shade).astype(np.float32),
        )

    def _marking(self, heights: Field, q: Field) -> Field:
        """Return how black the surface is, 0..1; its rims waver round the needle."""
        rng = np.random.default_rng((self._seed, 1))
        around = np.arcsin(q)
        waver = np.zeros_like(q)
        worn = np.zeros_like(q)
        for order in (2, 3, 5, 8, 13):
            phase, other = rng.uniform(0.0, 2.0 * math.pi, 2)
            waver += np.sin(order * around + phase) / order**0.7
            worn += np.sin(order * around + other) / order**0.7
        waver *= _RAGGED_UM / 1.6
        worn *= _RAGGED_UM / 1.6
        soft_um = 14.0
        lower = np.clip((heights - self.rim2_um - waver) / soft_um + 0.5, 0.0, 1.0)
        upper = np.clip((self.rim1_um + worn - heights) / soft_um + 0.5, 0.0, 1.0)
        return np.asarray(lower * upper)

    def _brushed(self, heights: Field, q: Field) -> Field:
        """Return the fine lengthwise and crosswise streaks of turned metal, about 1."""
        rng = np.random.default_rng((self._seed, 2))
        rings = cv2.GaussianBlur(rng.standard_normal((1, 4096)), (0, 0), 2.0)[0]
        lines = cv2.GaussianBlur(rng.standard_normal((1, 512)), (0, 0), 3.0)[0]
        ring = np.interp(np.clip(heights, 0.0, _TOP_UM) / _TOP_UM * 4095.0, np.arange(4096.0), rings)
        line = np.interp((np.arcsin(q) / math.pi + 0.5) * 511.0, np.arange(512.0), lines)
        return np.asarray(1.0 + 0.07 * ring + 0.10 * line)
