"""Test of one point: place, touch, read, and the ladder where that is no pass; what comes of it is one record.

What a verdict can say is a verdict; a `Fault` is raised only for what must stop whoever tests the next point too: the
instrument fails, the needle is bad or may be down, the board is not the one, a drive is in trouble.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PASSES, PointRecord, PointTest, PointVerdict, Rung
from daemon.jobs.context import JobContext, StationContext
from daemon.platform.beside import beside
from daemon.platform.clock import utc_now
from daemon.procedures.board_in_nest import require_board
from daemon.procedures.judging import ALONG_NET, limits_of
from daemon.procedures.ladder import cause_of, next_step
from daemon.procedures.meter_readings import MeterReadings
from daemon.procedures.neighbour_nets import neighbour_nets
from daemon.procedures.pad_touch import Budget
from daemon.procedures.point_faults import BOARD_UNSEEN, CONTRADICTED, SAID_BY_A_VERDICT, SURE_LOOKS
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.press_readers import PressReader, StationReader, TesterHold, TesterReader, TesterSilent
from daemon.procedures.rungs import spent_from_the_start, take
from daemon.procedures.seat_state import void_seat
from daemon.procedures.sibling_point import why_path_unproved
from daemon.procedures.sites import sited
from daemon.procedures.touch_sense import leave_metal, refuse_closed_sense
from daemon.procedures.touched_pad import TouchedPad
from daemon.station.device_errors import as_fault
from daemon.station.needle_health import NeedleHealth
from drivers.errors import DeviceError

NOTHING_DONE: Mapping[str, PointVerdict] = MappingProxyType({})


async def admit_probing(job: JobContext, context: StationContext, board_id: str | None, *, tester: bool) -> None:
    """Check what every point needs, before anything is done; nothing moves. Call it while the job is `triggered`.

    `tester`: the tester measures, and the station needs no instrument of its own.
    """
    await context.station.require_homed(job)
    await refuse_closed_sense(job, context)
    await require_board(context, board_id)
    context.calibrations.require_probe()
    context.require_map()
    context.geometry.require_surface()
    if not tester or context.station.meter is not None:
        meter = MeterReadings(job, context)
        await meter.check()
        await _refuse_closed_proof(job, context, meter)


async def _refuse_closed_proof(job: JobContext, context: StationContext, meter: MeterReadings) -> None:
    """Raise `Fault` if the needle's two wires are joined before it went anywhere: by a board that came up, it may be.

    Where a look has just shown that it hovers, nobody asks.
    """
    here = await context.station.position(job)
    if context.station.needle.board.holds or here.z_um >= context.gantry.free_z_um:
        return

    async def joined() -> bool:
        return not math.isinf(await meter.least_between_wires())

    if await joined():
        await leave_metal(job, context, joined)
        await meter.refuse_closed()


async def probe_point(  # noqa: PLR0913  # each is told by name
    job: JobContext,
    context: StationContext,
    test: PointTest,
    board_id: str | None,
    *,
    run: str | None = None,
    plan_hash: str | None = None,
    visit: str | None = None,
    health: NeedleHealth | None = None,
    hold: TesterHold | None = None,
    at_deg: float | None = None,
    done: Mapping[str, PointVerdict] = NOTHING_DONE,
) -> PointRecord:
    """Test one point to its verdict, write the record down, tell it, and return it; the needle is left up.

    `run`: of which run it is a part, by the plan of that hash. `visit`: by what the touches of one test are counted
    together over restarts, None: the run, or the job. `health`: what is known of the needle, None: the station's own.
    `hold`: the tester measures, and the needle is held for it. `at_deg`: the head's angle to begin with, where the
    test wants none. `done`: points that have their verdict in this run, with it; they are touched no more. The job has
    been `accepted` before.
    """
    health = health if health is not None else context.station.needle.health
    trial = _Trial(job, context, test, board_id, visit or run or job.request.id, health, hold, at_deg)
    began_s, looks = time.monotonic(), job.looks
    job.forget_looks()  # pictures are kept of each point
    trial.done = done
    end = await trial.go()
    await context.station.see_lifted(job)
    if end.verdict in PASSES:
        health.passed()
    elif trial.at is not None and trial.at.attempts:
        health.gave_no_pass(test.point)
    record = _record(test, context, trial.at, end).model_copy(
        update={
            "board_id": trial.pad.board_id, "run": run, "plan_hash": plan_hash,
            "looks": job.looks - looks,
            "seconds": round(time.monotonic() - began_s, 3), "at": utc_now(),
        }
    )  # fmt: skip
    record, keeping = job.touching.keep(record, job.pictured())
    if keeping is not None:
        job.later(keeping)
    await job.touching.book.add_point(job.request.id, record)
    job.touching.tell(record)
    return record


@dataclass(frozen=True)
class _End:
    verdict: PointVerdict
    reason: str = ""
    fault: str | None = None


class _Trial:
    """One point's way to its verdict."""

    def __init__(
        self,
        job: JobContext,
        context: StationContext,
        test: PointTest,
        board_id: str | None,
        visit: str,
        health: NeedleHealth,
        hold: TesterHold | None,
        at_deg: float | None,
    ) -> None:
        self._job, self._context, self._test, self._health, self._hold = job, context, test, health, hold
        self.visit, self._at_deg = visit, at_deg
        self.pad = TouchedPad.below(context, test.point, board_id, job.touching.book)
        """Which pad of which board it is: who leaves out the board means the one that was aligned."""
        self.done: Mapping[str, PointVerdict] = {}
        self.at: PointUnderTest | None = None
        """None until the point is known to be one that can be tested."""

    async def go(self) -> _End:
        """Come to a verdict, whatever one point may have; the needle is lifted."""
        try:
            return await self._climb(await self._take_up())
        except TesterSilent:
            if self.at is not None:
                await self.at.lift()
            return _End(PointVerdict.NOT_TESTED, "the tester said nothing of what it measured")
        except (Fault, DeviceError) as exc:
            fault = as_fault(exc)
            if fault.kind is FaultCode.CONTACT_BEFORE_DESCENT:
                await self._lift_clear()
            if not self._is_said(fault) or (self.at is not None and self.at.is_down):
                if fault.kind in CONTRADICTED:
                    await void_seat(self._context, fault.message)
                raise
            touched = self.at is not None and self.at.attempts
            verdict = PointVerdict.CONTACT_NOT_MADE if touched else PointVerdict.NOT_TESTED
            return _End(verdict, fault.message, fault.kind.wire_name)

    async def _lift_clear(self) -> None:
        """Lift a needle whose proof is closed where it hovers: it may stand on a board that came up."""
        if self.at is None or not self.at.is_down:
            await leave_metal(self._job, self._context, self._nobody_asks)

    @staticmethod
    async def _nobody_asks() -> bool:
        return True

    def _is_said(self, fault: Fault) -> bool:
        """Whether a verdict says it; that the board was not seen at all is believed at the second point in a row.

        That it lies turned or with its other side up, two looks from different sides may have said already.
        """
        if fault.kind not in BOARD_UNSEEN:
            return fault.kind in SAID_BY_A_VERDICT
        if fault.kind in CONTRADICTED and self.at is not None and self.at.contradictions >= SURE_LOOKS:
            return False
        self._health.points_unseen += 1
        return self._health.points_unseen == 1

    async def _take_up(self) -> PointUnderTest:
        """Return the point with all its test needs; raise `Fault` for one that cannot be tested."""
        context, test, pad = self._context, self._test, self.pad
        await pad.refuse_forbidden(context.board)
        point = await _target(context, test)
        own = self._hold is None or context.station.meter is not None
        meter = MeterReadings(self._job, context) if own else None
        reader = self._reader(point, meter)
        wear = await self._job.touching.book.wear_of(pad.board_id, pad.point, pad.since, self.visit)
        in_visit = test.touches or context.config.ladder.touches_per_visit
        budget = Budget.of(wear, pad, context.config.touch, self.visit, in_visit)
        if budget.touches <= 0 or budget.presses <= 0:
            raise _spent(pad, life=budget.life_spent)
        self.at = at = PointUnderTest(self._job, context, test, point, pad, budget, reader, meter, self._health)
        at.begin_at_deg = test.theta_deg if test.theta_deg is not None else self._at_deg
        at.done, at.spent = self.done, spent_from_the_start(at)
        return at

    def _reader(self, point: BoardPoint, meter: MeterReadings | None) -> PressReader:
        if self._hold is not None:
            return TesterReader(
                self._job, self._context, self._test, self._hold, meter, self._station_too(point, meter)
            )
        if self._test.method == "insert" or meter is None:
            raise Fault(FaultCode.INVALID_REQUEST, "method insert is the tester's, and none holds the needle")
        return StationReader(self._context, meter, self._test, point.net, self._health, self._beside(point))

    def _beside(self, point: BoardPoint) -> tuple[str, ...]:
        """Return the nets on which the needle may stand instead: within the largest error that can be corrected."""
        servo = self._context.servo
        return neighbour_nets(self._context.board, point, servo.max_placement_um + servo.tip_radius_um)

    def _station_too(self, point: BoardPoint, meter: MeterReadings | None) -> StationReader | None:
        """Return what reads the net beside the tester; None where the station's harness does not reach it."""
        section = self._context.config.meter
        if meter is None or section is None or point.net not in section.channels:
            return None
        if self._test.method not in ALONG_NET | {"insert"}:
            return None
        method = self._test.method if self._test.method in ALONG_NET else "continuity"
        test = PointTest(point=self._test.point, method=method, limits=self._test.limits)
        return StationReader(self._context, meter, test, point.net, self._health)

    async def _climb(self, at: PointUnderTest) -> _End:
        """Touch, and take rung after rung until there is a verdict."""
        ladder = self._context.config.ladder
        here = await beside(at.reader.ready(), at.place())
        if at.must_be_seen:
            here = (await at.see(here)).aim.look.position
        await at.touch(here, Rung.TOUCH, self._context.config.press_um)
        while isinstance(step := next_step(at.situation(), ladder.order), Rung):
            at.spent.add(step)
            await take(step, at)
        await at.lift()
        return _End(step, _why(step, at))


