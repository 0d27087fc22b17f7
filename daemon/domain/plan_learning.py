"""Limits of a plan learned from runs on boards that are known to be good.

The rule, for each test: the middle is the median of what the runs read there in their last press, the scatter 1.4826
times the median distance from it (the standard deviation where values are normal, and not moved by one odd board). The
limits lie `SCATTERS` scatters from the middle, and at least so far as the share and the floor below say: few boards do
not show how much boards differ. A continuity has no lower limit. What a person has not approved is not used.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from daemon.domain.plan import Plan
from daemon.domain.point_test import UNIT_OF_METHOD, Limits, PointRecord, PointTest, PointUnit, PointVerdict

SCATTERS = 6.0
SHARE, SHARE_OF_FEW, MANY = 0.10, 0.25, 5
"""Of the middle at least, from so many values on; with fewer, the larger share."""
FLOOR: Mapping[PointUnit, float] = {"ohm": 0.5, "V": 0.05, "F": 5e-12}
"""At least, whatever the middle: contact, leads and thermal voltages."""
PASSED = frozenset({PointVerdict.PASS_FIRST, PointVerdict.PASS_RECOVERED})
NOT_LEARNED = frozenset({"contact", "insert"})


@dataclass(frozen=True)
class Learned:
    """A plan with learned limits, and the tests for which nothing could be learned, with why."""

    plan: Plan
    left_out: Mapping[str, str]


def learn(name: str, base: Plan, runs: Mapping[str, Sequence[PointRecord]]) -> Learned:
    """Return the tests of `base` with limits learned from runs, id -> records; ValueError where nothing is left."""
    values: dict[tuple[str, str], list[float]] = {}
    for records in runs.values():
        for record in records:
            if record.verdict in PASSED and record.last_value is not None:
                values.setdefault((record.point, record.method), []).append(record.last_value)
    tests: list[PointTest] = []
    left_out: dict[str, str] = {}
    for test in base.tests:
        unit, found = UNIT_OF_METHOD[test.method], values.get((test.point, test.method), [])
        if test.method in NOT_LEARNED or unit is None:
            tests.append(test)
        elif not found:
            left_out[test.point] = "no run gave a value there that passed"
        else:
            tests.append(test.model_copy(update={"limits": limits_of(found, unit, both=test.method != "continuity")}))
    if not tests:
        raise ValueError("no run gave a value that passed, at any point")
    learned = base.model_copy(update={"name": name, "tests": tuple(tests), "learned_from": tuple(runs)})
    return Learned(Plan.model_validate(learned.model_dump()), left_out)


def limits_of(values: Iterable[float], unit: PointUnit, *, both: bool) -> Limits:
    """Return the limits that values of good boards give, by the rule of this module."""
    listed = list(values)
    middle = statistics.median(listed)
    scatter = 1.4826 * statistics.median(abs(value - middle) for value in listed)
    share = SHARE if len(listed) >= MANY else SHARE_OF_FEW
    away = max(SCATTERS * scatter, share * abs(middle), FLOOR[unit])
    return Limits(low=_rounded(middle - away) if both else None, high=_rounded(middle + away), unit=unit)


def _rounded(value: float) -> float:
    """Return a value to four digits, which is what people compare."""
    return float(f"{value:.4g}")
