"""White-lit frames of the probe needle before a board, with the place where its picture ends (thesis, section 5.3)."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tests.vision.studio import needle_board as background
from tests.vision.studio.lens import Frame, Level, develop
from tests.vision.studio.needle_body import SHAPE, Array, Body, Hits, bend, cast
from tests.vision.studio.needle_kit import HEADS, KITS, Kit, Teeth
from tests.vision.studio.needle_paint import Marking, Metal, rim, shade
from tests.vision.studio.needle_paper import GROUNDS, bright

DEFECTS: Final = (
    "no_needle",
    "other_needle",
    "no_marking",
    "worn_marking",
    "bent",
    "turned",
    "out_of_frame",
    "dark",
    "saturated",
    "blurred",
)

NOMINAL_TIP_PX: Final = (428.0, 620.0)
NOMINAL_ANGLE_DEG: Final = float(np.degrees(np.arctan2(620.0 - 388.0, 425.0 - 306.0)))
"""From the worked example of section 5.3: the bisecting line through (306, 388) and (425, 620)."""


@dataclass(frozen=True)
class WhiteScene:
    """A frame (1200, 1600, 3) uint8, BGR, and its truth.

    ``tip_px`` is the last point of the needle's picture on the picture of its axis: None without a needle, outside the
    frame for "out_of_frame". ``angle_deg`` is the axis' direction towards the end, below the x axis; of a bent
    needle both belong to the bent taper. ``what`` is the defect's name or "good".
    """

    frame: Frame
    tip_px: tuple[float, float] | None
    angle_deg: float
    what: str


@dataclass(frozen=True)
class Look:
    """The camera's share in a scene, in the terms of ``lens.develop``."""

    gain: float
    blur_px: float
    noise: float
    spikes: float
    falloff: float
    offset: float = 0.0


def needle_of(kit: int | str) -> Kit:
    """Return a needle by its number among ``KITS`` or its name among ``HEADS``."""
    return HEADS[kit] if isinstance(kit, str) else KITS[kit]


def golden(seed: int = 0, *, kit: int | str = 0) -> WhiteScene:
    """Return the clean picture for teaching: nominal place and angle, dark cloth behind."""
    needle = needle_of(kit)
    rng = np.random.default_rng([seed, needle.seed if isinstance(kit, str) else kit])
    body = needle.body(NOMINAL_TIP_PX, NOMINAL_ANGLE_DEG)
    level = background.plain(rng)
    _paste(level, body, needle.metal, needle.marking(body), needle.teeth)
    return _scene(level, body, Look(1.0, 0.9, 1.5, 0.0, 0.05), rng, "good")


def white_scene(
    seed: int, *, hard: bool = False, defect: str | None = None, kit: int | str = 0, ground: str | None = None
) -> WhiteScene:
    """Return one frame of a needle (see ``needle_of``); everything random comes from ``seed``.

    It stands before a board, or before one of the bright ``needle_paper.GROUNDS``.

    Clean: within 3 deg and 15 px of the nominal place, gain 0.75..1.25, blur 0.7..1.4 px, noise 3 grey levels. Hard:
    noise 7, salt and pepper, worn rims, glints, pads behind the taper and lettering along the needle.
    """
    if defect is not None and defect not in DEFECTS:
        msg = f"defect must be one of {', '.join(DEFECTS)} or None, got {defect!r}"
        raise ValueError(msg)
    if ground is not None and ground not in GROUNDS:
        msg = f"ground must be one of {', '.join(GROUNDS)} or None, got {ground!r}"
        raise ValueError(msg)
    rng = np.random.default_rng(seed)
    needle = needle_of(kit).other(rng) if defect == "other_needle" else needle_of(kit)
    body = _place(needle, rng, defect)
    tip = body.seen_end_px()
    if ground is None:
        level = background.board(rng, (tip[0], tip[1]), _angle_deg(body), cluttered=hard)
    else:
        level = bright(rng, ground, (tip[0], tip[1]), _angle_deg(body))
    look = _look(rng, defect, hard=hard)
    shown = None
    if defect != "no_needle":
        shown = _draw(level, needle, body, rng, defect, hard=hard)
    return _scene(level, shown, look, rng, defect or "good")


def _place(needle: Kit, rng: np.random.Generator, defect: str | None) -> Body:
    angle = NOMINAL_ANGLE_DEG + float(rng.uniform(-3.0, 3.0))
    x, y = (float(v) for v in np.asarray(NOMINAL_TIP_PX) + rng.uniform(-15.0, 15.0, 2))
    if defect == "turned":
        angle = NOMINAL_ANGLE_DEG + float(rng.choice([-1.0, 1.0]) * rng.uniform(7.0, 15.0))
    if defect == "out_of_frame":
        x, y = _beyond(rng, angle)
    return needle.body((x, y), angle)


