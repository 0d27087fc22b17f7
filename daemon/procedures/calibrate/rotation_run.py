"""Run over the head angles: go, look, correct, write down; and go on where an interrupted run ended.

What was measured is kept on disk after every angle. A run is continued only if its last stop is still where it was,
and is closed by visiting its first angle again: nothing may have moved meanwhile. A run that was refused is forgotten.
"""

from __future__ import annotations

import asyncio
import math
import time
from dataclasses import dataclass, replace

import numpy as np
import structlog
from numpy.typing import ArrayLike

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.calibrate.commit import on_disk
from daemon.procedures.calibrate.targets import CalibrationTarget, Sighting
from daemon.procedures.height import require_free
from daemon.procedures.move_sequence import MoveSequence, shifted
from daemon.procedures.surface_touch import card_height_um
from daemon.station.kinematics import TRUSTED_UM
from daemon.storage.calibration_records import SeenTarget, Stop, TrialLanding
from daemon.storage.calibration_resume import Partial, Spent
from drivers.gantry import Position
from vision.geometry import Array, PoseMap
from vision.head import Head

NEAR_UM = 60.0
"""From this near one look measures the rest; from farther away the tip is walked nearer first."""
MAX_LOOKS = 3
ASIDE_UM = ((0.0, 0.0), (250.0, 0.0), (-250.0, 0.0), (0.0, 250.0), (0.0, -250.0))
"""Where else to stand when the needle hides the target."""
REACH_PX = 80.0
MAX_CLOSURE_UM = 40.0
"""Two stops at one place differ by less than this: five sigma of a station that repeats to 8 um."""
MAX_MISSED_SHARE = 0.15
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class MeasuredAngle:
    """What a run has brought so far."""

    card_height_um: float = 0.0
    stops: tuple[Stop, ...] = ()
    sightings: tuple[SeenTarget, ...] = ()


