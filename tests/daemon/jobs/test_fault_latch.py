"""The owner of fault, state and lifecycle: who may leave a fault, and what stays whatever is cleared."""

from __future__ import annotations

import pytest

from daemon.domain.errors import REFERENCE_LOST, Fault, FaultCode
from daemon.domain.states import Event, IllegalTransition, Lifecycle, State
from daemon.jobs.fault_latch import AXES, FaultLatch, StateChange

LINK, ESTOP, DISK = (Fault(kind) for kind in (FaultCode.LINK_LOST, FaultCode.EMERGENCY_STOP, FaultCode.JOURNAL_FAILED))
NOT_HOMED = Fault(FaultCode.NOT_HOMED)


def _idle() -> FaultLatch:
    latch = FaultLatch()
    latch.opened()
    return latch


def _in(*faults: Fault) -> FaultLatch:
    latch = _idle()
    for fault in faults:
        latch.latch(fault)
    return latch


def test_it_begins_in_fault_and_opening_and_without_a_fault_it_is_idle_once_opened() -> None:
    latch = FaultLatch()
    assert (latch.state, latch.lifecycle, latch.fault) == (State.FAULT, Lifecycle.OPENING, None)
    latch.clear(())
    assert latch.state is State.FAULT, "nothing is known of the devices yet"
    latch.opened()
    assert (latch.state, latch.lifecycle) == (State.IDLE, Lifecycle.READY)


def test_opened_with_a_fault_it_stays_in_fault() -> None:
    latch = FaultLatch()
    latch.latch(LINK)
    latch.opened()
    assert (latch.state, latch.fault, latch.lifecycle) == (State.FAULT, LINK, Lifecycle.READY)


def test_closing_is_not_undone() -> None:
    latch = FaultLatch()
    latch.closing()
    latch.opened()
    assert latch.lifecycle is Lifecycle.CLOSING


def test_the_first_cause_is_kept_first_and_of_one_kind_the_first() -> None:
    latch = _in(LINK, ESTOP, Fault(FaultCode.LINK_LOST, "again"))
    assert latch.causes == (LINK, ESTOP)
    assert latch.fault is LINK


def test_only_the_faults_that_were_taken_are_cleared() -> None:
    latch = _in(LINK)
    taken = latch.causes
    latch.latch(DISK)
    latch.clear(taken)
    assert (latch.causes, latch.state) == ((DISK,), State.FAULT)
    latch.clear(latch.causes)
    assert (latch.fault, latch.state) == (None, State.IDLE)


def test_a_fault_latched_again_after_it_was_taken_is_another_one() -> None:
    latch = _in(LINK)
    taken = latch.causes
    latch.clear(taken)
    again = Fault(FaultCode.LINK_LOST)
    latch.latch(again)
    latch.clear(taken)
    assert latch.causes == (again,)


def test_what_is_found_by_a_reset_stands_before_what_was_latched() -> None:
    latch = _in(ESTOP)
    light = Fault(FaultCode.LIGHT_FAILED)
    latch.put_first(light)
    assert latch.causes == (light, ESTOP)
    newer = Fault(FaultCode.LIGHT_FAILED, "still")
    latch.put_first(newer)
    assert latch.causes == (newer, ESTOP)


def test_what_is_found_on_an_idle_station_puts_it_in_fault() -> None:
    latch = _idle()
    latch.put_first(LINK)
    assert latch.state is State.FAULT
    other = _idle()
    other.replace((), NOT_HOMED)
    assert (other.state, other.causes) == (State.FAULT, (NOT_HOMED,))


def test_a_fault_found_instead_of_those_taken_leaves_the_later_ones() -> None:
    latch = _in(LINK, ESTOP)
    taken = latch.causes
    latch.latch(DISK)
    latch.replace(taken, NOT_HOMED)
    assert latch.causes == (NOT_HOMED, DISK)


@pytest.mark.parametrize("kind", list(FaultCode))
def test_all_axes_are_in_doubt_after_the_faults_that_lose_the_reference(kind: FaultCode) -> None:
    expected = frozenset(AXES) if kind in REFERENCE_LOST else frozenset()
    for latch, way in ((_idle(), "latch"), (_idle(), "put_first")):
        getattr(latch, way)(Fault(kind))
        assert latch.doubtful == expected
        assert latch.doubt_changed.is_set() is bool(expected)
    replaced = _idle()
    replaced.replace((), Fault(kind))
    assert replaced.doubtful == expected


