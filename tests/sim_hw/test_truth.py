"""The truth record: tip minus pad centre in the robot frame, nearest first."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from sim_hw.board.board import load_board
from sim_hw.board.nest import InNest
from sim_hw.plant.card import CARD_CENTRE_UM
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.plant import Placement, Plant
from sim_hw.scene.needle import Needle
from sim_hw.scene.needle_bend import bend_um
from sim_hw.scene.optics import make_optics
from sim_hw.truth import TruthLog, truth_record
from tests.sim_hw.rig import make_plant
from tests.sim_hw.small_board import write_board


@dataclass(frozen=True)
class Pad:
    name: str
    x_mm: float
    y_mm: float


PADS = [Pad("far", 70.0, 40.0), Pad("near", 40.2, 25.0), Pad("under", 40.0, 25.0)]


def test_errors_are_tip_minus_the_real_pad_nearest_first() -> None:
    plant = make_plant(
        board_dx_um=100.0,
        board_dy_um=-50.0,
        board_rotation_deg=0.0,
        head_runout_scale=0.0,
        theta_start_deg=3.054,
        x_start_um=100_000.0 - 14_938.26,
        y_start_um=65_000.0,
    )
    record = truth_record(plant, PADS, 0.0)
    assert [target["name"] for target in record["targets"]] == ["under", "near"]
    under = record["targets"][0]
    assert (under["dx_um"], under["dy_um"]) == pytest.approx((-100.0, 50.0), abs=1e-6)
    assert under["error_um"] == pytest.approx(math.hypot(100.0, 50.0))


def test_a_bent_needle_moves_the_true_tip_by_what_the_picture_shows() -> None:
    plant = make_plant(theta_start_deg=0.0)
    straight = truth_record(plant, [], 0.0)["tip_um"]
    plant.faults.switch("bent", on=True, px=10.0)
    bent = truth_record(plant, [], 0.0)["tip_um"]
    moved = (bent[0] - straight[0], bent[1] - straight[1])
    optics = make_optics()
    end_px, bent_px = optics.project([[0.0, 0.0, 0.0], [*moved, 0.0]])
    across = Needle(optics, seed=1).across
    assert bent_px - end_px == pytest.approx(10.0 * across, abs=0.2)
    assert math.hypot(*moved) == pytest.approx(120.0, rel=0.02), "12 um per pixel across the view"
    assert bend_um(10.0, 90.0) == pytest.approx((-moved[1], moved[0]))


def test_the_log_is_one_json_object_a_line_and_is_readable_at_once(tmp_path: Path) -> None:
    log, plant = TruthLog(tmp_path / "truth.jsonl"), make_plant(seed=4)
    log.start(plant, {"board": "demo"})
    log.write("settled", truth_record(plant, PADS, 0.0))
    start, settled = (json.loads(line) for line in (tmp_path / "truth.jsonl").read_text().splitlines())
    log.close()
    assert (start["event"], start["seed"], start["knobs"]["x_backlash_um"]) == ("start", 4, 15.0)
    assert start["board_pose"]["dx_um"] == pytest.approx(plant.board_pose.dx_um, abs=1e-6)
    assert set(settled) == {"event", "t_s", "axes", "tip_um", "pressed_um", "targets"}


class OnBoard:
    """The small board in the nest, and the tip wherever a test wants it (CAD mm)."""

    def __init__(self, folder: Path, side: str = "top", parts_seed: int | None = None) -> None:
        self.nest = InNest.made(load_board(write_board(folder), side, parts_seed))
        knobs = Knobs().with_value("head_runout_scale", 0.0)
        placement = Placement(*self.nest.board.outline_mm, "top" if side == "top" else "bottom")
        self.plant = Plant(knobs, placement, Faults(), seed=5)

    def over(self, x_um: float, y_um: float) -> dict[str, Any]:
        """Return the record with the tip at a place of the robot frame."""
        state = self.plant.state_at(0.0)
        for axis, way in (("x_start_um", x_um - state.tip_x_um), ("y_start_um", y_um - state.tip_y_um)):
            self.plant.knobs = self.plant.knobs.with_value(axis, getattr(state, axis.replace("_start", "")) + way)
        moved = Plant(self.plant.knobs, self.plant.placement, self.plant.faults, seed=5)
        return truth_record(moved, self.nest.board.targets, 0.0, self.nest)

    def over_cad(self, x_mm: float, y_mm: float) -> dict[str, Any]:
        return self.over(*self.plant.to_real_um(x_mm, y_mm))


@pytest.mark.parametrize("side", ["top", "bottom"])
def test_a_landing_is_judged_by_the_record_alone(tmp_path: Path, side: str) -> None:
    bench = OnBoard(tmp_path, side)
    record = bench.over_cad(4.0 + 0.65, 10.0)
    assert record["cad_mm"] == pytest.approx((4.65, 10.0), abs=1e-6)
    assert record["board_um"] == pytest.approx((4_650.0 if side == "top" else 15_350.0, 10_000.0), abs=1e-3)
    on = record["on"]
    assert (record["side"], on["what"], on["pin"], on["net"]) == (side, "metal", "J1.1", "VIN")
    assert on["inside_um"] == pytest.approx(150.0, abs=3.0)
    assert (on["touches"], on["nets"]) == (("metal",), ("VIN",))
    nearest = record["pads"][0]
    assert (nearest["pin"], nearest["net"]) == ("J1.1", "VIN")
    assert nearest["error_um"] == pytest.approx(650.0)
    assert math.hypot(nearest["dx_um"], nearest["dy_um"]) == pytest.approx(650.0)


def test_the_record_follows_a_board_that_was_displaced(tmp_path: Path) -> None:
    bench = OnBoard(tmp_path)
    place = bench.plant.to_real_um(3.0, 3.0)
    assert bench.over(*place)["on"]["pin"] == "R1.1"
    bench.plant.faults.switch("board_displaced", on=True, dx_um=-1_400.0)
    assert bench.over(*place)["on"]["pin"] == "R1.2"


def test_what_is_no_board_is_told(tmp_path: Path) -> None:
    bench = OnBoard(tmp_path)
    assert bench.over(*CARD_CENTRE_UM)["on"] == {"what": "card"}
    bench.plant.faults.switch("board_gone", on=True)
    record = bench.over_cad(3.0, 3.0)
    assert (record["on"], record["pads"]) == ({"what": "nest"}, [])


def test_a_part_under_the_tip_is_told_by_its_name(tmp_path: Path) -> None:
    on = OnBoard(tmp_path, parts_seed=1).over_cad(3.7, 3.0)["on"]
    assert (on["what"], on["part"], on["touches"], on["inside_um"]) == ("body", "R1", ["body"], None)
