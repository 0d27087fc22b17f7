"""Probe as the camera sees it: a solid of revolution, upright in the world, riding on the head.

It stands still in the image (camera and probe ride on the same head), so it is drawn once for each place of
its end and then laid over every frame. Blunt end, taper, black marking with ragged rims, shiny cylinder, barrel.
A pressed pin is pushed into its barrel: all below the barrel moves up, in the image by the projection of that way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.scene.optics import Optics

Field = npt.NDArray[np.float64]

END_RADIUS_UM = 25.0
RIM2_PX = 127.0
"""From the end up to the marking's lower rim, along the needle, as seen."""
MARKING_PX = 45.0
MARKING_WIDTH_PX = 40.0
CYLINDER_WIDTH_PX = 42.0
CYLINDER_PX = 285.0
BARREL_WIDTH_PX = 75.0
_TOP_UM = 24_000.0
"""Beyond the upper border of the image."""
_STEP_UM = 5.0
_RAGGED_UM = 14.0
_BOWED_PX = 260.0
"""A bent probe is straight from here upwards."""
_RIM_REACH_UM = 100.0
"""No rim of the marking wavers farther."""


@dataclass(frozen=True)
class NeedleImage:
    """A cut-out: upper left corner in the frame, coverage 0..1 and both looks as grey levels, float32 (H, W)."""

    left: int
    top: int
    alpha: npt.NDArray[np.float32]
    white: npt.NDArray[np.float32]
    red: npt.NDArray[np.float32]


@dataclass(frozen=True)
class _Profile:
    """How the needle is seen along its axis: its end (px), half width, drop of the near side and outline (N,), px."""

    pressed_um: float
    end_px: float
    end_half_px: float
    end_drop_px: float
    half_px: Field
    drop_px: Field
    outline_px: Field


