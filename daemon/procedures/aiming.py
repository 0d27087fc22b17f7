"""Aiming: from one look to where the target is from the tip, um, or why that cannot be said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.station.station import LookResult, Search
from drivers.gantry import Position
from vision import NotFound, Reason, TestPoint, Tip
from vision.geometry import Array, ConstellationMatch, Correction, PoseMap, match_near, match_target
from vision.pads import probe_hides

UNUSABLE = frozenset({Reason.TOO_DARK, Reason.SATURATED, Reason.BLURRED, Reason.OUT_OF_FRAME})
STILL_UM = 45.0
"""From one look of a job to the next the target is where it was, within five sigma of the stops' scatter."""
AGAIN = 2
"""How often what is unclear is looked at again."""
UNCLEAR = frozenset({FaultCode.UNDECIDED, FaultCode.AMBIGUOUS, FaultCode.TEST_POINT_NOT_FOUND})
"""What another point of view may clear up. A tip that is not found is none of these: nothing moves without it."""
NO_MATCH = {
    "none_near": FaultCode.TEST_POINT_NOT_FOUND,
    "undecided": FaultCode.UNDECIDED,
    "ambiguous": FaultCode.AMBIGUOUS,
    "contradicted": FaultCode.AMBIGUOUS,
}


@dataclass(frozen=True)
class Prior:
    """What is known before a look: how far the target is from its nominal place, robot frame, and how well."""

    shift_um: tuple[float, float]
    trust_um: float
    firm: bool = False
    """Whether the target cannot be elsewhere: it was seen a moment ago."""


@dataclass(frozen=True)
class Aim:
    """The way from the tip to the target that one look found. `shift_um`: the target from its nominal place."""

    look: LookResult
    tip: Tip
    target: TestPoint
    correction: Correction
    shift_um: tuple[float, float]

    @property
    def error_um(self) -> float:
        """Distance between tip and target."""
        return self.correction.distance_um

    @property
    def place_um(self) -> tuple[float, float]:
        """Where the head has to be so that the tip is on the target, robot frame."""
        here = self.look.position
        return here.x_um + self.correction.dx_um, here.y_um + self.correction.dy_um


def known_beforehand(context: StationContext) -> Prior | None:
    """Return what a station knows before its first look: something only if head and board have been calibrated."""
    aligned = context.calibrations.head is not None and context.calibrations.alignment(context.board) is not None
    return Prior((0.0, 0.0), context.servo.trusted_um) if aligned else None


async def look_and_aim(
    job: JobContext,
    context: StationContext,
    position: Position,
    point: BoardPoint,
    pose_map: PoseMap,
    prior: Prior | None = None,
) -> Aim:
    """Look from `position` and find the way to `point`; a `Fault` says what could not be seen.

    What is unclear is looked at again from the same place: the camera's noise is another, nothing moves.
    """
    for _ in range(AGAIN):
        try:
            return await _aim(job, context, position, point, pose_map, prior)
        except Fault as unclear:
            if unclear.kind not in UNCLEAR and unclear.kind is not FaultCode.TIP_NOT_FOUND:
                raise
    return await _aim(job, context, position, point, pose_map, prior)


async def _aim(
    job: JobContext,
    context: StationContext,
    position: Position,
    point: BoardPoint,
    pose_map: PoseMap,
    prior: Prior | None,
) -> Aim:
    """Take one look."""
    model = context.calibrations.require_probe()
    servo = context.servo
    reach_um = servo.max_placement_um + servo.match_um
    height_um = context.geometry.height_below_um(position)
    search = Search.by_map(pose_map, model.tip_px, point, reach_um, height_um)
    look = await context.station.look(position, model, search, job)
    job.saw(look)
    try:
        tip = require_tip(look)
        target = choose(look, tip, point, pose_map, context, height_um, prior)
    except Fault:
        job.note("look", describe(look, None, None))
        raise
    way = pose_map.correction((target.x_px, target.y_px), (tip.x_px, tip.y_px), look.position.theta_deg,
                              math.hypot(tip.sigma_px, target.sigma_px), height_um=height_um)  # fmt: skip
    job.note("look", describe(look, target, way))
    nominal = context.geometry.from_tip_um(point.place_um, position)
    return Aim(look, tip, target, way, (float(way.dx_um - nominal[0]), float(way.dy_um - nominal[1])))


