"""Plant, the truth: where the axes, the tip and the board really are and how bright the lamps are, at any time.

Nothing here sleeps or looks at a clock; time is an argument. What is NOT modelled: vibration after a stop, thermal
drift, axes that are not square, jerk; a pressed probe's sideways walk, a board that gives way. A pin at the end of its
travel goes on into the surface. Force and contact are in `sim_hw/electric`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sim_hw.plant.axis import SPECS, Axis, AxisSpec
from sim_hw.plant.card import CardPose
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.lamp import Lamp
from sim_hw.plant.pose import NEST_DEPTH_UM, TOUCH_Z_UM, BoardPose, Placement
from sim_hw.plant.runout import tip_offset_um
from sim_hw.plant.spots import Spots

__all__ = ["BoardPose", "CardPose", "HeadState", "Knobs", "Placement", "Plant", "head_angle_deg"]

_SHORT_WAY_UM = 1000.0
"""Shorter ways are corrections: what put the carriage beside its place is still there."""


@dataclass(frozen=True)
class HeadState:
    """What is physically true at a moment."""

    x_um: float
    y_um: float
    z_um: float
    theta_deg: float
    """Head angle, 0..360."""
    tip_x_um: float
    """The end of a straight needle in the robot frame, run-out included; the `bent` fault is added by the truth log."""
    tip_y_um: float
    tip_z_um: float
    """The end of the pin, were it free, above the nominal board plane: the head's height."""
    pressed_um: float
    """How far the pin is pushed in."""
    tip_height_um: float
    """The end of the pin above the real surface at that place: 0 when pressed, below 0 past the pin's travel."""
    white: float
    """Light levels 0..1."""
    red: float
    moving: bool


def head_angle_deg(axis_deg: float) -> float:
    """Return the head angle 0..360 of a position of the theta axis (-220..100)."""
    return axis_deg % 360.0


