"""The calibration jobs: teach the tip, and map pixels to um (thesis 6.2, on one head angle).

The map job walks the head round one resting round target and logs (image, robot) pairs, first by small steps along
both axes, then by what those taught over the whole region a correction may come from. At the end it lowers the needle
beside the target: where the target then appears, against where it appeared at working height, is how far the place
below the tip lies from the tip in the picture.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

import numpy as np

from daemon.board import BoardPoint
from daemon.faults import Fault, Kind
from daemon.job import Bench, Job, Outcome
from daemon.messages import Calibrate
from daemon.sighting import describe, refuse_unusable
from daemon.states import Event
from daemon.station import HEIGHT_WINDOW_UM, Look, Search
from drivers.gantry import Position
from drivers.lights import Light
from vision import NotFound, ProbeModel, TestPoint, Tip
from vision.frames import Array
from vision.posemap import PoseMap, Sighting, fit_pose_map

SEARCH_STEPS = ((0.0, 0.0), *((500.0 * math.cos(a), 500.0 * math.sin(a)) for a in np.linspace(0.4, 6.0, 7)))
"""Where to stand for the first sight: over the target, else round it, for the needle may hide it."""
FIRST_STEPS = (((250.0, 0.0), (-250.0, 0.0)), ((0.0, 250.0), (0.0, -250.0)))
LEAST_SCALE = 1e-4
"""px/um squared; a picture that moves less with the head does not show the board."""
RINGS = ((0.45, 6), (0.95, 10))
"""Places round the target: share of the largest placement error, and how many on that circle."""
MIN_SIGHTINGS = 9
MIN_VISIBLE = 0.9
"""Of the target's contour; what the needle hides makes its centre worth less than a map needs."""
MAX_RESIDUAL_UM = 15.0
"""Beyond this the map is refused: repeatability and vision together leave about 8 um."""


async def calibrate(job: Job, bench: Bench) -> Outcome:
    """Run the calibration that was asked for."""
    request = job.request
    if not isinstance(request, Calibrate):
        raise TypeError(request)
    return await (_teach_tip(job, bench, request) if request.what == "tip" else _map(job, bench, request))


async def _teach_tip(job: Job, bench: Bench, request: Calibrate) -> Outcome:
    """Take a white picture and learn the probe from the pixel a person pointed at."""
    if request.tip_px is None:
        raise Fault(Kind.INVALID_REQUEST, "what=tip needs tip_px")
    job.fire(Event.ACCEPTED)
    frame = await bench.station.picture(Light.WHITE, job.watch, job.deadline)
    try:
        model = await asyncio.to_thread(ProbeModel.teach, frame.pixels, tip_px=request.tip_px)
    except ValueError as exc:
        raise Fault(Kind.CALIBRATION_FAILED, f"the tip cannot be taught: {exc}") from exc
    await asyncio.to_thread(bench.calibrations.store_probe, model)
    return Outcome("calibrated", detail={"what": "tip", "tip_px": list(request.tip_px)})


async def _map(job: Job, bench: Bench, request: Calibrate) -> Outcome:
    """Calibrate the map on one round target of the board; the old map stays unless the new one is good."""
    job.partial.test_point = request.test_point
    point = bench.board.find(request.test_point or "")
    bench.calibrations.require_probe()
    await bench.station.require_homed(job.watch, job.deadline)
    walk = _Walk(job, bench, point, request.theta_deg)
    for place in walk.extremes():
        bench.station.check(place)
    job.fire(Event.ACCEPTED)
    job.fire(Event.SEEN)
    try:
        pose_map = await walk.run()
    except ValueError as exc:
        raise Fault(Kind.CALIBRATION_FAILED, f"the map cannot be fitted: {exc}") from exc
    if pose_map.residual_um > MAX_RESIDUAL_UM:
        raise Fault(
            Kind.CALIBRATION_FAILED,
            f"the residual is {pose_map.residual_um:.0f} um, more than {MAX_RESIDUAL_UM:.0f} um",
            residual_um=round(pose_map.residual_um, 1),
        )
    await asyncio.to_thread(bench.calibrations.store_map, pose_map)
    detail = {
        "what": "map",
        "sightings": len(walk.sightings),
        "residual_um": round(pose_map.residual_um, 2),
        "radius_um": round(pose_map.radius_um, 1),
        "below_tip_px": [round(v, 2) for v in pose_map.below_tip_px],
        "um_per_px": round(1 / pose_map.scale_px_per_um(walk.tip_px), 3),
    }
    return Outcome("calibrated", test_point=point.name, detail=detail)


