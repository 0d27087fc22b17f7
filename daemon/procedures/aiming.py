"""Aiming: from one look to where the target is from the tip, um, or why that cannot be said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.look_numbers import describe, landing_of, sight_of
from daemon.procedures.registered import Registered, believe, board_search, look_by_cad
from daemon.procedures.registration_faults import unusable_frame
from daemon.station.station import LookResult, Search
from daemon.station.tip_search import UNUSABLE
from drivers.gantry import Position
from vision import NotFound, TestPoint, Tip
from vision.geometry import Array, ConstellationMatch, Correction, PoseMap, match_near, match_target
from vision.pads import probe_hides
from vision.registration import Registration

STILL_UM = 45.0
"""From one look of a job to the next the target is where it was, within five sigma of the stops' scatter."""
AGAIN = 2
"""How often what is unclear is looked at again."""
UNCLEAR = frozenset({FaultCode.UNDECIDED, FaultCode.AMBIGUOUS, FaultCode.TEST_POINT_NOT_FOUND})
"""What another point of view may clear up. A tip that is not found is none of these: nothing moves without it."""
HIDDEN = frozenset({FaultCode.TARGET_NOT_CONFIRMED, FaultCode.DISAGREE})
"""The same where CAD is registered, which is never wrong by chance: the needle, its shadow or a glint at the target."""
MOSTLY_AGREES = 0.6
"""Agreement at which a refused picture may be this board, with something before it."""
NO_MATCH = {
    "none_near": FaultCode.TEST_POINT_NOT_FOUND,
    "undecided": FaultCode.UNDECIDED,
    "ambiguous": FaultCode.AMBIGUOUS,
    "contradicted": FaultCode.AMBIGUOUS,
}

NO_MATCH_WORDS = {
    "none_near": "no pad is seen where it should be: the board may be turned, displaced, wrong side up or another one",
    "undecided": "what lies where it should be cannot be told from a pad: dirt, solder or a glint may cover it",
    "ambiguous": "several pads could be it: the board lies further off than their distance",
    "contradicted": "the pads in view do not lie as CAD has them: the board may be another one, or turned",
}


@dataclass(frozen=True)
class Prior:
    """What is known before a look: how far the target is from its nominal place, robot frame, and how well."""

    shift_um: tuple[float, float]
    trust_um: float
    firm: bool = False
    """Whether the target cannot be elsewhere: it was seen a moment ago."""
    last: Registration | None = None
    """Where the board was seen a moment ago."""
    astray_um: float | None = None
    """So far beside its place any way may have ended; the board is then not said to have moved."""


@dataclass(frozen=True)
class Aim:
    """The way from the tip to the target that one look found. `shift_um`: the target from its nominal place."""

    look: LookResult
    tip: Tip
    target: TestPoint | Registered
    correction: Correction
    shift_um: tuple[float, float]
    astray_um: float | None = None

    @property
    def firm(self) -> Prior:
        """What the next look of the job knows by this one; where ways may end astray, nothing."""
        if self.astray_um is not None:
            return Prior((0.0, 0.0), self.astray_um, astray_um=self.astray_um)
        registered = self.target.found if isinstance(self.target, Registered) else None
        return Prior(self.shift_um, STILL_UM, firm=True, last=registered)

    @property
    def tip_px(self) -> tuple[float, float]:
        """Where the needle's end was seen."""
        return self.tip.x_px, self.tip.y_px

    @property
    def error_um(self) -> float:
        """Distance between tip and target."""
        return self.correction.distance_um

    @property
    def place_um(self) -> tuple[float, float]:
        """Where the head has to be so that the tip is on the target, robot frame."""
        here = self.look.position
        return here.x_um + self.correction.dx_um, here.y_um + self.correction.dy_um


def known_beforehand(context: StationContext, *, astray: bool = False) -> Prior | None:
    """Return what a station knows before its first look: something only if head and board have been calibrated.

    `astray`: the way that led here may have ended anywhere that can be corrected, wherever the board is.
    """
    if astray and context.by_cad:
        most_um = context.servo.max_placement_um
        return Prior((0.0, 0.0), most_um, astray_um=most_um)
    aligned = context.calibrations.head is not None and context.calibrations.alignment(context.board) is not None
    return Prior((0.0, 0.0), context.servo.trusted_um) if aligned else None


