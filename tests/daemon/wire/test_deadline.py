"""Deadlines of requests."""

import time

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.wire.deadline import due_at_s

CLOCKS_APART_S = 0.05
"""The wall's clock may be corrected between two looks at it."""


def _budget_s(deadline_ms: float | None) -> tuple[float, float]:
    """Return the least and the most that a deadline may have left, by the clock before and after it was read."""
    before_s = time.monotonic()
    due_s = due_at_s(deadline_ms, 60.0)
    return due_s - time.monotonic(), due_s - before_s


def test_a_small_deadline_is_a_budget() -> None:
    least_s, most_s = _budget_s(500.0)
    assert least_s <= 0.5 <= most_s


def test_a_large_deadline_is_unix_time() -> None:
    before_s, unix_s = time.monotonic(), time.time()
    due_s = due_at_s((unix_s + 3.0) * 1e3, 60.0)
    assert due_s == pytest.approx(before_s + 3.0, abs=time.monotonic() - before_s + CLOCKS_APART_S)


def test_no_deadline_is_the_default() -> None:
    least_s, most_s = _budget_s(None)
    assert least_s <= 60.0 <= most_s


@pytest.mark.parametrize("deadline_ms", [0.0, -5.0, (time.time() - 1.0) * 1e3])
def test_a_stale_deadline_is_refused(deadline_ms: float) -> None:
    with pytest.raises(Fault) as caught:
        due_at_s(deadline_ms, 60.0)
    assert caught.value.kind is FaultCode.STALE_DEADLINE
