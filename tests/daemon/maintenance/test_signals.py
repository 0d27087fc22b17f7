"""What a job, a device or a calibration says is turned into the numbers of the right watch."""

import math
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from daemon.domain.results import ErrorBody, JobResult
from daemon.maintenance.limit_check import Limit
from daemon.maintenance.signals import (
    AxisWords,
    Counters,
    Landings,
    Step,
    of_axes,
    of_calibrations,
    of_ending,
    of_looks,
)
from daemon.maintenance.types import Point
from tests.daemon.tools.report.synthetic import backlash_record, map_record, rotation_record

NOW = datetime(2026, 11, 24, tzinfo=UTC)


def _result(**changes: Any) -> JobResult:
    facts: dict[str, Any] = {
        "id": "a", "op": "correct", "ok": True, "seq": 1, "station": "s", "finished_at": "t", "outcome": "corrected",
        "error_before_um": 50.0, "looks": 2, "moves": 1,
    }  # fmt: skip
    return JobResult(**(facts | changes))


def _look(dx_um: float, dy_um: float, theta_deg: float = 0.0) -> Step:
    return "look", {"dx_um": dx_um, "dy_um": dy_um, "theta_deg": theta_deg}


def test_the_miss_is_where_the_tip_was_from_the_pad() -> None:
    numbers = Landings(0.0).numbers(_result(), [_look(30.0, -40.0)])
    assert (numbers["placement_x"], numbers["placement_y"]) == ([-30.0], [40.0])
    assert numbers["placement_error"] == numbers["placement_at_000"] == [50.0]


@pytest.mark.parametrize("theta_deg", [0.0, 33.0, 90.0, 200.0, 359.0])
def test_a_head_that_has_slipped_shows_along_its_sense_of_turning_at_every_angle(theta_deg: float) -> None:
    turn = math.radians(theta_deg - 3.0)
    x_um, y_um = -10.0 * math.sin(turn), 10.0 * math.cos(turn)  # ahead by 10 um
    numbers = Landings(-3.0).numbers(_result(), [_look(-x_um, -y_um, theta_deg)])
    assert numbers["head_along"][0] == pytest.approx(10.0)
    assert numbers["head_across"][0] == pytest.approx(0.0, abs=1e-9)


def test_scatter_is_between_pairs_of_landings_and_knows_no_bias() -> None:
    landings = Landings(0.0)
    seen = [landings.numbers(_result(), [_look(500.0 + x, 500.0)]).get("placement_scatter") for x in (0, 8, 0, -8)]
    assert seen == [None, [pytest.approx(8.0 / math.sqrt(2))], None, [pytest.approx(8.0 / math.sqrt(2))]]


def test_what_the_first_move_left_is_the_scatter_of_the_stops() -> None:
    steps: list[Step] = [_look(100.0, 0.0), ("move", {}), _look(3.0, 4.0), ("move", {}), _look(1.0, 1.0)]
    assert Landings(0.0).numbers(_result(), steps)["stop_scatter"] == [5.0]
    assert "stop_scatter" not in Landings(0.0).numbers(_result(), steps[:1])


def test_a_landing_seen_only_after_stepping_aside_has_a_size_and_no_direction() -> None:
    steps: list[Step] = [("look", {"theta_deg": 0.0}), ("move", {}), _look(100.0, 0.0)]
    assert Landings(0.0).numbers(_result(), steps) == {"placement_error": [50.0]}
    assert Landings(0.0).numbers(_result(error_before_um=None), []) == {}


def test_every_look_says_how_the_needle_is() -> None:
    needle = {"width_px": 42.0, "contrast": 0.8, "bend_px": 0.1, "sharpness": 0.2}
    look: Step = ("look", {"tip_px": [430.0, 619.0], "needle": needle})
    numbers = of_looks([look, ("move", {}), look, ("look", {})], (428.0, 620.0))
    assert numbers["tip_x"] == [2.0, 2.0]
    assert numbers["tip_y"] == [-1.0, -1.0]
    assert numbers["focus"] == [0.2, 0.2]


