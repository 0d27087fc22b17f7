"""Pose map calibration: acquire the map from image to robot, and refuse one that must not be trusted."""

from __future__ import annotations

import asyncio
import json

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.calibrate.commit import Began, keep
from daemon.procedures.calibrate.map_walk import MapAcquisition
from daemon.procedures.calibrate.targets import CalibrationTarget
from daemon.storage.calibration_records import MapLimits, MapRecord, SeenTarget
from vision.geometry import MapPoint, PoseMap, worst_shrink

MAX_RESIDUAL_UM = 15.0
"""Beyond this the map is refused: repeatability and vision together leave about 8 um."""
MAX_LEFT = 0.5
"""A map that leaves this share of an error, or more, is refused."""


async def acquire_and_store(
    job: JobContext, context: StationContext, acquisition: MapAcquisition, target: CalibrationTarget
) -> dict[str, object]:
    """Acquire a map, refuse a bad one with a `Fault`, store a good one; return the figures for the answer."""
    began = Began.now(job)
    try:
        await acquisition.come_down()
        pose_map = await acquisition.run(MAX_RESIDUAL_UM)
        await asyncio.to_thread(refuse_bad_map, pose_map, acquisition)
    except ValueError as exc:
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the map cannot be fitted: {exc}") from exc
    record = MapRecord(
        **began.facts(job, context), mark=target.name, theta_deg=acquisition.over.theta_deg, tip_px=acquisition.tip_px,
        sightings=tuple(_seen(s) for s in acquisition.sightings), pose_map=json.loads(pose_map.to_json()),
        limits=MapLimits(residual_um=MAX_RESIDUAL_UM, left_share=MAX_LEFT),
    )  # fmt: skip
    kept = await keep(job, context, record)
    return {
        "what": "map",
        "sightings": len(acquisition.sightings),
        "residual_um": round(pose_map.residual_um, 2),
        "radius_um": round(pose_map.radius_um, 1),
        "below_tip_px": [round(v, 2) for v in pose_map.below_tip_px],
        "um_per_px": round(1 / pose_map.scale_px_per_um(acquisition.tip_px), 3),
        **kept,
    }


def refuse_bad_map(pose_map: PoseMap, acquisition: MapAcquisition) -> None:
    """Raise ValueError for a map that a needle must not be trusted to."""
    if pose_map.mirrored:
        raise ValueError("the picture is mirrored; switch the camera's flip off, teach the tip and calibrate again")
    if pose_map.residual_um > MAX_RESIDUAL_UM:
        raise ValueError(f"the residual is {pose_map.residual_um:.0f} um, more than {MAX_RESIDUAL_UM:.0f} um")
    left = worst_shrink(
        acquisition.sightings,
        tip_px=acquisition.tip_px,
        below_tip_px=pose_map.below_tip_px,
        work_z_um=pose_map.work_z_um,
        hover_um=pose_map.hover_um,
    )
    if not left < MAX_LEFT:
        raise ValueError(f"a correction by it would leave {left:.0%} of an error; look for what moved meanwhile")


def _seen(sighting: MapPoint) -> SeenTarget:
    """Return a sighting as the record keeps it."""
    s = sighting
    return SeenTarget(theta_deg=s.theta_deg, target_px=s.target_px, x_um=s.x_um, y_um=s.y_um)
