"""Motor as its drive sees it: the demanded motion, its own zero, the switches. Units: um or degrees."""

from __future__ import annotations

import math
import random
from typing import Literal

from sim_hw.plant.axis import AxisSpec
from sim_hw.plant.motion import Ramps, Trajectory, plan_move, plan_stop, resting
from sim_hw.plant.plant import Plant

Switch = Literal["negative", "positive", "home"]

SWITCH_BITS: dict[Switch, int] = {"negative": 0, "positive": 1, "home": 2}
"""Bit of each switch in 60FDh and of its enabling in 3240h:01."""


class Motor:
    """Order motion from the plant and count what was ordered (open loop: the count, not the truth)."""

    def __init__(self, spec: AxisSpec, plant: Plant, t_s: float) -> None:
        self.spec = spec
        self._plant = plant
        self._axis = plant.axes[spec.name]
        self._rng = random.Random(f"{plant.seed}/{spec.name}/drive")
        self.demand = resting(t_s, 0.0)
        self.zero = 0.0
        self._stalled = False
        self._held: float | None = None
        self._held_s = t_s
        self._slips = plant.faults.times("slip")

    def position(self, t_s: float) -> float:
        """Return the counted position at a time."""
        return self.demand.position(t_s) - self.zero

    def velocity(self, t_s: float) -> float:
        """Return the demanded velocity at a time."""
        return self.demand.velocity(t_s)

    def moving(self, t_s: float) -> bool:
        """Tell whether motion is demanded at a time."""
        return t_s < self.demand.end_s

    def direction(self) -> float:
        """Return the sign of the demanded motion, judged by where it ends."""
        return math.copysign(1.0, self.demand.end - self.demand.position(self.demand.start_s))

    def go(self, t_s: float, target: float, ramps: Ramps) -> None:
        """Start for a counted position from whatever speed the motor has."""
        x, v = self.demand.position(t_s), self.demand.velocity(t_s)
        self._order(plan_move(t_s, x, v, target + self.zero, ramps))

    def stop(self, t_s: float, deceleration: float) -> None:
        """Brake."""
        x, v = self.demand.position(t_s), self.demand.velocity(t_s)
        self._order(plan_stop(t_s, x, v, deceleration))

    def cut(self, t_s: float) -> None:
        """Lose the current: a moving axis slips, and the count does not know."""
        moving = self.moving(t_s)
        self.demand = resting(t_s, self.demand.position(t_s))
        if moving:
            sigma = 0.0 if self.spec.name == "theta" else self._plant.knobs.estop_slip_um
            self._axis.slip(t_s, self._rng.gauss(0.0, 1.0) * sigma)
            self._plant.changed()

    def set_position(self, t_s: float, position: float, *, found: bool) -> None:
        """Declare the place at a time to be a counted position; an edge that was found is found with an error."""
        error = self._rng.gauss(0.0, 1.0) * self._plant.home_sigma(self.spec.name) if found else 0.0
        self.zero = self.demand.position(t_s) - position + error

    def heed_stall(self, t_s: float) -> bool:
        """Lose steps from now on if the axis has just been made to stall in motion; tell whether it was."""
        stalls = self._plant.faults.hits("stall", "axis", self.spec.name)
        if not stalls or self._stalled or not self.moving(t_s):
            return False
        self._stalled = True
        self._held, self._held_s = self.demand.position(t_s), t_s
        self._axis.follow(resting(t_s, 0.0))
        self._plant.changed()
        return True

    def behind(self, t_s: float) -> float:
        """Return how far a rotor that stalled is behind the demand: what an encoder would show."""
        return 0.0 if self._held is None else self.demand.position(t_s) - self._held

    def behind_since(self, window: float) -> float | None:
        """Return when a stalled rotor falls behind the present demand by more than a window, or None."""
        if self._held is None:
            return None
        first_s = max(self._held_s, self.demand.start_s)
        if abs(self.behind(first_s)) > window:
            return first_s
        for segment in self.demand.segments:
            if segment.t1_s > first_s and abs(self.behind(segment.t1_s)) > window:
                side = math.copysign(window, self.behind(segment.t1_s))
                return max(first_s, segment.time_at(self._held + side) or segment.t1_s)
        return None

    def heed_slip(self, t_s: float) -> None:
        """Let the carriage slip once for each time the fault was switched on; motion goes on, and the count too."""
        faults, times = self._plant.faults, self._plant.faults.times("slip")
        if times == self._slips:
            return
        self._slips = times
        if faults.hits("slip", "axis", self.spec.name):
            self._axis.slip(t_s, float(faults.get("slip")["um"]))
            self._turn(self.demand.rest_of(t_s))

    def active(self, switch: Switch, t_s: float) -> bool:
        """Tell whether a switch is actuated at a time."""
        faults, spec = self._plant.faults, self.spec
        if switch != "home" and faults.hits("limit", "axis", spec.name) and faults.hits("limit", "side", switch):
            return True
        place = self._axis.carriage(t_s)
        if switch == "negative":
            return place < spec.negative_limit
        if switch == "positive":
            return place > spec.positive_limit
        return (place >= spec.home_edge) == spec.home_above

    def crossing(self, switch: Switch, after_s: float, *, upwards: bool) -> float | None:
        """Return when the ordered motion takes the carriage over a switch's edge, or None."""
        edges = {
            "negative": self.spec.negative_limit,
            "positive": self.spec.positive_limit,
            "home": self.spec.home_edge,
        }
        return self._axis.next_crossing(edges[switch], after_s, upwards=upwards)

    def _order(self, demand: Trajectory) -> None:
        if self._held is None:
            self._held, self._held_s = self.demand.position(demand.start_s), demand.start_s
        self.demand = demand
        self._stalled = self._plant.faults.hits("stall", "axis", self.spec.name) and bool(demand.segments)
        self._held = self._held if self._stalled else None
        self._turn(demand)

    def _turn(self, demand: Trajectory) -> None:
        name = self.spec.name
        backlash, sigma = self._plant.backlash(name), self._plant.stop_sigma(name)
        beside = self._plant.beside(name, demand.end - demand.position(demand.start_s))
        self._axis.follow(demand, backlash=backlash, sigma=sigma, stalled=self._stalled, beside=beside)
        self._plant.changed()
