"""The main job on the simulated station, judged by the truth."""

import pytest

from daemon.client import Client, Refused
from tests.station.rig import Rig


@pytest.mark.parametrize("name", ["TP1", "TP3", "TP5", "TP6", "TP12"])
def test_a_missed_touch_lands(rig: Rig, client: Client, name: str) -> None:
    """Each kind of target: via with and without a visible hole, site, tangent site, site with a via beside it."""
    landing = rig.session(client, seed=11).land(rig.board.point(name))
    assert landing.result.ok, landing.result.error
    assert landing.after_um <= 50.0
    assert landing.result.test_point == name
    assert landing.result.looks >= 1


def test_the_same_id_never_moves_twice(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP4", theta_deg=20.0)
    first = client.job("correct", job_id="once", test_point="TP4")
    assert first.ok, first.error
    client.job("place", test_point="TP4", theta_deg=30.0)
    before = rig.truth()["axes"]
    again = client.job("correct", job_id="once", test_point="TP4")
    assert again == first
    assert rig.truth()["axes"] == before
    with pytest.raises(Refused, match="id_reused"):
        client.job("correct", job_id="once", test_point="TP5")


def test_lights_are_off_when_idle(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP8", theta_deg=200.0)
    assert client.job("correct", test_point="TP8").ok
    rig.until(lambda truth: max(truth["white"], truth["red"]) < 0.05, "the lamps went on glowing")


def test_time_is_told_by_state_and_cause(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP9", theta_deg=0.0)
    result = client.job("correct", test_point="TP9")
    assert {"triggered", "look"} <= set(result.timing_ms)
    look = result.timing_ms["look"]
    assert look["total"] == pytest.approx(sum(v for k, v in look.items() if k != "total"), abs=1.0)


def test_pictures_and_numbers_are_kept(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP10", theta_deg=300.0)
    result = client.job("correct", test_point="TP10")
    client.job("look")  # the next job begins only when the pictures are written
    folder = rig.places.out / "station" / "pictures" / result.id
    assert str(folder) == result.pictures
    assert {"before-white.jpg", "before-red.jpg", "before-tip.jpg", "before-board.jpg", "result.json"} <= {
        f.name for f in folder.iterdir()
    }


def test_a_board_that_lies_elsewhere_is_told_how_far_and_the_head_stays(rig: Rig, client: Client) -> None:
    client.job("place", test_point="TP9", theta_deg=45.0)
    before = rig.truth()["axes"]
    as_it_lay = rig.truth_start()["board_pose"]["dx_um"]
    rig.bench.ask("set", name="board_dx_um", value=as_it_lay + 2500.0)
    try:
        result = client.job("correct", test_point="TP9")
    finally:
        rig.bench.ask("set", name="board_dx_um", value=as_it_lay)
    assert result.error is not None
    assert result.error.name == "wrong_place"
    assert result.error.detail["off_um"][0] == pytest.approx(2500.0, abs=150.0)
    assert result.moves == 0
    after = rig.truth()["axes"]
    assert max(abs(after[axis] - before[axis]) for axis in ("x_um", "y_um")) < 50.0
    if (aligned := client.job("align", timeout_s=300.0)).error is not None:  # its seat, if it was verified, is void
        raise AssertionError(aligned.error)
    assert client.job("correct", test_point="TP9").error is not None, "the head stands over the last place of the seat"
    client.job("place", test_point="TP9", theta_deg=45.0)
    assert client.job("correct", test_point="TP9").ok
