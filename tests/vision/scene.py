"""Draw what the camera sees, with the truth known to a hundredth of a pixel.

Shapes are signed distances in image pixels (negative inside); a shape's cover of a pixel follows from its distance,
on a grid twice as fine as the picture. Then come the lens (blur), the light (gain, fall-off), and the sensor (noise).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]
FRAME_WIDTH, FRAME_HEIGHT = 1600, 1200
NOMINAL_TIP = (428.0, 620.0)
AXIS_DEG = float(np.degrees(np.arctan2(232.0, 119.0)))
FINER = 2


@dataclass(frozen=True)
class Needle:
    tip: tuple[float, float] = NOMINAL_TIP
    angle_deg: float = AXIS_DEG
    taper_px: float = 127.0
    marking_px: float = 45.0
    end_width_px: float = 4.4
    rim_width_px: float = 40.0
    cylinder_width_px: float = 42.0
    bulge_px: float = 6.0  # how far the rims bow towards the tip (a circle seen obliquely)
    bend_deg: float = 0.0  # taper turned against the cylinder, about rim 2
    marked: bool = True
    highlight_at: float = 0.25  # of the half width
    marking_seed: int = 5
    dim_side: int = 0  # lit from one side: the flank on the side of this sign of v is hardly brighter than the ground
    flare: float = 0.0  # how much the cylinder's half width grows per px towards the barrel


def side_lit(dim_side: int, tapered: bool) -> Needle:
    """Return a needle lit from one side, one long taper or with a cylinder."""
    needle = Needle(dim_side=dim_side, highlight_at=-0.25 * dim_side)
    if not tapered:
        return needle
    return replace(needle, end_width_px=6.0, rim_width_px=24.0, cylinder_width_px=24.0, flare=0.068)


@dataclass(frozen=True)
class Camera:
    gain: float = 1.0
    blur_px: float = 1.0
    noise: float = 3.0
    spikes: float = 0.0  # share of pixels turned salt or pepper
    glint: bool = False
    falloff: float = 0.05


@dataclass(frozen=True)
class Pad:
    """An ellipse: semi-major radius_px, minor axis along the needle's direction, optional hole off its centre."""

    x: float
    y: float
    radius_px: float
    hole_px: float = 0.0
    hole_shift: tuple[float, float] = (0.0, 0.0)
    ratio: float = 0.87
    level: float = 190.0
    trace_deg: float | None = None  # an exposed trace leaving it
    trace_width_px: float = 4.0

    @property
    def target(self) -> tuple[float, float]:
        if self.hole_px > 0:
            return self.x + self.hole_shift[0], self.y + self.hole_shift[1]
        return self.x, self.y


class Canvas:
    """A part of the frame, drawn fine."""

    def __init__(self, centre: tuple[float, float], half: tuple[int, int], base: float) -> None:
        self.x0, self.y0 = round(centre[0]) - half[0], round(centre[1]) - half[1]
        self.width, self.height = 2 * half[0], 2 * half[1]
        columns = self.x0 + (np.arange(self.width * FINER, dtype=np.float32) + 0.5) / FINER - 0.5
        rows = self.y0 + (np.arange(self.height * FINER, dtype=np.float32) + 0.5) / FINER - 0.5
        self.x, self.y = np.meshgrid(columns, rows)
        self.level: Field = np.full(self.x.shape, base, dtype=np.float32)

    def paint(self, distance: Field, level: Field | float) -> None:
        cover = np.clip(0.5 - distance * FINER, 0.0, 1.0)
        self.level += cover * (level - self.level)

    def part(self, at: tuple[float, float], reach: float) -> Canvas:
        """Return a window on this canvas (the same memory) that holds everything within reach of a point."""
        x1, x2 = (int(np.clip((at[0] - self.x0 + way) * FINER, 0, self.level.shape[1])) for way in (-reach, reach))
        y1, y2 = (int(np.clip((at[1] - self.y0 + way) * FINER, 0, self.level.shape[0])) for way in (-reach, reach))
        window = object.__new__(Canvas)
        window.x, window.y, window.level = (field[y1:y2, x1:x2] for field in (self.x, self.y, self.level))
        return window

    def along(self, at: tuple[float, float], angle_deg: float) -> tuple[Field, Field]:
        angle = np.radians(angle_deg)
        c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
        dx, dy = self.x - np.float32(at[0]), self.y - np.float32(at[1])
        return dx * c + dy * s, dy * c - dx * s

    def ellipse(self, x: float, y: float, radius: float, ratio: float, minor_deg: float) -> Field:
        u, v = self.along((x, y), minor_deg)
        rho = np.sqrt((u / ratio) ** 2 + v**2) + 1e-6
        slope = np.sqrt((u / ratio**2) ** 2 + v**2) / rho
        return (rho - radius) / np.maximum(slope, 1e-3)

    def bar(self, at: tuple[float, float], angle_deg: float, length: float, width: float) -> Field:
        u, v = self.along(at, angle_deg)
        return np.maximum(np.abs(u) - length / 2, np.abs(v) - width / 2)

    def develop(self, camera: Camera, rng: np.random.Generator) -> NDArray[np.uint8]:
        level = cv2.GaussianBlur(self.level, (0, 0), camera.blur_px * FINER)
        level = cv2.resize(level, (self.width, self.height), interpolation=cv2.INTER_AREA)
        rows, columns = np.mgrid[0 : self.height, 0 : self.width]
        level = level * camera.gain * (1.0 - camera.falloff * (columns / self.width + rows / self.height - 1.0))
        level = level + rng.normal(0.0, camera.noise, level.shape)
        if camera.spikes:
            dice = rng.random(level.shape)
            level[dice < camera.spikes / 2] = 0
            level[dice > 1 - camera.spikes / 2] = 255
        return np.clip(np.rint(level), 0, 255).astype(np.uint8)


