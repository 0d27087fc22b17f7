"""Failures of one kind that repeat are known after the third, by operation, and are over when it goes well."""

from __future__ import annotations

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointRecord, PointVerdict
from daemon.domain.results import ErrorBody, JobResult
from daemon.maintenance.repeated_failures import IN_A_ROW, REPEATED, WINDOW, RepeatedFailures
from tests.daemon.domain.test_board_run import a_record


def _ended(op: str = "correct", kind: FaultCode | None = None) -> JobResult:
    error = None if kind is None else ErrorBody.of(Fault(kind))
    return JobResult(
        id="j", op=op, ok=kind is None, seq=1, station="s", finished_at="t", outcome="x", error=error,
        test_point="TP1" if op != "align" else None,
    )  # fmt: skip


def _told(*results: JobResult) -> str | None:
    failures = RepeatedFailures()
    for result in results:
        failures.add(result)
    return failures.message


FAILED = _ended(kind=FaultCode.TIP_NOT_FOUND)
WELL = _ended()


def test_the_third_failure_of_one_kind_is_told_with_its_cause_and_its_cure() -> None:
    assert _told(FAILED, FAILED) is None
    said = _told(FAILED, WELL, FAILED, FAILED) or ""
    assert said.startswith("correct failed 3 times of its last 4 by tip_not_found: the probe tip was not found; ")
    assert "Clean it" in said


def test_every_second_job_that_fails_is_told_and_stays() -> None:
    half = [FAILED, WELL] * 8
    assert "failed 5 times of its last 10" in (_told(*half) or "")


def test_what_goes_well_between_does_not_hide_an_operation_that_fails() -> None:
    placed = _ended("place")
    assert _told(*[placed, placed, FAILED] * REPEATED) is not None


def test_it_is_over_when_as_many_went_well_in_a_row_or_one_that_is_done_once() -> None:
    assert _told(*[FAILED] * 5, *[WELL] * (REPEATED - 1)) is not None
    assert _told(*[FAILED] * 5, *[WELL] * REPEATED) is None
    lost = _ended("align", FaultCode.NO_BOARD)
    assert _told(lost, lost, lost) is not None
    assert _told(lost, lost, lost, _ended("align")) is None


def test_of_two_kinds_that_repeat_the_newer_one_is_named() -> None:
    dark = _ended(kind=FaultCode.FRAME_UNUSABLE)
    assert "by frame_unusable" in (_told(*[FAILED] * 4, *[dark] * 3) or "")


def test_failures_of_several_kinds_or_long_ago_are_no_repetition() -> None:
    kinds = (FaultCode.TIP_NOT_FOUND, FaultCode.UNDECIDED, FaultCode.FRAME_UNUSABLE)
    assert _told(*(_ended(kind=kind) for kind in kinds)) is None
    spread = [FAILED, *[WELL] * (WINDOW // 2)] * 4
    assert _told(*spread) is None


@pytest.mark.parametrize("kind", [FaultCode.CANCELLED, FaultCode.OUTSIDE_ENVELOPE, FaultCode.POINT_FORBIDDEN])
def test_what_was_asked_for_wrongly_is_no_failure_of_the_station(kind: FaultCode) -> None:
    assert _told(*[_ended(kind=kind)] * WINDOW) is None


def _point(verdict: PointVerdict = PointVerdict.NOT_TESTED, fault: str | None = None) -> PointRecord:
    return a_record("TP1", verdict).model_copy(update={"fault": fault, "reason": "why"})


BLIND = _point(fault="tip_not_found")
NO_CONTACT = _point(PointVerdict.CONTACT_NOT_MADE)
PASS = _point(PointVerdict.PASS_FIRST)


def _told_of_points(*records: PointRecord) -> str | None:
    failures = RepeatedFailures()
    for record in records:
        failures.add_point(record)
    return failures.message


@pytest.mark.parametrize(("record", "cause", "cure"), [
    (BLIND, "tip_not_found", "Clean it"), (NO_CONTACT, "contact_not_made", "have in common"),
])  # fmt: skip
def test_points_in_a_row_that_end_for_one_cause_are_told_while_their_run_goes_on(
    record: PointRecord, cause: str, cure: str
) -> None:
    assert _told_of_points(*[record] * (IN_A_ROW - 1)) is None
    said = _told_of_points(*[record] * IN_A_ROW) or ""
    assert said.startswith(f"{IN_A_ROW} points in a row ended by {cause}, the last one TP1: why; ")
    assert cure in said
    assert _told_of_points(*[record] * 100) == said, "it is told once, not at each point that follows"


def test_a_point_that_is_judged_between_ends_the_row_and_the_alert() -> None:
    assert _told_of_points(*[BLIND] * 4, PASS, *[BLIND] * 4) is None
    assert _told_of_points(*[BLIND] * 4, NO_CONTACT, *[BLIND] * 4) is None
    assert _told_of_points(*[BLIND] * 9, PASS) is None
    assert _told_of_points(*[BLIND] * 9, _point(PointVerdict.OPEN_CONFIRMED)) is None


@pytest.mark.parametrize("fault", ["point_forbidden", "touch_budget_spent", "unknown_test_point", None])
def test_a_point_that_was_not_to_be_tested_says_nothing(fault: str | None) -> None:
    assert _told_of_points(*[_point(fault=fault)] * WINDOW) is None
    assert _told_of_points(*[BLIND, _point(fault=fault)] * IN_A_ROW) is not None


def test_what_fails_as_a_job_is_told_before_points() -> None:
    failures = RepeatedFailures()
    for record in [BLIND] * IN_A_ROW:
        failures.add_point(record)
    for result in [FAILED] * REPEATED:
        failures.add(result)
    assert (failures.message or "").startswith("correct failed")
    failures.forget()
    assert failures.message is None


def test_a_person_who_says_that_the_cause_is_gone_begins_anew() -> None:
    failures = RepeatedFailures()
    for _ in range(REPEATED):
        failures.add(FAILED)
    failures.forget()
    failures.add(FAILED)
    assert failures.message is None
