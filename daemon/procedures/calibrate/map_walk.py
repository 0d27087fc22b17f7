"""Map acquisition: walk round one resting target and learn the map from image to robot (thesis 6.2).

First by small fixed steps along both axes (table 6.1), then by what those taught over the whole region a correction
may come from, then far out: a look registers the board over many times that region, and near the tip the stops' flex
hides what bends a map. At the end the head is lifted beside the target: how far its image then moves is how far the
place below the hovering tip lies from the tip's own image. It is lifted, not lowered: no surface is touched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.calibrate.far_places import FAR_COUNT, FAR_REACH_PX, far_places, in_picture, may_stand
from daemon.procedures.calibrate.targets import CalibrationTarget, Sighting
from daemon.procedures.height import require_free
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.procedures.surface_touch import tip_px
from drivers.gantry import Position
from vision.geometry import Array, MapPoint, PoseMap, fit_pose_map

TABLE_6_1: Final = ((10.0, 300.0), (6.0, 200.0), (4.0, 100.0), (3.0, 50.0), (0.0, 30.0))
"""Distance seen, px, from which on a step is so long, um."""
SEARCH_UM: Final = 500.0
SEARCH_STEPS = ((0.0, 0.0), *((SEARCH_UM * math.cos(a), SEARCH_UM * math.sin(a)) for a in np.linspace(0.4, 6.0, 7)))
"""Where to stand for the first sighting: over the target, else round it, for the needle may hide it."""
LEAST_SCALE = 1e-4
"""px/um squared; an image that moves less with the head does not show the target."""
RINGS = ((0.45, 6), (0.95, 10))
"""Places round the target: share of the largest placement error, and how many on that circle."""
FIRST_STEPS = 3
MIN_SIGHTINGS = 9
LEAST_FAR = 3
"""Fewer far ones cannot show which of them is wrong, and a wrong one bends the map near the tip as well."""
LIFTS = 3
"""How often the lift is measured; without X and Y moving in between only the camera's noise differs."""
TOUCHED_PX = 1.5
"""A tip that stands so much higher than above the surface is pushed in; the camera's noise alone is a tenth of it."""
LIFT_REACH_PX = 20.0
"""Lifting by the hovering height moves the image by about half of this."""


def table_step_um(seen_px: float) -> float:
    """Return the fixed step of table 6.1, um, for a distance seen in the image."""
    return next(step_um for from_px, step_um in TABLE_6_1 if seen_px >= from_px)


def beside(step_um: float) -> list[float]:
    """Return the ways to both sides, um, until one shows the target: by this step, then by the longer ones.

    A target beside the needle, hidden just not too much, may be so at both ends of a short step; of a long one it is
    clear of the needle at one end.
    """
    lengths_um = sorted({step_um, *(longer for _, longer in TABLE_6_1 if longer > step_um), SEARCH_UM})
    return [side * length_um for length_um in lengths_um for side in (1.0, -1.0)]


