"""Backlash of X and Y: come to one place from below and from above, and see where the tip ends up."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.calibrate.commit import Began, keep
from daemon.procedures.calibrate.targets import CalibrationTarget, Sighting
from daemon.procedures.move_sequence import BELOW, MoveSequence, shifted
from daemon.storage.calibration_records import AxisBacklash, BacklashRecord
from drivers.gantry import Position
from vision.geometry import PoseMap

REPEATS = 8
"""Of each side; with stops that scatter by 6 um an axis, the backlash is then known to 3 um."""
AWAY_UM = 400.0
REACH_PX = 120.0
Axis = Literal["x", "y"]


async def measure_backlash(
    job: JobContext, context: StationContext, target: CalibrationTarget, theta_deg: float
) -> Outcome:
    """Measure the backlash of X and Y on a resting target and store it, with the verdict on the one-sided approach."""
    context.calibrations.require_probe()
    pose_map = context.require_map()
    await context.station.require_homed(job)
    over = context.geometry.position_at(target.place_um, theta_deg)
    r = context.servo.max_placement_um + AWAY_UM
    for dx, dy in ((-r, -r), (r, r)):
        context.station.check(shifted(over, dx, dy))
    job.fire(Event.ACCEPTED)
    began = Began.now(job)
    visits = _Visits(MoveSequence(job, context), target, pose_map, over)
    x = await visits.axis("x", 0)
    y = await visits.axis("y", REPEATS)
    record = BacklashRecord(
        **began.facts(job, context), x=x, y=y, approach_um=context.gantry.approach_um
    )  # fmt: skip
    kept = await keep(job, context, record)
    return Outcome("calibrated", detail=_told(record) | kept)


class _Visits:
    """Visits of one place from both sides."""

    def __init__(self, sequence: MoveSequence, target: CalibrationTarget, pose_map: PoseMap, over: Position) -> None:
        self._sequence, self._target, self._map, self._over = sequence, target, pose_map, over

    async def axis(self, axis: Axis, done: int) -> AxisBacklash:
        """Visit the place from both sides in turn; drift between the two then counts for neither."""
        below, above = [], []
        for n in range(REPEATS):
            self._sequence.job.progress(done + n, 2 * REPEATS, f"play of {axis.upper()}")
            below.append(await self._tip_um(axis, -AWAY_UM, BELOW))
            above.append(await self._tip_um(axis, AWAY_UM, frozenset({axis})))
        backlash_um = float(np.mean(above) - np.mean(below))
        sigma_um = math.sqrt((np.var(above, ddof=1) + np.var(below, ddof=1)) / REPEATS)
        return AxisBacklash(
            from_below_um=tuple(below), from_above_um=tuple(above), backlash_um=backlash_um, sigma_um=float(sigma_um)
        )  # fmt: skip

    async def _tip_um(self, axis: Axis, from_um: float, from_above: frozenset[str]) -> float:
        """Come from one side; return where the tip then is along the axis, from the target."""
        sequence, probe = self._sequence, self._sequence.context.calibrations.require_probe()
        await sequence.go(shifted(self._over, **{f"d{axis}_um": from_um}), from_above=from_above)
        position = await sequence.go(self._over, from_above=from_above)
        height_um = sequence.context.geometry.height_below_um(position)
        below_px = self._map.below_px(height_um)
        sighting = await self._target.see(sequence.job, sequence.context, position, below_px, REACH_PX)
        if not isinstance(sighting, Sighting):
            raise Fault(
                FaultCode.CALIBRATION_FAILED,
                f"{self._target.name} was not seen: {sighting.why}",
                advice="choose a mark that stands alone, or see that the printed cross is uncovered",
            )
        way = self._map.correction(
            sighting.target_px, probe.tip_px, position.theta_deg, sighting.sigma_px, height_um=height_um
        )
        return -(way.dx_um if axis == "x" else way.dy_um)


def _told(record: BacklashRecord) -> dict[str, object]:
    """Return the figures for the answer, and whether the one-sided approach takes the backlash up."""
    worst_um = max(abs(a.backlash_um) + 3 * a.sigma_um for a in (record.x, record.y))
    return {
        "what": "backlash",
        "x_um": round(record.x.backlash_um, 1),
        "y_um": round(record.y.backlash_um, 1),
        "sigma_um": [round(record.x.sigma_um, 1), round(record.y.sigma_um, 1)],
        "approach_um": record.approach_um,
        "approach_enough": worst_um < record.approach_um,
    }
