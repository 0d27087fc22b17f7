"""A held touch: lease, renewal, whose it is, and by what it ends; on a clock of the test's own."""

from __future__ import annotations

import asyncio

import pytest

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.held_touch import HeldTouch
from daemon.wire.example_parts import CONTACT
from tests.daemon.clock import Clock

FACTS = ContactFacts(**CONTACT)
MINE, OTHERS = "tester-1", "tester-2"


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
async def held(clock: Clock) -> HeldTouch:
    touch = HeldTouch("t", MINE, clock)
    touch.stands(FACTS, lease_ms=2000.0, hold_ms=10_000.0)
    return touch


async def test_it_stays_while_nothing_ends_it(held: HeldTouch, clock: Clock) -> None:
    clock.now_s += 1.99
    assert await held.wait(0.0) is None
    assert held.contact == held.made.result() == FACTS


async def test_without_a_renewal_its_lease_ends(held: HeldTouch, clock: Clock) -> None:
    clock.now_s += 2.0
    assert await held.wait(60.0) == "lease_expired"


async def test_a_renewal_counts_from_when_it_comes(held: HeldTouch, clock: Clock) -> None:
    clock.now_s += 1.5
    assert held.renew(MINE, 3000.0) == (FACTS, pytest.approx(3000.0))
    clock.now_s += 2.9
    assert await held.wait(0.0) is None
    clock.now_s += 0.2
    assert await held.wait(60.0) == "lease_expired"


async def test_no_renewal_brings_back_what_is_over(held: HeldTouch, clock: Clock) -> None:
    clock.now_s += 2.5
    with pytest.raises(Fault) as late:
        held.renew(MINE, 2000.0)
    assert late.value.kind is FaultCode.LEASE_EXPIRED
    assert await held.wait(60.0) == "lease_expired"


async def test_no_lease_is_longer_than_the_hold(held: HeldTouch, clock: Clock) -> None:
    clock.now_s += 1.0
    assert held.renew(MINE, 30_000.0)[1] == pytest.approx(9000.0)
    clock.now_s += 9.0
    assert await held.wait(60.0) == "hold_ms"


async def test_what_is_being_lifted_is_not_held_again(held: HeldTouch, clock: Clock) -> None:
    held.let_go()
    with pytest.raises(Fault) as lifting:
        held.renew(MINE, 2000.0)
    assert lifting.value.kind is FaultCode.UNKNOWN_JOB
    over = HeldTouch("t", MINE, clock)
    over.stands(FACTS, lease_ms=2000.0, hold_ms=500.0)
    clock.now_s += 0.6
    with pytest.raises(Fault) as ended:
        over.renew(MINE, 2000.0)
    assert ended.value.kind is FaultCode.UNKNOWN_JOB


@pytest.mark.parametrize("way", ["let_go", "lift", "lease", "hold"])
async def test_nobody_is_told_that_it_stands_once_it_is_to_be_lifted(held: HeldTouch, clock: Clock, way: str) -> None:
    if way == "let_go":
        held.let_go()
    elif way == "lift":
        held.lift(MINE, {})
    else:
        held.renew(MINE, 2000.0 if way == "lease" else 60_000.0)
        clock.now_s += 2.0 if way == "lease" else 10.0
    assert held.contact is None
    assert held.end() == FACTS, "that it stood is known"


async def test_a_lift_wakes_who_waits_and_brings_what_was_measured(held: HeldTouch) -> None:
    waiting = asyncio.create_task(held.wait(60.0))
    await asyncio.sleep(0)
    held.lift(MINE, {"verdict": "pass"})
    held.lift(MINE, {"verdict": "open"})
    assert await waiting == "lift"
    assert held.measured == {"verdict": "pass"}, "what was said first counts"
    with pytest.raises(Fault) as over:
        held.renew(MINE, 2000.0)
    assert over.value.kind is FaultCode.UNKNOWN_JOB


async def test_who_lifts_first_and_then_says_what_was_measured_is_heard(held: HeldTouch) -> None:
    held.lift(MINE, {})
    held.lift(MINE, {"verdict": "pass"})
    assert held.close() == {"verdict": "pass"}


async def test_what_comes_after_the_close_is_not_taken(held: HeldTouch) -> None:
    assert held.close() == {}
    held.lift(MINE, {"verdict": "pass"})
    assert held.measured == held.close() == {}
    assert await held.wait(60.0) == "lift"


async def test_a_stranger_neither_holds_nor_lifts(held: HeldTouch) -> None:
    with pytest.raises(Fault) as kept:
        held.renew(OTHERS, 2000.0)
    with pytest.raises(Fault) as lifted:
        held.lift(OTHERS, {})
    assert {kept.value.kind, lifted.value.kind} == {FaultCode.NOT_THE_HOLDER}
    assert await held.wait(0.0) is None


