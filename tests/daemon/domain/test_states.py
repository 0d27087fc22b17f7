"""The state table, walked whole."""

from itertools import product
from pathlib import Path

import pytest

from daemon.domain.states import BUSY, TRANSITIONS, Event, IllegalTransition, Machine, State, mermaid, next_state


def _way_to(state: State) -> list[Event]:
    """Return events that lead from the first state to this one."""
    ways: dict[State, list[Event]] = {State.FAULT: []}
    while state not in ways:
        known = [(way, row) for at, way in ways.items() for row in TRANSITIONS[at].items()]
        ways |= {target: [*way, event] for way, (event, target) in known if target not in ways}
    return ways[state]


@pytest.mark.parametrize(("state", "event"), list(product(State, Event)))
def test_every_pair_is_listed_or_raises_and_changes_nothing(state: State, event: Event) -> None:
    changes: list[State] = []
    machine = Machine(lambda _before, _event, after: changes.append(after))
    for step in _way_to(state):
        machine.fire(step)
    changes.clear()
    if event in TRANSITIONS[state]:
        assert machine.fire(event) is TRANSITIONS[state][event] is next_state(state, event)
        assert changes == [machine.state]
    else:
        with pytest.raises(IllegalTransition):
            machine.fire(event)
        assert machine.state is state
        assert changes == []


def test_the_daemon_starts_in_fault() -> None:
    assert Machine(lambda *_: None).state is State.FAULT


def test_failed_leads_to_fault_from_every_other_state() -> None:
    assert all(TRANSITIONS[s][Event.FAILED] is State.FAULT for s in State if s is not State.FAULT)


def test_every_busy_state_can_be_cancelled_to_idle() -> None:
    assert {s for s in State if TRANSITIONS[s].get(Event.CANCELLED) is State.IDLE} == set(BUSY)


def test_without_cleared_nothing_moves() -> None:
    """From the first state, with `cleared` taken away, `move` cannot be reached."""
    reached, todo = set(), [State.FAULT]
    while todo:
        state = todo.pop()
        reached.add(state)
        todo += [t for e, t in TRANSITIONS[state].items() if e is not Event.CLEARED and t not in reached]
    assert State.MOVE not in reached


def test_the_readme_shows_this_very_table() -> None:
    readme = Path(__file__).parents[3] / "README.md"
    assert mermaid() in readme.read_text()
