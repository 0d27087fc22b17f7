"""Result of a search without an answer: a falsy value with a reason."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal


class Reason(StrEnum):
    """Say why a search has no answer. The strings are stable: journals and messages carry them."""

    # The image itself
    TOO_DARK = "too_dark"
    SATURATED = "saturated"
    BLURRED = "blurred"
    OUT_OF_FRAME = "out_of_frame"
    # The probe
    NO_NEEDLE = "no_needle"
    WRONG_NEEDLE = "wrong_needle"
    NO_MARKING = "no_marking"
    BENT = "bent"
    # The pads
    NO_TEST_POINT = "no_test_point"
    AMBIGUOUS = "ambiguous"
    UNDECIDED = "undecided"
    # The control point
    NO_CONTROL_POINT = "no_control_point"


@dataclass(frozen=True, slots=True)
class NotFound:
    """Carry the reason a search ended without an answer; false in a condition.

    `message` is a whole sentence for a process engineer: the measured fact and what to do about it.
    """

    reason: Reason
    message: str

    def __bool__(self) -> Literal[False]:
        """Return False, so that `if not tip:` reads as it should."""
        return False