async def test_before_it_stands_it_cannot_be_held_but_a_lift_waits_for_it(clock: Clock) -> None:
    touch = HeldTouch("t", MINE, clock)
    with pytest.raises(Fault) as early:
        touch.renew(MINE, 2000.0)
    assert early.value.kind is FaultCode.UNKNOWN_JOB
    touch.lift(MINE, {})
    touch.stands(FACTS, 2000.0, 10_000.0)
    assert await touch.wait(60.0) == "lift"


async def test_after_its_end_nothing_is_told_of_it(held: HeldTouch) -> None:
    assert held.end() == FACTS
    assert held.contact is None
    assert held.end() is None


async def test_what_is_measured_before_the_needle_stands_counts_for_no_press(clock: Clock) -> None:
    touch = HeldTouch("t", MINE, clock, judged=True)
    touch.lift(MINE, {"verdict": "pass"})
    touch.stands(FACTS, 2000.0, 10_000.0)
    assert await touch.wait(0.0) is None, "it is still to be measured"
    touch.lift(MINE, {"verdict": "open"})
    assert await touch.wait(60.0) == "lift"
    assert touch.close() == {"verdict": "open"}


async def test_who_only_wants_the_needle_up_before_it_stands_is_heard(clock: Clock) -> None:
    touch = HeldTouch("t", MINE, clock, judged=True)
    touch.lift(MINE, {})
    touch.stands(FACTS, 2000.0, 10_000.0)
    assert await touch.wait(60.0) == "lift"


async def test_who_speaks_after_the_end_is_not_told_that_it_stands(clock: Clock) -> None:
    touch = HeldTouch("t", MINE, clock, judged=True)
    touch.stands(FACTS, 2000.0, 10_000.0)
    touch.end()
    touch.lift(MINE, {"verdict": "pass"})
    assert not touch.made.done()


@pytest.fixture
async def second(clock: Clock) -> HeldTouch:
    """Return a probe's hold in its second press; of the first one `open` was said."""
    touch = HeldTouch("t", MINE, clock, judged=True)
    for number in (1, 2):
        press = touch.next_press()
        assert press == number
        touch.stands(FACTS.model_copy(update={"press": press}), 2000.0, 10_000.0)
        if press == 1:
            touch.lift(MINE, {"verdict": "open"}, 1)
            touch.close()
            touch.again()
    return touch


@pytest.mark.parametrize("said", [{"verdict": "pass"}, {}])
@pytest.mark.parametrize("press", [1, 3])
async def test_what_is_said_of_another_press_is_refused_and_the_needle_stays(
    second: HeldTouch, press: int, said: dict[str, str]
) -> None:
    with pytest.raises(Fault) as refused:
        second.lift(MINE, said, press)
    assert refused.value.kind is FaultCode.ANOTHER_PRESS
    assert (refused.value.detail["press"], refused.value.detail["stands"]) == (press, 2)
    assert await second.wait(0.0) is None
    second.lift(MINE, {"verdict": "pass"}, 2)
    assert await second.wait(60.0) == "lift"
    assert second.close() == {"verdict": "pass"}


async def test_what_was_kept_of_a_press_and_is_sent_again_lifts_nothing(second: HeldTouch) -> None:
    second.lift(MINE, {"verdict": "open"}, 1)
    assert await second.wait(0.0) is None
    assert second.made.result().press == 2, "it is answered as before: the needle stands again"


async def test_between_two_presses_what_names_the_one_that_is_over_is_refused(second: HeldTouch) -> None:
    second.lift(MINE, {"verdict": "open"}, 2)
    second.again()
    with pytest.raises(Fault) as refused:
        second.lift(MINE, {"verdict": "pass"}, 2)
    assert refused.value.kind is FaultCode.ANOTHER_PRESS
    assert second.last_said() == {"measured": {"verdict": "open"}, "press": 2}


@pytest.mark.parametrize("closed", [False, True])
async def test_another_word_of_the_same_press_is_refused_where_the_job_may_go_on_by_the_first(
    second: HeldTouch, closed: bool
) -> None:
    second.lift(MINE, {"verdict": "open"})
    if closed:
        second.close()
    second.lift(MINE, {"verdict": "open"}, 2)
    second.lift(MINE, {}, 2)
    for press in (None, 2):
        with pytest.raises(Fault) as refused:
            second.lift(MINE, {"verdict": "pass"}, press)
        assert refused.value.kind is FaultCode.VERDICT_NOT_KEPT
        assert refused.value.detail["kept"] == {"verdict": "open"}


async def test_a_press_of_which_nothing_was_said_has_not_the_word_of_the_one_before(second: HeldTouch) -> None:
    second.lift(MINE, {}, 2)
    second.again()
    assert second.last_said() == {"measured": {"verdict": "open"}, "press": 1}


async def test_where_no_press_had_a_word_the_last_one_is_told(clock: Clock) -> None:
    touch = HeldTouch("t", MINE, clock, judged=True)
    assert touch.last_said() == {"measured": None}
    for _ in (1, 2):
        touch.stands(FACTS.model_copy(update={"press": touch.next_press()}), 2000.0, 10_000.0)
        touch.again()
    assert touch.last_said() == {"measured": None, "press": 2}