def test_each_way_not_to_see_is_counted_by_its_own_watch() -> None:
    error = ErrorBody(code=2101, name="tip_not_found", message="", advice="")
    failed = of_ending(_result(ok=False, outcome="failed", error=error))
    assert failed["tip_refused"] == [1.0, 1.0]
    assert failed["pictures_unusable"] == [0.0, 1.0]
    assert all(events == 0.0 for events, _ in of_ending(_result()).values())
    assert of_ending(_result(moves=2))["more_moves"] == [1.0, 1.0]
    assert "more_moves" not in of_ending(_result(moves=0)), "nothing had to move"


def test_counts_are_since_the_last_time_and_begin_anew_with_what_was_opened_anew() -> None:
    counters = Counters()
    assert counters.since("bus", 2, 100) == [2.0, 100.0]
    assert counters.since("bus", 3, 150) == [1.0, 50.0]
    assert counters.since("bus", 0, 20) == [0.0, 20.0]


def test_a_drive_s_warning_and_its_error_word_are_told_in_its_own_words() -> None:
    axes = [
        AxisWords("x", warning=True, error="", following=0.5),
        AxisWords("y", warning=True, error="error 4310h: over-temperature", following=None),
        AxisWords("z", warning=False, error="", following=0.0),
    ]
    numbers, words = of_axes(axes, {"x": -0.7})
    assert [numbers[f"drive_{name}"][0] for name in "xyz"] == [1.0, 2.0, 0.0]
    assert words["drive_y"] == "error 4310h: over-temperature"
    assert "drive_z" not in words
    assert numbers["arrival_x"] == [0.7]
    assert "following_y" not in numbers


def test_an_old_map_and_a_growing_play_are_measured_against_what_is_allowed() -> None:
    made = (NOW - timedelta(days=25)).isoformat()
    records: Any = {"map": map_record().model_copy(update={"made_at": made}), "backlash": backlash_record(play_um=30.0)}
    numbers = of_calibrations(records, None, 30.0, NOW)
    figure, warn, serious = numbers["calibration_age"]
    assert figure == pytest.approx(25.0)
    assert (warn, serious) == (24.0, 30.0)
    assert numbers["backlash_x"][0] == pytest.approx(30.0, abs=10.0)
    assert numbers["backlash_x"][1] <= numbers["backlash_x"][2]
    assert of_calibrations({}, None, 30.0, NOW) == {}


def test_a_clock_that_jumps_tells_an_age_that_is_gone_again_with_it() -> None:
    records: Any = {"map": map_record().model_copy(update={"made_at": NOW.isoformat()})}
    ages = [of_calibrations(records, None, 30.0, NOW + timedelta(days=days))["calibration_age"][0] for days in (-9, 40)]
    assert ages == [pytest.approx(-9.0), pytest.approx(40.0)]
    watch = Limit("beyond its limit")
    found = []
    for days in (1, 40, 1, -9):
        watch.feed(Point(float(days), 0, "t"), 24.0, 30.0)
        found.append(watch.finding.severity if watch.finding else None)
    assert found == [None, "serious", None, None]


def test_a_rotation_is_held_against_what_the_one_before_promised() -> None:
    before = rotation_record()
    after = before.model_copy(update={"total_error_um": 90.0 * math.sqrt(sum(before.used))})
    figure, warn, serious = of_calibrations({"rotation": after}, before, 30.0, NOW)["head_total_error"]
    assert figure == pytest.approx(90.0), "eq. 6.8 grows with the angles, its root mean square does not"
    assert warn == pytest.approx(max(30.0, 2.0 * before.holdout_rms_um))
    assert serious > warn
    assert "head_total_error" not in of_calibrations({"rotation": after}, None, 30.0, NOW)
