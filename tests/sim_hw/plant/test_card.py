"""Where the control-point card lies, what it does to the tip's height, and what the truth log says of it."""

import json
import math
from pathlib import Path

import pytest

from sim_hw.plant.axis import SPECS
from sim_hw.plant.card import CARD_CENTRE_UM, CARD_SIDE_UM, CardPose
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.runout import tip_offset_um
from sim_hw.truth import TruthLog, truth_record
from tests.sim_hw.rig import make_plant

BY_NAME = {spec.name: spec for spec in SPECS}
EXACT = {"card_dx_um": 0.0, "card_dy_um": 0.0, "card_rotation_deg": 0.0, "card_dz_um": 0.0}


def over_card(dx_um: float = 0.0, dy_um: float = 0.0, **knobs: float) -> dict[str, float]:
    """Return the knobs that put the tip so far from the card's nominal centre at head angle 0."""
    offset_x_um, offset_y_um = tip_offset_um(0.0)
    x_um, y_um = CARD_CENTRE_UM[0] + dx_um - offset_x_um, CARD_CENTRE_UM[1] + dy_um - offset_y_um
    return {"theta_start_deg": 0.0, "x_start_um": x_um, "y_start_um": y_um, "z_start_um": 5_200.0, **knobs}


def test_poses_stay_within_their_knobs_and_vary() -> None:
    poses = [CardPose.drawn(Knobs(), seed) for seed in range(300)]
    shifts = [math.hypot(pose.dx_um, pose.dy_um) for pose in poses]
    assert 80.0 < max(shifts) <= 100.0
    assert 0.8 < max(abs(pose.rotation_deg) for pose in poses) <= 1.0
    assert 12.0 < math.sqrt(sum(pose.dz_um**2 for pose in poses) / 300.0) < 18.0
    assert len({pose.dx_um for pose in poses}) == 300


def test_the_card_is_drawn_apart_from_the_board_and_moves_when_its_knobs_turn() -> None:
    plant = make_plant(seed=9)
    board, before = plant.board_pose, plant.card_pose
    plant.set_knob("card_dx_um", 400.0)
    assert plant.card_pose == CardPose(400.0, before.dy_um, before.rotation_deg, before.dz_um)
    assert plant.board_pose == board
    plant.set_knob("card_dx_um", None)
    assert plant.card_pose == before


@pytest.mark.parametrize("theta_deg", [float(angle) for angle in (*range(0, 101, 5), *range(140, 360, 5))])
def test_the_tip_reaches_the_card_at_every_allowed_head_angle(theta_deg: float) -> None:
    for axis, centre_um, offset_um in zip("xy", CARD_CENTRE_UM, tip_offset_um(theta_deg), strict=True):
        spec = BY_NAME[axis]
        assert spec.negative_limit + 3_000.0 < centre_um - offset_um < spec.positive_limit - 3_000.0


def test_a_turned_card_covers_its_square_and_no_more() -> None:
    card = CardPose(dx_um=500.0, rotation_deg=45.0)
    x_um, y_um = card.centre_um
    corner_um = CARD_SIDE_UM / math.sqrt(2.0)
    assert card.covers((x_um + corner_um - 1.0, y_um))
    assert not card.covers((x_um + corner_um + 1.0, y_um))
    assert not card.covers((x_um + CARD_SIDE_UM / 2.0 - 1.0, y_um + CARD_SIDE_UM / 2.0 - 1.0))


def test_over_the_card_the_tip_height_counts_from_the_card() -> None:
    plant = make_plant(**over_card(card_dz_um=60.0, board_dz_um=-25.0, board_tilt_x_um_per_mm=0.0))
    state = plant.state_at(0.0)
    assert state.tip_height_um == pytest.approx(140.0)
    assert state.tip_z_um == pytest.approx(200.0)
    plant.faults.switch("card_gone", on=True)
    plane_um = plant.board_pose.height_um((state.tip_x_um, state.tip_y_um), plant.placement.centre_um)
    assert plane_um < 0.0
    assert plant.state_at(0.0).tip_height_um == pytest.approx(200.0 - plane_um)


def test_beside_the_card_the_tip_height_counts_from_the_board_plane() -> None:
    plant = make_plant(**over_card(dx_um=CARD_SIDE_UM / 2.0 + 200.0, **{**EXACT, "card_dz_um": 60.0}))
    state = plant.state_at(0.0)
    plane_um = plant.board_pose.height_um((state.tip_x_um, state.tip_y_um), plant.placement.centre_um)
    assert state.tip_height_um == pytest.approx(200.0 - plane_um)


def test_the_control_point_is_a_target_while_it_is_there_and_near() -> None:
    plant = make_plant(**over_card(30.0, -40.0, **{**EXACT, "card_dx_um": 10.0}))
    (target,) = truth_record(plant, [], 0.0)["targets"]
    assert target == {
        "name": "CONTROL",
        "dx_um": pytest.approx(20.0),
        "dy_um": pytest.approx(-40.0),
        "error_um": pytest.approx(math.hypot(20.0, 40.0)),
    }
    plant.faults.switch("card_gone", on=True)
    assert truth_record(plant, [], 0.0)["targets"] == []
    assert truth_record(make_plant(**over_card(3_500.0)), [], 0.0)["targets"] == []


def test_the_truth_log_begins_with_where_the_card_lies(tmp_path: Path) -> None:
    log, plant = TruthLog(tmp_path / "truth.jsonl"), make_plant(card_dx_um=12.5)
    log.start(plant, {})
    log.close()
    assert json.loads((tmp_path / "truth.jsonl").read_text())["card_pose"]["dx_um"] == 12.5
