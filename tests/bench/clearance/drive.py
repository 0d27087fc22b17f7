"""A plant that is driven along the gantry's own legs, without drives and line, and what it ran into."""

from __future__ import annotations

from collections.abc import Sequence

from daemon.config.model import Config
from drivers.gantry import GantryConfig, Position
from drivers.gantry.path import Ends, Leg
from sim_hw.board.parts import Bodies
from sim_hw.plant.motion import Ramps, plan_move
from sim_hw.plant.plant import Plant
from sim_hw.scene.collision import Hit, hit_at, hits_between
from sim_hw.scene.needle import Needle

AXES = ("x", "y", "z", "theta")


class Drive:
    """Moves a plant's axes by the speeds of a configuration; the drives count where they were sent."""

    def __init__(self, plant: Plant, bodies: Bodies, needle: Needle, config: Config) -> None:
        self.plant, self._bodies, self._needle = plant, bodies, needle
        self._sections = {name: getattr(config.axes, name) for name in AXES}
        self._descent = config.gantry.descent_speed
        self._t_s = 1.0
        self._at = {name: plant.axes[name].position(0.0) for name in AXES}
        gantry = config.gantry
        self.limits = GantryConfig(
            safe_z_um=gantry.safe_z_um, backlash_um=gantry.approach_um, backlash_theta_deg=gantry.approach_deg,
            slow_z_um=gantry.highest_surface_um, slow_um_s=gantry.descent_speed, floor_z_um=gantry.floor_z_um,
        )  # fmt: skip
        self.ends = Ends(*((section.minimum, section.maximum) for section in self._sections.values()))

    @property
    def position(self) -> Position:
        """Where the drives count to be."""
        return Position(self._at["x"], self._at["y"], self._at["z"], self._at["theta"])

    def go(self, legs: Sequence[Leg]) -> list[Hit]:
        """Drive the legs one after the other, and return what was hit on the way or where it ends."""
        begun_s = self._t_s
        for leg in legs:
            for name, to in leg.to.items():
                self._follow(name, to, leg.speed_units_s)
            self._t_s = max(self._t_s, self.plant.rest_s()) + 0.01
        return list(hits_between(self.plant, self._bodies, self._needle, begun_s, self._t_s))

    def hit_here(self) -> Hit | None:
        """Return what something is in as the head stands."""
        return hit_at(self.plant, self._bodies, self._needle, self._t_s)

    def tip_um(self) -> tuple[float, float]:
        """Return where the needle's end really is, robot frame."""
        state = self.plant.state_at(self._t_s)
        return state.tip_x_um, state.tip_y_um

    def _follow(self, name: str, to: float, speed: float | None) -> None:
        section, way = self._sections[name], to - self._at[name]
        most = section.speed if speed is None else min(speed, section.speed)
        ramps = Ramps(most, section.acceleration, section.acceleration)
        self.plant.axes[name].follow(
            plan_move(self._t_s, self._at[name], 0.0, to, ramps), backlash=self.plant.backlash(name),
            sigma=self.plant.stop_sigma(name), beside=self.plant.beside(name, way),
        )  # fmt: skip
        self._at[name] = to
