"""Readers of one press: the station's instrument, or the tester that measures while the needle is held for it."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import UNIT_OF_METHOD, PointTest
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.judging import (
    ALONG_NET,
    INNOCENT,
    WITHOUT_CURRENT,
    Judged,
    Taken,
    any_pad_passes,
    judge,
    limits_of,
    needs_proof,
    proved,
)
from daemon.procedures.meter_readings import AGAINST_GROUND, MeterReadings
from daemon.procedures.tare import tare_of
from daemon.station.needle_health import NeedleHealth
from drivers.deadline import Deadline
from drivers.meter import Method

SHORTED = frozenset({"diode", "capacitance"})
"""Methods against ground that a net which is joined to it fails; of volts on a powered board no ohms can be asked."""
ASK_EVERY_S = 0.25
"""So often the drives are asked how they are while the needle is held down."""


class TesterSilent(Exception):
    """The tester held the needle to the end, or had it lifted, and said nothing of what it measured."""


@dataclass(frozen=True)
class TesterHold:
    """How long the needle is held for the tester in each press."""

    hold_ms: float = 30_000.0
    lease_ms: float = 2000.0


class PressReader(Protocol):
    """What reads in one press."""

    async def ready(self) -> None:
        """Make sure, while the needle is up, that what is read will mean something; raise `Fault` if not."""

    async def read(self, contact: ContactFacts, /) -> Taken:
        """Read while the needle stands."""

    def lifted(self) -> None:
        """Hear that the needle was lifted."""

    def path_proved(self, judged: Judged, /) -> bool:
        """Whether by what a press was read is known to read: else the net may be whole, and the harness open."""


class StationReader:
    """The station's own instrument."""

    def __init__(
        self,
        context: StationContext,
        meter: MeterReadings,
        test: PointTest,
        net: str | None,
        health: NeedleHealth,
        beside: Sequence[str] = (),
    ) -> None:
        """Take the test and the net it is about; raise `Fault` where the harness does not reach it.

        `beside`: the nets on which a needle may stand instead.
        """
        self._context, self._meter, self._test, self._health = context, meter, test, health
        self._channels = meter.channels(test, net)
        self._net, self._beside = net or "", () if any_pad_passes(test) else meter.reached(beside)
        self._read_at = 0
        """How many readings of channels had been told when this point was last read."""

    async def ready(self) -> None:
        """See that the proof of contact is open, and set the instrument up."""
        await self._meter.refuse_closed()
        await self._meter.prepare(self._test, self._channels)
        await self._meter.refuse_joined(self._test, self._channels)

    async def read(self, _contact: ContactFacts) -> Taken:
        """Read the value, and where that needs it prove the contact without moving anything."""
        meter, deadline = self._meter, self._meter.press_deadline()
        taken = await meter.take(self._test, self._channels, tare_of(self._context, self._health), deadline)
        judged = judge(taken, self._test, self._context.config.ladder)
        if meter.can_prove and needs_proof(taken, self._test, judged):
            taken = replace(taken, contact_ohm=await meter.between_wires(deadline))
        if judged in {Judged.PASS, Judged.LOW} and self._test.method in ALONG_NET:
            taken = await self._seen_apart(taken, deadline)
        if self._test.method in SHORTED and judged not in INNOCENT and proved(taken, self._context.config.ladder):
            taken = await self._seen_apart_from_ground(taken, deadline)
        self._note_path(taken)
        self._read_at = self._health.path.count
        return taken

    def lifted(self) -> None:
        """Nobody waits for it."""

    async def _seen_apart(self, taken: Taken, deadline: Deadline) -> Taken:
        """See in this press that what is read is read through the channel, and on the net: elsewhere nothing flows.

        A relay that sticks, such as that of the needle's second wire, would pass every net, and broken ones; and make
        every one look as if it was shorted. Two wires of the harness that touch each other would pass a net while the
        needle stands on the other one's pad. What was read a press before says nothing of now: relays weld as they
        switch.
        """
        ladder, method = self._context.config.ladder, Method(self._test.method)
        limits = limits_of(self._test, ladder)
        leads_ohm = taken.tare.ohm if taken.tare is not None else 0.0  # here none are taken off
        most_ohm = sys.float_info.max if limits is None or limits.high is None else limits.high + leads_ohm
        for net in self._beside or (None,):
            wire_ohm = 0.0 if net is None else ladder.continuity_max_ohm  # the neighbour's may add more than the own
            ohm = await self._meter.through(net, method, most_ohm + wire_ohm, deadline)
            if ohm is None:
                continue
            stuck_ohm = ohm if net is None else await self._meter.through(None, method, most_ohm, deadline)
            if stuck_ohm is not None or net is None:
                return replace(taken, doubt=_sticks(ohm if stuck_ohm is None else stuck_ohm))
            taken = replace(taken, joined=taken.joined or self._meter.joined(self._net, net, ohm))
        return taken

    async def _seen_apart_from_ground(self, taken: Taken, deadline: Deadline) -> Taken:
        """See whether ground's wire is joined to the net: its own wire may touch that one, and the net be sound."""
        ground, most_ohm = self._meter.ground_net, self._context.config.ladder.continuity_max_ohm
        if ground in (None, self._net) or not self._meter.reached((self._net,)):
            return taken
        ohm = await self._meter.through(ground, Method.CONTINUITY, most_ohm, deadline)
        return taken if ohm is None else replace(taken, doubt=self._meter.joined(self._net, ground or "", ohm))

    def path_proved(self, judged: Judged) -> bool:
        """Whether the channel has read at another point since; where a value accuses the net: no more than it may.

        What is too low along a net needs no such proof: a current flows, and a harness can only add.
        """
        method = self._test.method
        if method == "contact" or (judged is Judged.LOW and method not in WITHOUT_CURRENT):
            return True
        most_ohm = math.inf if judged is Judged.OPEN else self._most_ohm()
        return self._health.path.is_proved(self._channels, self._test.point, self._read_at, most_ohm)

    def _most_ohm(self) -> float:
        """Return what a channel may add at most, where a value is held against the net."""
        ladder = self._context.config.ladder
        if self._test.method in AGAINST_GROUND:
            return ladder.continuity_max_ohm
        limits = limits_of(self._test, ladder)
        return math.inf if limits is None or limits.high is None else limits.high

    def passes(self, taken: Taken) -> bool:
        """Whether what was read is within limits."""
        return judge(taken, self._test, self._context.config.ladder) is Judged.PASS

    def _note_path(self, taken: Taken) -> None:
        """Keep that a current flowed through the channel."""
        if self._test.method in WITHOUT_CURRENT | {"contact"} or taken.value is None or not taken.steady or taken.doubt:
            return
        ohm = taken.value if self._test.method in ALONG_NET else math.inf
        self._health.path.read(self._channels, self._test.point, ohm)


