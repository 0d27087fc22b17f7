"""Planarity check (thesis 6.2, end): touch places all over the board, fit the plane, give a verdict."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.calibrate.commit import Began, keep
from daemon.procedures.move_sequence import MoveSequence
from daemon.procedures.surface_touch import SurfaceSearch, heights_um
from daemon.storage.calibration_records import SurfaceRecord, Touch
from daemon.wire.operations.jobs import Calibrate
from vision.geometry import Array, Surface, fit_plane

PLANAR_WITHIN_UM = 50.0
"""Two pixels of the tip's place: the thesis' measure of the same height, on its camera."""
MAX_RMS_UM = 25.0
"""Heights that are farther from any plane are not described by one."""
LEAST_PLACES = 4


async def measure_surface(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Touch test points of the board, fit the plane they lie in and keep it; if they lie in none the old one stays."""
    press_um = context.gantry.press_um
    if press_um <= 0.0:
        raise Fault(
            FaultCode.NOT_CALIBRATED,
            "the configuration allows no pressing",
            advice="set gantry.press_um to what the pin takes, say 200, and repeat",
        )
    context.calibrations.require_probe()
    pose_map = context.require_map()
    await context.station.require_homed(job)
    points = _choose(context.board.test_points(), request.places, request.id)
    places = [context.geometry.position_over(point.place_um, request.theta_deg) for point in points]
    sequence, pushes = MoveSequence(job, context), []
    search = SurfaceSearch(sequence, pose_map)
    for place in places:
        context.station.check(replace(place, z_um=context.gantry.free_z_um))
        context.station.check(replace(place, z_um=context.gantry.touch_z_um - press_um))
    job.fire(Event.ACCEPTED)
    began = Began.now(job)
    for n, (point, place) in enumerate(zip(points, places, strict=True)):
        job.progress(n, len(places), f"touching {point.name}")
        pushes.append(await search.press(place))
    heights = heights_um(pushes, pose_map, press_um, context.gantry.touch_z_um)
    where = np.array([context.geometry.tip_um(place) for place in places])
    surface = _plane(where, np.array(heights))
    record = _record(surface, where, heights, began.facts(job, context))
    kept = await keep(job, context, record)
    return Outcome("calibrated", detail=_told(record) | kept)


def _choose(points: tuple[BoardPoint, ...], count: int, seed: str) -> list[BoardPoint]:
    """Choose test points at random, every job others; pads are made to be touched, the board between them is not."""
    if len(points) < LEAST_PLACES:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the board has {len(points)} test points; a plane needs {LEAST_PLACES}",
            advice="check the surface with another board",
        )
    if len(points) <= count:
        return list(points)
    return random.Random(seed).sample(points, count)  # noqa: S311  # a repeatable choice, not a secret


def _plane(places: Array, heights: Array) -> Surface:
    """Fit the plane, or say why there is none."""
    try:
        surface = fit_plane(places, heights, sigma_um=None)
    except ValueError as exc:
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the surface is no plane: {exc}") from exc
    if surface.rms_um > MAX_RMS_UM:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the touched places lie {surface.rms_um:.0f} um off any plane; {MAX_RMS_UM:.0f} um are allowed",
            advice="see whether the board lies flat in its nest and nothing lies below it",
            heights_um=[round(float(h), 1) for h in heights],
        )
    return surface


def _record(surface: Surface, places: Array, heights: list[float], facts: dict[str, object]) -> SurfaceRecord:
    unflat_um = max(heights) - min(heights)
    return SurfaceRecord(
        **facts,  # type: ignore[arg-type]  # checked by the model
        touches=tuple(
            Touch(x_um=float(x), y_um=float(y), height_um=h) for (x, y), h in zip(places, heights, strict=True)
        ),
        residuals_um=tuple(float(r) for r in surface.residuals_um),
        surface=surface.to_dict(),
        flatness_um=surface.flatness_um,
        rms_um=surface.rms_um,
        limit_um=PLANAR_WITHIN_UM,
        planar=unflat_um <= PLANAR_WITHIN_UM,
        max_rms_um=MAX_RMS_UM,
    )


def _told(record: SurfaceRecord) -> dict[str, object]:
    heights = [touch.height_um for touch in record.touches]
    return {
        "what": "surface",
        "places": len(heights),
        "height_um": round(float(np.mean(heights)), 1),
        "spread_um": round(max(heights) - min(heights), 1),
        "rms_um": round(record.rms_um, 1),
        "planar": record.planar,
        "limit_um": record.limit_um,
    }
