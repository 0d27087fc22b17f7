"""The state machine of the daemon, as data, and its lifecycle.

Everything that decides what may follow what stands in `TRANSITIONS`. A pair that is not listed raises
`IllegalTransition` and changes nothing. `Machine` is the only writer of the current state; what a state *does*
lives in the procedures. Calibration, homing and placing walk the same states, so there is no second machine.

The state says what the station works at; the lifecycle says whether the daemon is up. They are two things: a daemon
that opens its devices is in `fault` because nothing is known yet, and one that closes may still be in `idle`.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum


class State(Enum):
    """What the station works at."""

    IDLE = "idle"
    """No job runs, and nothing speaks against the next one."""
    TRIGGERED = "triggered"
    """A job has begun; what speaks against it is checked, nothing has moved."""
    LOOK = "look"
    """Frames are taken and searched where the head is; nothing moves."""
    MOVE = "move"
    """The head moves, or is about to."""
    VERIFY = "verify"
    """The head has arrived; frames or drives are asked whether it is where it should be."""
    FAULT = "fault"
    """Something speaks against any work: a latched fault, or that the devices are still being opened."""


class Lifecycle(Enum):
    """Whether the daemon is up."""

    OPENING = "opening"
    """The devices are being opened for the first time; jobs wait."""
    READY = "ready"
    """The devices were asked once: what is wrong is known as a fault, and jobs are run or refused."""
    CLOSING = "closing"
    """The daemon was told to end: new jobs are refused."""


class Event(Enum):
    """What can happen to it. A job that moves without a look before, as homing does, has `departed`."""

    TRIGGER = "trigger"
    ACCEPTED = "accepted"
    DEPARTED = "departed"
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
        Event.DEPARTED: State.MOVE,
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
