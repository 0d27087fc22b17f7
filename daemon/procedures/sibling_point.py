"""Sibling point: another point of a net, touched to see whether the harness' channel of that net reads at all.

A break in the harness and one in the net read alike at a single point. Where another point of the net reads through the
same channel, the harness is whole and the net is not; where none does, nobody knows which of them it is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault
from daemon.domain.point_test import PASSES, PointTest, Rung
from daemon.platform.beside import beside
from daemon.procedures.judging import ALONG_NET
from daemon.procedures.meter_readings import AGAINST_GROUND, MeterReadings
from daemon.procedures.pad_touch import Budget
from daemon.procedures.point_faults import BOARD_UNSEEN, SAID_BY_A_VERDICT, SURE_LOOKS
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.press_readers import StationReader
from daemon.procedures.sites import sited
from daemon.procedures.touched_pad import TouchedPad
from daemon.station.device_errors import as_fault
from drivers.errors import DeviceError

MOST_TRIED = 3
"""Points to which the head goes; of some of them nothing is seen, and a plane's net has hundreds."""
CONNECTOR = re.compile(r"(J|P|CN|CON|X)\d")
"""Parts at which a harness is plugged in: their pads are on its side of most breaks."""


async def see_that_path_reads(at: PointUnderTest) -> None:
    """Touch other points of the net until one of them reads through the channel; the needle is left up.

    Each is seen below the tip before, and all together cost no more descents than the test of a point may.
    """
    await at.lift()
    if at.meter is None:
        return
    gone = 0
    with at.job.looks_elsewhere():  # the pictures that are kept are of the point itself
        for point in siblings(at):
            spent = at.touches + at.elsewhere >= at.context.config.ladder.touches_per_visit
            if at.path_proved or spent or gone >= MOST_TRIED:
                return
            gone += await _touch(at, at.meter, point)


def why_path_unproved(at: PointUnderTest) -> str:
    """Return in words that nobody knows whether net or harness is open; nothing where that was not the question."""
    if Rung.PATH not in at.spent or at.path_proved:
        return ""
    tried = f", at {at.elsewhere} touches of other points of it either" if at.elsewhere else ""
    return (
        f"contact was proved, but the harness' channel of net {_net(at)} has read nothing better since{tried}: "
        "net or harness, nobody knows"
    )


def _net(at: PointUnderTest) -> str | None:
    """Return the net whose pin of the harness the test goes by."""
    section = at.context.config.meter
    if at.test.method in AGAINST_GROUND:
        return section.ground_net if section is not None else None
    return at.point.net


def siblings(at: PointUnderTest) -> Sequence[BoardPoint]:
    """Return the other points of that net, the likeliest to be on the harness' side of a break first.

    Those are the nearest to a point of it that passed in this run; where none did, those of connectors, and then the
    farthest from the accused one, for a break lies between.
    """
    context, net = at.context, _net(at)
    board = context.board
    found = [p for p in (board.test_points() if context.by_cad else board.round_points()) if p.net == net]
    others = [p for p in found if p.name != at.test.point and p.name not in at.done]
    passed = [p.place_um for p in found if at.done.get(p.name) in PASSES]
    if passed:
        return sorted(others, key=lambda p: min(math.dist(p.place_um, place_um) for place_um in passed))
    return sorted(others, key=lambda p: (not CONNECTOR.match(p.part or ""), -math.dist(p.place_um, at.point.place_um)))


async def _touch(at: PointUnderTest, meter: MeterReadings, named: BoardPoint) -> bool:
    """Touch one of them as a test of its own would; what one point may fail of says nothing here.

    Returns whether the head went there.
    """
    context, job, health = at.context, at.job, at.health
    method = at.test.method if at.test.method in ALONG_NET else "continuity"
    test = PointTest(point=named.name, net=named.net, method=method, second_site=False)
    pad = TouchedPad.below(context, named.name, at.pad.board_id, job.touching.book)
    visit = at.budget.visit
    wear = await pad.book.wear_of(pad.board_id, pad.point, pad.since, visit)
    if wear.touches_in_visit:
        return False  # it has its own verdict in this run, and is touched no more
    budget = Budget.of(wear, pad, context.config.touch, visit, 1)
    if budget.touches <= 0 or budget.presses <= 0:
        return False
    sibling: PointUnderTest | None = None
    try:
        await pad.refuse_forbidden(context.board)
        point = await sited(context, named) if context.by_cad else named
        reader = StationReader(context, meter, test, named.net, health)
        sibling = PointUnderTest(job, context, test, point, pad, budget, reader, meter, health)
        await _read(at, sibling)
    except (Fault, DeviceError) as exc:
        if sibling is not None and sibling.contradictions >= SURE_LOOKS:
            at.contradictions = sibling.contradictions  # that the board lies otherwise is no matter of one point
            raise
        if as_fault(exc).kind not in SAID_BY_A_VERDICT | BOARD_UNSEEN or (sibling is not None and sibling.is_down):
            raise
    return sibling is not None


async def _read(at: PointUnderTest, sibling: PointUnderTest) -> None:
    """Touch it once, seen below the tip, read, and lift the needle."""
    here = await beside(sibling.reader.ready(), sibling.place())
    landed = await sibling.see(here)
    at.elsewhere += 1
    await sibling.touch(landed.aim.look.position, Rung.PATH, at.context.config.press_um)
    await sibling.lift()