def _beyond(rng: np.random.Generator, angle_deg: float) -> tuple[float, float]:
    """Return an end just outside the frame: below it or right of it while the needle is still seen, or left of it."""
    beyond = float(rng.uniform(10.0, 100.0))
    side = int(rng.integers(3))
    if side == 0:
        return NOMINAL_TIP_PX[0] + (SHAPE[0] - NOMINAL_TIP_PX[1]) / float(np.tan(np.radians(angle_deg))), 1199 + beyond
    return (1599 + beyond, 620.0) if side == 1 else (-beyond, NOMINAL_TIP_PX[1])


def _look(rng: np.random.Generator, defect: str | None, *, hard: bool) -> Look:
    spikes = float(rng.uniform(0.001, 0.005)) if hard else 0.0
    gain, blur = float(rng.uniform(0.75, 1.25)), float(rng.uniform(0.7, 1.4))
    look = Look(gain, blur, 7.0 if hard else 3.0, spikes, float(rng.uniform(0.05, 0.25)))
    if defect == "dark":
        return replace(look, gain=float(rng.uniform(0.03, 0.06)))
    if defect == "saturated":
        return replace(look, gain=float(rng.uniform(3.6, 4.5)), offset=60.0)
    if defect == "blurred":
        return replace(look, blur_px=float(rng.uniform(4.0, 7.0)))
    return look


def _draw(level: Level, needle: Kit, body: Body, rng: np.random.Generator, defect: str | None, *, hard: bool) -> Body:
    marking = _marking(needle, body, rng, defect, hard=hard)
    metal = _lamps_moved(needle.metal, rng, 0.10 if hard else 0.05)
    parts: tuple[Body, ...] = (body,)
    if defect == "bent":
        shoulder = float(body.outline[np.argmax(body.outline[:, 1] >= 0.98 * needle.radius_px), 0])
        straight, bent = bend(body, shoulder, float(rng.choice([-1.0, 1.0]) * rng.uniform(5.0, 12.0)))
        parts = (bent, straight)
    tip = parts[0].seen_end_px()
    background.shadow(level, (tip[0], tip[1]), _angle_deg(body), rng)
    for part in parts:
        _paste(level, part, metal, marking, needle.teeth if part is parts[0] else None)
    if hard:
        background.glints(level, rng, (tip[0], tip[1]), _angle_deg(parts[0]))
    return parts[0]


def _marking(needle: Kit, body: Body, rng: np.random.Generator, defect: str | None, *, hard: bool) -> Marking | None:
    marking = needle.marking(body)
    if hard:
        marking = replace(
            marking,
            lower=marking.lower + rim(rng, float(rng.uniform(0.5, 1.5))),
            upper=marking.upper + rim(rng, float(rng.uniform(0.5, 2.0))),
            flaked=float(rng.uniform(0.0, 0.05)),
        )
    if defect == "no_marking":
        return None
    if defect == "worn_marking":
        faded = rng.random() < 0.5
        cover, flaked = (rng.uniform(0.05, 0.22), 0.0) if faded else (0.9, rng.uniform(0.78, 0.95))
        return replace(marking, cover=float(cover), flaked=float(flaked))
    return marking


def _lamps_moved(metal: Metal, rng: np.random.Generator, by: float) -> Metal:
    lamps = tuple(
        replace(
            lamp, azimuth=lamp.azimuth + float(rng.normal(0.0, by)), shine=lamp.shine * float(rng.uniform(0.8, 1.2))
        )
        for lamp in metal.lamps
    )
    return replace(metal, lamps=lamps)


def _paste(level: Level, body: Body, metal: Metal, marking: Marking | None, teeth: Teeth | None = None) -> None:
    """Put the body before the board in place: each pixel is the mean of what its rays see."""
    for hits in cast(body):
        if teeth is not None:
            hits = teeth.cut(hits)
        behind = level[hits.rows, hits.cols]
        level[hits.rows, hits.cols] = _mean(hits, shade(hits, metal, marking), behind)


def _mean(hits: Hits, shades: Array, behind: Level) -> Level:
    cover = hits.met.mean(axis=1)
    front = (shades * hits.met).mean(axis=1)
    return np.asarray(front + (1.0 - cover) * behind, np.float32)


def _angle_deg(body: Body) -> float:
    dx, dy = body.axis_direction()
    return float(np.degrees(np.arctan2(dy, dx)))


def _scene(level: Level, body: Body | None, look: Look, rng: np.random.Generator, what: str) -> WhiteScene:
    frame = develop(
        level,
        gain=look.gain,
        blur_px=look.blur_px,
        noise=look.noise,
        spikes=look.spikes,
        rng=rng,
        falloff=look.falloff,
        lamp_px=(700.0, 520.0),
        offset=look.offset,
    )
    if body is None:
        return WhiteScene(frame, None, NOMINAL_ANGLE_DEG, what)
    x, y = body.seen_end_px()
    return WhiteScene(frame, (float(x), float(y)), _angle_deg(body), what)
