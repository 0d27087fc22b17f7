"""Figures of a run are those of its records, and what has a verdict is not left."""

from __future__ import annotations

import pytest

from daemon.domain.board_run import BoardRun, RunBoard, RunPlace, in_a_sentence, summarise
from daemon.domain.plan import Plan
from daemon.domain.point_test import Cause, PointMethod, PointReading, PointRecord, PointTest, PointVerdict, Rung

AT = "2026-11-26T00:30:00.000+00:00"


def a_record(point: str, verdict: PointVerdict, touches: int = 1, **more: object) -> PointRecord:
    reading = PointReading(
        rung=Rung.TOUCH, site_um=(0.0, 0.0), pressed_um=300.0, force_n=0.48, proof=True, value=0.2, unit="ohm"
    )
    whole = {
        "point": point, "net": f"N{point}", "board_id": "b1", "run": "run-1", "method": "continuity", "limits": None,
        "verdict": verdict, "readings": (reading,), "touches": touches, "presses": touches, "seconds": 1.0, "at": AT,
    }  # fmt: skip
    return PointRecord.model_validate(whole | more)


def a_run(points: tuple[str, ...], **more: object) -> BoardRun:
    tests = tuple(PointTest(point=point, net=f"N{point}", method="continuity") for point in points)
    plan = Plan(name="power", board="demo", board_revision="r1", tests=tests)
    whole = {
        "id": "run-1", "board_id": "b1", "plan": plan, "plan_version": 1, "plan_hash": plan.hash,
        "board": RunBoard(name="demo", side="top", revision="r1", width_um=50_000.0, height_um=40_000.0),
        "order": tuple(range(len(points))),
        "places": tuple(RunPlace(x_um=1e3 * n, y_um=2e3, theta_deg=0.0) for n in range(len(points))),
        "station": "s", "software": "0.1", "calibrated": {"map": AT}, "begun_at": AT, "jobs": ("run-1",),
    }  # fmt: skip
    return BoardRun.model_validate(whole | more)


def test_every_point_counts_once_under_its_verdict() -> None:
    records = [
        a_record("A", PointVerdict.PASS_FIRST),
        a_record("B", PointVerdict.PASS_FIRST),
        a_record("C", PointVerdict.PASS_RECOVERED, 2, recovered_by=Rung.LOOK, cause=Cause.MISPLACED, looks=2),
        a_record("D", PointVerdict.PASS_RECOVERED, 3, recovered_by=Rung.PUMP, cause=Cause.FILM),
        a_record("E", PointVerdict.FAIL, 2),
        a_record("F", PointVerdict.OPEN_CONFIRMED, 2),
        a_record("G", PointVerdict.CONTACT_NOT_MADE, 3),
        a_record("H", PointVerdict.NOT_TESTED, 0),
    ]
    told = summarise(10, records, [0.3, 0.4, 0.5])
    assert (told.points, told.done, told.passed_first, told.false_opens) == (10, 8, 2, 2)
    assert (told.recovered_by, told.causes) == ({"look": 1, "pump": 1}, {"misplaced": 1, "film": 1})
    assert (told.failed, told.opens_confirmed, told.contact_not_made, told.not_tested) == (1, 1, 1, 1)
    assert told.first_touch_yield == pytest.approx(2 / 7)
    assert (told.touches, told.touches_max, told.touches_p99, told.looks) == (14, 3, 3, 2)
    assert told.touches_mean == pytest.approx(2.0)
    assert (told.seconds, told.seconds_per_point) == (8.0, 1.0)
    assert (told.reference_first_ohm, told.reference_last_ohm) == (0.3, 0.5)
    assert "2 false opens recovered (1 by look, 1 by pump)" in in_a_sentence(told)


def test_a_run_without_a_record_has_no_shares() -> None:
    told = summarise(3, [])
    assert (told.first_touch_yield, told.touches_mean, told.touches_p99, told.seconds_per_point) == (None,) * 4


def test_of_a_hundred_points_the_99th_percentile_leaves_one_out() -> None:
    records = [a_record(str(n), PointVerdict.PASS_FIRST, 9 if n == 50 else 1) for n in range(100)]
    told = summarise(100, records)
    assert (told.touches_p99, told.touches_max) == (1, 9)


def test_what_has_a_verdict_is_not_left_and_the_rest_is_in_the_order_of_the_way() -> None:
    run = a_run(("A", "B", "C", "D"), order=(3, 1, 0, 2))
    left = run.tests_left([a_record("B", PointVerdict.NOT_TESTED), a_record("D", PointVerdict.FAIL)])
    assert [(test.point, place.x_um) for test, place in left] == [("A", 0.0), ("C", 2000.0)]


def test_a_verdict_is_of_one_method_only() -> None:
    run = a_run(("A",))
    other: PointMethod = "resistance"
    assert len(run.tests_left([a_record("A", PointVerdict.PASS_FIRST, method=other)])) == 1