class Plant:
    """Own the axes, the lamps and the board; everything random comes from the seed."""

    def __init__(self, knobs: Knobs, placement: Placement, faults: Faults, seed: int) -> None:
        self.knobs = knobs
        self.placement = placement
        self.faults = faults
        self.seed = seed
        self.seat = 0
        self.board_pose = self._board_pose()
        self.card_pose = CardPose.drawn(knobs, seed)
        self.spots = Spots.drawn(knobs, seed)
        #: Height (um) above the board's plane of what stands at a CAD place (mm): parts, where there are any.
        self.relief_um: Callable[[float, float], float] | None = None
        self.axes = {spec.name: Axis(spec, self._start(spec), self._rng(f"{spec.name}/stop")) for spec in SPECS}
        self._beside = {"x": 0.0, "y": 0.0}
        self._beside_rng = self._beside_streams()
        self.lamps = {name: Lamp(self._rng(f"{name}/contact")) for name in ("white", "red")}
        #: Called with (t_s, event, facts) for what the truth log keeps.
        self.note: Callable[[float, str, Mapping[str, object]], None] = lambda _t_s, _event, _facts: None
        #: Asked with a time by the drive whose input the touch sense is wired to.
        self.sense: Callable[[float], bool] = lambda _t_s: False
        self.tip_worn_um = 0.0
        """By how much touches have shortened the needle."""
        self._listeners: list[Callable[[], None]] = []
        faults.listen(self._fault_changed)

    def listen(self, listener: Callable[[], None]) -> None:
        """Call `listener()` whenever a motion or a light is ordered."""
        self._listeners.append(listener)

    def changed(self) -> None:
        """Tell the listeners that something was ordered."""
        for listener in self._listeners:
            listener()

    def set_knob(self, name: str, value: object) -> None:
        """Turn one knob; those of board and card move it at once, the others count from their next use.

        Raises:
            ValueError: no such knob or an unfit value.

        """
        self.knobs = self.knobs.with_value(name, value)
        self.board_pose = self._board_pose()
        self.card_pose = CardPose.drawn(self.knobs, self.seed)
        self.spots = Spots.drawn(self.knobs, self.seed)
        if name.startswith("misplaced"):
            # What follows is the same, however many ways there were before.
            self._beside_rng = self._beside_streams()
        self.changed()

    def _beside_streams(self) -> dict[str, random.Random]:
        return {name: self._rng(f"{name}/beside") for name in self._beside}

    def seat_board(self, placement: Placement) -> None:
        """Lay a board into the nest: the next seat draws another pose, as each laying in does."""
        self.seat += 1
        self.placement = placement
        self.board_pose = self._board_pose()
        self.changed()

    def backlash(self, axis: str) -> float:
        """Return the backlash of an axis, um or degrees."""
        return float(getattr(self.knobs, f"{axis}_backlash_{_unit(axis)}"))

    def stop_sigma(self, axis: str) -> float:
        """Return the spread of the error one stop of an axis draws, um or degrees."""
        if axis in ("x", "y"):
            return self.knobs.repeatability_um / math.sqrt(2.0)
        return float(getattr(self.knobs, f"{axis}_repeatability_{_unit(axis)}"))

    def beside(self, axis: str, way: float) -> float:
        """Return how far beside its place a way of X or Y ends, um; a short one keeps what the last long one drew."""
        if axis not in self._beside:
            return 0.0
        if abs(way) > _SHORT_WAY_UM:
            rng = self._beside_rng[axis]
            drawn, share = rng.random(), rng.uniform(-1.0, 1.0)
            # Of two axes that move, one or the other is beside its place as often as the knob says.
            chance = 1.0 - math.sqrt(max(0.0, 1.0 - self.knobs.misplaced_share))
            self._beside[axis] = share * self.knobs.misplaced_um if drawn < chance else 0.0
        return self._beside[axis]

    def home_sigma(self, axis: str) -> float:
        """Return the spread with which a homing finds its edge, um or degrees."""
        return self.knobs.theta_home_repeatability_deg if axis == "theta" else self.knobs.home_repeatability_um

    def switch_lamp(self, name: str, t_s: float, *, on: bool) -> None:
        """Energise or release the relay coil of a lamp."""
        self.lamps[name].switch(t_s, self.knobs, on=on)
        self.note(t_s, "light", {"lamp": name, "on": on})
        self.changed()

    def light(self, name: str, t_s: float) -> float:
        """Return the level 0..1 of a lamp; a dead one stays dark."""
        return 0.0 if self.faults.hits("dead_lamp", "lamp", name) else self.lamps[name].level(t_s)

    def rest_s(self) -> float:
        """Return the time from which all axes rest, as far as is ordered."""
        return max(axis.rest_s for axis in self.axes.values())

    def state_at(self, t_s: float) -> HeadState:
        """Return the truth at any simulated time within the past half minute, or ahead as far as is ordered."""
        x_um, y_um, z_um, axis_deg = (self.axes[name].position(t_s) for name in ("x", "y", "z", "theta"))
        theta_deg = head_angle_deg(axis_deg)
        offset_x_um, offset_y_um = tip_offset_um(theta_deg, self.knobs.head_runout_scale)
        tip = (x_um + offset_x_um, y_um + offset_y_um)
        free_um = z_um - TOUCH_Z_UM + self.tip_worn_um
        above_um = free_um - self.surface_um(tip)
        pressed_um = max(0.0, min(-above_um, self.knobs.pin_travel_um))
        return HeadState(
            x_um=x_um,
            y_um=y_um,
            z_um=z_um,
            theta_deg=theta_deg,
            tip_x_um=tip[0],
            tip_y_um=tip[1],
            tip_z_um=free_um,
            pressed_um=pressed_um,
            tip_height_um=above_um + pressed_um,
            white=self.light("white", t_s),
            red=self.light("red", t_s),
            moving=any(axis.moving(t_s) for axis in self.axes.values()),
        )

    @property
    def card(self) -> CardPose | None:
        """Return where the control-point card lies, or None while it is gone."""
        return None if self.faults.on("card_gone") else self.card_pose

    def surface_um(self, place_um: tuple[float, float]) -> float:
        """Return the height of what lies at a place of the robot frame, card or board plane, above the nominal one."""
        card = self.card
        if card is not None and card.covers(place_um):
            return card.dz_um
        spot = self.spots.at(place_um)
        if spot is not None:
            return spot.dz_um
        plane_um = self.board_pose.height_um(place_um, self.placement.centre_um)
        if self.faults.on("board_gone"):
            return plane_um - NEST_DEPTH_UM
        return plane_um + (0.0 if self.relief_um is None else self.relief_um(*self.to_cad_mm(*place_um)))

    def to_real_um(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return where a CAD place (mm) really is in the robot frame."""
        return self.board_pose.apply(self.placement.to_robot_um(x_mm, y_mm), self.placement.centre_um)

    def to_cad_mm(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Return which CAD place (mm) really lies at a place of the robot frame: the inverse of `to_real_um`."""
        return self.placement.to_cad_mm(*self.board_pose.undo((x_um, y_um), self.placement.centre_um))

    def _board_pose(self) -> BoardPose:
        """Return where the board really lies, as drawn for this seat and as the faults moved it."""
        pose = BoardPose.drawn(self.knobs, self.seed, self.seat)
        for name in ("board_displaced", "board_turned"):
            if self.faults.on(name):
                way = self.faults.get(name)
                pose = pose.moved(way.get("dx_um", 0.0), way.get("dy_um", 0.0), way["turn_deg"])
        return pose

    def _fault_changed(self, name: str, on: bool, parameters: Mapping[str, object]) -> None:  # noqa: ARG002, FBT001 - faults.Listener
        if name.startswith("board_"):
            self.board_pose = self._board_pose()

    def _rng(self, purpose: str) -> random.Random:
        return random.Random(f"{self.seed}/{purpose}")

    def _start(self, spec: AxisSpec) -> float:
        """Return where an axis stands at power-up."""
        rng = self._rng(f"{spec.name}/start")
        ranges = {"x": (5e3, 15e3), "y": (5e3, 15e3), "z": (20e3, 29e3), "theta": (-200.0, 80.0)}
        drawn = rng.uniform(*ranges[spec.name])
        knob = getattr(self.knobs, f"{spec.name}_start_{_unit(spec.name)}")
        return drawn if knob is None else float(knob)


def _unit(axis: str) -> str:
    return "deg" if axis == "theta" else "um"