def _sticks(ohm: float) -> str:
    return (
        f"{ohm:.3g} ohm are read with no channel closed: a relay of the scanner sticks, or the board is joined to "
        "the instrument's return by another way"
    )


class TesterReader:
    """The tester's own: the needle is held down until it says what it measured."""

    def __init__(
        self,
        job: JobContext,
        context: StationContext,
        test: PointTest,
        hold: TesterHold,
        meter: MeterReadings | None,
        own: StationReader | None = None,
    ) -> None:
        """Take how long it is held; `meter`: of the station, by which contact can be proved beside.

        `own`: by which the station's harness reaches the net, so that what the tester finds open or too high is asked
        of another wiring than its own, too.
        """
        self._job, self._context, self._test, self._hold, self._meter = job, context, test, hold, meter
        self._own = own
        self._asked_of = set[Judged]()
        """What of the tester's the station's instrument was asked about."""
        self._told: ContactFacts | None = None
        """The contact that was last told of, while the needle stands."""

    def path_proved(self, judged: Judged) -> bool:
        """Whether the station's channel is known to read; where it was not asked, the tester's word counts."""
        return self._own is None or judged not in self._asked_of or self._own.path_proved(judged)

    def lifted(self) -> None:
        """Tell that it was lifted, and be ready for the next press."""
        told, self._told = self._told, None
        self._job.touching.held.again()
        if told is not None:
            self._job.touching.lifted(told)

    async def ready(self) -> None:
        """See that the proof of contact is open, and leave the leads to the tester."""
        if self._meter is not None:
            await self._meter.refuse_closed()
            await self._meter.let_go()

    async def read(self, contact: ContactFacts) -> Taken:
        """Hold the needle until the tester says a word or a value; prove the contact in the same press."""
        held = self._job.touching.held
        if self._told is not None:
            held.again()  # pumped: the same stay, and another press to be measured
        self._told = contact
        held.stands(contact, self._hold.lease_ms, self._hold.hold_ms)
        self._job.touching.made(contact)
        try:
            while (ended_by := await held.wait(ASK_EVERY_S)) is None:
                await self._context.station.require_homed(self._job)
                await self._context.station.position(self._job)
        finally:
            held.let_go()
        if ended_by == "lease_expired":
            raise Fault(FaultCode.LEASE_EXPIRED, f"{contact.test_point} was let go of: no `hold` came in time")
        if ended_by == "hold_ms":
            raise TesterSilent
        measured = held.close()
        if not measured and self._test.method != "insert":
            raise TesterSilent  # somebody wanted the needle up, and that is no pass
        taken = _told(measured, self._test)
        if self._meter is not None and self._meter.can_prove:
            judged = judge(taken, self._test, self._context.config.ladder)
            if needs_proof(taken, self._test, judged):
                ohm = await self._meter.between_wires(self._meter.press_deadline())
                taken = await self._asked_too(replace(taken, contact_ohm=ohm), judged, contact)
                await self._meter.let_go()
        return taken

    async def _asked_too(self, taken: Taken, judged: Judged, contact: ContactFacts) -> Taken:
        """Read an open net, or ohms that are too high, with the station's own instrument in the same press."""
        measured = judged is Judged.OPEN or (judged is Judged.HIGH and taken.value is not None)
        if self._own is None or not measured:
            return taken
        self._asked_of.add(judged)
        own = await self._own.read(contact)
        if not self._own.passes(own):
            return taken
        why = (
            f"the tester finds it no good, and the station's instrument reads {own.value:.3g} ohm in the same press: "
            "the tester's wiring, or what it measures"
        )
        return replace(taken, doubt=own.doubt or why)


def _told(measured: dict[str, object], test: PointTest) -> Taken:
    """Return what the tester said: a value that the limits judge, or its own word."""
    unit = UNIT_OF_METHOD[test.method]
    word = str(measured["verdict"]).lower() if "verdict" in measured else None
    value = measured.get("value")
    if word == "open":
        return Taken(None, overload=True, unit=unit, said=word)
    if isinstance(value, int | float) and (word is None or test.limits is not None):
        return Taken(float(value), overload=False, unit=unit, said=word)
    return Taken(None, overload=False, unit=unit, said=word or "pass")
