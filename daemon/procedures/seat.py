"""The seat: looks at places that are found once on the board settle which board lies there, which side up, and how.

No single look can tell a corner from its like on the other side, or a pitch off in a long row. Places whose
surroundings are nowhere else can, and three of them give the pose and the scale as well: this is the alignment.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from daemon.domain.board import BoardPoint, SeatPlace
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import StationContext
from daemon.procedures.aiming import require_tip
from daemon.procedures.height import require_free
from daemon.procedures.look_numbers import describe
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.procedures.point_faults import CONTRADICTED
from daemon.procedures.registered import board_search, look_by_cad
from daemon.procedures.registration_faults import board_away, refusal_fault
from daemon.procedures.seat_decides import shows_place
from daemon.storage.calibration_records import Seat, SeatLook
from drivers.errors import EnvelopeViolation
from drivers.gantry import Position
from vision.geometry import Array, PoseMap, require_span
from vision.registration import UNIQUE_SCORE, LayerFit, NotRegistered, Refusal, Registration, median_shifts

LEAST_PLACES, MOST_PLACES = 3, 4
LEAST_UNIQUE = 2
MOST_TRIES = 2
"""So many places may fail (dirt, a label, a part that CAD does not know) before the alignment does."""
ANOTHER_MAY_DO = frozenset(
    {FaultCode.AMBIGUOUS, FaultCode.NOT_THIS_BOARD, FaultCode.TARGET_NOT_CONFIRMED, FaultCode.TIP_NOT_FOUND}
)
"""What one poor view may say by mistake where a place that is found once has been seen on this side already."""
FROM_ASIDE = frozenset({FaultCode.TIP_NOT_FOUND, FaultCode.TARGET_NOT_CONFIRMED})
"""What another ground behind the needle, or another view of the place, may cure."""
MOST_NEAR, MOST_STOPS = 3, 5
"""From so many stops a place is looked at, and from so many a tip that the ground hides: the body of a part as grey as
the needle is not left by half a millimetre."""
ASIDE_UM = (
    (0.0, 0.0), (500.0, 400.0), (-500.0, -400.0), (1500.0, 0.0), (-1500.0, 0.0), (0.0, 1500.0), (0.0, -1500.0),
    (2500.0, 2000.0), (-2500.0, -2000.0), (2500.0, -2000.0), (-2500.0, 2000.0),
)  # fmt: skip
SAME_PLACE_UM = 60.0
"""So near a place is found again from another head angle; `align` asks as much of each."""
NAME = "seat"
Placed = TypeVar("Placed", SeatPlace, BoardPoint)


@dataclass
class SeatViews:
    """What was seen of the seat: by place, where it is in the robot frame from each angle; and each look's numbers."""

    views: dict[str, list[Array]] = field(default_factory=dict)
    looks: list[SeatLook] = field(default_factory=list)
    layers: list[tuple[str, LayerFit]] = field(default_factory=list)
    """By the place's name: what was told of the layers' shifts."""

    def seat(self) -> Seat:
        """Return the seat as the record keeps it."""
        unique = {look.name for look in self.looks if look.rival <= UNIQUE_SCORE}
        shifts = median_shifts([fit for _, fit in self.layers])
        return Seat(
            ink_um=_rounded(shifts.ink_um),
            openings_um=_rounded(shifts.openings_um),
            verified=len(unique) >= LEAST_UNIQUE,
            places=len(self.views),
            agreement=min(look.agreement for look in self.looks),
            looks=tuple(self.looks),
        )

    def leave_out(self, name: str) -> None:
        """Forget a place that was not seen from each angle: half of it would pull the fit aside."""
        self.views.pop(name, None)
        self.looks = [look for look in self.looks if look.name != name]
        self.layers = [(place, fit) for place, fit in self.layers if place != name]


def _rounded(shift_um: tuple[float, float]) -> tuple[float, float]:
    """To 0.1 um."""
    return round(shift_um[0], 1), round(shift_um[1], 1)


async def seat_points(context: StationContext, thetas_deg: tuple[float, ...]) -> list[BoardPoint]:
    """Return the places to look at, in the order in which they are to be tried: unique, in reach, far apart.

    Raises `Fault` where the board has too few of them.
    """
    places = await context.references.seat()
    unique = [p for p in places if p.rival <= UNIQUE_SCORE]
    near = [p for p in unique if all(_in_reach(context, p, theta) for theta in thetas_deg)]
    if len(near) < LEAST_PLACES:
        raise Fault(
            FaultCode.INVALID_REQUEST,
            f"of board {context.board.name} ({context.board.side}) {len(unique)} places are found once, and "
            f"{len(near)} of them are in the camera's reach; {LEAST_PLACES} are needed",
            advice="name three or more targets far apart as `fiducials`",
        )
    return [
        BoardPoint(name=f"{NAME} {n}", kind="site", x_um=p.x_um, y_um=p.y_um, why_not="a place to look at")
        for n, p in enumerate(_spread(near), start=1)
    ]


