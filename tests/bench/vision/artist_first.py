"""The first artist: the renderer of the unit tests (tests/vision/scene.py), over the ranges of a station's day."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from tests.bench.vision import crb
from tests.bench.vision.artist_first_pads import EMPTY, PADS, VIEW_RATIO, around, far, nothing, placed, shift
from tests.bench.vision.scenes import DiscScene, Frame, MarkScene, PadScene, Point, TipKit, TipScene, split
from tests.vision.scene import (
    AXIS_DEG,
    NOMINAL_TIP,
    Camera,
    Canvas,
    Needle,
    Pad,
    draw_needle,
    frame_of,
    red_frame,
    white_frame,
)

Rng = np.random.Generator
KITS = 4
# With its two anti-aliasing steps the renderer blurs a little more than the lens it draws.
DRAWN_BLUR_VARIANCE = 0.25 / 12.0
# This camera always sees circles like this.
FLAT = (VIEW_RATIO, float(np.radians(AXIS_DEG)))


def needle_of(kit: int) -> Needle:
    """Return needle number `kit`: each has a marking painted by another hand."""
    rng = np.random.default_rng([kit, 77])
    return Needle(
        marking_seed=5 + kit,
        marking_px=45.0 + rng.uniform(-3, 3),
        cylinder_width_px=42.0 + rng.uniform(-2, 2),
        bulge_px=rng.uniform(4, 8),
        highlight_at=rng.uniform(0.1, 0.35),
    )


@lru_cache(maxsize=KITS)
def kit_of(kit: int) -> TipKit:
    """Return the taught picture of a needle."""
    golden = white_frame(needle_of(kit), Camera(), kit, clutter=0.0)
    return TipKit(golden, NOMINAL_TIP, float(np.radians(AXIS_DEG)), f"first/{kit}")


def posed(needle: Needle, rng: Rng) -> Needle:
    tip = NOMINAL_TIP[0] + rng.uniform(-15, 15), NOMINAL_TIP[1] + rng.uniform(-15, 15)
    return replace(needle, tip=tip, angle_deg=AXIS_DEG + rng.uniform(-3, 3))


def camera_of(rng: Rng, hard: bool) -> Camera:
    gain, blur = rng.uniform(0.75, 1.25), rng.uniform(0.7, 1.4)
    return Camera(gain, blur, 7.0, 0.003, True, 0.1) if hard else Camera(gain, blur, 3.0)


CONDITIONS = ("", " +hard", " +needle", " +hard +needle", " +hidden", " +hard +hidden")
DEFECTS = ("no needle", "bent", "no marking", "marking worn", "turned", "thick needle", "out of focus")


class FirstArtist:
    name = "first"

    def tip_kinds(self) -> list[str]:
        return ["needle", "needle +hard"]

    def defect_kinds(self) -> list[str]:
        return list(DEFECTS)

    def pad_kinds(self) -> list[str]:
        return [kind + condition for condition in CONDITIONS for kind in PADS]

    def empty_kinds(self) -> list[str]:
        return [kind + condition for condition in ("", " +hard +needle") for kind in EMPTY]

    def disc_kinds(self) -> list[str]:
        return ["via", "site", "site with hole"]

    def mark_kinds(self) -> list[str]:
        return ["two arms hidden", "two arms hidden +hard", "whole", "needle over one arm"]

    def tip(self, kind: str, seed: int) -> TipScene:
        name, conditions = split(kind)
        rng = np.random.default_rng([seed, 1])
        number, hard = int(rng.integers(KITS)), "hard" in conditions
        needle, camera = posed(needle_of(number), rng), camera_of(rng, hard)
        defect = name in DEFECTS
        shown: Needle | None = needle
        if defect:
            shown, camera = _damaged(name, needle, camera, rng)
        frame = white_frame(shown, camera, 1000 + seed, 1.0 if hard else 0.4)
        return TipScene(self.name, kind, seed, hard, defect, frame, shown and shown.tip, kit_of(number))

    def pad(self, kind: str, seed: int) -> PadScene:
        name, conditions = split(kind)
        rng = np.random.default_rng([seed, 2])
        hard, number = "hard" in conditions, int(rng.integers(KITS))
        needle = posed(needle_of(number), rng)
        level, camera = rng.uniform(140, 230), camera_of(rng, hard)
        shown = needle if {"needle", "hidden"} & conditions else None
        if name in EMPTY:
            beyond = Pad(*far(needle.tip, rng), rng.uniform(5, 8), level=level)
            pads = (beyond,) if name == "pad beyond reach" else ()
            hidden, truth, radius = 0.0, None, 0.0
        else:
            pads, hidden = placed(PADS[name], needle, level, rng, conditions)
            truth, radius = pads[0].target, pads[0].radius_px
        clutter = EMPTY.get(name, nothing)
        red = red_frame(pads, shown, camera, seed, lambda canvas, g: clutter(canvas, g, needle.tip))
        white = white_frame(needle, camera, seed, 0.0) if shown else None
        return PadScene(
            self.name,
            kind,
            seed,
            hard,
            red,
            needle.tip,
            truth,
            radius,
            hidden,
            white,
            kit_of(number) if shown else None,
            FLAT,
        )

    def disc(self, kind: str, seed: int, noise: float) -> DiscScene:
        rng = np.random.default_rng([seed, 3])
        x, y = around(NOMINAL_TIP, rng, 8.0)
        radius = rng.uniform(5, 8) if kind == "via" else rng.uniform(14, 21)
        hole = rng.uniform(3.5, 6) if kind == "site with hole" else 0.0
        pad = Pad(x, y, radius, hole, shift(rng, 1.5) if hole else (0.0, 0.0), level=160.0)
        camera = Camera(noise=noise, falloff=0.0)
        canvas = Canvas(NOMINAL_TIP, (130, 130), 45.0)
        canvas.paint(canvas.ellipse(x, y, radius, pad.ratio, AXIS_DEG), pad.level)
        if hole:
            canvas.paint(canvas.ellipse(*pad.target, hole, pad.ratio, AXIS_DEG), 45.0)
        frame = frame_of(canvas.develop(camera, rng), canvas, False, 45.0)
        disc = crb.Disc(x, y, radius, 160.0, 45.0, pad.ratio, float(np.radians(AXIS_DEG)), *pad.target, hole, 45.0)
        blur = float(np.sqrt(camera.blur_px**2 + DRAWN_BLUR_VARIANCE))
        return DiscScene(
            self.name, kind, seed, noise, frame, NOMINAL_TIP, pad.target, crb.bound_px(disc, noise, blur), FLAT
        )

    def mark(self, kind: str, seed: int) -> MarkScene:
        name, conditions = split(kind)
        rng = np.random.default_rng([seed, 4])
        hard = "hard" in conditions
        camera = camera_of(rng, hard) if hard else Camera(noise=3.0)
        frame, centre = _cross(name, camera, rng)
        hidden = {"two arms hidden": 2, "needle over one arm": 1}.get(name, 0)
        return MarkScene(self.name, kind, seed, hard, hidden, frame, NOMINAL_TIP, centre, 60.0, 70.0)


def _damaged(name: str, needle: Needle, camera: Camera, rng: Rng) -> tuple[Needle | None, Camera]:
    side = float(rng.choice([-1, 1]))
    if name == "no needle":
        return None, camera
    if name == "out of focus":
        return needle, replace(camera, blur_px=float(rng.uniform(3.5, 6.0)))
    changes: dict[str, float | bool] = {
        "bent": {"bend_deg": side * rng.uniform(1.5, 6.0)},
        "no marking": {"marked": False},
        "marking worn": {"marking_px": needle.marking_px - rng.uniform(6, 15)},
        "turned": {"angle_deg": AXIS_DEG + side * rng.uniform(5.5, 9.0)},
        "thick needle": {"rim_width_px": 56.0, "cylinder_width_px": 58.0},
    }[name]
    return replace(needle, **changes), camera  # type: ignore[arg-type]


def _cross(name: str, camera: Camera, rng: Rng) -> tuple[Frame, Point]:
    """Return a printed cross and its centre; what hides arms comes from the needle's side."""
    canvas = Canvas(NOMINAL_TIP, (200, 200), 205.0)
    x, y = NOMINAL_TIP[0] + rng.uniform(-40, 40), NOMINAL_TIP[1] + rng.uniform(-40, 40)
    hide = name == "two arms hidden"
    # Two arms lie on the needle's side when the needle points between them.
    first = AXIS_DEG + 45.0 + rng.uniform(-20, 20) if hide else rng.uniform(0, 90)
    width, corner = rng.uniform(4, 7), rng.uniform(76, 94)
    for angle in (first, first + corner):
        canvas.paint(canvas.bar((x, y), angle, 140, width), 40.0)
    if hide:
        u, v = canvas.along((x, y), AXIS_DEG)
        canvas.paint(u + rng.uniform(7, 12), np.asarray(150.0 + 40.0 * np.cos(v / 40.0), dtype=np.float32))
    elif name == "needle over one arm":
        tip = x - 3.6 + rng.uniform(-3, 3), y - 7.0 + rng.uniform(-3, 3)
        draw_needle(canvas, Needle(tip=tip), True)
    return frame_of(canvas.develop(camera, rng), canvas, True, 205.0 * camera.gain), (x, y)
