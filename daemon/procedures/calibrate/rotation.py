"""Calibration of the head's rotation: where the head stands, at each angle, when the tip is on the control point.

The thesis walks there in fixed steps, 21 minutes for 320 angles (6.2). With the map one look says how far the tip is
off, and a smooth model of the head needs few angles (appendix D's own record shows it), so a look or two an angle do.
Afterwards the new model is tried: the head jumps to the target at angles it was not fitted on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.calibrate.commit import Began, keep
from daemon.procedures.calibrate.head_angles import between, plan_angles
from daemon.procedures.calibrate.map_walk import MapAcquisition
from daemon.procedures.calibrate.pose_map import acquire_and_store
from daemon.procedures.calibrate.rotation_run import MAX_CLOSURE_UM, MeasuredAngle, RotationRun
from daemon.procedures.calibrate.targets import CalibrationTarget, choose_target
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.storage.calibration_records import Circle, RotationLimits, RotationRecord, TrialLanding
from daemon.wire.operations.jobs import Calibrate
from vision.geometry import PoseMap
from vision.head import Choice, Head, HeadFit, fit_head, head_to_dict, total_error_um

CHECKS = 8
"""Landings by which the new model is tried."""
MAX_HOLDOUT_UM = 60.0
MAX_LANDING_UM = 200.0
"""The thesis' own bound on a first landing."""


async def calibrate_rotation(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Calibrate the head's rotation on the control point; the old calibration stays unless the new one is good."""
    target = choose_target(context, None)
    context.calibrations.require_probe()
    await context.station.require_homed(job)
    theta = context.config.axes.theta
    lowest_deg = theta.minimum + context.config.gantry.approach_deg  # below it there is no room to come from below
    angles = plan_angles(request.angles, request.every_deg, lowest_deg, theta.maximum)
    _check_reach(context, target, angles)
    job.fire(Event.ACCEPTED)
    sequence, began = MoveSequence(job, context), Began.now(job)
    run = RotationRun(sequence, target, await _map(sequence, target, angles[0]), angles, spare_steps=CHECKS)
    prior = context.geometry.head
    try:
        resumed = await run.measure(resume=request.resume)
        fit = fit_or_refuse(run.measured, request.model)
        landings = await _try_out(run, fit, between(angles, CHECKS))
    except Fault as refused:
        if run.complete and refused.kind is FaultCode.CALIBRATION_FAILED:
            await run.forget()
        raise
    record = _record(run, fit, began.facts(job, context), prior, landings)
    kept = await keep(job, context, record)
    return Outcome("calibrated", detail=_told(record) | {"resumed": resumed} | kept)


def _check_reach(context: StationContext, target: CalibrationTarget, angles: Sequence[float]) -> None:
    """See that the head may stand everywhere round the target before it moves at all."""
    r = context.servo.max_placement_um
    for angle in angles:
        over = context.geometry.position_at(target.place_um, angle)
        for dx, dy in ((-r, -r), (r, r)):
            context.station.check(shifted(over, dx, dy))


async def _map(sequence: MoveSequence, target: CalibrationTarget, theta_deg: float) -> PoseMap:
    """Return the map in force; where there is none, acquire one on the control point itself."""
    context = sequence.context
    try:
        return context.require_map()
    except Fault as missing:
        if missing.kind is not FaultCode.NOT_CALIBRATED:
            raise
    await acquire_and_store(sequence.job, context, MapAcquisition(sequence, target, theta_deg), target)
    return context.require_map()


def fit_or_refuse(measured: MeasuredAngle, model: Choice) -> HeadFit:
    """Fit the head; refuse a fit that predicts badly."""
    rows = np.array([(s.theta_deg, s.x_um, s.y_um) for s in measured.stops])
    try:
        fit = fit_head(*rows.T, model=model)
    except ValueError as exc:
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the head cannot be fitted: {exc}") from exc
    if not fit.holdout_rms_um <= MAX_HOLDOUT_UM:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"angles left out of the fit are predicted to {fit.holdout_rms_um:.0f} um only; "
            f"{MAX_HOLDOUT_UM:.0f} um are allowed",
            advice="take more angles; if that does not help, look for play in the head",
            holdout_rms_um=round(fit.holdout_rms_um, 1),
        )
    return fit


