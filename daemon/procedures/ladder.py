"""Ladder of a probe: what is tried next at a point that gave no pass, or the verdict. Pure; its order is data.

No press follows an open before the eye has seen the pad's metal below the tip, and nobody is accused by a press in
which contact was not proved: a point whose contact was never proved is called that, for pad or needle may be to blame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from daemon.domain.point_test import Cause, PointVerdict, Rung
from daemon.procedures.judging import Judged

TWICE = 2
"""Presses that have to agree before somebody is accused."""


@dataclass(frozen=True)
class Attempt:
    """One press and what was read in it."""

    rung: Rung
    judged: Judged
    accuses: bool
    """Contact was proved in this press, and what was read cannot be the contact's own."""
    seen: bool
    """A look has shown that it stood on the pad's own metal."""
    doubted: bool = False
    """What was read is not to be believed, for a reason that lies neither in the pad nor in the needle."""
    passes_seen: bool = False
    """It is a pass as soon as the eye vouches for where it stood."""

    def vouched_for(self) -> Attempt:
        """Return it as one that stood on the pad's own metal."""
        return replace(self, seen=True, judged=Judged.PASS if self.passes_seen else self.judged)


@dataclass(frozen=True)
class Situation:
    """What is known of a point after a press."""

    attempts: tuple[Attempt, ...]
    spent: frozenset[Rung]
    """Rungs that were taken, or cannot be here."""
    down: bool
    """The needle stands where a look has shown the pad."""
    touches_left: int
    """Descents onto the pad that its budget still has."""
    presses_left: int
    reference_good: bool = False
    """The needle was good on the reference pad just before."""
    suspected: bool = False
    """The point before gave no pass either, and the needle has not been on the reference pad since."""
    path_good: bool = True
    """By what was read is known to read: else the harness may be open, and not the net."""


def next_step(now: Situation, order: Sequence[Rung]) -> Rung | PointVerdict:
    """Return the rung to take, or the verdict; `order`: of the rungs after the first touch."""
    first, last = now.attempts[0], now.attempts[-1]
    if last.judged is Judged.PASS:
        return PointVerdict.PASS_FIRST if last is first else PointVerdict.PASS_RECOVERED
    if _twice(now, Judged.LOW) or _twice(now, Judged.HIGH):
        return PointVerdict.FAIL if now.path_good else _ask_path(now)
    if _twice(now, Judged.OPEN):
        return _accused(now, order)
    if _is_doubted(now):
        return PointVerdict.CONTACT_NOT_MADE
    return next((rung for rung in _ordered(now, order) if _may(now, rung)), PointVerdict.CONTACT_NOT_MADE)


def is_settled(now: Situation) -> bool:
    """Whether another press in the same place can tell nothing more."""
    accused = any(_twice(now, judged) for judged in (Judged.LOW, Judged.HIGH, Judged.OPEN))
    return now.attempts[-1].judged is Judged.PASS or accused or _is_doubted(now)


def _twice(now: Situation, judged: Judged) -> bool:
    return sum(one.accuses and one.seen and one.judged is judged for one in now.attempts) >= TWICE


def _is_doubted(now: Situation) -> bool:
    """Whether more presses cannot settle it: instrument or wiring contradict what is read."""
    return sum(one.doubted for one in now.attempts) >= TWICE


def _accused(now: Situation, order: Sequence[Rung]) -> Rung | PointVerdict:
    """Return what follows two proved opens: needle and harness have to be known to be good."""
    if now.reference_good and not now.suspected:
        return PointVerdict.OPEN_CONFIRMED if now.path_good else _ask_path(now)
    return Rung.REFERENCE if Rung.REFERENCE in order and _may(now, Rung.REFERENCE) else PointVerdict.CONTACT_NOT_MADE


def _ask_path(now: Situation) -> Rung | PointVerdict:
    """Return what follows a proof against a net whose channel was never seen to read; it costs this pad nothing."""
    return PointVerdict.CONTACT_NOT_MADE if Rung.PATH in now.spent else Rung.PATH


def _ordered(now: Situation, order: Sequence[Rung]) -> Sequence[Rung]:
    """Return the order; where the needle is under suspicion, it is asked first."""
    if now.suspected and Rung.REFERENCE in order:
        return [Rung.REFERENCE, *(rung for rung in order if rung is not Rung.REFERENCE)]
    return order


def _may(now: Situation, rung: Rung) -> bool:
    """Whether a rung is left, and the pad's budget allows what it does to the pad."""
    if rung in now.spent:
        return False
    if rung is Rung.REFERENCE or (rung is Rung.LOOK and now.attempts[-1].passes_seen):
        return True
    return now.presses_left > 0 and (now.touches_left > 0 or (rung is Rung.PUMP and now.down))


def cause_of(recovered_by: Rung, error_um: float | None, metal_um: float | None) -> Cause:
    """Return why the first touch gave no pass, by what cured it.

    `error_um`: how far the first look saw the tip off; `metal_um`: so far it may be off and still stand on the metal.
    """
    if recovered_by is Rung.REFERENCE:
        return Cause.NEEDLE
    if recovered_by is Rung.LOOK:
        if error_um is None or metal_um is None:
            return Cause.UNKNOWN
        return Cause.MISPLACED if error_um > metal_um else Cause.FILM
    return Cause.FILM
