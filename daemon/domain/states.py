"""The state machine of the daemon, whole, as data.

Everything that decides what may follow what stands in `TRANSITIONS`. A pair that is not listed raises
`IllegalTransition` and changes nothing. `Machine` is the only writer of the current state; what a state *does*
lives in the jobs. Calibration, homing and placing walk the same states, so there is no second machine.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum


class State(Enum):
    """What the daemon is doing."""

    IDLE = "idle"
    TRIGGERED = "triggered"
    LOOK = "look"
    MOVE = "move"
    VERIFY = "verify"
    FAULT = "fault"


class Event(Enum):
    """What can happen to it."""

    TRIGGER = "trigger"
    ACCEPTED = "accepted"
    REFUSED = "refused"
    SEEN = "seen"
    ON_TARGET = "on_target"
    ARRIVED = "arrived"
    OFF_TARGET = "off_target"
    CANCELLED = "cancelled"
    FAILED = "failed"
    CLEARED = "cleared"


TRANSITIONS: dict[State, dict[Event, State]] = {
    State.IDLE: {
        Event.TRIGGER: State.TRIGGERED,
        Event.FAILED: State.FAULT,
    },
    State.TRIGGERED: {
        Event.ACCEPTED: State.LOOK,
        Event.REFUSED: State.IDLE,
        Event.CANCELLED: State.IDLE,
        Event.FAILED: State.FAULT,
    },
    State.LOOK: {
        Event.SEEN: State.MOVE,
        Event.ON_TARGET: State.IDLE,
        Event.CANCELLED: State.IDLE,
        Event.FAILED: State.FAULT,
    },
    State.MOVE: {
        Event.ARRIVED: State.VERIFY,
        Event.CANCELLED: State.IDLE,
        Event.FAILED: State.FAULT,
    },
    State.VERIFY: {
        Event.ON_TARGET: State.IDLE,
        Event.OFF_TARGET: State.MOVE,
        Event.CANCELLED: State.IDLE,
        Event.FAILED: State.FAULT,
    },
    State.FAULT: {
        Event.CLEARED: State.IDLE,
    },
}

BUSY = frozenset({State.TRIGGERED, State.LOOK, State.MOVE, State.VERIFY})
"""States in which a job runs; each can be cancelled."""


class IllegalTransition(Exception):
    """Say that an event has no place in a state."""

    def __init__(self, state: State, event: Event) -> None:
        super().__init__(f"{event.value!r} cannot happen in state {state.value!r}")
        self.state = state
        self.event = event


def next_state(state: State, event: Event) -> State:
    """Return the state that follows, or raise `IllegalTransition`."""
    try:
        return TRANSITIONS[state][event]
    except KeyError:
        raise IllegalTransition(state, event) from None


class Machine:
    """Hold the current state; the one place where it is written.

    It begins in `fault`, the most restrictive state: only a station that is known to be homed is let out of it.
    """

    def __init__(self, on_change: Callable[[State, Event, State], None]) -> None:
        self._state = State.FAULT
        self._on_change = on_change

    @property
    def state(self) -> State:
        """The current state."""
        return self._state

    def fire(self, event: Event) -> State:
        """Take one transition and tell the observer; an unlisted pair raises and changes nothing."""
        before = self._state
        after = next_state(before, event)
        self._state = after
        self._on_change(before, event, after)
        return after


def mermaid() -> str:
    """Draw the table as a Mermaid state diagram (the README carries it; a test compares)."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.FAULT.value}"]
    for state, row in TRANSITIONS.items():
        by_target: dict[State, list[str]] = {}
        for event, target in row.items():
            by_target.setdefault(target, []).append(event.value)
        lines += [f"    {state.value} --> {target.value}: {', '.join(names)}" for target, names in by_target.items()]
    return "\n".join(lines)
