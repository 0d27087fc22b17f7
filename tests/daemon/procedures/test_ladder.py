"""The ladder accuses nobody without proof, and keeps the order and the budgets it is given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from daemon.domain.point_test import Cause, PointVerdict, Rung
from daemon.procedures.judging import Judged
from daemon.procedures.ladder import Attempt, Situation, cause_of, is_settled, next_step

ORDER = (Rung.LOOK, Rung.PUMP, Rung.REFERENCE, Rung.SECOND_SITE)
UNPROVED = Attempt(Rung.TOUCH, Judged.OPEN, accuses=False, seen=False)
PROVED = Attempt(Rung.LOOK, Judged.OPEN, accuses=True, seen=True)
GOOD = Attempt(Rung.TOUCH, Judged.PASS, accuses=False, seen=False)


def _at(*attempts: Attempt, **changes: Any) -> Situation:
    whole = Situation(attempts, frozenset(), down=False, touches_left=2, presses_left=7)
    return replace(whole, **changes)


def test_a_pass_at_the_first_touch_is_the_end() -> None:
    assert next_step(_at(GOOD), ORDER) is PointVerdict.PASS_FIRST


def test_a_pass_later_was_recovered() -> None:
    later = replace(GOOD, rung=Rung.PUMP, seen=True)
    assert next_step(_at(UNPROVED, later), ORDER) is PointVerdict.PASS_RECOVERED


@pytest.mark.parametrize("first", [UNPROVED, replace(PROVED, seen=False), replace(UNPROVED, judged=Judged.HIGH)])
def test_what_gave_no_pass_is_looked_at_first(first: Attempt) -> None:
    assert next_step(_at(first), ORDER) is Rung.LOOK


def test_the_rungs_come_in_the_order_that_is_given() -> None:
    spent: set[Rung] = set()
    taken = []
    while isinstance(step := next_step(_at(UNPROVED, spent=frozenset(spent)), reversed_ := ORDER[::-1]), Rung):
        taken.append(step)
        spent.add(step)
    assert tuple(taken) == reversed_
    assert step is PointVerdict.CONTACT_NOT_MADE


def test_a_rung_that_the_order_leaves_out_is_never_taken() -> None:
    assert next_step(_at(UNPROVED, spent=frozenset({Rung.LOOK})), (Rung.LOOK,)) is PointVerdict.CONTACT_NOT_MADE


def test_an_open_is_confirmed_by_two_proved_presses_with_a_needle_known_to_be_good() -> None:
    assert next_step(_at(PROVED, PROVED, reference_good=True), ORDER) is PointVerdict.OPEN_CONFIRMED


def test_the_reference_pad_is_asked_before_an_open_is_confirmed() -> None:
    assert next_step(_at(PROVED, PROVED), ORDER) is Rung.REFERENCE
    asked = _at(PROVED, PROVED, spent=frozenset({Rung.REFERENCE}))
    assert next_step(asked, ORDER) is PointVerdict.CONTACT_NOT_MADE


@pytest.mark.parametrize("judged", [Judged.OPEN, Judged.HIGH])
def test_whoever_is_accused_through_a_channel_that_never_read_is_asked_at_another_point_first(judged: Judged) -> None:
    proved = replace(PROVED, judged=judged)
    now = _at(proved, proved, reference_good=True, path_good=False, touches_left=0, presses_left=0)
    assert next_step(now, ORDER) is Rung.PATH, "it costs this pad nothing, and no order leaves it out"
    assert next_step(replace(now, spent=frozenset({Rung.PATH})), ORDER) is PointVerdict.CONTACT_NOT_MADE
    proved_now = next_step(replace(now, spent=frozenset({Rung.PATH}), path_good=True), ORDER)
    assert proved_now is (PointVerdict.OPEN_CONFIRMED if judged is Judged.OPEN else PointVerdict.FAIL)


def test_without_a_reference_pad_no_open_is_confirmed() -> None:
    assert next_step(_at(PROVED, PROVED), (Rung.LOOK, Rung.PUMP)) is PointVerdict.CONTACT_NOT_MADE


def test_two_points_in_a_row_without_a_pass_ask_the_reference_pad_before_anything_else() -> None:
    assert next_step(_at(UNPROVED, suspected=True), ORDER) is Rung.REFERENCE
    assert next_step(_at(PROVED, PROVED, suspected=True, reference_good=True), ORDER) is Rung.REFERENCE


@pytest.mark.parametrize("judged", [Judged.LOW, Judged.HIGH])
def test_a_value_outside_fails_when_two_proved_presses_say_so(judged: Judged) -> None:
    outside = replace(PROVED, judged=judged)
    assert next_step(_at(outside, outside), ORDER) is PointVerdict.FAIL
    assert next_step(_at(replace(outside, seen=False), outside), ORDER) is Rung.LOOK


def test_a_proved_open_and_a_proved_value_are_no_two_of_a_kind() -> None:
    both = _at(PROVED, replace(PROVED, judged=Judged.HIGH), spent=frozenset(ORDER), reference_good=True)
    assert next_step(both, ORDER) is PointVerdict.CONTACT_NOT_MADE


def _every_situation() -> Iterator[Situation]:
    kinds = [
        Attempt(Rung.PUMP, judged, accuses, seen)
        for judged, accuses, seen in product(Judged, (False, True), (False, True))
    ]
    budgets = ((0, 0), (0, 1), (1, 1))
    for one, other in product(kinds, kinds):
        for down, good, suspected, budget in product((False, True), (False, True), (False, True), budgets):
            yield Situation((one, other), frozenset({Rung.LOOK}), down, *budget, good, suspected)


def test_in_no_situation_is_an_open_or_a_value_accused_without_two_proofs_on_the_pad() -> None:
    for now in _every_situation():
        step = next_step(now, ORDER)
        proofs = [a for a in now.attempts if a.accuses and a.seen]
        if step is PointVerdict.OPEN_CONFIRMED:
            assert [a.judged for a in proofs] == [Judged.OPEN] * 2
            assert now.reference_good
            assert not now.suspected
        if step is PointVerdict.FAIL:
            assert len(proofs) == 2
            assert all(a.judged in (Judged.LOW, Judged.HIGH) for a in proofs)


def test_in_no_situation_is_a_pad_touched_or_pressed_beyond_its_budget() -> None:
    for now in _every_situation():
        step = next_step(now, ORDER)
        if step in (Rung.LOOK, Rung.PUMP, Rung.SECOND_SITE):
            assert now.presses_left > 0
            assert now.touches_left > 0 or (step is Rung.PUMP and now.down)
            assert step not in now.spent


def test_pumping_stops_where_another_push_tells_nothing_more() -> None:
    assert is_settled(_at(UNPROVED, replace(GOOD, rung=Rung.PUMP)))
    assert is_settled(_at(PROVED, PROVED))
    assert not is_settled(_at(UNPROVED, PROVED))
    assert not is_settled(_at(replace(PROVED, seen=False), PROVED))


@pytest.mark.parametrize(
    ("rung", "error_um", "metal_um", "cause"),
    [
        (Rung.LOOK, 300.0, 200.0, Cause.MISPLACED),
        (Rung.LOOK, 60.0, 200.0, Cause.FILM),
        (Rung.LOOK, 300.0, None, Cause.UNKNOWN),
        (Rung.PUMP, 300.0, 200.0, Cause.FILM),
        (Rung.SECOND_SITE, None, 200.0, Cause.FILM),
        (Rung.REFERENCE, None, None, Cause.NEEDLE),
    ],
)
def test_what_cured_a_point_tells_what_it_had(
    rung: Rung, error_um: float | None, metal_um: float | None, cause: Cause
) -> None:
    assert cause_of(rung, error_um, metal_um) is cause