def test_a_cleared_fault_leaves_the_doubt_and_each_axis_is_settled_by_itself() -> None:
    latch = _in(ESTOP)
    latch.clear(latch.causes)
    assert latch.doubtful == frozenset(AXES)
    latch.settle("x")
    assert latch.doubtful == frozenset(AXES) - {"x"}


def test_homing_alone_may_begin_in_not_homed_and_nothing_else() -> None:
    latch = _in(NOT_HOMED)
    assert latch.against("home") is None
    assert latch.against("place") is NOT_HOMED
    latch.latch(DISK)
    assert latch.against("home") is DISK, "homing does not cure a full disk"
    assert latch.against("place") is NOT_HOMED
    assert _idle().against("place") is None


def test_homing_that_comes_to_its_end_settles_every_axis() -> None:
    latch = _in(ESTOP)
    latch.replace(latch.causes, NOT_HOMED)
    latch.begin("home", "h1")
    assert (latch.state, latch.running, latch.fault) == (State.TRIGGERED, ("home", "h1"), None)
    for event in (Event.DEPARTED, Event.ARRIVED):
        latch.fire(event)
    latch.end(Event.ON_TARGET)
    assert (latch.state, latch.fault, latch.running) == (State.IDLE, None, None)
    assert latch.doubtful == frozenset()


@pytest.mark.parametrize("event", [Event.CANCELLED, Event.FAILED])
def test_homing_that_ends_early_leaves_what_it_was_to_cure(event: Event) -> None:
    latch = _in(ESTOP)
    latch.replace(latch.causes, NOT_HOMED)
    latch.begin("home", "h1")
    latch.fire(Event.DEPARTED)
    latch.end(event)
    assert (latch.state, latch.causes) == (State.FAULT, (NOT_HOMED,))
    assert latch.doubtful == frozenset(AXES)


def test_homing_that_ends_in_another_fault_names_that_first() -> None:
    latch = _in(NOT_HOMED)
    latch.begin("home", "h1")
    latch.fire(Event.DEPARTED)
    latch.end(Event.FAILED, ESTOP)
    assert latch.causes == (ESTOP, NOT_HOMED)


def test_a_fault_that_is_not_latched_clears_itself_with_the_job() -> None:
    latch = _idle()
    latch.begin("look", "l1")
    latch.fire(Event.ACCEPTED)
    told: list[StateChange] = []
    latch.subscribe(told.append)
    unseen = Fault(FaultCode.TIP_NOT_FOUND)
    latch.end(Event.FAILED, passing=unseen)
    assert (latch.state, latch.fault) == (State.IDLE, None)
    assert [(change.after, change.fault) for change in told] == [(State.FAULT, unseen), (State.IDLE, None)]


def test_a_job_that_never_began_changes_nothing() -> None:
    latch = _in(LINK)
    latch.end(Event.FAILED)
    assert (latch.state, latch.causes) == (State.FAULT, (LINK,))


def test_a_job_of_another_kind_does_not_leave_a_fault() -> None:
    latch = _in(LINK)
    with pytest.raises(IllegalTransition):
        latch.begin("place", "p1")
    assert (latch.state, latch.causes, latch.running) == (State.FAULT, (LINK,), None)


def test_every_transition_is_told_with_its_job_and_its_fault() -> None:
    told: list[StateChange] = []
    latch = _idle()
    latch.subscribe(told.append)
    latch.begin("place", "p1")
    latch.fire(Event.DEPARTED)
    latch.end(Event.FAILED, LINK)
    assert [(c.before, c.event, c.after, c.job) for c in told] == [
        (State.IDLE, Event.TRIGGER, State.TRIGGERED, "p1"),
        (State.TRIGGERED, Event.DEPARTED, State.MOVE, "p1"),
        (State.MOVE, Event.FAILED, State.FAULT, "p1"),
    ]
    assert told[-1].fault is LINK, "why it is in fault comes with the news that it is"
    latch.clear(latch.causes)
    assert told[-1].after is State.IDLE
    assert told[-1].job is None


def test_a_job_that_ends_where_it_may_not_leaves_a_fault_and_nothing_that_runs() -> None:
    latch = FaultLatch()
    latch.opened()
    latch.begin("place", "p1")
    latch.fire(Event.ACCEPTED)
    latch.fire(Event.SEEN)
    with pytest.raises(IllegalTransition):
        latch.end(Event.ON_TARGET)  # a body that forgot to verify
    assert (latch.state, latch.running) == (State.FAULT, None)
    assert latch.fault is not None
    assert latch.fault.kind is FaultCode.INTERNAL