def _spread(places: list[Placed]) -> list[Placed]:
    """Return the most unique place, then always the one farthest from those before it."""
    order, rest = places[:1], places[1:]
    while rest:
        farthest = max(rest, key=lambda p: min(math.dist((p.x_um, p.y_um), (q.x_um, q.y_um)) for q in order))
        order.append(farthest)
        rest.remove(farthest)
    return order


def _in_reach(context: StationContext, place: SeatPlace, theta_deg: float) -> bool:
    r, stop = context.servo.max_placement_um, seat_stop(context, (place.x_um, place.y_um), theta_deg)
    return _reached(context, shifted(stop, -r, -r)) and _reached(context, shifted(stop, r, r))


def _reached(context: StationContext, stop: Position) -> bool:
    try:
        context.station.check(stop)
    except EnvelopeViolation:
        return False
    return True


def seat_stop(context: StationContext, place_um: tuple[float, float], theta_deg: float) -> Position:
    """Return where to look from: where the configuration has the place, for the board may be another one.

    So its height is not known either, and the needle stays free of any.
    """
    over = context.geometry.position_at(context.geometry.nominal_um(place_um), theta_deg)
    return replace(over, z_um=max(context.gantry.work_z_um, context.gantry.free_z_um))


async def see_seat(
    sequence: MoveSequence, points: list[BoardPoint], thetas_deg: tuple[float, ...], pose_map: PoseMap, *, named: bool
) -> SeatViews:
    """Look at the places from each angle. `named`: the client chose targets, and all of them must be seen.

    Raises `Fault` with the reason for which a place was not seen, by name.
    """
    seen, context, tries = SeatViews(), sequence.context, 0
    wanted = len(points) if named else MOST_PLACES
    points = points if named else await asyncio.to_thread(_clear_ones_first, context, points, thetas_deg)
    accepted: list[BoardPoint] = []
    for point in points:
        if len(accepted) == wanted:
            break
        unseen = await _look(sequence, seen, point, thetas_deg[0], pose_map, named=named)
        if unseen is not None:
            tries += 1
            left = len(points) - points.index(point) - 1
            another = ANOTHER_MAY_DO | CONTRADICTED if accepted else ANOTHER_MAY_DO
            if named or unseen.kind not in another or tries > MOST_TRIES or len(accepted) + left < LEAST_PLACES:
                raise unseen
        else:
            accepted.append(point)
            sequence.job.progress(len(accepted), wanted * len(thetas_deg), f"looking at {point.name}")
    spare = 0 if named else min(MOST_TRIES - tries, len(accepted) - LEAST_PLACES)
    await _see_turned(sequence, seen, accepted, thetas_deg[1:], pose_map, named=named, spare=spare)
    for point in accepted:
        rival = await context.references.how_unique(point.place_um, alone=not named)
        seen.looks = [
            replace_rival(look, rival.rival_score) if look.name == point.name else look for look in seen.looks
        ]
    return seen


async def _see_turned(
    sequence: MoveSequence,
    seen: SeatViews,
    accepted: list[BoardPoint],
    thetas_deg: tuple[float, ...],
    pose_map: PoseMap,
    *,
    named: bool,
    spare: int,
) -> None:
    """Look at the accepted places from the other angles; so many may be left out that are not known there.

    A part's side that leans into the view hides a place, or makes it look like another board: the others know better.
    """
    for theta_deg in thetas_deg:
        for point in tuple(accepted):
            unseen = await _look(sequence, seen, point, theta_deg, pose_map, named=named)
            if unseen is not None:
                spare -= 1
                rest = [one for one in accepted if one is not point]
                if spare < 0 or unseen.kind not in ANOTHER_MAY_DO | CONTRADICTED or not _span(rest):
                    raise unseen
                accepted.remove(point)
                seen.leave_out(point.name)
            sequence.job.progress(len(seen.looks), len(accepted) * (1 + len(thetas_deg)), f"looking at {point.name}")


def replace_rival(look: SeatLook, rival: float) -> SeatLook:
    """Return a look with how near another place comes to being taken for it."""
    return look.model_copy(update={"rival": round(rival, 3)})


async def _look(
    sequence: MoveSequence, seen: SeatViews, point: BoardPoint, theta_deg: float, pose_map: PoseMap, *, named: bool
) -> Fault | None:
    """Look at one place, from beside where needed, and note where it is; return why it was not seen.

    A move that is refused is raised: from no other place will it be allowed.
    """
    unseen: Fault | None = None
    for tried, there in enumerate(_stops(sequence.context, point, theta_deg)):
        if tried >= MOST_NEAR and unseen is not None and unseen.kind is not FaultCode.TIP_NOT_FOUND:
            break
        position = await sequence.go(there)
        try:
            found = await _look_from(sequence, seen, point, position, pose_map, named=named)
            seen.looks.append(_numbers(point, theta_deg, found))
            return None
        except Fault as fault:
            unseen = fault
            if fault.kind not in FROM_ASIDE:
                break
    return unseen


