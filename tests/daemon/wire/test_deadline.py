"""Deadlines of requests."""

import time

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.wire.deadline import due_at_s


def test_a_small_deadline_is_a_budget() -> None:
    assert due_at_s(500.0, 60.0) - time.monotonic() == pytest.approx(0.5, abs=0.2)


def test_a_large_deadline_is_unix_time() -> None:
    assert due_at_s((time.time() + 3.0) * 1e3, 60.0) - time.monotonic() == pytest.approx(3.0, abs=0.2)


def test_no_deadline_is_the_default() -> None:
    assert due_at_s(None, 60.0) - time.monotonic() == pytest.approx(60.0, abs=0.2)


@pytest.mark.parametrize("deadline_ms", [0.0, -5.0, (time.time() - 1.0) * 1e3])
def test_a_stale_deadline_is_refused(deadline_ms: float) -> None:
    with pytest.raises(Fault) as caught:
        due_at_s(deadline_ms, 60.0)
    assert caught.value.kind is FaultCode.STALE_DEADLINE
