"""Truth log: where the tip really was, over which metal of the board, and what it ran into; no wire carries it.

A landing on any pad of any board is judged by `cad_mm` and `on` alone: which net and pin the metal under the needle's
end belongs to, how far its edge is, and what else the end touches. README.md says what each field means.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

from sim_hw.board.nest import InNest
from sim_hw.plant.plant import Plant
from sim_hw.scene.collision import Hit
from sim_hw.scene.needle import END_RADIUS_UM
from sim_hw.scene.needle_bend import bend_um

CONTROL = "CONTROL"
"""Name of the control point of the card among the targets."""
REACH_UM = 3000.0
"""Targets and pads farther from the tip than this are left out of a record."""
PADS_TOLD = 8
"""No more than so many pins and vias around the tip are told of."""


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


def head_record(plant: Plant, t_s: float) -> dict[str, Any]:
    """Return what is true of the head alone at a time: time, axes, tip, and how far the pin is pushed in."""
    state = plant.state_at(t_s)
    tip_x_um, tip_y_um = state.tip_x_um, state.tip_y_um
    if plant.faults.on("bent"):
        bend_x_um, bend_y_um = bend_um(float(plant.faults.get("bent")["px"]), state.theta_deg)
        tip_x_um, tip_y_um = tip_x_um + bend_x_um, tip_y_um + bend_y_um
    return {
        "t_s": t_s,
        "axes": {"x_um": state.x_um, "y_um": state.y_um, "z_um": state.z_um, "theta_deg": state.theta_deg},
        "tip_um": [tip_x_um, tip_y_um, state.tip_height_um],
        "pressed_um": state.pressed_um,
    }


def truth_record(
    plant: Plant, targets: Iterable[RoundTarget], t_s: float, nest: InNest | None = None
) -> dict[str, Any]:
    """Return what is true at a time: axes, tip, and tip minus centre for the targets around, nearest first.

    The height in `tip_um` is that of the pin's end, 0 when it is pressed; `pressed_um` is how far it is pushed in.
    With what lies in the nest the record also says where on the board the tip is, and over what.
    """
    head = head_record(plant, t_s)
    tip_x_um, tip_y_um, _ = head["tip_um"]
    near: list[dict[str, Any]] = []
    places = [(target.name, plant.to_real_um(target.x_mm, target.y_mm)) for target in targets]
    if plant.card is not None:
        places.append((CONTROL, plant.card.centre_um))
    for name, (real_x_um, real_y_um) in places:
        dx_um, dy_um = tip_x_um - real_x_um, tip_y_um - real_y_um
        error_um = math.hypot(dx_um, dy_um)
        if error_um <= REACH_UM:
            near.append({"name": name, "dx_um": dx_um, "dy_um": dy_um, "error_um": error_um})
    record: dict[str, Any] = {**head, "targets": sorted(near, key=lambda item: item["error_um"])}
    return record if nest is None else {**record, **_on_board(plant, nest, (tip_x_um, tip_y_um))}


def _on_board(plant: Plant, nest: InNest, tip_um: tuple[float, float]) -> dict[str, Any]:
    """Return where on the board a place of the robot frame is, what is there, and the pads around it."""
    x_mm, y_mm = plant.to_cad_mm(*tip_um)
    if plant.card is not None and plant.card.covers(tip_um):
        on: dict[str, Any] = {"what": "card"}
    elif plant.faults.on("board_gone"):
        on = {"what": "nest"}
    else:
        on = asdict(nest.surface.at(x_mm, y_mm, END_RADIUS_UM))
        body = nest.bodies.over(x_mm, y_mm)
        if body is not None:
            on = {**on, "what": "body", "part": body.part, "inside_um": None, "touches": ["body"], "nets": []}
    pads = [] if on["what"] in ("card", "nest") else _pads_near(plant, nest, tip_um, (x_mm, y_mm))
    x0_mm, y0_mm, x1_mm, _ = nest.board.outline_mm
    across_mm = x_mm - x0_mm if nest.board.side == "top" else x1_mm - x_mm
    seen_um = [1e3 * across_mm, 1e3 * (y_mm - y0_mm)]
    return {"side": nest.board.side, "cad_mm": [x_mm, y_mm], "board_um": seen_um, "on": on, "pads": pads}


def _pads_near(
    plant: Plant, nest: InNest, tip_um: tuple[float, float], cad_mm: tuple[float, float]
) -> list[dict[str, Any]]:
    """Return tip minus centre (robot frame) for the nearest pins and vias, covered by mask or not."""
    found = sorted((math.dist(cad_mm, (pad.x_mm, pad.y_mm)), k) for k, pad in enumerate(nest.board.pads))
    near = []
    for away_mm, k in found[:PADS_TOLD]:
        pad = nest.board.pads[k]
        if away_mm * 1e3 > REACH_UM:
            break
        x_um, y_um = plant.to_real_um(pad.x_mm, pad.y_mm)
        place = {"dx_um": tip_um[0] - x_um, "dy_um": tip_um[1] - y_um, "error_um": away_mm * 1e3}
        near.append({"pin": pad.name, "net": pad.net, **place})
    return near


def hit_record(hit: Hit) -> dict[str, Any]:
    """Return what the log says of a needle, barrel or head that ran into a part."""
    facts = {"t_s": hit.t_s, "part": hit.part, "by": hit.by, "cad_mm": list(hit.cad_mm)}
    return {**facts, "below_um": hit.below_um, "moving": hit.moving}


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
        knobs["spots"] = asdict(plant.spots)
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
