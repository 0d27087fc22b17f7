"""Held touch: who holds the needle down, until when, and by what it is lifted.

A job may hold one after the other: a point that the tester calls open is touched again, and it measures again.

It lives from the request's arrival to the job's end. `hold` and `lift` reach it from the control socket at once; the
job waits on it while the needle stands. Times are of the monotonic clock, so that nobody who sets the computer's clock
lengthens a lease.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Literal

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointUnit

EndedBy = Literal["at_once", "hold_ms", "lift", "lease_expired"]


class HeldTouch:
    """One touch, as its holder reaches it."""

    def __init__(
        self,
        job_id: str,
        key: str,
        clock: Callable[[], float] = time.monotonic,
        *,
        judged: bool = False,
        unit: PointUnit | None = None,
    ) -> None:
        """Take whose it is: the name of the client's key; empty where nobody comes with one."""
        self.judged = judged
        """Whether the job goes by the tester's word, so that it has to be one that is known."""
        self.unit = unit
        """In which a value is judged; None: no value is."""
        self._id, self._key, self._clock = job_id, key, clock
        self.made: asyncio.Future[ContactFacts] = asyncio.get_running_loop().create_future()
        """Done when the needle stands, or stands again after a lift; never, if it does not come to that."""
        self._stood: ContactFacts | None = None
        """Set from when the needle stands until the touch is over."""
        self.measured: dict[str, Any] = {}
        """What the tester said with `lift`, until it was closed."""
        self.last_measured: dict[str, Any] = {}
        """What it said of the last press before this one, where a job has several."""
        self._presses = 0
        self._last_press: int | None = None
        self._said: dict[int, dict[str, Any]] = {}
        """What the tester said of each press that is over, by its number."""
        self._lifted = asyncio.Event()
        self._let_go = self._closed = False
        self._lease_until_s = self._hold_until_s = 0.0

    # --- from the job ----------------------------------------------------------------------------------------

    def next_press(self) -> int:
        """Count a press; return its number, by which a `lift` may name it."""
        self._presses += 1
        return self._presses

    def stands(self, contact: ContactFacts, lease_ms: float, hold_ms: float) -> None:
        """Begin to hold: the needle stands."""
        now_s = self._clock()
        self._lease_until_s, self._hold_until_s = now_s + lease_ms / 1e3, now_s + hold_ms / 1e3
        self._stood = contact
        if not self.made.done():
            self.made.set_result(contact)

    async def wait(self, at_most_s: float) -> EndedBy | None:
        """Wait until the needle is to be lifted, and return by what; None if it stays for `at_most_s`."""
        ended = self._ended()
        left_s = min(at_most_s, self._lease_until_s - self._clock(), self._hold_until_s - self._clock())
        if ended is None and left_s > 0.0:
            with suppress(TimeoutError):
                async with asyncio.timeout(left_s):
                    await self._lifted.wait()
            ended = self._ended()
        return ended

    def _ended(self) -> EndedBy | None:
        if self._lifted.is_set():
            return "lift"
        if self._clock() >= self._hold_until_s:
            return "hold_ms"
        return "lease_expired" if self._clock() >= self._lease_until_s else None

    def let_go(self) -> None:
        """Have nobody renew it any more: from here on the needle is lifted, whatever the reason."""
        self._let_go = True

    def close(self) -> dict[str, Any]:
        """Return what the tester said; what it says from here on is not taken."""
        self._closed = True
        return self.measured

    def last_said(self) -> dict[str, Any]:
        """Return for a result what the tester said last, and in which press; of no press where none was made.

        A later press of which it said nothing has no part in that.
        """
        if self._last_press is None:
            return {"measured": None}
        return {"measured": self.last_measured or None, "press": self._last_press}

    def end(self) -> ContactFacts | None:
        """Be over; return what was told of it if the needle stood."""
        stood, self._stood = self._stood, None
        return stood

    # --- from the control socket -----------------------------------------------------------------------------

    @property
    def contact(self) -> ContactFacts | None:
        """What is told of it while the needle stands; None before, and from when it is to be lifted."""
        return None if self._let_go or self._ended() is not None else self._stood

    def renew(self, key: str, lease_ms: float) -> tuple[ContactFacts, float]:
        """Renew the lease; return what stands, and ms until it ends; raise `Fault` if that is not to be."""
        self._require_holder(key)
        contact = self.contact
        if self._stood is not None and self._ended() == "lease_expired":
            raise Fault(FaultCode.LEASE_EXPIRED, id=self._id)
        if contact is None:
            raise Fault(FaultCode.UNKNOWN_JOB, f"the needle is not held down by {self._id!r}"[:200], id=self._id)
        now_s = self._clock()
        self._lease_until_s = now_s + lease_ms / 1e3
        return contact, max(0.0, min(self._lease_until_s, self._hold_until_s) - now_s) * 1e3

    def lift(self, key: str, measured: dict[str, Any], press: int | None = None) -> None:
        """Have the needle lifted, with what the tester measured; raise `Fault` for who does not hold it.

        `press`: in which it was measured, None: the one that stands. A word of any other is refused; one that was kept
        of a press that is over, and is sent again, changes nothing.

        Where it is not down yet, it is lifted as soon as it stands. What was said first counts; whether it was kept the
        result tells.

        Where the job goes by the tester's word, one that comes before the needle stands is of no press, or of the one
        before and sent again: it is not taken, and the needle stays to be measured.
        """
        self._require_holder(key)
        if press is not None and self._is_repeated(press, measured):
            return
        if self.judged and self._stood is not None:
            self._require_said_first(measured)
        if self._stood is not None or not (self.judged and measured):
            if not self.measured and not self._closed:
                self.measured = measured
            self._lifted.set()
        if self.made.done():
            self.made = asyncio.get_running_loop().create_future()

    def again(self) -> None:
        """Be ready for the next press of the same job: what was said of the last one counts no longer."""
        if self._stood is not None:
            self._said[self._stood.press] = self.measured
            if self.measured or not self.last_measured:
                self._last_press = self._stood.press
        self.last_measured = self.measured or self.last_measured
        self.measured, self._stood = {}, None
        self._let_go = self._closed = False
        self._lifted.clear()
        if self.made.done():
            self.made = asyncio.get_running_loop().create_future()

    def _require_said_first(self, measured: dict[str, Any]) -> None:
        """Raise `Fault` for another word than the one that counts of this press, or one that comes after it counted.

        The job may go on with another press, and its answer would not tell that this was not kept.
        """
        late = self._closed or bool(self.measured)
        if measured and late and measured != self.measured:
            raise Fault(FaultCode.VERDICT_NOT_KEPT, id=self._id, kept=self.measured or None)

    def _is_repeated(self, press: int, measured: dict[str, Any]) -> bool:
        """Whether a word of a press that is over was kept already; raise `Fault` if it is of none that stands."""
        if self._stood is not None and press == self._stood.press:
            return False
        if press in self._said and self._said[press] == measured:
            return True
        stands = self._stood.press if self._stood is not None else None
        now = f"the needle stands in press {stands}" if stands else "the needle does not stand"
        why = f"press {press} of {self._id!r} is not the one that is measured: {now}"
        raise Fault(FaultCode.ANOTHER_PRESS, why[:200], id=self._id, press=press, stands=stands)

    def _require_holder(self, key: str) -> None:
        if key != self._key:
            raise Fault(FaultCode.NOT_THE_HOLDER, f"the needle is held down by {self._key!r}", id=self._id)
