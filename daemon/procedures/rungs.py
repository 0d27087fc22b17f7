"""Rungs of the ladder: what each does at a point; which comes next is decided in `daemon.procedures.ladder`."""

from __future__ import annotations

from daemon.domain.point_test import Rung
from daemon.procedures.ladder import is_settled
from daemon.procedures.pad_sites import second_site
from daemon.procedures.point_under_test import PointUnderTest
from daemon.procedures.reference_pad import check_needle
from daemon.procedures.sibling_point import see_that_path_reads


async def take(rung: Rung, at: PointUnderTest) -> None:
    """Take one rung; each press in it is one attempt more."""
    match rung:
        case Rung.LOOK:
            await _look(at)
        case Rung.PUMP:
            await _pump(at)
        case Rung.REFERENCE:
            await _reference(at)
        case Rung.SECOND_SITE:
            await _second_site(at)
        case Rung.PATH:
            await see_that_path_reads(at)
        case Rung.TOUCH:
            raise ValueError("the first touch is no rung to take later")


def spent_from_the_start(at: PointUnderTest) -> set[Rung]:
    """Return the rungs that cannot be taken at a point: no room on it, no reference pad, nothing to read it by."""
    spent: set[Rung] = set()
    if not (at.test.second_site and at.context.by_cad and second_site(at.point, at.context.servo)):
        spent.add(Rung.SECOND_SITE)
    if at.context.config.reference is None or at.meter is None:
        spent.add(Rung.REFERENCE)
    return spent


async def _look(at: PointUnderTest) -> None:
    """Lift, look, correct what is found, touch again; where nothing was off, that is a push more on the same metal.

    Where the pad may not be touched again, the eye alone is asked what the last touch was worth.
    """
    here = await at.lift()
    if at.is_over(here):
        landed = await at.see_where_it_was(here)
        if is_settled(at.situation()):
            return  # what was read there is enough, now that the eye vouches for it
    else:
        landed = await at.see(await at.place())
    if at.budget.touches > 0 and at.budget.presses > 0:
        by = Rung.LOOK if landed.steps else Rung.PUMP
        await at.touch(landed.aim.look.position, by, at.context.config.press_um)


async def _pump(at: PointUnderTest) -> None:
    """Push the pin in again and again, until more of it can tell nothing more."""
    if not at.may_be_pumped:
        here = await at.lift()
        landed = await at.see(here if at.is_over(here) else await at.place())
        await at.touch(landed.aim.look.position, Rung.PUMP, at.context.config.press_um)
    await _strokes(at)


async def _strokes(at: PointUnderTest) -> None:
    """Push the pin in again and again where it stands, as often as budget and configuration allow."""
    for _ in range(at.context.config.ladder.pumps):
        if at.budget.presses <= 0 or is_settled(at.situation()):
            return
        await at.stroke()


async def _reference(at: PointUnderTest) -> None:
    """Ask the reference pad; a needle that had to be brushed touches the point again, seen to be there."""
    await at.lift()
    if at.meter is None:
        return
    brushed = await check_needle(at.job, at.context, at.meter, at.health)
    if brushed and at.budget.touches > 0 and at.budget.presses > 0:
        await at.reader.ready()
        landed = await at.see(await at.place())
        await at.touch(landed.aim.look.position, Rung.REFERENCE, at.context.config.press_um)


async def _second_site(at: PointUnderTest) -> None:
    """Touch another place of the pad, harder, as far as the pin allows, and pump there too."""
    site = second_site(at.point, at.context.servo)
    if site is not None:
        here = await at.lift()
        landed = await at.see(here if at.is_over(here) else await at.place(), site)
        harder_um = at.context.config.press_um * at.context.config.ladder.harder
        await at.touch(landed.aim.look.position, Rung.SECOND_SITE, min(harder_um, at.context.gantry.overtravel_um))
        if Rung.PUMP in at.context.config.ladder.order:
            await _strokes(at)
