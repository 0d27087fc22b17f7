"""Collisions of what the head carries, needle, barrel and the head itself, with the parts on a board."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from sim_hw.board.parts import Bodies, Body
from sim_hw.plant.plant import HeadState, Plant
from sim_hw.plant.pose import TOUCH_Z_UM
from sim_hw.scene.needle import Needle

HEAD_BOX_UM = (-9_000.0, -6_000.0, 7_000.0, 6_000.0)
"""Footprint of the head's lowest part at head angle 0: x0, y0, x1, y1 about the needle; it turns with the head."""
_REACH_MM = 0.5
"""The barrel, the widest part of the needle, has this radius at most."""
_HEAD_REACH_MM = 11.0
"""No corner of the head is farther from the needle."""
_STEP_S = 0.002
_TILT_UM = 600.0
"""No board lies higher than this over the nominal plane."""
_LEANS_UM = 100.0
"""Nor by more than this higher at one end of the head than below the needle."""
_INSIDE_AREA = 1e-6
Carried = Literal["needle", "barrel", "head"]
Outline = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Hit:
    """Needle, barrel or head in a part: when, which, where the needle's end was (CAD mm), how far below the part's top.

    `below_um` is the end's, whatever is in the part: the head is there where it is more than the head is high.
    """

    t_s: float
    part: str
    cad_mm: tuple[float, float]
    below_um: float
    moving: bool
    by: Carried = "needle"


def hit_at(plant: Plant, bodies: Bodies, needle: Needle, t_s: float) -> Hit | None:
    """Return what is in a part at a time, or None."""
    return next(_hits_at(plant, bodies, needle, t_s), None)


def hits_between(plant: Plant, bodies: Bodies, needle: Needle, t0_s: float, t1_s: float) -> Iterator[Hit]:
    """Yield the first hit of each part between two times, looked at every other millisecond."""
    if not bodies.all:
        return
    seen = set[str]()
    count = max(1, round((t1_s - t0_s) / _STEP_S))
    low_um = TOUCH_Z_UM + bodies.tallest_um + _TILT_UM
    stood: list[float] | None = None
    for t_s in np.linspace(t0_s, t1_s, count + 1).tolist():
        if plant.axes["z"].position(t_s) > low_um:
            continue
        stands = [axis.position(t_s) for axis in plant.axes.values()]
        if stands == stood:
            continue  # looked at already: most of the time the head stands still
        stood = stands
        for hit in _hits_at(plant, bodies, needle, t_s):
            if hit.part not in seen:
                seen.add(hit.part)
                yield hit


def _hits_at(plant: Plant, bodies: Bodies, needle: Needle, t_s: float) -> Iterator[Hit]:
    """Yield every part that something is in at a time."""
    state = plant.state_at(t_s)
    place_um = (state.tip_x_um, state.tip_y_um)
    free_um = state.tip_z_um - plant.board_pose.height_um(place_um, plant.placement.centre_um)
    if plant.faults.on("board_gone") or free_um >= bodies.tallest_um + _LEANS_UM:
        return
    x_mm, y_mm = plant.to_cad_mm(*place_um)
    head_um = plant.knobs.head_from_um
    under_head = free_um + head_um < bodies.tallest_um + _LEANS_UM
    for body in bodies.near(x_mm, y_mm, _HEAD_REACH_MM if under_head else _REACH_MM):
        below_um = body.height_um - free_um
        by = _what(needle, below_um, 1e3 * body.inside_mm(x_mm, y_mm), state)
        if by is None and below_um + _LEANS_UM > head_um and _under_head(plant, body, state):
            by = "head"
        if by is not None:
            yield Hit(t_s, body.part, (x_mm, y_mm), below_um, state.moving, by)


def _what(needle: Needle, below_um: float, inside_um: float, state: HeadState) -> Carried | None:
    """Return whether needle or barrel is in a body whose top is so far above the needle's end."""
    if below_um <= 0.0 or inside_um <= -1e3 * _REACH_MM:
        return None
    if inside_um > -_radius_um(needle, min(below_um, needle.barrel_um - 100.0), state):
        return "needle"
    return "barrel" if inside_um > -_radius_um(needle, below_um, state) else None


def _radius_um(needle: Needle, above_um: float, state: HeadState) -> float:
    """Return how thick the needle is that far above its free end."""
    return float(needle.radius_um(np.array([above_um]), state.pressed_um)[0])


def _under_head(plant: Plant, body: Body, state: HeadState) -> bool:
    """Tell whether a body's top is in the head, by how high the board lies where the body stands."""
    x_mm, y_mm = body.outline_mm.mean(axis=0).tolist()
    place_um = plant.to_real_um(x_mm, y_mm)
    above_um = body.height_um + plant.board_pose.height_um(place_um, plant.placement.centre_um) - state.tip_z_um
    return above_um > plant.knobs.head_from_um and _overlaps(plant, body, state)


def _overlaps(plant: Plant, body: Body, state: HeadState) -> bool:
    """Tell whether a body's outline reaches into the head's footprint, seen from above."""
    corners = np.array([plant.to_real_um(x, y) for x, y in body.outline_mm.tolist()])
    turn = np.deg2rad(state.theta_deg)
    c, s = np.cos(turn), np.sin(turn)
    # Into the head's own frame: the footprint is upright there
    seen = (corners - (state.tip_x_um, state.tip_y_um)) @ np.array([[c, -s], [s, c]])
    x0, y0, x1, y1 = HEAD_BOX_UM
    for axis, limit, sign in ((0, x0, 1.0), (0, x1, -1.0), (1, y0, 1.0), (1, y1, -1.0)):
        seen = _clipped(seen, axis, limit, sign)
        if len(seen) == 0:
            return False
    x, y = seen.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2.0 > _INSIDE_AREA


def _clipped(outline: Outline, axis: int, limit: float, sign: float) -> Outline:
    """Return what of an outline is on the inner side of a limit (Sutherland and Hodgman)."""
    kept: list[Outline] = []
    inside = sign * (outline[:, axis] - limit)
    for k, n in itertools.pairwise((*range(len(outline)), 0)):
        if inside[k] >= 0.0:
            kept.append(outline[k])
        if inside[k] * inside[n] < 0.0:
            kept.append(outline[k] + inside[k] / (inside[k] - inside[n]) * (outline[n] - outline[k]))
    return np.array(kept).reshape(-1, 2)
