"""Point under test: where the needle stands over it, what was read in each press, and what it may still bear.

Its movements keep the rules: sideways only with the needle up, a press only from where it hovers, and what a look has
seen below the tip counts until something but Z moves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointReading, PointTest, PointVerdict, Rung
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.aiming import require_tip
from daemon.procedures.basic import ARRIVED_WITHIN_UM
from daemon.procedures.correct import Landed, bring_onto
from daemon.procedures.descent import Ground, hover_free, remember_free
from daemon.procedures.head_angle import other_views, reachable
from daemon.procedures.height import StoodOn
from daemon.procedures.judging import Judged, Taken, accuses, any_pad_passes, believed, proved
from daemon.procedures.ladder import Attempt, Situation
from daemon.procedures.meter_readings import AGAINST_GROUND, MeterReadings
from daemon.procedures.pad_sites import on_metal_within_um
from daemon.procedures.pad_touch import Budget, PadTouch
from daemon.procedures.point_faults import CONTRADICTED, SURE_LOOKS
from daemon.procedures.press_readers import PressReader
from daemon.procedures.seat_state import seat_shifts
from daemon.procedures.tare import what_was_read
from daemon.procedures.touched_pad import TouchedPad
from daemon.station.needle_health import NeedleHealth
from drivers.gantry import Position

ANOTHER_SIDE = frozenset(
    {
        FaultCode.NOT_THIS_BOARD, FaultCode.NO_BOARD, FaultCode.WRONG_PLACE, FaultCode.AMBIGUOUS, FaultCode.DISAGREE,
        FaultCode.TARGET_NOT_CONFIRMED, FaultCode.TEST_POINT_NOT_FOUND, FaultCode.UNDECIDED, *CONTRADICTED,
    }
)  # fmt: skip
"""What a look from one side may fail of, and from another not: the needle, its shadow, a glint, a poor view."""

NAMES_NO_NET = AGAINST_GROUND | {"contact"}
"""What a pad of another net would answer as well: that the needle stands on this one, only a look can say."""


class PointUnderTest:
    """One point, from the first move to the last lift."""

    def __init__(
        self,
        job: JobContext,
        context: StationContext,
        test: PointTest,
        point: BoardPoint,
        pad: TouchedPad,
        budget: Budget,
        reader: PressReader,
        meter: MeterReadings | None,
        health: NeedleHealth,
    ) -> None:
        self.job, self.context, self.test, self.point = job, context, test, point
        self.pad, self.budget, self.reader, self.meter, self.health = pad, budget, reader, meter, health
        self.attempts: list[Attempt] = []
        self.readings: list[PointReading] = []
        self.spent: set[Rung] = set()
        self.done: Mapping[str, PointVerdict] = {}
        """Points that have their verdict in this run, with it; they are touched no more."""
        self.touches = self.elsewhere = self.contradictions = 0
        """Descents onto its pad, and onto other points of its net; sides that, one after the other, showed the board to
        lie otherwise."""
        self.error_um: float | None = None
        """By how much the first look saw the tip off."""
        self.sigma_um: float | None = None
        self.doubt = ""
        """Why what was read last could not be believed, in words."""
        self.joined = ""
        """That a net beside the point is joined to its own, in words."""
        self.metal_um = on_metal_within_um(point, context.servo)
        names_no_net = test.method in NAMES_NO_NET or any_pad_passes(test)
        self.must_be_seen = budget.pressed_before or test.look == "first" or names_no_net
        """Whether a look comes before the first touch: no pad is pressed again before it was seen below the tip."""
        self.begin_at_deg = test.theta_deg
        """Of the head at the first touch; None: as it stands. Another view may turn it where the test wants none."""
        self._stays_since = 0
        """Number of the first press since the head last moved sideways."""
        self._standing: PadTouch | None = None
        self._seen = self._looked = False
        self._offset_um = (0.0, 0.0)

    @property
    def is_down(self) -> bool:
        """Whether the needle stands on the pad."""
        return self._standing is not None

    @property
    def may_be_pumped(self) -> bool:
        """Whether the needle stands where a look has shown the pad."""
        return self._standing is not None and self._seen

    def situation(self) -> Situation:
        """Return what the ladder goes by."""
        return Situation(
            tuple(self.attempts), frozenset(self.spent), self.may_be_pumped, self.budget.touches, self.budget.presses,
            self.health.good_within(self.context.config.ladder.reference_good_s, what_was_read(self.context)),
            self.health.suspected_at(self.test.point), self.path_proved,
        )  # fmt: skip

    @property
    def path_proved(self) -> bool:
        """Whether by what all that accuses was read is known to read."""
        return all(self.reader.path_proved(judged) for judged in {one.judged for one in self.attempts if one.accuses})

    # --- movements ---------------------------------------------------------------------------------------------

    def over(self, theta_deg: float) -> Position:
        """Return where the head puts the tip over the point, at the height of looks."""
        return self.context.geometry.position_over(self.point.place_um, theta_deg)

    async def place(self) -> Position:
        """Put the tip over the point by calibration alone."""
        here = await self.context.station.last_position(self.job)
        return await self._go_over(reachable(self.context, self.over, here, self.begin_at_deg))

    async def _go_over(self, target: Position) -> Position:
        job, context = self.job, self.context
        self._ground(target)
        self._stays_since = len(self.attempts)
        if context.by_cad and (self.must_be_seen or self.attempts):
            context.references.begin(self.point.place_um, seat_shifts(context))  # drawn while the head travels
        await context.station.may_go(target, job)
        job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
        job.moves += 1
        reached = await context.station.go(
            target, job, slow_z_um=context.geometry.slow_z_um(target), clear=await context.clearance.by_calibration()
        )
        job.fire(Event.ARRIVED)
        away_um = math.dist((reached.x_um, reached.y_um, reached.z_um), (target.x_um, target.y_um, target.z_um))
        if away_um > ARRIVED_WITHIN_UM:
            raise Fault(FaultCode.MOTION_FAILED, f"the axes stand {away_um:.0f} um from where they were sent")
        job.note("move", {"x_um": round(target.x_um, 2), "y_um": round(target.y_um, 2), "theta_deg": target.theta_deg})
        return reached

    async def see(self, here: Position, site: BoardPoint | None = None, stood: StoodOn | None = None) -> Landed:
        """Bring the tip onto the point, or another site of its pad, seen to be there.

        What cannot be seen from here may be seen from another side, unless the test wants this angle. `stood`: the
        needle was just lifted off something; raised where it stood on the pad all the same.
        """
        first, self._looked = not self._looked, True
        if first:
            self.job.first_look = None  # the one that shows how far off the tip was is the first that matters
        try:
            landed = await self._seen_from(here, site or self.point, stood)
            if first and not landed.begun_elsewhere:
                self.error_um = round(landed.before_um, 1)
            return landed
        except Fault as fault:
            if not self._another_side_may_show(fault) or self.test.theta_deg is not None:
                raise
            unseen = fault
        for target in other_views(self.context, self.over, here):
            try:
                landed = await self._seen_from(await self._go_over(target), site or self.point)
                return replace(landed, begun_elsewhere=True)
            except Fault as fault:
                if not self._another_side_may_show(fault):
                    raise
        raise unseen

    def _another_side_may_show(self, fault: Fault) -> bool:
        """Return whether another side may show what this one did not: not once two show the board to lie otherwise."""
        self.contradictions += fault.kind in CONTRADICTED
        return fault.kind in ANOTHER_SIDE and self.contradictions < SURE_LOOKS

    async def _seen_from(self, here: Position, point: BoardPoint, stood: StoodOn | None = None) -> Landed:
        job, context = self.job, self.context
        try:
            landed = await bring_onto(job, context, here, point, context.require_map(), astray=True, stood=stood)
        except Fault as fault:
            if fault.kind is not FaultCode.NOT_CONVERGING:
                raise
            # A way that ended beside its place makes one step grow; the next one may go well.
            here, self._stays_since = await context.station.position(job), len(self.attempts)
            landed = await bring_onto(job, context, here, point, context.require_map(), astray=True)
            landed = replace(landed, begun_elsewhere=True)
        self.health.points_unseen = self.contradictions = 0
        if landed.steps:
            self._stays_since = len(self.attempts)
        self.sigma_um = round(landed.aim.correction.sigma_um, 2)
        self._seen = True
        self._offset_um = point.x_um - self.point.x_um, point.y_um - self.point.y_um
        return landed

    async def touch(self, here: Position, rung: Rung, press_um: float) -> None:
        """Lower the needle from where it hovers, and read."""
        await self.context.station.see_lifted(self.job)  # where the pin stands now is else no place of a free one
        look = self.job.last_look
        above = here if self._seen and look is not None and look.position == here else await self._hover(here)
        ground = self._ground(above)
        if self._seen and self.job.last_look is not None:
            remember_free(self.context, require_tip(self.job.last_look), above, ground.pose_map)
        standing = PadTouch(self.job, self.context, self.pad, self.budget, self.reader, above, ground, press_um)
        self._standing = standing
        self.touches += 1
        contact, taken = await standing.down(rung)
        self._note(rung, contact.pressed_um, contact.force_n, taken)

    async def _hover(self, here: Position) -> Position:
        """See the needle free where it is, and return that place; one that came down beside the pad is brought to it.

        One whose tip is not seen from this side is looked at from another, unless the test wants this angle, or the pad
        was seen from here: from another side nothing vouches for where the needle would be pressed.
        """
        try:
            return await hover_free(self.job, self.context, here, self._ground(here))
        except StoodOn as stood:
            return (await self.see(stood.freed, stood=stood)).aim.look.position
        except Fault as fault:
            if fault.kind is not FaultCode.TIP_NOT_FOUND or self.test.theta_deg is not None or self._seen:
                raise
            unseen = fault
        for target in other_views(self.context, self.over, here):
            try:
                turned = await self._go_over(target)
                return await hover_free(self.job, self.context, turned, self._ground(turned))
            except Fault as fault:
                if fault.kind is not FaultCode.TIP_NOT_FOUND:
                    raise
        raise unseen

    async def stroke(self) -> None:
        """Push the pin in once more where the needle stands, and read."""
        if self._standing is not None:
            contact, taken = await self._standing.stroke()
            self._note(Rung.PUMP, contact.pressed_um, contact.force_n, taken)

    async def lift(self) -> Position:
        """Lift the needle if it stands; return where the head is. What was seen before a press counts no longer."""
        standing, self._seen = self._standing, False
        if standing is None:
            return await self.context.station.position(self.job)
        await standing.up()
        self._standing = None  # not before: a lift that fails leaves it standing
        return standing.above

    async def see_where_it_was(self, here: Position) -> Landed:
        """Look from where the needle was lifted; the presses there are vouched for if it stood on the pad's metal."""
        since = self._stays_since
        landed = await self.see(here)
        if self.metal_um is not None and not landed.begun_elsewhere and landed.before_um < self.metal_um:
            here_pressed = [one.vouched_for() for one in self.attempts[since:]]
            self.attempts = [*self.attempts[:since], *here_pressed]
        return landed

    def is_over(self, here: Position) -> bool:
        """Whether the head stands near enough to the point to look for it there."""
        away_um = math.hypot(*self.context.geometry.from_tip_um(self.point.place_um, here))
        return away_um <= self.context.servo.max_placement_um

    # --- what they are made of ---------------------------------------------------------------------------------

    def _ground(self, at: Position) -> Ground:
        """Return what lies below the tip; raise `Fault` where this board's surface was not measured."""
        geometry = self.context.geometry
        height_um = geometry.measured_um(geometry.tip_um(at))
        if height_um is None:
            raise geometry.unmeasured(self.test.point)
        metal_um = height_um + (self.point.stands_um or 0.0)
        return Ground(self.context.require_map(), self.context.gantry.touch_z_um + metal_um)

    def _note(self, rung: Rung, pressed_um: float, force_n: float, taken: Taken) -> None:
        """Keep what was read in one press."""
        ladder = self.context.config.ladder
        judged = believed(taken, self.test, ladder)
        self.joined = taken.joined or self.joined
        to_be_seen = judged is Judged.PASS and bool(taken.joined) and not self._seen
        judged = Judged.UNPROVED if to_be_seen else judged
        accused = accuses(taken, self.test, ladder, judged)
        self.attempts.append(Attempt(rung, judged, accused, self._seen, bool(taken.doubt), passes_seen=to_be_seen))
        self.doubt = taken.doubt or self.doubt
        contact_ohm = taken.contact_ohm
        flows = contact_ohm is not None and not math.isinf(contact_ohm)
        self.readings.append(
            PointReading(
                rung=rung, site_um=self._offset_um, pressed_um=pressed_um, force_n=force_n,
                proof=proved(taken, ladder), contact_ohm=_rounded(contact_ohm) if flows else None, seen=self._seen,
                tare_ohm=_rounded(taken.tare.ohm) if taken.tare is not None else None,
                tare_age_s=round(taken.tare.age_s, 1) if taken.tare is not None else None,
                value=_rounded(taken.value), overload=taken.overload, unit=taken.unit, said=taken.said,
            )
        )  # fmt: skip


def _rounded(value: float | None) -> float | None:
    """Return six digits of a value, which is more than any such contact is good for."""
    return None if value is None else float(f"{value:.6g}")