async def look_and_aim(
    job: JobContext,
    context: StationContext,
    position: Position,
    point: BoardPoint,
    pose_map: PoseMap,
    prior: Prior | None = None,
    *,
    moves_next: bool = False,
    is_last: bool = False,
) -> Aim:
    """Look from `position` and find the way to `point`; a `Fault` says what could not be seen.

    moves_next: that way will be gone at once, and looked at again. is_last: it will hardly be gone.

    What is unclear is looked at again from the same place: the camera's noise is another, nothing moves. Registration
    is not at the mercy of noise.
    """
    context.station.needle.sight = None
    again = {FaultCode.TIP_NOT_FOUND} if context.by_cad else UNCLEAR | {FaultCode.TIP_NOT_FOUND}
    for _ in range(AGAIN):
        try:
            return await _aim(job, context, position, point, pose_map, prior, moves_next=moves_next, is_last=is_last)
        except Fault as unclear:
            if unclear.kind not in again:
                raise
    return await _aim(job, context, position, point, pose_map, prior, moves_next=moves_next, is_last=is_last)


def another_view_helps(context: StationContext, fault: Fault, prior: Prior | None = None) -> bool:
    """Whether what could not be seen may be seen from a step aside.

    Where ways may end astray, that is also a picture that mostly agrees with CAD: what stands before some of its metal
    here stands elsewhere from aside.
    """
    if not context.by_cad:
        return fault.kind in UNCLEAR
    astray = prior is not None and prior.astray_um is not None
    mostly = fault.kind is FaultCode.NOT_THIS_BOARD and float(fault.detail.get("agreement", 0.0)) >= MOSTLY_AGREES
    return fault.kind in HIDDEN or (astray and mostly)


def _height_below_um(context: StationContext, position: Position, point: BoardPoint) -> float:
    """Return the height of what a look finds: by CAD the board's surface, else the pad's own outline."""
    height_um = context.geometry.height_below_um(position)
    return height_um if context.by_cad else height_um + (point.stands_um or 0.0)


async def _aim(
    job: JobContext,
    context: StationContext,
    position: Position,
    point: BoardPoint,
    pose_map: PoseMap,
    prior: Prior | None,
    *,
    moves_next: bool,
    is_last: bool,
) -> Aim:
    """Take one look."""
    model = context.calibrations.require_probe()
    servo = context.servo
    reach_um = servo.max_placement_um + servo.match_um
    height_um = _height_below_um(context, position, point)
    astray_um = prior.astray_um if prior is not None else None
    if context.by_cad:
        last = prior.last if prior is not None else None
        by_cad = await board_search(context, position, point, pose_map, last)
        look = await look_by_cad(
            job, context, position, model, by_cad, by_seat=True, astray_um=astray_um, moves_next=moves_next,
            is_last=is_last,
        )  # fmt: skip
    else:
        search = Search.by_map(pose_map, model.tip_px, point, reach_um, height_um)
        look = await context.station.look(position, model, search, job, moves_next=moves_next, is_last=is_last)
        job.saw(look)
    target: TestPoint | Registered
    try:
        tip = require_tip(look)
        if context.by_cad:
            target = await believe(look, context, point, astray_um)
        else:
            target = choose(look, tip, point, pose_map, context, height_um, prior)
    except Fault:
        job.note("look", describe(look, None, None))
        raise
    way = pose_map.correction((target.x_px, target.y_px), (tip.x_px, tip.y_px), look.position.theta_deg,
                              math.hypot(tip.sigma_px, target.sigma_px), height_um=height_um)  # fmt: skip
    look = _told(job, context, look, tip, target, way, pose_map, height_um)
    nominal = context.geometry.from_tip_um(point.place_um, position)
    shift_um = float(way.dx_um - nominal[0]), float(way.dy_um - nominal[1])
    return Aim(look, tip, target, way, shift_um, astray_um)


def _told(
    job: JobContext, context: StationContext, look: LookResult, tip: Tip, target: TestPoint | Registered,
    way: Correction, pose_map: PoseMap, height_um: float,
) -> LookResult:  # fmt: skip
    """Keep what a look showed: in numbers, for its pictures, and for live ones until the head moves."""
    job.note("look", describe(look, target, way))
    told = replace(look, landing=landing_of(look, tip, target, pose_map.below_px(height_um), way))
    job.aimed(told)
    px_per_um = pose_map.scale_px_per_um((tip.x_px, tip.y_px), height_um=height_um)
    context.station.needle.sight = sight_of(told, context.servo.tolerance_um * px_per_um)
    return told


