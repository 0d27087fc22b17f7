"""Head angle by which a place is reached: the one asked for, else the present one, else any that the axes allow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

from daemon.jobs.context import StationContext
from drivers.errors import EnvelopeViolation
from drivers.gantry import Position

ANGLES_DEG = (0.0, 45.0, 90.0, 180.0, 225.0, 270.0, 315.0)
"""Tried in this order; the band of the wiring lies between the third and the fourth."""


TURNS_DEG = (180.0, 90.0, 270.0)
"""By which the head is turned for another view, the farthest first."""


def reachable(
    context: StationContext, over: Callable[[float], Position], here: Position, wanted_deg: float | None = None
) -> Position:
    """Return the position of the head that puts the tip over a place; the present angle costs no turn.

    Raises `EnvelopeViolation`, of the angle tried first, where none reaches it.
    """
    angles = (wanted_deg,) if wanted_deg is not None else (here.theta_deg % 360.0, *ANGLES_DEG)
    return first_within(context, over, angles)


def other_views(context: StationContext, over: Callable[[float], Position], here: Position) -> Iterator[Position]:
    """Yield the positions from which a place may be looked at otherwise."""
    for turn_deg in TURNS_DEG:
        with suppress(EnvelopeViolation):
            yield first_within(context, over, ((here.theta_deg + turn_deg) % 360.0,))


def first_within(context: StationContext, over: Callable[[float], Position], angles: Sequence[float]) -> Position:
    """Return the position at the first of some angles that is within reach; raise `EnvelopeViolation` of the first."""
    first: EnvelopeViolation | None = None
    for angle in angles:
        target = over(angle)
        try:
            context.station.check(target)
        except EnvelopeViolation as outside:
            first = first or outside
        else:
            return target
    if first is None:
        raise ValueError("no angle was tried")
    raise first
