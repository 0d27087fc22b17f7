"""Verdict on a verdict, by the truth log alone: whether it is so, and why a first touch failed."""

from __future__ import annotations

from collections.abc import Sequence

from daemon.domain.point_test import PASSES, PointVerdict
from daemon.tools.demo.true_place import same_net
from daemon.tools.demo.truth_log import Stroke

GOOD_OHM = 1.0
"""A contact whose film and debris have less is as good as none between."""


def wrong_verdict(verdict: str, net: str, strokes: Sequence[Stroke], *, sound: bool) -> str | None:
    """Return what is wrong with a verdict, or None. `strokes`: on the board, for this point, in their order.

    `net`: as the truth spells it; `sound`: whether the pad reaches its net's pin of the harness.
    """
    if verdict == PointVerdict.OPEN_CONFIRMED and sound:
        return "open_confirmed on a sound net"
    if verdict not in PASSES:
        return None
    if not strokes:
        return "pass without a touch"
    if not on_net(net, strokes[-1]):
        return f"pass through {'/'.join(strokes[-1].nets) or strokes[-1].material}"
    return None if sound else "pass on a broken net"


def first_open(net: str, strokes: Sequence[Stroke], *, sound: bool) -> str | None:
    """Return why a sound net could not be measured at the first stroke: off its pad, film or debris; None: it could."""
    if not strokes or not sound:
        return None
    if not on_net(net, strokes[0]):
        return "misplaced"
    return None if strokes[0].soil_ohm <= GOOD_OHM else "soiled"


def on_net(net: str, stroke: Stroke) -> bool:
    """Whether a stroke met metal of a net."""
    return any(same_net(found, net) for found in stroke.nets)