def require_tip(look: LookResult) -> Tip:
    """Return the tip or raise the `Fault` that names why there is none."""
    if look.tip is None:
        raise Fault(FaultCode.NOT_CALIBRATED, "the probe's tip has not been taught")
    if isinstance(look.tip, NotFound):
        refuse_unusable(look.tip, "white")
        raise Fault(FaultCode.TIP_NOT_FOUND, f"tip not found: {look.tip.message}", reason=look.tip.reason.value)
    return look.tip


def refuse_unusable(missing: NotFound, lamp: Literal["white", "red"]) -> None:
    """Raise `Fault` if it is the frame under that lamp itself that is no good: no other place helps then."""
    if missing.reason in UNUSABLE:
        raise unusable_frame(missing.message, missing.reason.value, lamp)


def choose(
    look: LookResult,
    tip: Tip,
    point: BoardPoint,
    pose_map: PoseMap,
    context: StationContext,
    height_um: float,
    prior: Prior | None,
) -> TestPoint:
    """Choose the pad that is `point` among those seen: by CAD's neighbourhood or by its known place; never guess.

    Where the neighbourhood calls for a pad far from the known place, and one thing alone lies there, it is that.
    """
    seen = look.seen
    if seen is None:
        raise Fault(FaultCode.TEST_POINT_NOT_FOUND, "the pad was not looked for in the red picture")
    if isinstance(seen.nearest, NotFound):
        refuse_unusable(seen.nearest, "red")
    servo, theta, tip_px = context.servo, look.position.theta_deg, (tip.x_px, tip.y_px)
    radius_px = point.round_um / 2 * pose_map.scale_px_per_um(tip_px)

    def places_um(pixels: list[tuple[float, float]]) -> Array:
        return pose_map.from_tip_um(pixels, tip_px, theta, height_um=height_um) if pixels else np.empty((0, 2))

    def hidden(places: Array) -> Sequence[bool]:
        return probe_hides(tip, pose_map.to_px(places, tip_px, theta, height_um=height_um), radius_px)

    cad = lookalikes(point, look.position, context)
    pads = places_um([(p.x_px, p.y_px) for p in seen.taken])
    doubtful = places_um([(o.object.x_px, o.object.y_px) for o in seen.undecided])
    match = match_target(
        pads,
        cad,
        max_shift_um=servo.max_placement_um,
        tolerance_um=servo.match_um,
        reach_um=servo.max_placement_um,
        doubtful_um=doubtful,
        hidden=hidden,
    )
    far = isinstance(match, ConstellationMatch) and prior is not None and (
        math.dist(match.shift_um, prior.shift_um) > prior.trust_um
    )  # fmt: skip
    if isinstance(match, ConstellationMatch) and not far:
        return seen.taken[match.index]
    if prior is not None:
        could_be = [*seen.taken, *seen.possible(radius_px, followed=prior.firm)]
        places = places_um([(p.x_px, p.y_px) for p in could_be])
        index = match_near(places, cad, shift_um=prior.shift_um, trust_um=prior.trust_um)
        if index is not None:
            return could_be[index]
    if isinstance(match, ConstellationMatch):
        if prior is not None and prior.firm:
            raise Fault(FaultCode.AMBIGUOUS, f"{point.name}: what is seen now is not what was seen before")
        return seen.taken[match.index]
    objects = np.vstack([pads, doubtful])
    raise Fault(
        NO_MATCH[match.reason],
        f"{point.name}: {NO_MATCH_WORDS[match.reason]}; in view are {_number(len(pads), 'pad')} of its size and "
        f"{_number(len(doubtful), 'doubtful object')}",
        match=match.reason,
        candidates_um=[[round(float(v), 1) for v in objects[i]] for i in match.candidates],
        thrown=[t.rule for t in seen.thrown][:20],
    )


def _number(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def lookalikes(point: BoardPoint, position: Position, context: StationContext) -> Array:
    """Return CAD's round targets near `point`, itself first, from where it nominally is below the tip; um, robot frame.

    The nominal place of the target is taken as the origin: what the placement missed is what is to be found.
    """
    servo = context.servo
    places = context.board.lookalikes_um(point, 3 * (servo.max_placement_um + servo.match_um))
    from_tip: Array = context.geometry.board_to_robot_um(places) - context.geometry.tip_um(position)
    return from_tip
