"""Judgement of what was read in one press: within limits or not, and whether that can be held against the net. Pure.

Contact resistance adds to every resistance. So a value that is too high is the net's own only where it is too high
without what lies between the needle and the pad, which the needle's second wire tells (two-wire Kelvin contact check).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from daemon.config.sections.touching import LadderSection
from daemon.domain.point_test import UNIT_OF_METHOD, Limits, PointTest, PointUnit
from daemon.station.needle_health import Tare

READINGS = 3
"""So many have to agree before they count."""
FLOOR: dict[PointUnit, float] = {"ohm": 0.05, "V": 0.005, "F": 2e-12}
"""Readings that differ by no more than this agree, however small they are."""
ALONG_NET = frozenset({"continuity", "resistance", "fres"})
"""Methods that measure from the needle along the net to its own pin of the harness."""
WITHOUT_CURRENT = frozenset({"voltage", "capacitance"})
"""Methods that read something even where the needle stands on nothing."""


class Judged(Enum):
    """What a press' reading is."""

    PASS = "pass"  # noqa: S105  # a word, no password
    LOW = "low"
    HIGH = "high"
    OPEN = "open"
    UNSTEADY = "unsteady"
    UNPROVED = "unproved"
    """A pass that would be read as well with the needle on nothing, on a neighbour, or with no channel closed."""


INNOCENT = frozenset({Judged.PASS, Judged.UNSTEADY, Judged.UNPROVED})
"""What speaks against no net."""


@dataclass(frozen=True)
class Taken:
    """What was read in one press. `value` is None where nothing was read, or an overload."""

    value: float | None
    overload: bool
    unit: PointUnit | None
    below: bool = False
    """An overload below zero."""
    steady: bool = True
    contact_ohm: float | None = None
    """Between the needle's two wires; infinite: none flows. None: nobody asked, or nothing can tell."""
    said: str | None = None
    """The tester's own word, where it measured."""
    tare: Tare | None = None
    """What was taken off the value for leads and needle; None: nothing was."""
    doubt: str = ""
    """Why it speaks neither for nor against the net, in words: what read it, or its wiring, is not to be believed."""
    joined: str = ""
    """That a net beside the point would be read through the same channel, in words: only the eye tells which it was."""


def limits_of(test: PointTest, ladder: LadderSection) -> Limits | None:
    """Return the limits in force; where a test gives none, those of contact and continuity are the configuration's."""
    if test.limits is not None:
        return test.limits
    default = {"contact": ladder.proof_max_ohm, "continuity": ladder.continuity_max_ohm}.get(test.method)
    return None if default is None else Limits(high=default, unit="ohm")


def proved(taken: Taken, ladder: LadderSection) -> bool | None:
    """Return whether contact was proved in this press; None where nobody asked, or nothing can tell."""
    return None if taken.contact_ohm is None else taken.contact_ohm <= ladder.proof_max_ohm


def judge(taken: Taken, test: PointTest, ladder: LadderSection) -> Judged:
    """Return what a reading is, as it stands."""
    if taken.said is not None and taken.value is None:
        return {"pass": Judged.PASS, "fail": Judged.HIGH}.get(taken.said, Judged.OPEN)
    limits = limits_of(test, ladder)
    if not taken.steady:
        return Judged.UNSTEADY
    if taken.overload:
        return _judge_overload(taken, test, limits)
    if taken.value is None:
        return Judged.PASS if test.method == "insert" else Judged.UNSTEADY
    if limits is None or limits.holds(taken.value):
        return Judged.HIGH if taken.said == "fail" else Judged.PASS  # what contradicts itself is no pass
    return Judged.LOW if limits.low is not None and taken.value < limits.low else Judged.HIGH


def _judge_overload(taken: Taken, test: PointTest, limits: Limits | None) -> Judged:
    """Return what it means that an instrument can tell no value: along a net that no current flows, else no open.

    A capacitance is one where a current flows past it, as through a short.
    """
    if test.method == "capacitance":
        return Judged.HIGH
    if taken.below and limits is not None:
        return Judged.PASS if limits.low is None else Judged.LOW
    if limits is not None and limits.high is None:
        return Judged.PASS
    return Judged.HIGH if test.method in {"voltage", "diode"} else Judged.OPEN


def any_pad_passes(test: PointTest) -> bool:
    """Whether a pad of another net would pass as well: where no current along the own net is what is asked for."""
    return test.method in ALONG_NET and test.limits is not None and test.limits.high is None


def needs_proof(taken: Taken, test: PointTest, judged: Judged) -> bool:
    """Whether contact is to be proved before a judgement counts."""
    return test.method != "contact" if judged is not Judged.PASS else _passes_without_contact(taken, test)


def believed(taken: Taken, test: PointTest, ladder: LadderSection) -> Judged:
    """Return what a reading is, where a pass that no contact would give as well is one only with contact proved."""
    judged = judge(taken, test, ladder)
    if judged is Judged.PASS and (taken.doubt or (_passes_without_contact(taken, test) and not proved(taken, ladder))):
        return Judged.UNPROVED
    return judged


def _passes_without_contact(taken: Taken, test: PointTest) -> bool:
    """Whether a pass may have been read with the needle on nothing; a tester's own word is its own business."""
    if taken.value is None:
        return taken.overload
    return test.method in WITHOUT_CURRENT and (test.limits is None or test.limits.holds(0.0))


def accuses(taken: Taken, test: PointTest, ladder: LadderSection, judged: Judged) -> bool:
    """Whether a press speaks against the net, and not against pad or needle."""
    contact_ohm = taken.contact_ohm
    limits = limits_of(test, ladder)
    if taken.doubt:
        return False
    if judged is Judged.LOW and UNIT_OF_METHOD[test.method] == "ohm" and taken.said is None:
        # A current flows, and contact resistance can only add; but a tare may have been read through a bad contact.
        return (
            taken.value is not None and limits is not None and limits.low is not None and _untared(taken) < limits.low
        )
    if not proved(taken, ladder) or contact_ohm is None or judged in INNOCENT:
        return False
    if judged is Judged.HIGH and taken.unit == "ohm" and taken.value is not None and limits and limits.high is not None:
        return taken.value - contact_ohm > limits.high
    return True


def _untared(taken: Taken) -> float:
    """Return a value with what was taken off it: it is too high then, and never too low."""
    return (taken.value or 0.0) + (taken.tare.ohm if taken.tare is not None else 0.0)


def agree(values: Sequence[float], share: float, floor: float) -> bool:
    """Whether readings agree; overloads do among themselves."""
    finite = [value for value in values if abs(value) != float("inf")]
    if len(finite) < len(values):
        return not finite
    return max(values) - min(values) <= max(floor, share * max(abs(value) for value in values))
