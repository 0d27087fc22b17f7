"""Touch of a pad in a test of it: down, read, pumped if need be, and up; each written down before it is done."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace

from daemon.config.sections.touching import TouchSection
from daemon.domain.contact import ContactFacts
from daemon.domain.point_test import PadWear, Rung
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.descent import Ground, contact_facts, contact_record, go_straight
from daemon.procedures.judging import Taken, proved
from daemon.procedures.press_readers import PressReader
from daemon.procedures.touch_sense import come_near, refuse_closed_sense
from daemon.procedures.touched_pad import TouchedPad
from drivers.gantry import Position


@dataclass
class Budget:
    """What a pad may still be touched and pressed."""

    visit: str
    """The test, over restarts, of which its touches are a part."""
    touches: int
    presses: int
    life_spent: bool = False
    pressed_before: bool = False
    """Whether the needle was on the pad already."""

    @classmethod
    def of(cls, wear: PadWear, pad: TouchedPad, touch: TouchSection, visit: str, in_visit: int) -> Budget:
        """Return what is left: in this visit, and in the life of a board that somebody named."""
        touches, presses = in_visit - wear.touches_in_visit, touch.presses_per_pad - wear.presses_in_visit
        spent = False
        if pad.board_id is not None:
            left, pushes = touch.touches_per_pad - wear.touches, touch.presses_per_pad - wear.presses
            touches, presses, spent = min(touches, left), min(presses, pushes), min(left, pushes) <= 0
        return cls(visit, max(0, touches), max(0, presses), life_spent=spent, pressed_before=wear.touches > 0)


@dataclass
class PadTouch:
    """One touch: the needle stands from `down` until `up`."""

    job: JobContext
    context: StationContext
    pad: TouchedPad
    budget: Budget
    reader: PressReader
    above: Position
    ground: Ground
    press_um: float
    presses: int = field(default=0, init=False)
    _number: int = field(default=0, init=False)

    async def down(self, rung: Rung) -> tuple[ContactFacts, Taken]:
        """Lower the needle and read."""
        await refuse_closed_sense(self.job, self.context)
        book, pad = self.job.touching.book, self.pad
        self._number = await book.begin_touch(
            self.job.request.id, pad.board_id, pad.point, visit=self.budget.visit, rung=rung.value
        )
        self.budget.touches -= 1
        self.context.station.needle.stand.pressed()
        await come_near(self.job, self.context, self.above, self.ground)
        return await self._press()

    async def stroke(self) -> tuple[ContactFacts, Taken]:
        """Let the pin half out and push it in again, without leaving the pad, and read."""
        await self.job.touching.book.tell_touch(self._number, {"presses": self.presses + 1})
        half_z_um = self.ground.surface_z_um - self.press_um / 2
        await go_straight(self.job, self.context, replace(self.above, z_um=half_z_um), self.ground)
        self.context.station.needle.pumped()
        return await self._press()

    async def _press(self) -> tuple[ContactFacts, Taken]:
        self.presses += 1
        self.budget.presses -= 1
        z_um = self.ground.surface_z_um - self.press_um
        down = await go_straight(self.job, self.context, replace(self.above, z_um=z_um), self.ground)
        await asyncio.sleep(self.context.config.touch.dwell_ms / 1e3)
        pad = self.pad
        contact = contact_facts(self.job, self.context, pad.point, pad.board_id, down, self.ground.surface_z_um)
        taken = await self.reader.read(contact)
        proof = proved(taken, self.context.config.ladder)
        facts = contact_record(contact, self.context) | {
            "proof": None if proof is None else int(proof), "value": taken.value, "unit": taken.unit,
            "reading": "overload" if taken.overload else taken.said,
        }  # fmt: skip
        self.job.later(self.job.touching.book.tell_touch(self._number, facts))
        return contact, taken

    async def up(self) -> None:
        """Lift the needle to where it came from."""
        await go_straight(self.job, self.context, self.above, self.ground)
        self.reader.lifted()
        # With its end a touch is told again to who carries records away: what was read came after its first record.
        self.job.later(self.job.touching.book.tell_touch(self._number, {"ended_by": "lifted"}))
