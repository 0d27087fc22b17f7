"""Red-lit frames of test pads with known truth, drawn as polygons on a fine raster under a tilted camera.

Kinds are those of thesis fig. 5.17 and the things around them (sec. 5.4). The truth is the projection of the point on
the board, not a property of the drawn ellipse, whose own middle lies up to 0.1 px off it in perspective. Not modelled:
depth of the board (barrel wall of a hole, shadow of the needle), chromatic error, motion blur.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.vision.studio.board_canvas import Canvas
from tests.vision.studio.board_crowded import CROWDED_RECIPES, INK_RECIPES, draw_crowded
from tests.vision.studio.board_needle import Needle, draw_needle, random_needle
from tests.vision.studio.board_pads import RECIPES, draw_pads
from tests.vision.studio.board_shapes import circle
from tests.vision.studio.board_stage import Look, Pad, Stage
from tests.vision.studio.board_surround import EMPTY_RECIPES, draw_empty
from tests.vision.studio.board_view import FRAME_HW, View, random_view
from tests.vision.studio.lens import delivered, develop

KINDS = tuple(RECIPES)
EMPTY_KINDS = tuple(EMPTY_RECIPES)
CROWDED_KINDS = tuple(CROWDED_RECIPES)
INK_KINDS = tuple(INK_RECIPES)
"""Crowded and worn boards with pads, and boards with what only looks like pads."""
ALL_KINDS = KINDS + EMPTY_KINDS + CROWDED_KINDS + INK_KINDS
"""In the order that seeds count on: new kinds go to the end."""

TIP_PX = (430.0, 620.0)
REACH_PX = 20.0
RUNNER_UP_PX = 6.0
HIDDEN_SHARE = (0.02, 1.0 / 3.0)
HARD_NOISE = 7.0
EASY_NOISE = 3.0
DRAWS = 60
"""Layouts tried before a kind is held to be impossible."""


@dataclass(frozen=True)
class RedScene:
    """One red-lit frame (H, W, 3) BGR and what is true of it, in px."""

    frame: npt.NDArray[np.uint8]
    around_px: tuple[float, float]
    """Where the tip is: the middle of the search."""
    target_px: tuple[float, float] | None
    """Hole centre, where a hole is drawn, else pad centre, of the pad nearest to ``around_px``; None: no pad."""
    radius_px: float
    """Semi-major radius of the target pad (0 without one)."""
    kind: str
    pads: tuple[tuple[float, float, float], ...]
    """(x, y, semi-major radius) of every true pad, x and y as in ``target_px``."""
    hidden_share: float = 0.0
    """Share of the target pad's area that the needle covers."""
    view: View | None = None
    needle: Needle | None = None
    hole_px: float = 0.0
    """Semi-major radius of the target pad's hole (0 without one)."""


def red_scene(
    seed: int,
    kind: str,
    *,
    noise: float = EASY_NOISE,
    hard: bool = False,
    needle: bool = False,
    square: bool = False,
    camera: bool = False,
) -> RedScene:
    """Draw one scene of ``ALL_KINDS``.

    ``noise`` is the sensor's standard deviation in grey levels (a hard scene's is 7 unless another than the default is
    given). ``hard`` adds salt and pepper, dirt, glints and ragged edges; ``needle`` a probe that hides up to a third
    of the target; ``square`` takes the camera's tilt away; ``camera`` sends the frame through a Bayer mosaic and JPEG.
    The same arguments give the same scene; the
    kinds of one seed are independent draws.
    """
    if kind not in ALL_KINDS:
        msg = f"kind must be one of {ALL_KINDS}, got {kind!r}"
        raise ValueError(msg)
    rng = np.random.default_rng((seed, ALL_KINDS.index(kind)))
    stage, pose = _drawn(rng, kind, hard=hard, needle=needle, square=square)
    level = np.full(FRAME_HW, stage.look.mask, np.float32)
    stage.finished(level)
    if pose.probe:
        draw_needle(level, pose.probe)
    frame = develop(
        level,
        gain=rng.uniform(0.75, 1.25),
        blur_px=rng.uniform(0.7, 1.4),
        noise=HARD_NOISE if hard and noise == EASY_NOISE else noise,
        spikes=rng.uniform(0.001, 0.005) if hard else 0.0,
        rng=rng,
        falloff=rng.uniform(0.0, 0.3),
        colour="red",
    )
    if camera:
        frame = delivered(frame, rng)
    pads = tuple(_seen(stage.view, pad) for pad in stage.pads)
    if pose.aim is None:
        return RedScene(frame, pose.around_px, None, 0.0, kind, pads, view=stage.view, needle=pose.probe)
    x, y, radius = pads[pose.aim]
    hole = stage.pads[pose.aim].hole
    hole_px = 0.0 if hole is None else stage.view.semi_major(*hole)
    return RedScene(
        frame, pose.around_px, (x, y), radius, kind, pads, pose.hidden_share, stage.view, pose.probe, hole_px
    )