class _Walk:
    """The way of the head round the target, and what was seen from each place."""

    def __init__(self, job: Job, bench: Bench, point: BoardPoint, theta_deg: float) -> None:
        self._job, self._bench, self._point = job, bench, point
        self._over = bench.station.position_over(point.x_um, point.y_um, theta_deg)
        self._reach_um = bench.config.servo.max_placement_um
        self._reach_px = 2 * self._reach_um / bench.config.camera.pitch_um
        self._verifying = False
        self._position = self._over
        self._why_unseen = ""
        self.tip_px = (math.nan, math.nan)
        self.sightings: list[Sighting] = []

    def extremes(self) -> list[Position]:
        """Return the corners of the walk, so that the envelope is checked before the first step."""
        r = 2 * self._reach_um
        return [self._shifted(dx, dy) for dx in (-r, r) for dy in (-r, r)]

    async def run(self) -> PoseMap:
        """Walk, see, fit."""
        offset = await self._approach()
        for radius, count in RINGS:
            for k in range(count):
                angle = 2 * math.pi * (k + radius) / count
                ring = radius * self._reach_um * np.array([math.cos(angle), math.sin(angle)])
                await self._visit(offset + ring)
        if len(self.sightings) < MIN_SIGHTINGS:
            raise ValueError(f"the target was seen from {len(self.sightings)} places only; {MIN_SIGHTINGS} are needed")
        rough = self._fit((0.0, 0.0))
        below_px = await self._below_tip(rough)
        return self._fit(below_px)

    async def _approach(self) -> Array:
        """Find the target, learn the map's linear part by small steps, and return where the head is over it."""
        start, seen = await self._first_seen(np.zeros(2), SEARCH_STEPS)
        along_x, seen_x = await self._first_seen(start, FIRST_STEPS[0])
        along_y, seen_y = await self._first_seen(start, FIRST_STEPS[1])
        steps = np.column_stack([along_x - start, along_y - start])
        px_per_um = np.column_stack([seen_x - seen, seen_y - seen]) @ np.linalg.inv(steps)
        if abs(np.linalg.det(px_per_um)) < LEAST_SCALE:
            raise ValueError("the picture hardly moves with the head; check that the camera sees the board")
        # Where the head must go so that the target appears at the tip; it is only the centre of the walk.
        offset = start + np.linalg.solve(px_per_um, np.array(self.tip_px) - seen)
        length = float(np.linalg.norm(offset))
        return np.asarray(offset * min(1.0, self._reach_um / length), dtype=float)

    async def _first_seen(self, start: Array, steps: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
        """Try places beside `start` until tip and target are both seen; return the place and the target's pixel."""
        for step in steps:
            place = start + np.array(step)
            seen = await self._visit(place)
            if seen is not None:
                return place, seen
        raise Fault(Kind.TEST_POINT_NOT_FOUND, f"{self._point.name} was not seen with the tip: {self._why_unseen}")

    async def _below_tip(self, rough: PoseMap) -> tuple[float, float]:
        """Measure the oblique view's parallax between working and touching height, beside the target."""
        heights = self._bench.config.gantry
        clear = self._clear_side(rough)
        await self._go(self._shifted(*clear))
        level = self._shifted(*clear)
        at_work = await self._see()
        await self._go(Position(level.x_um, level.y_um, heights.touch_z_um, level.theta_deg))
        at_touch = await self._see()
        await self._go(level)
        if at_work is None or at_touch is None:
            raise ValueError("the target was lost while lowering the needle")
        dx, dy = at_work - at_touch
        return float(dx), float(dy)

    def _clear_side(self, rough: PoseMap) -> Array:
        """Choose the sighting farthest from the needle's body: below the tip in the needle's own direction."""
        probe = self._bench.calibrations.require_probe()
        along = np.array([math.cos(probe.angle_rad), math.sin(probe.angle_rad)])
        want_px = np.array(self.tip_px) + along * self._point.diameter_um * 1.2 * rough.scale_px_per_um(self.tip_px)
        best = min(self.sightings, key=lambda s: float(np.linalg.norm(np.array(s.target_px) - want_px)))
        return np.array([best.x_um - self._over.x_um, best.y_um - self._over.y_um])

    async def _visit(self, offset_um: Array) -> Array | None:
        """Go to a place beside the target and log where it appears; None where needle or background hide it."""
        await self._go(self._shifted(float(offset_um[0]), float(offset_um[1])))
        return await self._see()

    async def _go(self, target: Position) -> None:
        if self._verifying:
            self._job.fire(Event.OFF_TARGET)
        self._job.moves += 1
        self._position = await self._bench.station.go(target, self._job.watch, self._job.deadline)
        self._job.fire(Event.ARRIVED)
        self._verifying = True

    async def _see(self) -> Array | None:
        """Take one look; return the target's pixel, logging it with the head's position; None if it is not seen."""
        look = await self._look()
        target = look.seen.nearest if look.seen is not None else None
        self._job.note("look", describe(look, target if isinstance(target, TestPoint) else None, None))
        if not isinstance(look.tip, Tip) or not isinstance(target, TestPoint):
            missing = look.tip if not isinstance(look.tip, Tip) else target
            if isinstance(missing, NotFound):
                self._why_unseen = missing.message
                refuse_unusable(missing)
            return None
        if target.visible < MIN_VISIBLE:
            self._why_unseen = "the needle hides too much of it"
            return None
        position = look.position
        at = self._as_if_unbent(look.tip, target)
        if abs(position.z_um - self._bench.config.gantry.work_z_um) < HEIGHT_WINDOW_UM:
            self.sightings.append(Sighting(at, position.x_um, position.y_um, position.theta_deg))
        return np.array(at)

    def _as_if_unbent(self, tip: Tip, target: TestPoint) -> tuple[float, float]:
        """Return the target's pixel as in the first look: from stop to stop, camera and needle flex together."""
        if math.isnan(self.tip_px[0]):
            self.tip_px = (tip.x_px, tip.y_px)
        return target.x_px - tip.x_px + self.tip_px[0], target.y_px - tip.y_px + self.tip_px[1]

    async def _look(self) -> Look:
        bench, job = self._bench, self._job
        expected_px = self._point.diameter_um / 2 / bench.config.camera.pitch_um
        search = Search((0.0, 0.0), self._reach_px, expected_px)
        probe = bench.calibrations.require_probe()
        look = await bench.station.look(self._position, probe, search, job.watch, job.deadline)
        job.saw(look)
        return look

    def _shifted(self, dx_um: float, dy_um: float) -> Position:
        over = self._over
        return Position(over.x_um + dx_um, over.y_um + dy_um, over.z_um, over.theta_deg)

    def _fit(self, below_px: tuple[float, float]) -> PoseMap:
        work_z_um = self._bench.config.gantry.work_z_um
        return fit_pose_map(self.sightings, tip_px=self.tip_px, below_tip_px=below_px, work_z_um=work_z_um)
