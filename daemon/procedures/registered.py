"""Registered looks: the board's CAD laid on the red picture, and what may be believed of it.

The name of a pad comes with the place: the whole neighbourhood is registered, no pad stands for itself. What is known
beforehand only breaks a tie that the picture left, and only on a seat that was verified.
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.registration_faults import board_away, refusal_fault
from daemon.procedures.seat_decides import decide_by_seat
from daemon.procedures.seat_state import limit_um, require_unique, seat_shifts, verified, void_seat
from daemon.procedures.sites import looks_known, target_of
from daemon.station.board_view import BoardSearch, BoardSeen, HeadView
from daemon.station.station import LookResult
from drivers.gantry import Position
from vision import ProbeModel
from vision.geometry import PoseMap
from vision.registration import NotRegistered, Refusal, Registration, Target

SAME_PLACE_UM = 120.0
"""From one look of a job to the next the board stays within this, five sigma of the stops' scatter."""
ANOTHER_BELOW = 0.4
WITNESS_UM, WITNESS_SIGMAS = 25.0, 3.0


@dataclass(frozen=True)
class Registered:
    """A target that was found by registration; as a pad that was seen for itself, and what it was found by."""

    x_px: float
    y_px: float
    sigma_px: float
    kind: str
    rule: str
    found: Registration


async def board_search(
    context: StationContext,
    position: Position,
    point: BoardPoint,
    pose_map: PoseMap,
    last: Registration | None = None,
    *,
    alone: bool = False,
    measure_layers: bool = False,
) -> BoardSearch:
    """Return what to register for a look at `point` from `position`; `alone`: the board, whatever became of the pad."""
    height_um = context.geometry.height_below_um(position)
    reference = await context.references.about(point.place_um, seat_shifts(context))
    target = None if alone else await asyncio.to_thread(_known_target, context, point)
    return BoardSearch(
        view=HeadView(context.geometry, pose_map, position, height_um),
        reference=reference,
        target=target,
        sides=context.references.sides,
        bend=context.wide_view.of(pose_map, height_um),
        measure_layers=measure_layers,
        last=last,
        round_um=point.round_um if point.stands_round and not alone else None,
        hole_um=point.hole_um if point.shape == "ring" else 0.0,
    )


def _known_target(context: StationContext, point: BoardPoint) -> Target | None:
    """Return the target, if CAD says what it looks like; for a worker thread."""
    target = target_of(point)
    return target if target is not None and looks_known(target, context.references.sides.obstacles) else None


async def look_by_cad(
    job: JobContext,
    context: StationContext,
    position: Position,
    probe: ProbeModel,
    search: BoardSearch,
    *,
    by_seat: bool = False,
    astray_um: float | None = None,
    moves_next: bool = False,
    is_last: bool = False,
) -> LookResult:
    """Take a look that is registered, count it, and keep what it taught of the map's far parts.

    by_seat: the verified seat may decide what the picture leaves open; not while the seat itself is looked for.
    astray_um: so far from where its drives have it the head may stand. moves_next, is_last: as `Station.look`.
    """
    look = await context.station.look(position, probe, search, job, moves_next=moves_next, is_last=is_last)
    if by_seat:
        look = await decide_by_seat(look, context, astray_um)
    job.saw(look)
    if look.board is not None and look.board.bend is not None:
        context.wide_view.learned(search.view.pose_map, look.board.bend)
    return look