class Needle:
    """Draw the probe for given places of its end."""

    def __init__(self, optics: Optics, seed: int) -> None:
        self._seed = seed
        self._optics = optics
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
        """Choose lengths and radii so that the image has the numbers at the top of this file."""

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
        self._plunger_um = self.barrel_um - 60.0
        stations = (
            (0.0, END_RADIUS_UM),
            (self.rim2_um - 150.0, body_um),
            (self.rim1_um, body_um),
            (self.rim1_um + 30.0, cylinder_um),
            (self._plunger_um, cylinder_um),
            (self.barrel_um + 120.0, barrel_um),
            (_TOP_UM, barrel_um),
        )
        self._stations = np.array(stations)
        self._free = self._profile(0.0)

    def radius_um(self, heights_um: Field, pressed_um: float = 0.0) -> Field:
        """Return the radius of the needle at heights (N,) over the place of the free pin's end."""
        heights, radii = self._stations.T
        # The barrel's foot hides the plunger: the straight cylinder is what goes in.
        material_um = np.where(heights_um < self._plunger_um, heights_um - pressed_um, heights_um)
        return np.asarray(np.interp(material_um, heights, radii))

    def _profile(self, pressed_um: float) -> _Profile:
        """Work out how the needle is seen along its axis."""
        half_px = self.radius_um(self.heights_um, pressed_um) * self._px_per_um
        drop_px = self.radius_um(self.heights_um, pressed_um) * self._drop_per_um
        # The outline of a cone is the envelope of its rings, a little wider than the ring at the same place.
        lean = np.gradient(half_px, self._axis_s) * drop_px / half_px
        return _Profile(
            pressed_um=pressed_um,
            end_px=float(np.interp(pressed_um, self.heights_um, self._axis_s)),
            end_half_px=END_RADIUS_UM * float(np.interp(pressed_um, self.heights_um, self._px_per_um)),
            end_drop_px=END_RADIUS_UM * float(np.interp(pressed_um, self.heights_um, self._drop_per_um)),
            half_px=half_px,
            drop_px=drop_px,
            outline_px=half_px / np.sqrt(1.0 - np.clip(lean, 0.0, 0.5) ** 2),
        )

    def end_px(self, pressed_um: float = 0.0) -> Field:
        """Return where the end of a straight needle is seen (2,) with its pin pushed in so far."""
        return np.asarray(self._optics.project([[0.0, 0.0, pressed_um]])[0])

    def draw(
        self, shift_px: tuple[float, float] = (0.0, 0.0), bent_px: float = 0.0, pressed_um: float = 0.0
    ) -> NeedleImage:
        """Return the cut-out of a needle shifted in the image; `bent_px` bows its end sideways."""
        profile = self._profile(pressed_um) if pressed_um else self._free
        end = self.tip_px + shift_px
        reach = float(profile.half_px.max()) + 6.0 + abs(bent_px)
        upper = end + self.up * (end[1] + reach) / -self.up[1]
        left = max(0, math.floor(min(upper[0], end[0]) - reach))
        right = math.ceil(end[0] + reach)
        bottom = math.ceil(end[1] + 8.0)
        columns, rows = np.meshgrid(np.arange(left, right, dtype=np.float64), np.arange(0.0, bottom))
        x, y = columns - end[0], rows - end[1]
        if bent_px:
            away = x * self.up[0] + y * self.up[1] - profile.end_px
            bow = bent_px * np.clip(1.0 - away / _BOWED_PX, 0.0, None) ** 2
            x, y = x - bow * self.bend_direction[0], y - bow * self.bend_direction[1]
        determinant = self.up[0] * self.across[1] - self.up[1] * self.across[0]
        s = (x * self.across[1] - y * self.across[0]) / determinant
        v = (self.up[0] * y - self.up[1] * x) / determinant
        # Most of the upright box about the slanting needle is beside it.
        seen = np.abs(v) < float(profile.outline_px.max()) + 0.5
        s, v = s[seen], v[seen]
        near = np.abs(v) < np.interp(s, self._axis_s, profile.outline_px) + 0.5
        seen[seen] = near
        fields = self._shade(profile, s[near], v[near])
        return NeedleImage(left, 0, *(_spread(seen, field) for field in fields))

    def _surface(self, profile: _Profile, s: Field, v: Field) -> tuple[Field, Field, Field]:
        """Return the height of the surface point seen (um), its place across -1..1 and the coverage 0..1."""
        outline = np.interp(s, self._axis_s, profile.outline_px)
        end_px = profile.end_drop_px * np.sqrt(np.clip(1.0 - (v / profile.end_half_px) ** 2, 0.0, 1.0))
        below = np.clip(s - profile.end_px + end_px + 0.5, 0.0, 1.0)
        alpha = np.clip(outline - np.abs(v) + 0.5, 0.0, 1.0) * below
        seen, half = s, outline
        for _ in range(4):
            half = np.interp(seen, self._axis_s, profile.half_px)
            drop = np.interp(seen, self._axis_s, profile.drop_px)
            seen = s + drop * np.sqrt(np.clip(1.0 - (v / half) ** 2, 0.0, 1.0))
        return np.interp(seen, self._axis_s, self.heights_um), np.clip(v / half, -1.0, 1.0), alpha

    def _shade(self, profile: _Profile, s: Field, v: Field) -> tuple[Field, Field, Field]:
        """Return the coverage and both looks of places `s` px along the needle and `v` px across it."""
        heights, q, alpha = self._surface(profile, s, v)
        groove = np.exp(-(((heights - self.barrel_um + 90.0) / 70.0) ** 2))
        # From here on heights count along the material: what is on the plunger moves with it.
        heights = np.where(heights < self._plunger_um, heights - profile.pressed_um, heights)
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
        shade = (1.0 - 0.55 * groove) * (0.62 + 0.38 * np.clip(seen_px / 3.0, 0.0, 1.0))
        return alpha, white * shade, red * shade

    def _marking(self, heights: Field, q: Field) -> Field:
        """Return how black the surface is, 0..1; its rims waver round the needle."""
        black = np.zeros_like(q)
        near = (heights > self.rim2_um - _RIM_REACH_UM) & (heights < self.rim1_um + _RIM_REACH_UM)
        around = np.arcsin(q[near])
        rng = np.random.default_rng((self._seed, 1))
        waver = np.zeros_like(around)
        worn = np.zeros_like(around)
        for order in (2, 3, 5, 8, 13):
            phase, other = rng.uniform(0.0, 2.0 * math.pi, 2)
            waver += np.sin(order * around + phase) / order**0.7
            worn += np.sin(order * around + other) / order**0.7
        waver *= _RAGGED_UM / 1.6
        worn *= _RAGGED_UM / 1.6
        soft_um = 14.0
        lower = np.clip((heights[near] - self.rim2_um - waver) / soft_um + 0.5, 0.0, 1.0)
        upper = np.clip((self.rim1_um + worn - heights[near]) / soft_um + 0.5, 0.0, 1.0)
        black[near] = lower * upper
        return black

    def _brushed(self, heights: Field, q: Field) -> Field:
        """Return the fine lengthwise and crosswise streaks of turned metal, about 1."""
        rng = np.random.default_rng((self._seed, 2))
        rings = cv2.GaussianBlur(rng.standard_normal((1, 4096)), (0, 0), 2.0)[0]
        lines = cv2.GaussianBlur(rng.standard_normal((1, 512)), (0, 0), 3.0)[0]
        ring = np.interp(np.clip(heights, 0.0, _TOP_UM) / _TOP_UM * 4095.0, np.arange(4096.0), rings)
        line = np.interp((np.arcsin(q) / math.pi + 0.5) * 511.0, np.arange(512.0), lines)
        return np.asarray(1.0 + 0.07 * ring + 0.10 * line)


def _spread(where: npt.NDArray[np.bool_], values: Field) -> npt.NDArray[np.float32]:
    """Return an image (H, W) that holds the values where they belong and 0 elsewhere."""
    image = np.zeros(where.shape, dtype=np.float32)
    image[where] = values
    return image