class RotationRun:
    """The visits of one run. `spare_steps`: what its owner will still do after `measure`, for the bar."""

    def __init__(
        self,
        sequence: MoveSequence,
        target: CalibrationTarget,
        pose_map: PoseMap,
        angles: list[float],
        *,
        spare_steps: int,
    ) -> None:
        self.target, self.measured, self.closure_um = target, MeasuredAngle(), math.nan
        self.complete = False
        """Whether all angles were visited: what is refused from then on would be refused again."""
        self._sequence, self._map, self._angles = sequence, pose_map, angles
        self._job, self._context = sequence.job, sequence.context
        self._steps = len(angles) + spare_steps + 1
        self._head: Head = sequence.context.geometry.head
        self._control_um: Array = np.asarray(target.place_um, dtype=float)
        """Where the target seems to be by the head known so far; it follows the run-out from stop to stop."""
        self.earlier = Spent()
        """What the legs before this one took."""
        self._began_s, self._looks_before = time.monotonic(), self._job.looks
        self._missed: list[float] = []
        self._touched = False
        """Whether the print's height was measured."""

    # --- the run ------------------------------------------------------------------------------------------------

    async def measure(self, *, resume: bool) -> bool:
        """Visit all angles and the first one again; return whether an interrupted run was continued."""
        resumed = resume and await self._resume()
        if not resumed:
            await self._begin()
        done = {s.theta_deg for s in self.measured.stops}
        for n, angle in enumerate(self._angles):
            if angle not in done:
                self._job.progress(n, self._steps, f"head angle {angle:.1f} deg")
                await self._visit(angle)
        self.complete = True
        await self._close()
        return resumed

    async def land(self, head: Head, control_um: ArrayLike, angles: list[float]) -> list[TrialLanding]:
        """Jump to the target by another head model, once an angle, and return where the tip came to be from it."""
        self._head, self._control_um = head, np.asarray(control_um, dtype=float)
        landings = []
        for n, angle in enumerate(angles):
            self._job.progress(self._steps - len(angles) + n, self._steps, f"landing at {angle:.1f} deg")
            place = self._over(angle)
            sighting = await self._look_from(place, REACH_PX)
            if isinstance(sighting, Sighting):
                dx_um, dy_um = self._off(sighting, place)
                landings.append(TrialLanding(theta_deg=angle, dx_um=-dx_um, dy_um=-dy_um))
        return landings

    async def _begin(self) -> None:
        """Find the target at the first angle, wherever it lies within reach, and measure how high its surface is."""
        self.measured, self._control_um = MeasuredAngle(), np.asarray(self.target.place_um, dtype=float)
        self._touched = False
        servo, camera = self._context.servo, self._context.camera
        first = await self._stop_at(self._angles[0], 2 * servo.max_placement_um / camera.pitch_um)
        if isinstance(first, str):
            raise _lost(f"the {self.target.name} was not seen at {self._angles[0]:.1f} deg: {first}")
        height_um = await card_height_um(self._sequence, self._map, self._over(self._angles[0]))
        self.measured = replace(self.measured, card_height_um=height_um)
        self._touched = self._context.gantry.press_um > 0.0

    async def _visit(self, angle: float) -> None:
        """Measure one angle and keep it; an angle may be missed, many may not."""
        found = await self._stop_at(angle, REACH_PX)
        if isinstance(found, str):
            self._missed.append(angle)
            if len(self._missed) > max(1.0, MAX_MISSED_SHARE * len(self._angles)):
                where = ", ".join(f"{a:.1f}" for a in self._missed)
                raise _lost(f"the {self.target.name} was not seen at {where} deg: {found}")
            return
        stop, seen = found
        so_far = self.measured
        self.measured = replace(so_far, stops=(*so_far.stops, stop), sightings=(*so_far.sightings, seen))
        await on_disk(self._partial().write, self._context.calibrations.folder)

    async def _close(self) -> None:
        """Visit the first angle again."""
        first = self.measured.stops[0]
        self._job.progress(len(self._angles), self._steps, f"again {first.theta_deg:.1f} deg")
        away = await self._moved_um(first)
        if isinstance(away, str):
            raise _lost(f"the {self.target.name} was lost at the end: {away}")
        self.closure_um = away
        if away > MAX_CLOSURE_UM:
            raise Fault(
                FaultCode.CALIBRATION_FAILED,
                f"at {first.theta_deg:.1f} deg the {self.target.name} is {away:.0f} um from where it was at the start",
                advice="it moved or an axis slipped: fix the print, `home`, and calibrate again",
                closure_um=round(away, 1),
            )

    async def forget(self) -> None:
        """Drop what is kept of this run, for it was refused: the next one measures again."""
        try:
            await asyncio.to_thread(Partial.forget, self._context.calibrations.folder)
        except OSError as exc:
            log.warning("run_not_forgotten", why=str(exc))

    # --- one angle ----------------------------------------------------------------------------------------------

    async def _stop_at(self, angle: float, reach_px: float) -> tuple[Stop, SeenTarget] | str:
        """Bring the tip onto the target at one head angle; return what was measured, or why it was not seen."""
        place, first_off_um, looks = self._over(angle), math.nan, 0
        while True:
            sighting = await self._look_from(place, reach_px)
            looks += 1
            if isinstance(sighting, str):
                return sighting
            dx_um, dy_um = self._off(sighting)
            off_um = math.hypot(dx_um, dy_um)
            if math.isnan(first_off_um):
                first_off_um = math.hypot(*self._off(sighting, place))
            at = sighting.position
            place = Position(at.x_um + dx_um, at.y_um + dy_um, place.z_um, place.theta_deg)
            if off_um <= NEAR_UM or looks == MAX_LOOKS:
                break
        self._control_um = np.add((place.x_um, place.y_um), self._head.tip_offset_um(angle))
        stop = Stop(theta_deg=angle, x_um=place.x_um, y_um=place.y_um, off_um=round(first_off_um, 2), looks=looks)
        return stop, SeenTarget(theta_deg=angle, target_px=sighting.target_px, x_um=at.x_um, y_um=at.y_um)

    async def _look_from(self, place: Position, reach_px: float) -> Sighting | str:
        """Go there and look; if the needle hides the target, look from beside; return why if no place shows it."""
        why = ""
        offset = self._map.below_px(self._height_um(place))
        for dx_um, dy_um in ASIDE_UM:
            position = await self._sequence.go(shifted(place, dx_um, dy_um), slow_z_um=self._slow_um)
            seen = await self.target.see(self._job, self._context, position, offset, reach_px)
            await require_free(self._job, self._context, self._map, self._sequence.go)
            if isinstance(seen, Sighting):
                return seen
            why = why or seen.why
        return why

    def _off(self, sighting: Sighting, place: Position | None = None) -> tuple[float, float]:
        """Return the way from the tip to the target, robot frame, um.

        `place`: the way from where the tip would be there instead; the head may have looked from beside.
        """
        tip_px = self._context.calibrations.require_probe().tip_px
        way = self._map.correction(
            sighting.target_px,
            tip_px,
            sighting.position.theta_deg,
            sighting.sigma_px,
            height_um=self._height_um(sighting.position),
        )
        if place is None:
            return way.dx_um, way.dy_um
        at = sighting.position
        return way.dx_um + at.x_um - place.x_um, way.dy_um + at.y_um - place.y_um

    def _over(self, angle: float) -> Position:
        """Return where the head should stand for the tip to be on the target, by all that is known so far."""
        x_um, y_um = self._control_um - self._head.tip_offset_um(angle)
        return Position(float(x_um), float(y_um), self._z_um, angle)

    @property
    def _z_um(self) -> float:
        """Z of every look: over the print as the map was made, or free of any until its height is measured.

        Over a low print it is working height all the same: for the rest of the station the needle is down below it.
        """
        gantry = self._context.gantry
        if self._touched:
            return gantry.work_z_um + max(0.0, self.measured.card_height_um)
        return max(gantry.work_z_um, gantry.free_z_um)

    @property
    def _slow_um(self) -> float:
        """Z below which the needle may meet the print."""
        gantry = self._context.gantry
        if self._touched:
            return gantry.touch_z_um + self.measured.card_height_um + TRUSTED_UM
        return gantry.highest_surface_um

    def _height_um(self, position: Position) -> float:
        """Return how much nearer to the head the print is than a nominal surface is at working height."""
        return self.measured.card_height_um - (position.z_um - self._context.gantry.work_z_um)

    async def _moved_um(self, stop: Stop) -> float | str:
        """Measure a stop again; return how far it is from where it was, or why it was not seen."""
        place = Position(stop.x_um, stop.y_um, self._z_um, stop.theta_deg)
        sighting = await self._look_from(place, REACH_PX)
        if isinstance(sighting, str):
            return sighting
        dx_um, dy_um = self._off(sighting)
        return math.dist((sighting.position.x_um + dx_um, sighting.position.y_um + dy_um), (stop.x_um, stop.y_um))

    # --- going on with an interrupted run -----------------------------------------------------------------------

    def _partial(self) -> Partial:
        """Return what to keep of this run."""
        context = self._context
        return Partial(
            station=context.config.station.name,
            probe=context.calibrations.fingerprint,
            map_made_at=str(context.calibrations.mapped_at),
            control_um=self.target.place_um,
            angles=tuple(self._angles),
            card_height_um=self.measured.card_height_um,
            stops=self.measured.stops,
            sightings=self.measured.sightings,
            spent=Spent(
                seconds=self.earlier.seconds + time.monotonic() - self._began_s,
                looks=self.earlier.looks + self._job.looks - self._looks_before,
                legs=self.earlier.legs + 1,
            ),
        )

    async def _resume(self) -> bool:
        """Take over what an interrupted run of the same kind left, if its last stop is still where it was."""
        partial = await asyncio.to_thread(Partial.read, self._context.calibrations.folder)
        if partial is None or not partial.stops or not partial.same_run(self._partial()):
            return False
        left = MeasuredAngle(partial.card_height_um, partial.stops, partial.sightings)
        self.measured, self._touched = left, self._context.gantry.press_um > 0.0
        last = left.stops[-1]
        away = await self._moved_um(last)
        if isinstance(away, str) or away > MAX_CLOSURE_UM:
            return False
        self.earlier = partial.spent
        self._control_um = np.add((last.x_um, last.y_um), self._head.tip_offset_um(last.theta_deg))
        return True


def _lost(fact: str) -> Fault:
    advice = "see that the printed cross lies flat, clean and uncovered at its place, then calibrate again"
    return Fault(FaultCode.CALIBRATION_FAILED, fact, advice=advice)
