"""Repeated failures: one operation that fails again and again in the same way, known before anything was learned. Pure.

The watches compare with what is usual, and need to have seen it. This asks for nothing but the last few endings.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final

from daemon.domain.errors import FaultCode
from daemon.domain.results import ErrorBody, JobResult

WINDOW: Final = 10
"""So many endings of one operation are remembered."""
REPEATED: Final = 3
"""Failures of one kind among them that stand as an alert: one may be the pad's, two a pad that was asked for twice.

As many have to go well in a row of an operation of single points, for they differ; of any other one.
"""
CALLERS_OWN: Final = frozenset(
    {
        FaultCode.OUTSIDE_ENVELOPE,
        FaultCode.IN_FAULT,
        FaultCode.NEEDLE_DOWN,
        FaultCode.TOUCH_BUDGET_SPENT,
        FaultCode.POINT_FORBIDDEN,
        FaultCode.LEASE_EXPIRED,
        FaultCode.LOOK_NEEDED,
        FaultCode.ANOTHER_PRESS,
        FaultCode.INTERRUPTED,
        FaultCode.JOURNAL_FAILED,
    }
)
"""What was asked for wrongly, and what is told by an alert or a fault of its own; besides all of 1xxx, the request."""
_NOT_COUNTED: Final = frozenset(kind.wire_name for kind in CALLERS_OWN)


class RepeatedFailures:
    """The last endings of each operation. `add` takes one in; `message` is what is wrong now, None for nothing."""

    def __init__(self) -> None:
        self._endings: dict[str, deque[ErrorBody | None]] = {}
        self._of_points: set[str] = set()

    def add(self, result: JobResult) -> None:
        """Take in how a job ended; one that says nothing about the station is left out."""
        error = result.error
        if error is not None and (error.code < 2000 or error.name in _NOT_COUNTED):  # 1xxx: the request
            return
        if result.test_point is not None:
            self._of_points.add(result.op)
        self._endings.setdefault(result.op, deque(maxlen=WINDOW)).append(error)

    def forget(self) -> None:
        """Begin anew: a person says that the cause is gone."""
        self._endings.clear()

    @property
    def message(self) -> str | None:
        """Say which operation fails how, and what to do: the one that fails most often."""
        found = [(failed, op) for op in self._endings if (failed := self._failed(op))]
        if not found:
            return None
        (error, times), op = max(found, key=lambda one: (one[0][1], one[1]))
        of = len(self._endings[op])
        return f"{op} failed {times} times of its last {of} by {error.name}: {error.message}; {error.advice}"

    def _failed(self, op: str) -> tuple[ErrorBody, int] | None:
        """Return the newest error of a kind that repeats, and how often it was; None if none does, or it is over."""
        endings = self._endings[op]
        counted = Counter(error.name for error in endings if error is not None)
        newest = next((one for one in reversed(endings) if one is not None and counted[one.name] >= REPEATED), None)
        if newest is None:
            return None
        well = next(n for n, error in enumerate(reversed(endings)) if error is not None)
        if well >= (REPEATED if op in self._of_points else 1):
            return None
        return newest, counted[newest.name]
