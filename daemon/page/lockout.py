"""Lockout of who guesses: wrong tries by name and by address."""

from __future__ import annotations

from collections.abc import Callable


class Lockout:
    """Wrong tries by name and by address: after five, a minute's wait."""

    TRIES, WAIT_S, MOST = 5, 60.0, 10_000

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._wrong: dict[str, tuple[int, float]] = {}
        """Who -> wrong tries, and when the last one was."""

    def wait_s(self, *who: str) -> float:
        """Return how long any of them has to wait yet; 0 if not at all."""
        now = self._clock()
        waits = [at + self.WAIT_S - now for tries, at in map(self._of, who) if tries >= self.TRIES]
        return max(0.0, *waits) if waits else 0.0

    def wrong(self, *who: str) -> None:
        """Count a wrong try; it is counted before the secret is looked at, so that tries at once count each."""
        now = self._clock()
        if len(self._wrong) > self.MOST:
            self._wrong = {one: (n, at) for one, (n, at) in self._wrong.items() if now - at < self.WAIT_S}
        for one in who:
            self._wrong[one] = (self._of(one)[0] + 1, now)

    def right(self, *who: str) -> None:
        """Forget what was wrong before."""
        for one in who:
            self._wrong.pop(one, None)

    def _of(self, one: str) -> tuple[int, float]:
        tries, at = self._wrong.get(one, (0, 0.0))
        return (0, 0.0) if self._clock() - at >= self.WAIT_S else (tries, at)