def board_behind(canvas: Canvas, rng: np.random.Generator, white: bool, clutter: float) -> None:
    """Draw solder mask, traces under it, silkscreen, pads, scattered over the whole canvas."""
    texture = rng.normal(0.0, 1.0, (canvas.height // 8 + 1, canvas.width // 8 + 1)).astype(np.float32)
    canvas.level += 4.0 * cv2.resize(texture, canvas.level.shape[::-1], interpolation=cv2.INTER_CUBIC)

    def place() -> tuple[float, float]:
        return canvas.x0 + rng.random() * canvas.width, canvas.y0 + rng.random() * canvas.height

    for _ in range(int(12 * clutter)):
        at = place()
        near = canvas.part(at, 165.0)
        near.paint(near.bar(at, rng.choice([0, 45, 90, 135]), 300, rng.uniform(8, 24)), 48.0)
    for _ in range(int(6 * clutter)):
        level, at = rng.uniform(150, 220), place()
        near = canvas.part(at, 80.0)
        if rng.random() < 0.5:
            near.paint(near.ellipse(*at, rng.uniform(8, 45), 0.87, AXIS_DEG), level)
        else:
            near.paint(near.bar(at, rng.uniform(0, 180), rng.uniform(30, 90), rng.uniform(20, 60)), level)
    for _ in range(int(6 * clutter)):
        level = rng.uniform(150, 200) if white else rng.uniform(90, 140)
        at = place()
        near = canvas.part(at, 80.0)
        near.paint(near.bar(at, rng.choice([0, 30, 90, 120]), rng.uniform(40, 120), 10), level)


def draw_needle(canvas: Canvas, needle: Needle, white: bool) -> None:
    """Draw cylinder, marking and taper; the tip's end lies at needle.tip whatever the bend."""
    tip, taper = needle.tip, needle.taper_px
    u, v = canvas.along(tip, needle.angle_deg + needle.bend_deg)
    slope = (needle.rim_width_px - needle.end_width_px) / 2 / taper
    half = needle.end_width_px / 2 - slope * u
    inside = np.maximum(np.maximum((np.abs(v) - half) / np.hypot(1.0, slope), u), -u - taper - 2.0)
    canvas.paint(inside, _metal(v / np.maximum(half, 0.5), needle, white))
    bend = np.radians(needle.angle_deg + needle.bend_deg)
    rim2 = tip[0] - taper * np.cos(bend), tip[1] - taper * np.sin(bend)
    u, v = canvas.along(rim2, needle.angle_deg)
    half_width = needle.cylinder_width_px / 2 - needle.flare * np.minimum(u, 0.0)
    cylinder = np.maximum(np.abs(v) - half_width, np.maximum(u, -u - 380.0))
    canvas.paint(cylinder, _metal(v / half_width, needle, white))
    if not needle.flare:
        canvas.paint(np.maximum(np.abs(v) - 37.5, np.abs(u + 480.0) - 150.0), _metal(v / 37.5, needle, white))
    if needle.marked:
        _draw_marking(canvas, needle, u, v, white)


def _draw_marking(canvas: Canvas, needle: Needle, u: Field, v: Field, white: bool) -> None:
    half_width = needle.cylinder_width_px / 2 - needle.flare * np.minimum(u, 0.0)
    ragged = np.random.default_rng(needle.marking_seed).normal(0.0, 0.5, (2, 64))
    ragged = np.stack([np.convolve(row, [0.25, 0.5, 0.25], mode="same") for row in ragged])
    column = np.clip((v / half_width + 1.0) * 31.5, 0.0, 63.0)
    wave = [np.interp(column.ravel(), np.arange(64), row).reshape(v.shape).astype(np.float32) for row in ragged]
    bow = needle.bulge_px * np.sqrt(np.clip(1.0 - (v / half_width) ** 2, 0.0, 1.0)) - needle.bulge_px
    lower, upper = bow + wave[0] - wave[0][np.unravel_index(np.argmin(u**2 + v**2), u.shape)], bow + wave[1]
    body = np.abs(v) - half_width - 0.3
    marking = np.maximum(body, np.maximum(u - lower, upper - needle.marking_px - u))
    canvas.paint(marking, 26.0 if white else 14.0)


def _metal(across: Field, needle: Needle, white: bool) -> Field:
    side = np.clip(1.0 - across**2, 0.0, 1.0)
    shine = np.exp(-0.5 * ((across - needle.highlight_at) / 0.16) ** 2)
    if white and needle.dim_side:
        facing = np.maximum(np.cos(np.arcsin(np.clip(across, -1.0, 1.0)) + 0.45 * needle.dim_side), 0.0)
        return np.asarray(62.0 + 110.0 * facing**1.3 + 70.0 * shine, dtype=np.float32)
    if white:
        return np.asarray(105.0 + 55.0 * side + 75.0 * shine, dtype=np.float32)
    return np.asarray(45.0 + 25.0 * side + 90.0 * shine, dtype=np.float32)


def frame_of(part: NDArray[np.uint8], canvas: Canvas, white: bool, fill: float) -> NDArray[np.uint8]:
    """Set the drawn part into a whole 1600x1200 BGR frame."""
    frame = np.full((FRAME_HEIGHT, FRAME_WIDTH, 3), int(fill), dtype=np.uint8)
    if not white:
        frame[:, :, :2] = 4
    y1, x1 = max(canvas.y0, 0), max(canvas.x0, 0)
    y2, x2 = min(canvas.y0 + canvas.height, FRAME_HEIGHT), min(canvas.x0 + canvas.width, FRAME_WIDTH)
    cut = part[y1 - canvas.y0 : y2 - canvas.y0, x1 - canvas.x0 : x2 - canvas.x0]
    if white:
        frame[y1:y2, x1:x2] = cut[:, :, None]
    else:
        frame[y1:y2, x1:x2, 2] = cut
    return frame


def white_frame(
    needle: Needle | None,
    camera: Camera = Camera(),
    seed: int = 0,
    clutter: float = 1.0,
    pads: tuple[Pad, ...] = (),
    more: Callable[[Canvas], None] | None = None,
) -> NDArray[np.uint8]:
    """Return a white-lit frame of the needle before a board."""
    rng = np.random.default_rng(seed)
    canvas = Canvas((NOMINAL_TIP[0] - 90, NOMINAL_TIP[1] - 150), (210, 270), 38.0)
    board_behind(canvas, rng, True, clutter)
    _draw_pads(canvas, pads)
    if more:
        more(canvas)
    if needle:
        draw_needle(canvas, needle, True)
    if camera.glint:
        at = canvas.x0 + rng.random() * canvas.width, canvas.y0 + rng.random() * canvas.height
        canvas.paint(canvas.ellipse(*at, rng.uniform(3, 9), 0.6, 20.0), 255.0)
    return frame_of(canvas.develop(camera, rng), canvas, True, 38.0 * camera.gain)


def red_frame(
    pads: tuple[Pad, ...],
    needle: Needle | None = None,
    camera: Camera = Camera(),
    seed: int = 0,
    clutter: Callable[[Canvas, np.random.Generator], None] | None = None,
    minor_deg: float = AXIS_DEG,
) -> NDArray[np.uint8]:
    """Return a red-lit frame: pads bright in the red channel, the rest nearly dark."""
    rng = np.random.default_rng(seed)
    canvas = Canvas((NOMINAL_TIP[0], NOMINAL_TIP[1]), (130, 130), 35.0)
    texture = rng.normal(0.0, 1.0, (33, 33)).astype(np.float32)
    canvas.level += 3.0 * cv2.resize(texture, canvas.level.shape[::-1], interpolation=cv2.INTER_CUBIC)
    for _ in range(3):
        at = canvas.x0 + rng.random() * 260, canvas.y0 + rng.random() * 260
        canvas.paint(canvas.bar(at, rng.choice([0, 45, 90]), 400, rng.uniform(8, 20)), 45.0)
    if clutter:
        clutter(canvas, rng)
    _draw_pads(canvas, pads, minor_deg)
    if needle:
        draw_needle(canvas, needle, False)
    if camera.glint:
        at = NOMINAL_TIP[0] + rng.uniform(-50, 50), NOMINAL_TIP[1] + rng.uniform(-50, 50)
        canvas.paint(canvas.ellipse(*at, rng.uniform(2, 4), 0.5, 20.0), 255.0)
    return frame_of(canvas.develop(camera, rng), canvas, False, 35.0 * camera.gain)


def _draw_pads(canvas: Canvas, pads: tuple[Pad, ...], minor_deg: float = AXIS_DEG) -> None:
    for pad in pads:
        if pad.trace_deg is not None:
            angle = np.radians(pad.trace_deg)
            middle = pad.x + 100 * np.cos(angle), pad.y + 100 * np.sin(angle)
            canvas.paint(canvas.bar(middle, pad.trace_deg, 200, pad.trace_width_px), pad.level)
        canvas.paint(canvas.ellipse(pad.x, pad.y, pad.radius_px, pad.ratio, minor_deg), pad.level)
        if pad.hole_px > 0:
            canvas.paint(canvas.ellipse(*pad.target, pad.hole_px, pad.ratio, minor_deg), 18.0)
