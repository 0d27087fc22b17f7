"""Repeated failures: one operation that fails again and again in the same way, known before anything was learned. Pure.

So do points of a run, one after the other, while their job goes on as if nothing were the matter.

The watches compare with what is usual, and need to have seen it. This asks for nothing but the last few endings.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final

from daemon.domain.errors import FaultCode
from daemon.domain.point_test import PointRecord, PointVerdict
from daemon.domain.results import ErrorBody, JobResult

WINDOW: Final = 10
"""So many endings of one operation are remembered."""
REPEATED: Final = 3
"""Failures of one kind among them that stand as an alert: one may be the pad's, two a pad that was asked for twice.

As many have to go well in a row of an operation of single points, for they differ; of any other one.
"""
IN_A_ROW: Final = 5
"""Points one after the other of which none could be judged, for one cause; as many without contact stop a run."""
LOOK_AT: Final = "look at the needle, and at what these points have in common: `reprobe points` lists them"
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
        self._points = _PointsInARow()

    def add(self, result: JobResult) -> None:
        """Take in how a job ended; one that says nothing about the station is left out."""
        error = result.error
        if error is not None and (error.code < 2000 or error.name in _NOT_COUNTED):  # 1xxx: the request
            return
        if result.test_point is not None:
            self._of_points.add(result.op)
        self._endings.setdefault(result.op, deque(maxlen=WINDOW)).append(error)

    def add_point(self, record: PointRecord) -> None:
        """Take in what came of a point, of a run or alone."""
        self._points.add(record)

    def forget(self) -> None:
        """Begin anew: a person says that the cause is gone."""
        self._endings.clear()
        self._points = _PointsInARow()

    @property
    def message(self) -> str | None:
        """Say which operation fails how, and what to do: the one that fails most often; else what points do."""
        found = [(failed, op) for op in self._endings if (failed := self._failed(op))]
        if not found:
            return self._points.message
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


class _PointsInARow:
    """How many points one after the other could not be judged for one cause; any other ending of a point ends it."""

    def __init__(self) -> None:
        self._cause, self._times = "", 0
        self.message: str | None = None
        """Of the point with which they were enough: it stays the same while more follow, and is told once."""

    def add(self, record: PointRecord) -> None:
        """Take a point in; one that says nothing about the station is left out."""
        kind = FaultCode.__members__.get((record.fault or "").upper())  # one of a newer program is not known
        if kind is not None and (kind in CALLERS_OWN or kind.code < 2000):
            return
        if record.verdict is PointVerdict.NOT_TESTED and kind is None:  # the tester said nothing
            return
        judged = kind is None and record.verdict is not PointVerdict.CONTACT_NOT_MADE
        cause = "" if judged else record.fault or record.verdict.value
        self._times = self._times + 1 if cause == self._cause else 1
        self._cause = cause
        if not cause or self._times < IN_A_ROW:
            self.message = None
        elif self._times == IN_A_ROW:
            advice = kind.value.advice if kind is not None else LOOK_AT
            last = f"{record.point}: {record.reason}"
            self.message = f"{IN_A_ROW} points in a row ended by {cause}, the last one {last}; {advice}"