async def believe(
    look: LookResult, context: StationContext, point: BoardPoint, astray_um: float | None = None
) -> Registered:
    """Return the target that a look registered; a `Fault` says why it is not to be believed.

    A board that lies elsewhere than its verified seat voids the seat; within `astray_um` it is the head that stands
    elsewhere, and nothing is said of the board.
    """
    seen = look.board
    if seen is None:
        raise Fault(FaultCode.TEST_POINT_NOT_FOUND, "the pad was not looked for in the red picture")
    found = seen.found
    if isinstance(found, NotRegistered):
        doubtful = astray_um is not None and found.reason in MAY_BE_ASTRAY
        if not doubtful and (found.reason in _BOARD_CHANGED or _is_another(found)):
            await void_seat(context, found.message)
        raise refusal_fault(found, point, context.board)
    if astray_um is None or math.hypot(*found.shift_um) > astray_um:
        await require_seat(context, point, found, seen.search.last if seen.moved else None)
    else:
        await require_unique(context, point)
    _require_witness(seen, found, point)
    rule = "registered" if seen.left_open is None else "registered_at_seat"
    if seen.search.target is None:
        rule = f"{rule}_by_surroundings"
    return Registered(*found.target_px, found.sigma_px, point.kind, rule, found)


_BOARD_CHANGED = frozenset({Refusal.WRONG_PLACE, Refusal.BOARD_TURNED, Refusal.WRONG_SIDE, Refusal.NO_BOARD})
"""What says that another board, or this one otherwise, lies in the nest."""


MAY_BE_ASTRAY = _BOARD_CHANGED | {Refusal.NOT_THIS_BOARD}
"""What one look may also say where the head stands elsewhere than its drives believe, or sees little but parts."""


def _is_another(found: NotRegistered) -> bool:
    """Whether so little agrees that dirt cannot be the reason."""
    reached = 0.0 if found.best is None else found.best.agreement
    return found.reason is Refusal.NOT_THIS_BOARD and reached < ANOTHER_BELOW


async def require_seat(
    context: StationContext, point: BoardPoint, found: Registration, last: Registration | None = None
) -> None:
    """Raise `Fault` where a registered board contradicts its seat, or nothing but an alignment could tell its place."""
    off_um = math.hypot(*found.shift_um)
    if last is not None and math.dist(found.shift_um, last.shift_um) > SAME_PLACE_UM:
        await void_seat(context, "the board moved while it was looked at")
        raise board_away(point, found.shift_um, "where it was a look ago", since_um=last.shift_um)
    if off_um > limit_um(context):
        where = "where its seat was verified" if verified(context) else "where it should"
        await void_seat(context, f"the board was seen {off_um:.0f} um off its seat")
        raise board_away(point, found.shift_um, where)
    await require_unique(context, point)


def _require_witness(seen: BoardSeen, found: Registration, point: BoardPoint) -> None:
    """Raise `Fault` (disagree) where a round pad's own outline lies elsewhere than CAD puts it."""
    witness = seen.witness
    if witness is None:
        return
    px_per_um = math.sqrt(abs(_area_px(seen, found.target_um)))
    apart_um = math.dist(found.target_px, (witness.x_px, witness.y_px)) / px_per_um
    sigma_um = math.hypot(found.sigma_um, witness.sigma_px / px_per_um)
    if apart_um <= WITNESS_SIGMAS * sigma_um + WITNESS_UM:
        return
    raise Fault(
        FaultCode.DISAGREE,
        f"{point.name}: CAD puts it {apart_um:.0f} um from where its own outline is seen; one of both is wrong",
        apart_um=round(apart_um, 1),
        registered_px=[round(v, 2) for v in found.target_px],
        outline_px=[round(witness.x_px, 2), round(witness.y_px, 2)],
    )


def _area_px(seen: BoardSeen, place_um: tuple[float, float]) -> float:
    """Return how many square pixels a square micrometre of the board takes at a place."""
    h = seen.board_to_px
    w = float(h[2] @ (place_um[0], place_um[1], 1.0))
    x, y = (float(h[k] @ (place_um[0], place_um[1], 1.0)) / w for k in (0, 1))
    a, b = (h[0, :2] - x * h[2, :2]) / w, (h[1, :2] - y * h[2, :2]) / w
    return float(a[0] * b[1] - a[1] * b[0])


def recognise(context: StationContext, look: LookResult) -> None:
    """Trust the board below the needle to be this one, where a look that is believed left nothing of that open."""
    if look.board is not None and look.board.left_open is None:
        context.station.needle.board.recognised()
