"""Rate limit of each client: a bucket of tokens, filled steadily, emptied by requests."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from daemon.domain.errors import Fault, FaultCode

BUCKETS = 1024
"""So many clients are remembered; of more, those that have been quiet longest start with a full bucket."""


class RateLimit:
    """Count requests by client. A request costs one token; `per_s` come back each second, `burst` can be saved up."""

    def __init__(self, per_s: float, burst: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._per_s, self._burst, self._now_s = per_s, burst, now_s
        self._buckets: dict[str, tuple[float, float]] = {}

    @property
    def remembered(self) -> int:
        """How many clients are remembered; `BUCKETS` at most."""
        return len(self._buckets)

    def spend(self, client: str) -> None:
        """Take one token; raise `Fault` with `retry_after_ms` if there is none."""
        now_s = self._now_s()
        tokens, since_s = self._buckets.pop(client, (self._burst, now_s))
        tokens = min(self._burst, tokens + (now_s - since_s) * self._per_s)
        enough = tokens >= 1.0
        # Put at the end: the dictionary's order is that of the last request.
        self._buckets[client] = (tokens - 1.0 if enough else tokens, now_s)
        if len(self._buckets) > BUCKETS:
            del self._buckets[next(iter(self._buckets))]
        if not enough:
            wait_ms = math.ceil((1.0 - tokens) / self._per_s * 1e3)
            raise Fault(
                FaultCode.RATE_LIMITED, f"more than {self._per_s:g} requests a second", retry_after_ms=wait_ms,
                limit_per_s=self._per_s, burst=self._burst,
            )  # fmt: skip