async def _try_out(run: RotationRun, fit: HeadFit, angles: list[float]) -> list[TrialLanding]:
    """Jump to the target by the new model at angles it has not seen; refuse it if a jump misses by far."""
    landings = await run.land(fit.head, fit.control_um, angles)
    worst_um = max((math.hypot(one.dx_um, one.dy_um) for one in landings), default=math.inf)
    if worst_um > MAX_LANDING_UM:
        fact = f"a landing by the new head model missed by {worst_um:.0f} um"
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            fact if landings else "no landing by the new head model could be seen",
            advice="look for what moved during the run, `home`, and calibrate again",
        )
    return landings


def _record(
    run: RotationRun, fit: HeadFit, facts: dict[str, Any], prior: Head, after: list[TrialLanding]
) -> RotationRecord:
    """Return what is kept."""
    measured = run.measured
    before = _before(measured, prior)
    errors = np.array([(one.dx_um, one.dy_um) for one in before])
    facts["looks"] += run.earlier.looks
    facts["seconds"] = round(facts["seconds"] + run.earlier.seconds, 2)
    return RotationRecord(
        **facts,
        legs=run.earlier.legs + 1,
        control_um=run.target.place_um,
        card_height_um=measured.card_height_um,
        stops=measured.stops,
        used=tuple(bool(u) for u in fit.used),
        residuals_um=tuple((float(x), float(y)) for x, y in -fit.residuals_um),
        head=head_to_dict(fit.head),
        kind=fit.kind,
        order=fit.order,
        rms_um=fit.rms_um,
        holdout_rms_um=fit.holdout_rms_um,
        holdout_max_um=fit.holdout_max_um,
        circle=Circle(centre_um=fit.circle.centre_um, radius_um=fit.circle.radius_um, rms_um=fit.circle.rms_um),
        total_error_um=total_error_um(errors[:, 0], errors[:, 1], (0.0, 0.0)).total_um,
        closure_um=run.closure_um,
        before=tuple(before),
        after=tuple(after),
        sightings=measured.sightings,
        limits=RotationLimits(holdout_um=MAX_HOLDOUT_UM, landing_um=MAX_LANDING_UM, closure_um=MAX_CLOSURE_UM),
    )


def _before(measured: MeasuredAngle, head: Head) -> list[TrialLanding]:
    """Return the landings that the head model in force so far gives at the stops, about their middle.

    The middle is taken off because where the print lies was not known any better.
    """
    tips = np.array([np.add((s.x_um, s.y_um), head.tip_offset_um(s.theta_deg)) for s in measured.stops])
    off = tips.mean(axis=0) - tips
    return [
        TrialLanding(theta_deg=s.theta_deg, dx_um=float(dx), dy_um=float(dy))
        for s, (dx, dy) in zip(measured.stops, off, strict=True)
    ]


def _told(record: RotationRecord) -> dict[str, object]:
    """Return the figures for the answer."""
    errors = [math.hypot(one.dx_um, one.dy_um) for one in record.after]
    return {
        "what": "rotation",
        "angles": len(record.stops),
        "outliers": [s.theta_deg for s, used in zip(record.stops, record.used, strict=True) if not used],
        "model": record.kind if record.order is None else f"{record.kind} {record.order}",
        "radius_um": round(record.circle.radius_um, 1),
        "rms_um": round(record.rms_um, 1),
        "holdout_rms_um": round(record.holdout_rms_um, 1),
        "holdout_max_um": round(record.holdout_max_um, 1),
        "landings_um": [round(e, 1) for e in errors],
        "closure_um": round(record.closure_um, 1),
        "card_height_um": round(record.card_height_um, 1),
    }
