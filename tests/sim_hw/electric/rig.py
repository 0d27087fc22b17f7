"""A needle over a board of squares, moved by hand: the plant's Z axis is ordered directly."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import sim_hw
from sim_hw.board.board import Board, load_board
from sim_hw.board.nest import InNest
from sim_hw.electric.electricity import Electricity
from sim_hw.plant.motion import Ramps, plan_move
from sim_hw.plant.plant import Plant
from tests.sim_hw.rig import make_plant

REACH_UM, PHASE_DEG = 14_938.26, 3.054
"""With the head at this angle a straight needle's end is so far to the right of the head, and not aside."""
TOUCH_Z_UM = 5_000.0
STILL = {
    "board_dx_um": 0.0, "board_dy_um": 0.0, "board_rotation_deg": 0.0, "board_dz_um": 0.0,
    "board_tilt_x_um_per_mm": 0.0, "board_tilt_y_um_per_mm": 0.0, "head_runout_scale": 0.0,
    "repeatability_um": 0.0, "z_repeatability_um": 0.0, "spots_height_sigma_um": 0.0,
    "theta_start_deg": PHASE_DEG, "z_start_um": 8_000.0,
}  # fmt: skip


@cache
def demo_board() -> Board:
    return load_board(Path(sim_hw.__file__).parent / "demo_board")


def start_over(x_mm: float, y_mm: float) -> dict[str, float]:
    """Return the knobs of a head that stands with the needle over a CAD place of the demo board."""
    x0, y0, _, _ = demo_board().outline_mm
    return {
        "x_start_um": 60_000.0 + (x_mm - x0) * 1e3 - REACH_UM,
        "y_start_um": 40_000.0 + (y_mm - y0) * 1e3,
    }


class Needle:
    """The needle over a target of the demo board; `t_s` is the present, `log` what the truth log got."""

    def __init__(
        self, target: str = "TP5", *, off_um: tuple[float, float] = (0.0, 0.0), seed: int = 1, **knobs: Any
    ) -> None:
        board = demo_board()
        pad = board.target(target)
        place = start_over(pad.x_mm + off_um[0] / 1e3, pad.y_mm + off_um[1] / 1e3)
        self.plant: Plant = make_plant(seed, **{**STILL, "contact_bounce_s": 0.0, **place, **knobs})
        x0, y0, x1, y1 = board.outline_mm
        assert (self.plant.placement.x0_mm, self.plant.placement.y0_mm) == (0.0, 0.0)
        self.plant.placement = type(self.plant.placement)(x0, y0, x1, y1)
        self.log: list[tuple[float, str, Mapping[str, Any]]] = []
        self.plant.note = lambda t_s, event, facts: self.log.append((t_s, event, facts))
        self.electricity = Electricity(self.plant, seed)
        self.electricity.lay_board(InNest.made(board))
        self.t_s = 0.1

    def move(self, axis: str, place: float, speed: float = 2_000.0) -> None:
        """Order a way and let it come to its end and rest a while."""
        where = self.plant.axes[axis].position(self.t_s)
        demand = plan_move(self.t_s, where, 0.0, place, Ramps(speed, 1e6, 1e6))
        self.plant.axes[axis].follow(demand)
        self.t_s = demand.end_s + 0.1
        self.electricity.update(self.t_s)

    def press(self, um: float, speed: float = 2_000.0) -> None:
        """Go to so far below the nominal board; below 0 is above it."""
        self.move("z", TOUCH_Z_UM - um, speed)

    def lift(self) -> None:
        self.press(-1_000.0)

    def events(self, kind: str) -> list[Mapping[str, Any]]:
        return [facts for _, event, facts in self.log if event == kind]