def require_tip(look: LookResult) -> Tip:
    """Return the tip or raise the `Fault` that names why there is none."""
    if look.tip is None:
        raise Fault(FaultCode.NOT_CALIBRATED, "the probe's tip has not been taught")
    if isinstance(look.tip, NotFound):
        refuse_unusable(look.tip)
        raise Fault(FaultCode.TIP_NOT_FOUND, f"tip not found: {look.tip.message}", reason=look.tip.reason.value)
    return look.tip


def refuse_unusable(missing: NotFound) -> None:
    """Raise `Fault` if it is the frame itself that is no good: no other place helps then."""
    if missing.reason in UNUSABLE:
        raise Fault(FaultCode.FRAME_UNUSABLE, missing.message, reason=missing.reason.value)


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
        raise Fault(FaultCode.TEST_POINT_NOT_FOUND, "the red picture was not searched")
    if isinstance(seen.nearest, NotFound):
        refuse_unusable(seen.nearest)
    servo, theta, tip_px = context.servo, look.position.theta_deg, (tip.x_px, tip.y_px)
    radius_px = point.diameter_um / 2 * pose_map.scale_px_per_um(tip_px)

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
        f"{point.name}: {match.reason}; {len(pads)} pads of its size and {len(doubtful)} doubtful objects are in view",
        candidates_um=[[round(float(v), 1) for v in objects[i]] for i in match.candidates],
        thrown=[t.rule for t in seen.thrown][:20],
    )


def lookalikes(point: BoardPoint, position: Position, context: StationContext) -> Array:
    """Return CAD's round targets near `point`, itself first, from where it nominally is below the tip; um, robot frame.

    The nominal place of the target is taken as the origin: what the placement missed is what is to be found.
    """
    servo = context.servo
    places = context.board.lookalikes_um(point, 3 * (servo.max_placement_um + servo.match_um))
    from_tip: Array = context.geometry.board_to_robot_um(places) - context.geometry.tip_um(position)
    return from_tip


def describe(look: LookResult, target: TestPoint | None, way: Correction | None) -> dict[str, object]:
    """Return a look's numbers for the journal."""
    body: dict[str, object] = {
        "x_um": round(look.position.x_um, 2),
        "y_um": round(look.position.y_um, 2),
        "z_um": round(look.position.z_um, 2),
        "theta_deg": round(look.position.theta_deg, 5),
        "white_sequence": look.white.sequence,
    }
    if look.red is not None:
        body["red_sequence"] = look.red.sequence
    if isinstance(look.tip, Tip):
        body |= {
            "tip_px": [round(look.tip.x_px, 3), round(look.tip.y_px, 3)],
            "tip_sigma_px": round(look.tip.sigma_px, 3),
            "needle": _needle(look.tip),
        }
    if target is not None:
        body |= {"target_px": [round(target.x_px, 3), round(target.y_px, 3)], "kind": str(target.kind)}
    if way is not None:
        body |= {"dx_um": round(way.dx_um, 2), "dy_um": round(way.dy_um, 2), "sigma_um": round(way.sigma_um, 2)}
    return body


def _needle(tip: Tip) -> dict[str, float]:
    """Return what was measured of the needle itself; maintenance follows it over months."""
    return {
        "width_px": round(tip.width_px, 3),
        "marking_px": round(tip.shape.marking_px, 3),
        "contrast": round(tip.marking_contrast, 4),
        "bend_px": round(tip.bend_px, 3),
        "sharpness": round(tip.sharpness, 4),
        "score": round(tip.score, 4),
        "support": round(tip.edge_support, 3),
    }
