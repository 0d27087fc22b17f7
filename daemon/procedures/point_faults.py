"""Faults of one point: what may be wrong with it and need not be with the next one, so that a verdict says it."""

from __future__ import annotations

from daemon.domain.errors import FaultCode

SAID_BY_A_VERDICT = frozenset(
    {
        FaultCode.UNKNOWN_TEST_POINT, FaultCode.OUTSIDE_ENVELOPE, FaultCode.SURFACE_UNKNOWN,
        FaultCode.TOUCH_BUDGET_SPENT, FaultCode.POINT_FORBIDDEN,
        FaultCode.TIP_NOT_FOUND, FaultCode.TEST_POINT_NOT_FOUND, FaultCode.UNDECIDED,
        FaultCode.AMBIGUOUS, FaultCode.FRAME_UNUSABLE, FaultCode.TARGET_NOT_CONFIRMED, FaultCode.DISAGREE,
        FaultCode.NOT_CONVERGING, FaultCode.CORRECTION_TOO_LARGE,
    }
)  # fmt: skip
"""What one point may have and the next one need not."""
CONTRADICTED = frozenset({FaultCode.WRONG_SIDE, FaultCode.BOARD_TURNED})
"""The board lies otherwise: believed of two looks, from different sides or at two points in a row."""
SURE_LOOKS = 2
"""From different sides, with none between that shows the board as it should lie: it lies otherwise."""
BOARD_UNSEEN = frozenset({FaultCode.WRONG_PLACE, FaultCode.NO_BOARD, FaultCode.NOT_THIS_BOARD}) | CONTRADICTED
"""What one look may say by mistake where a way ended astray; at two points in a row it is the board."""