async def _target(context: StationContext, test: PointTest) -> BoardPoint:
    """Return the target; raise `Fault` for one that cannot be tested, or is not what the plan takes it for."""
    board = context.board
    named = board.point(test.point) if context.by_cad else board.round_point(test.point)
    point = await sited(context, named) if context.by_cad else named
    if test.net is not None and test.net != point.net:
        raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"{test.point} is of net {point.net}, not {test.net}")
    return point


def _why(verdict: PointVerdict, at: PointUnderTest) -> str:
    """Return in words what the verdict alone does not tell."""
    if verdict is not PointVerdict.CONTACT_NOT_MADE:
        return at.joined
    if verdict_of_path := why_path_unproved(at):
        return verdict_of_path
    if at.attempts[-1].passes_seen:
        return f"it read like a pass, but no look has shown that it was read on the pad: {at.joined}"
    if at.meter is None or not at.meter.can_prove:
        return "nothing here can prove contact (meter.contact_channel), so that nobody is accused"
    if at.doubt:
        return at.doubt
    if any(one.accuses for one in at.attempts):
        return "contact was proved, but not twice on the pad with the needle known to be good"
    return "no press proved contact: pad or needle, nobody knows"


def _record(test: PointTest, context: StationContext, at: PointUnderTest | None, end: _End) -> PointRecord:
    """Return what came of the point, but for what its caller knows."""
    recovered = at is not None and end.verdict is PointVerdict.PASS_RECOVERED
    by = at.attempts[-1].rung if at is not None and recovered else None
    net = next((one.net for one in context.board.points if one.name == test.point), None)
    return PointRecord(
        point=test.point, net=test.net or net, board_id=None, method=test.method,
        limits=limits_of(test, context.config.ladder), verdict=end.verdict, reason=end.reason, fault=end.fault,
        recovered_by=by,
        cause=cause_of(by, at.error_um, at.metal_um) if by is not None and at is not None else None,
        readings=tuple(at.readings) if at is not None else (), touches=at.touches if at is not None else 0,
        elsewhere=at.elsewhere if at is not None else 0,
        presses=len(at.readings) if at is not None else 0, error_um=at.error_um if at is not None else None,
        sigma_um=at.sigma_um if at is not None else None, seconds=0.0, at="",
    )  # fmt: skip


def _spent(pad: TouchedPad, *, life: bool) -> Fault:
    of = f"board {pad.board_id}" if pad.board_id is not None else "the board in the nest, which nobody named,"
    limits = "touch.touches_per_pad, touch.presses_per_pad" if life else "ladder.touches_per_visit"
    return Fault(FaultCode.TOUCH_BUDGET_SPENT, f"{pad.point} of {of} was touched as often as it may be ({limits})")
