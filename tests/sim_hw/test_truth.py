"""The truth record: tip minus pad centre in the robot frame, nearest first."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from sim_hw.scene.needle import Needle
from sim_hw.scene.needle_bend import bend_um
from sim_hw.scene.optics import make_optics
from sim_hw.truth import TruthLog, truth_record
from tests.sim_hw.rig import make_plant


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
