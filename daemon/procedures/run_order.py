"""Way of a run: at which head angle each point is tested, and in which order."""

from __future__ import annotations

from collections.abc import Iterable

from daemon.domain.board_run import RunPlace
from daemon.domain.plan import Plan
from daemon.jobs.context import StationContext
from daemon.procedures.head_angle import reachable
from daemon.station.shortest_order import shortest_order
from daemon.station.travel_time import TravelTimes
from drivers.errors import EnvelopeViolation
from drivers.gantry import Position


def places_of(context: StationContext, plan: Plan, here: Position) -> list[tuple[RunPlace, Position]]:
    """Return where each test of a plan is made, and the head's position there.

    A point that no angle reaches has none; the head is then taken to stay where it is. 5000 points take a second of the
    processor: not for the event loop.
    """
    return [_place(context, test.point, test.theta_deg, here) for test in plan.tests]


def _place(context: StationContext, name: str, wanted_deg: float | None, here: Position) -> tuple[RunPlace, Position]:
    at_um = context.board.point(name).place_um
    try:
        target = reachable(context, lambda theta: context.geometry.position_over(at_um, theta), here, wanted_deg)
    except EnvelopeViolation:
        return RunPlace(x_um=at_um[0], y_um=at_um[1], theta_deg=wanted_deg), here
    theta_deg = wanted_deg if wanted_deg is not None else target.theta_deg % 360.0
    return RunPlace(x_um=at_um[0], y_um=at_um[1], theta_deg=theta_deg), target


def order_of(context: StationContext, positions: Iterable[Position], here: Position, *, short: bool) -> list[int]:
    """Return the numbers of the positions in the order of the way that begins here; not for the event loop."""
    listed = list(positions)
    if not short:
        return list(range(len(listed)))
    times = TravelTimes(context.config, [here, *listed], context.station.approach)
    return [place - 1 for place in shortest_order(times, range(1, len(listed) + 1), 0)]