class MapAcquisition:
    """The way of the head round the target, and what was seen from each place."""

    def __init__(self, sequence: MoveSequence, target: CalibrationTarget, theta_deg: float) -> None:
        self._sequence, self._target = sequence, target
        self._job, self._context = sequence.job, sequence.context
        geometry, gantry = self._context.geometry, self._context.gantry
        over = geometry.position_at(target.place_um, theta_deg)
        height_um = (geometry.measured_um(target.place_um) or 0.0) + geometry.stands_um(target.place_um)
        self.over = replace(over, z_um=gantry.work_z_um + height_um)
        self._reach_um = self._context.servo.max_placement_um
        self._reach_px = 2 * self._reach_um / self._context.camera.pitch_um
        self._hover_um = self._context.gantry.work_z_um - self._context.gantry.touch_z_um
        self.tip_px = self._context.calibrations.require_probe().tip_px
        angle = self._context.calibrations.require_probe().angle_rad
        self._needle = np.array([math.cos(angle), math.sin(angle)])
        """Direction of the needle in the picture, towards its end."""
        self._slow_um: float | None = None
        """Z below which the needle may meet the surface: known once it hovered over the target and was free."""
        self._why_unseen = ""
        self.sightings: list[MapPoint] = []

    def extremes(self) -> list[Position]:
        """Return the corners of what has to be in reach, so that the envelope is checked before the first step.

        Far places are not among them: those out of reach are left out.
        """
        r = 2 * self._reach_um
        return [shifted(self.over, dx, dy, dz) for dx in (-r, r) for dy in (-r, r) for dz in (0.0, self._hover_um)]

    async def come_down(self) -> None:
        """Come to working height over a surface whose height is not known: slowly, and seen to be free there.

        X and Y stand still meanwhile, so that camera and needle flex alike in both looks. Raises `Fault` if the pin is
        pushed in; the needle is then lifted again.
        """
        sequence, gantry = self._sequence, self._context.gantry
        known = self._context.geometry.measured_um(self._target.place_um) is not None
        if known or self.over.z_um >= gantry.free_z_um:
            return
        above = replace(self.over, z_um=gantry.free_z_um)
        free = await self._tip_px(above)
        here = await self._tip_px(self.over)
        risen_px = float(np.dot(free - here, self._needle))
        if risen_px > TOUCHED_PX:
            await sequence.go(above)
            raise Fault(
                FaultCode.WRONG_HEIGHT,
                f"{self._target.name} lies higher than it should: at working height the tip stands {risen_px:.1f} px "
                "higher in the picture than above it",
                advice="correct gantry.touch_z_um and work_z_um, or see that nothing lies below the board",
                pushed_px=round(risen_px, 1),
            )
        self._slow_um = self.over.z_um

    async def _tip_px(self, place: Position) -> Array:
        """Go there and return where the tip is in the image, (2,) px; without a tip no target can be seen either."""
        position = await self._sequence.go(place)
        try:
            return await tip_px(self._sequence, position, measured=True)
        except Fault as unseen:
            if unseen.kind is not FaultCode.TIP_NOT_FOUND:
                raise
            await self._sequence.go(replace(place, z_um=max(place.z_um, self._context.gantry.free_z_um)))
            text = f"{self._target.name} was not seen with the tip: {unseen.message}"
            raise Fault(FaultCode.TEST_POINT_NOT_FOUND, text) from unseen

    async def run(self, most_left_um: float) -> PoseMap:
        """Go, see, fit; raise ValueError if that gives no map.

        Far sightings with which the fit would leave more than `most_left_um`, rms, are left out.
        """
        offset = await self._approach()
        for radius, count in RINGS:
            for k in range(count):
                angle = 2 * math.pi * (k + radius) / count
                away_um = offset + radius * self._reach_um * np.array([math.cos(angle), math.sin(angle)])
                await self._visit(shifted(self.over, *away_um))
                self._progress()
        if len(self.sightings) < MIN_SIGHTINGS:
            raise ValueError(
                f"{self._target.name} was seen from {len(self.sightings)} places only; {MIN_SIGHTINGS} are needed: "
                f"{self._why_unseen}"
            )
        rough, near = self._fit((0.0, 0.0), 0.0), tuple(self.sightings)
        await self._go_far(rough, near, offset)
        if not self._far_ones_agree(near, most_left_um):
            self.sightings = list(near)
        lifts = await self._lift(rough, near)
        x, y = lifts.mean(axis=0)
        return self._fit((float(x), float(y)), float(lifts.std(axis=0, ddof=1).mean()) / math.sqrt(LIFTS))

    def _progress(self) -> None:
        total = FIRST_STEPS + sum(count for _, count in RINGS) + FAR_COUNT
        self._job.progress(len(self.sightings), total, f"map on {self._target.name}")

    async def _go_far(self, rough: PoseMap, near: Sequence[MapPoint], offset: Array) -> None:
        """See the target far from the tip, where the map of what is near it says that it is."""
        for place in far_places(shifted(self.over, *offset)):
            expected_px = self._expected_px(rough, near, place)
            inside = in_picture(self._context, self._target.size_um, expected_px)
            if not inside or not await may_stand(self._context, place):
                continue
            away_px = expected_px - np.array(self.tip_px)
            try:
                await self._visit(place, (float(away_px[0]), float(away_px[1])), FAR_REACH_PX)
            except Fault as unusable:
                # Glare or shadow of that place alone; a lamp that is out is told near the tip, by the lift's looks
                if unusable.kind is not FaultCode.FRAME_UNUSABLE:
                    raise
            self._progress()

    def _expected_px(self, rough: PoseMap, near: Sequence[MapPoint], place: Position) -> Array:
        """Return where the target is in the image from a place of the head, (2,) px.

        The median leaves out near sightings of another thing, as the fit does.
        """
        away = [rough.from_tip_um(s.target_px, self.tip_px, s.theta_deg) for s in near]
        there = [(s.x_um, s.y_um) for s in near]
        away_um = np.median(np.add(there, away), axis=0) - (place.x_um, place.y_um)
        return np.asarray(rough.to_px(away_um, self.tip_px, place.theta_deg)[0])

    def _far_ones_agree(self, near: Sequence[MapPoint], most_left_um: float) -> bool:
        """Whether a map goes through near and far sightings alike: a lens may bend the picture as no plane does."""
        if len(self.sightings) - len(near) < LEAST_FAR:
            return False
        try:
            return self._fit((0.0, 0.0), 0.0).residual_um <= most_left_um
        except ValueError:
            return False

    async def _approach(self) -> Array:
        """Find the target, learn the map's linear part by small steps, and return where the head is over it."""
        start, seen = await self._first_seen(np.zeros(2), SEARCH_STEPS)
        step_um = table_step_um(math.dist(seen, self.tip_px))
        ways_um = beside(step_um)
        along_x, seen_x = await self._first_seen(start, [(way_um, 0.0) for way_um in ways_um])
        along_y, seen_y = await self._first_seen(start, [(0.0, way_um) for way_um in ways_um])
        steps = np.column_stack([along_x - start, along_y - start])
        px_per_um = np.column_stack([seen_x - seen, seen_y - seen]) @ np.linalg.inv(steps)
        if abs(np.linalg.det(px_per_um)) < LEAST_SCALE:
            raise ValueError("the picture hardly moves with the head; check that the camera sees the mark")
        # Where the head must go so that the target appears at the tip; it is only the centre of the walk.
        offset = start + np.linalg.solve(px_per_um, np.array(self.tip_px) - seen)
        length = float(np.linalg.norm(offset))
        return np.asarray(offset * min(1.0, self._reach_um / length), dtype=float)

    async def _first_seen(self, start: Array, steps: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
        """Try places beside `start` until tip and target are both seen; return the place and the target's pixel."""
        for step in steps:
            place = start + np.array(step)
            seen = await self._visit(shifted(self.over, *place))
            if seen is not None:
                return place, seen
        kind = FaultCode.TEST_POINT_NOT_FOUND
        raise Fault(kind, f"{self._target.name} was not seen with the tip: {self._why_unseen}")

    async def _lift(self, rough: PoseMap, near: Sequence[MapPoint]) -> Array:
        """Measure the oblique view's parallax by lifting the head beside the target; (LIFTS, 2) px."""
        level = shifted(self.over, *self._clear_side(rough, near))
        seen = []
        for _ in range(LIFTS):
            low = await self._not_lost(level, (0.0, 0.0), self._reach_px)
            from_tip_px = low.target_px[0] - self.tip_px[0], low.target_px[1] - self.tip_px[1]
            high = await self._not_lost(shifted(level, dz_um=self._hover_um), from_tip_px, LIFT_REACH_PX)
            seen.append(np.subtract(high.target_px, low.target_px))
        return np.array(seen)

    async def _not_lost(self, place: Position, offset_px: tuple[float, float], reach_px: float) -> Sighting:
        """Go there and see the target; raise ValueError if it is not seen."""
        sighting = await self._see(await self._sequence.go(place, slow_z_um=self._slow_um), offset_px, reach_px)
        if sighting is None:
            raise ValueError(f"{self._target.name} was lost while the needle was lifted beside it: {self._why_unseen}")
        return sighting

    def _clear_side(self, rough: PoseMap, near: Sequence[MapPoint]) -> tuple[float, float]:
        """Choose one of the near sightings beside the needle, across its direction.

        The needle does not hide the target there; and across the view the parallax is what it is at the tip itself,
        which along the view it is not.
        """
        probe = self._context.calibrations.require_probe()
        scale = rough.scale_px_per_um(self.tip_px)
        way_px = min(self._target.size_um / 2 * scale + probe.shape.cylinder_half_px, self._reach_px / 2)
        across = np.array([-math.sin(probe.angle_rad), math.cos(probe.angle_rad)])
        wanted = [np.array(self.tip_px) + side * way_px * across for side in (-1, 1)]
        best = min(near, key=lambda s: min(math.dist(s.target_px, want) for want in wanted))
        return best.x_um - self.over.x_um, best.y_um - self.over.y_um

    async def _visit(
        self, place: Position, offset_px: tuple[float, float] = (0.0, 0.0), reach_px: float | None = None
    ) -> Array | None:
        """Go to a place and log where the target appears; None where needle or background hide it.

        It is sought within `reach_px` (by default as far as a correction may come from) of `offset_px` from the tip.
        """
        reach_px = self._reach_px if reach_px is None else reach_px
        sighting = await self._see(await self._sequence.go(place, slow_z_um=self._slow_um), offset_px, reach_px)
        if sighting is None:
            return None
        at = sighting.position
        self.sightings.append(MapPoint(sighting.target_px, at.x_um, at.y_um, at.theta_deg))
        return np.array(sighting.target_px)

    async def _see(self, position: Position, offset_px: tuple[float, float], reach_px: float) -> Sighting | None:
        """Look once; remember why if the target is not seen. By a map that is in force the pin is seen to be free."""
        seen = await self._target.see(self._job, self._context, position, offset_px, reach_px)
        if (known := self._context.calibrations.pose_map) is not None:
            await require_free(self._job, self._context, known, self._sequence.go)
        if isinstance(seen, Sighting):
            return seen
        self._why_unseen = seen.why
        return None

    def _fit(self, below_px: tuple[float, float], below_sigma_px: float) -> PoseMap:
        return fit_pose_map(
            self.sightings,
            tip_px=self.tip_px,
            below_tip_px=below_px,
            below_sigma_px=below_sigma_px,
            work_z_um=self._context.gantry.work_z_um,
            hover_um=self._hover_um,
        )