def disc(
    seed: int,
    *,
    radius_px: float = 18.0,
    contrast: float = 100.0,
    blur_px: float = 1.0,
    noise: float = 8.0,
    square: bool = True,
) -> RedScene:
    """Draw a plain disc, ``contrast`` grey levels above an even ground of 60, for comparison with the Cramer-Rao bound.

    No texture, no falloff, gain 1; the centre is anywhere in its pixel and ``around_px`` within 5 px of it. The levels
    are those of the red channel.
    """
    rng = np.random.default_rng(seed)
    anchor = (TIP_PX[0] + rng.uniform(-20, 20), TIP_PX[1] + rng.uniform(-20, 20))
    view = random_view(rng, anchor, square=square)
    canvas = Canvas(anchor, half_px=int(radius_px) + 20, ground=60.0)
    look = Look(60.0, 60.0 + contrast, 60.0, 60.0, 0.0, 0.0, 0.0, hard=False)
    stage = Stage(rng, view, look, canvas)
    pad = stage.round_pad(0.0, 0.0, radius_px)
    level = np.full(FRAME_HW, 60.0, np.float32)
    stage.finished(level)
    frame = develop(level, gain=1.0, blur_px=blur_px, noise=noise, spikes=0.0, rng=rng, colour="red")
    x, y, radius = _seen(view, pad)
    around = (x + rng.uniform(-3.5, 3.5), y + rng.uniform(-3.5, 3.5))
    return RedScene(frame, around, (x, y), radius, "disc", ((x, y, radius),), view=view)


def _stage(rng: np.random.Generator, *, hard: bool, square: bool) -> Stage:
    anchor = (TIP_PX[0] + rng.uniform(-40, 40), TIP_PX[1] + rng.uniform(-40, 40))
    mask = rng.uniform(20, 50)
    look = Look(
        mask=mask,
        pad=rng.uniform(120, 230),
        silk=rng.uniform(80, 140),
        hole=rng.uniform(5, 0.8 * mask),
        slope=rng.uniform(0.0, 0.22 if hard else 0.14),
        ragged_px=0.2 if hard else 0.08,
        grain=rng.uniform(0.01, 0.05 if hard else 0.03),
        hard=hard,
    )
    return Stage(rng, random_view(rng, anchor, square=square), look, Canvas(anchor, ground=mask))


def _seen(view: View, pad: Pad) -> tuple[float, float, float]:
    return (*view.point(*pad.target), view.semi_major(pad.x, pad.y, pad.radius))


@dataclass(frozen=True)
class _Pose:
    around_px: tuple[float, float]
    aim: int | None
    """Index of the target among the stage's pads."""
    hidden_share: float = 0.0
    probe: Needle | None = None


def _drawn(rng: np.random.Generator, kind: str, *, hard: bool, needle: bool, square: bool) -> tuple[Stage, _Pose]:
    for _ in range(DRAWS):
        stage = _stage(rng, hard=hard, square=square)
        _draw(stage, kind)
        pose = _posed(stage, needle=needle)
        if pose is not None:
            return stage, pose
    msg = f"no {kind} scene of this seed meets the rules for neighbours and needle; take another seed"
    raise RuntimeError(msg)


def _draw(stage: Stage, kind: str) -> None:
    if kind in RECIPES:
        draw_pads(stage, kind)
    elif kind in EMPTY_RECIPES:
        draw_empty(stage, kind)
    else:
        draw_crowded(stage, kind)


def _posed(stage: Stage, *, needle: bool) -> _Pose | None:
    """Choose where the tip is: near the pad at the origin and clear of any rival; None where nowhere will do."""
    rng = stage.rng
    centres = np.array([stage.view.point(*pad.target) for pad in stage.pads]).reshape(-1, 2)
    origin = np.array(stage.view.point(0.0, 0.0))
    aim = int(np.hypot(*(centres - origin).T).argmin()) if len(centres) else None
    for _ in range(200):
        away, way = REACH_PX * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        middle = origin if aim is None else centres[aim]
        around = (float(middle[0] + away * np.cos(way)), float(middle[1] + away * np.sin(way)))
        probe = random_needle(rng, around) if needle else None
        if aim is None:
            return _Pose(around, None, probe=probe)
        apart = np.hypot(*(centres - around).T)
        if (np.delete(apart, aim) < apart[aim] + RUNNER_UP_PX).any():
            continue
        share = hidden_share(stage.view, stage.pads[aim], probe) if probe else 0.0
        if probe is None or _fair(stage.view, stage.pads[aim], probe, share):
            return _Pose(around, aim, share, probe)
    return None


def _fair(view: View, pad: Pad, probe: Needle, share: float) -> bool:
    hole_hidden = pad.hole is not None and bool(probe.covers(np.array(view.point(*pad.target))))
    return HIDDEN_SHARE[0] < share <= HIDDEN_SHARE[1] and not hole_hidden


def hidden_share(view: View, pad: Pad, probe: Needle) -> float:
    """Return the share of a pad's disc that the needle covers, counted on 24 rings of equal area."""
    radii = pad.radius * np.sqrt((np.arange(24) + 0.5) / 24)
    rings = [view.project(circle(pad.x, pad.y, float(radius))) for radius in radii]
    return float(np.mean([probe.covers(ring).mean() for ring in rings]))
