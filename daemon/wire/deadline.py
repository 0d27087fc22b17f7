"""The deadline of a request, as a time of the monotonic clock."""

from __future__ import annotations

import time

from daemon.domain.errors import Fault, FaultCode

ABSOLUTE_DEADLINE_FROM_MS = 10**11
"""Deadlines from here on are Unix time; smaller ones are a budget that starts when the request arrives."""


def due_at_s(deadline_ms: float | None, default_s: float) -> float:
    """Turn a request's deadline into a monotonic time; raise `Fault` if it has passed already."""
    now_s = time.monotonic()
    if deadline_ms is None:
        return now_s + default_s
    left_ms = deadline_ms - time.time() * 1e3 if deadline_ms >= ABSOLUTE_DEADLINE_FROM_MS else deadline_ms
    if left_ms <= 0:
        raise Fault(FaultCode.STALE_DEADLINE, f"the deadline passed {-left_ms:.0f} ms ago", late_ms=round(-left_ms, 1))
    return now_s + left_ms / 1e3