def _clear_ones_first(
    context: StationContext, points: list[BoardPoint], thetas_deg: tuple[float, ...]
) -> list[BoardPoint]:
    """Return the places, last those that are looked at from above a part alone, if the first ones do without them."""

    def parts_all_over(point: BoardPoint) -> bool:
        return any(_part_below(context, _stops(context, point, theta_deg)[0]) for theta_deg in thetas_deg)

    clear = [point for point in points if not parts_all_over(point)]
    first = _spread(clear)
    if len(clear) < MOST_PLACES or not _span(first[:MOST_PLACES]):
        return points
    return first + [point for point in points if point not in clear]


def _span(points: list[BoardPoint]) -> bool:
    """Whether the board's place and turn can be told from these."""
    try:
        require_span(np.array([point.place_um for point in points]), SAME_PLACE_UM)
    except ValueError:
        return False
    return True


def _stops(context: StationContext, point: BoardPoint, theta_deg: float) -> list[Position]:
    """Return where to look at a place from: where no part stands below the needle; anywhere, if one does everywhere."""
    over = seat_stop(context, point.place_um, theta_deg)
    reached = [there for there in (shifted(over, *by_um) for by_um in ASIDE_UM) if _reached(context, there)]
    clear = [there for there in reached if not _part_below(context, there)]
    if clear:
        # The farthest before what lies between: a body that hides the tip from near hides it from there too
        return [*clear[:MOST_NEAR], *reversed(clear[MOST_NEAR:])][:MOST_STOPS]
    return reached[:MOST_NEAR]


def _part_below(context: StationContext, stop: Position) -> bool:
    """Whether a part of the board file may stand below the needle: it comes down lower than many parts are high."""
    at_um = context.config.board.pose().inverse().apply(context.geometry.tip_um(stop))
    reach_um = context.servo.max_placement_um
    return bool(context.references.sides.obstacles.covers_near(at_um - reach_um, at_um + reach_um))


async def _look_from(
    sequence: MoveSequence, seen: SeatViews, point: BoardPoint, position: Position, pose_map: PoseMap, *, named: bool
) -> Registration:
    job, context = sequence.job, sequence.context
    search = await board_search(context, position, point, pose_map, alone=not named, measure_layers=True)
    look = await look_by_cad(job, context, position, context.calibrations.require_probe(), search)
    job.note("look", describe(look, None, None) | {"seat_place": point.name})
    tip = require_tip(look)
    await require_free(job, context, pose_map, sequence.go)

    def place_um(target_px: tuple[float, float]) -> Array:
        from_tip = pose_map.from_tip_um(
            target_px, (tip.x_px, tip.y_px), position.theta_deg, height_um=search.view.height_um
        )
        return np.add(context.geometry.tip_um(position), from_tip)

    found = look.board.found if look.board is not None else None
    if isinstance(found, NotRegistered):
        counts = _as_seen_before(found, seen.views.get(point.name, []), place_um)
        if counts is not None:
            job.note("look", {"seat_place": point.name, "counts_by": "another angle", "refused": str(found.reason)})
            found = counts
    if found is None or isinstance(found, NotRegistered):
        raise _unseen(found, point, context)
    if math.hypot(*found.shift_um) > context.servo.max_placement_um:
        raise board_away(point, found.shift_um, "where it should")
    seen.views.setdefault(point.name, []).append(place_um(found.target_px))
    if look.board is not None and look.board.layers is not None:
        seen.layers.append((point.name, look.board.layers))
    return found


def _as_seen_before(
    refused: NotRegistered, before_um: list[Array], place_um: Callable[[tuple[float, float]], Array]
) -> Registration | None:
    """Return what a view too poor to say which board this is shows, if a full one had it there from another angle."""
    best = refused.best
    if best is None or not before_um or refused.reason is not Refusal.NOT_THIS_BOARD or not shows_place(best):
        return None
    return best if math.dist(place_um(best.target_px), before_um[0]) <= SAME_PLACE_UM else None


def _unseen(found: NotRegistered | None, point: BoardPoint, context: StationContext) -> Fault:
    if found is None:
        return Fault(FaultCode.NOT_THIS_BOARD, f"{point.name}: the pad was not looked for in the red picture")
    return refusal_fault(found, point, context.board)


def _numbers(point: BoardPoint, theta_deg: float, found: Registration) -> SeatLook:
    return SeatLook(
        name=point.name,
        board_um=point.place_um,
        theta_deg=theta_deg,
        agreement=round(found.agreement, 3),
        log_odds=round(found.log_odds, 1),
        turn_deg=round(found.turn_deg, 4),
        rival=1.0,
    )
