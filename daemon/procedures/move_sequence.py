"""Move sequence of a job: every move with the look after it is one round of move and verify."""

from __future__ import annotations

from daemon.domain.states import Event
from daemon.jobs.context import JobContext, StationContext
from drivers.gantry import Position

BELOW: frozenset[str] = frozenset()
"""The rule: all axes come to a place from below."""


class MoveSequence:
    """Go to one place after the other; the job must be in `look` when the sequence begins."""

    def __init__(self, job: JobContext, context: StationContext) -> None:
        self.job, self.context = job, context
        self._under_way = False

    async def go(
        self, target: Position, *, from_above: frozenset[str] = BELOW, slow_z_um: float | None = None
    ) -> Position:
        """Move and return where the drives say the head is; the white lamp is switched on ahead.

        `slow_z_um`: Z below which it goes down slowly; None: where this board's surface may be.
        """
        job, station = self.job, self.context.station
        station.check(target)
        await station.may_go(target, job)
        job.fire(Event.OFF_TARGET if self._under_way else Event.SEEN)
        self._under_way = True
        await station.prepare_white(job)
        job.moves += 1
        slow_um = self.context.geometry.slow_z_um(target) if slow_z_um is None else slow_z_um
        position = await station.go(target, job, from_above=from_above, slow_z_um=slow_um)
        job.note("move", {"x_um": round(target.x_um, 2), "y_um": round(target.y_um, 2), "theta_deg": target.theta_deg})
        job.fire(Event.ARRIVED)
        return position


def shifted(position: Position, dx_um: float = 0.0, dy_um: float = 0.0, dz_um: float = 0.0) -> Position:
    """Return a place beside another."""
    return Position(position.x_um + dx_um, position.y_um + dy_um, position.z_um + dz_um, position.theta_deg)
