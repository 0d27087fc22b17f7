"""Truth log: where the tip really was against the real centres of pads and card; no wire carries it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

from sim_hw.plant.plant import Plant
from sim_hw.scene.needle_bend import bend_um

CONTROL = "CONTROL"
"""Name of the control point of the card among the targets."""
REACH_UM = 3000.0
"""Targets farther from the tip than this are left out of a record."""


class RoundTarget(Protocol):
    """What the log needs to know of a target of the board."""

    @property
    def name(self) -> str:
        """Return the target's name."""

    @property
    def x_mm(self) -> float:
        """Return the CAD place of its centre."""

    @property
    def y_mm(self) -> float:
        """Return the CAD place of its centre."""


def truth_record(plant: Plant, targets: Iterable[RoundTarget], t_s: float) -> dict[str, Any]:
    """Return what is true at a time: axes, tip, and tip minus centre for the targets around, nearest first.

    The height in `tip_um` is that of the pin's end, 0 when it is pressed; `pressed_um` is how far it is pushed in.
    """
    state = plant.state_at(t_s)
    tip_x_um, tip_y_um = state.tip_x_um, state.tip_y_um
    if plant.faults.on("bent"):
        bend_x_um, bend_y_um = bend_um(float(plant.faults.get("bent")["px"]), state.theta_deg)
        tip_x_um, tip_y_um = tip_x_um + bend_x_um, tip_y_um + bend_y_um
    near = []
    places = [(target.name, plant.to_real_um(target.x_mm, target.y_mm)) for target in targets]
    if plant.card is not None:
        places.append((CONTROL, plant.card.centre_um))
    for name, (real_x_um, real_y_um) in places:
        dx_um, dy_um = tip_x_um - real_x_um, tip_y_um - real_y_um
        error_um = math.hypot(dx_um, dy_um)
        if error_um <= REACH_UM:
            near.append({"name": name, "dx_um": dx_um, "dy_um": dy_um, "error_um": error_um})
    return {
        "t_s": t_s,
        "axes": {"x_um": state.x_um, "y_um": state.y_um, "z_um": state.z_um, "theta_deg": state.theta_deg},
        "tip_um": [tip_x_um, tip_y_um, state.tip_height_um],
        "pressed_um": state.pressed_um,
        "targets": sorted(near, key=lambda item: item["error_um"]),
    }


class TruthLog:
    """Append JSON lines to a file, each at once."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("a", encoding="utf-8", buffering=1)

    def write(self, event: str, facts: Mapping[str, Any]) -> None:
        """Append one event; numbers are rounded to what is meaningful (1 nm, 1 us)."""
        self._file.write(json.dumps({"event": event, **_rounded(facts)}) + "\n")

    def start(self, plant: Plant, facts: Mapping[str, Any]) -> None:
        """Append the first event: seed, knobs and what was drawn."""
        knobs = {"knobs": asdict(plant.knobs), "board_pose": asdict(plant.board_pose)}
        knobs["card_pose"] = asdict(plant.card_pose)
        self.write("start", {"seed": plant.seed, **facts, **knobs})

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6)
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value
