"""Readings of the measuring instrument through a needle that stands: settled, tared, and with contact proved.

A reading counts when three in a row agree. Contact is proved by the needle's second wire in the same press, with
nothing moved in between: only metal can join the two (Kelvin contact check of source meters). While the needle is up
that proof has to be open, or it would prove nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from statistics import median

from daemon.config.sections.meter import MeterSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import UNIT_OF_METHOD, PointTest
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.judging import ALONG_NET, FLOOR, READINGS, Taken, agree
from daemon.station.needle_health import Tare
from drivers.deadline import Deadline
from drivers.meter import Meter, Method

AGAINST_GROUND = frozenset({"voltage", "diode", "capacitance"})
"""Methods that measure between the net and ground, not along the net to its own pin of the harness."""
TARED = frozenset({"continuity", "resistance"})
"""Methods to which leads and needle add."""


class MeterReadings:
    """The station's instrument, as one job reads it."""

    def __init__(self, job: JobContext, context: StationContext) -> None:
        """Take it; raise `Fault` where the station has none."""
        section, meter = context.config.meter, context.station.meter
        if section is None or meter is None:
            raise Fault(
                FaultCode.METER_FAILED,
                "this station has no measuring instrument",
                advice="`reprobe setup --only meter` asks for one; or measure yourself: "
                '`reprobe probe --measure tester`, over the wire "measure": "tester"',
            )
        self._job, self._context = job, context
        self._section: MeterSection = section
        self._meter: Meter = meter
        self._ladder = context.config.ladder

    @property
    def can_prove(self) -> bool:
        """Whether something can prove that the needle stands on metal."""
        return self._section.contact_channel is not None

    def channels(self, test: PointTest, net: str | None) -> tuple[int, ...]:
        """Return what the scanner has to close for a test of a net; `Fault` where the harness has no such pin."""
        if test.method == "contact":
            if self._section.contact_channel is None:
                raise _no_pin("the needle has no second wire (meter.contact_channel)")
            return (self._section.contact_channel,)
        wanted = self._section.ground_net if test.method in AGAINST_GROUND else net
        if wanted is None:
            ground = f"{test.method} is measured against a net, and meter.ground_net names none: set it, then reload"
            why = ground if test.method in AGAINST_GROUND else f"{test.point} has no net"
            raise _no_pin(why)
        if wanted not in self._section.channels:
            raise _no_pin(f"the harness has no pin of net {wanted} (meter.channels)")
        return (self._section.channels[wanted],)

    def press_deadline(self) -> Deadline:
        """Return by when all that is measured in one press has to be done."""
        return self._job.deadline.within(self._ladder.measure_max_ms / 1e3)

    async def check(self) -> None:
        """Raise unless the instrument answers and still is who it was."""
        with self._job.watch.spend("bus"):
            await self._meter.check(self.press_deadline())

    async def refuse_closed(self) -> None:
        """Raise `Fault` if the proof of contact is closed although the needle is up: it would prove nothing."""
        ohm = await self.least_between_wires()
        if not math.isinf(ohm):
            raise Fault(
                FaultCode.CONTACT_BEFORE_DESCENT,
                f"between the needle's two wires are {ohm:.3g} ohm while it is up",
                ohm=round(ohm, 3),
            )

    async def refuse_joined(self, test: PointTest, channels: Sequence[int]) -> None:
        """Raise `Fault` if a current flows through a test's channels while the needle is up; call it after `prepare`.

        A wire of the harness that is joined to the needle's would pass its net whatever the needle stands on.
        """
        if test.method not in ALONG_NET | {"diode"}:
            return
        deadline, method = self.press_deadline(), Method(test.method)
        with self._job.watch.spend("bus"):
            value = (await self._meter.measure(method, deadline)).value
        if math.isinf(value):
            return
        values, _ = await self._settled(method, channels, FLOOR["ohm"], deadline)
        if math.isinf(least := min(values)):
            return
        numbers = ", ".join(map(str, channels))
        why = f"through channel {numbers} of the harness {least:.3g} is read while the needle is up"
        if self.can_prove:  # the needle is known to stand on nothing: it is this channel alone
            raise _no_pin(f"{why}: its wire is joined to the needle's")
        raise Fault(FaultCode.CONTACT_BEFORE_DESCENT, why)

    async def least_between_wires(self) -> float:
        """Return the least of some readings between the needle's wires; infinite: none flows, or nothing can tell.

        Wires that touch each other now and then are closed.
        """
        channel = self._section.contact_channel
        if channel is None:
            return math.inf
        values, _ = await self._settled(Method.CONTACT, (channel,), FLOOR["ohm"], self.press_deadline())
        return min(values)

    async def prepare(self, test: PointTest, channels: Sequence[int]) -> None:
        """Set the instrument up ahead, so that the first reading is a quick one."""
        with self._job.watch.spend("bus"):
            deadline = self.press_deadline()
            await self._meter.connect(channels, deadline)
            await self._meter.prepare(Method(test.method), deadline)

    async def let_go(self) -> None:
        """Open all channels: the leads are somebody else's."""
        with self._job.watch.spend("bus"):
            await self._meter.connect((), self.press_deadline())

    async def take(self, test: PointTest, channels: Sequence[int], tare: Tare | None, deadline: Deadline) -> Taken:
        """Return the settled value of a test, less what the leads add."""
        unit = UNIT_OF_METHOD[test.method]
        values, steady = await self._settled(Method(test.method), channels, FLOOR.get(unit or "ohm", 0.0), deadline)
        value = median(values)
        if math.isinf(value):
            below = value < 0.0
            return Taken(None, overload=True, unit=unit, below=below, steady=steady, contact_ohm=_contact(test, value))
        contact_ohm = _contact(test, value)
        if tare is None or test.method not in TARED:
            return Taken(value, overload=False, unit=unit, steady=steady, contact_ohm=contact_ohm)
        less = max(0.0, value - tare.ohm)
        return Taken(less, overload=False, unit=unit, steady=steady, contact_ohm=contact_ohm, tare=tare)

    async def ohms_to_return(self, deadline: Deadline) -> float:
        """Return the settled resistance with no channel closed, as on the reference pad; infinite: none flows."""
        values, steady = await self._settled(Method.RESISTANCE, (), FLOOR["ohm"], deadline)
        return median(values) if steady else math.inf

    async def through(self, net: str | None, method: Method, most_ohm: float, deadline: Deadline) -> float | None:
        """Return how many ohms are read through a net's channel, or with none closed; None where that is too many.

        One reading tells that nothing flows; that something does is believed of some, for a relay takes its time.
        """
        channels = () if net is None else (self._section.channels[net],)
        with self._job.watch.spend("bus"):
            await self._meter.connect(channels, deadline)
            ohm = (await self._meter.measure(method, deadline)).value
        if ohm <= most_ohm:
            values, _ = await self._settled(method, channels, FLOOR["ohm"], deadline)
            ohm = min(values)
        return ohm if ohm <= most_ohm else None

    @property
    def ground_net(self) -> str | None:
        """Against which some methods measure."""
        return self._section.ground_net

    def reached(self, nets: Sequence[str]) -> tuple[str, ...]:
        """Return those nets of which the harness has a wire."""
        return tuple(net for net in nets if net in self._section.channels)

    def joined(self, one: str, other: str, ohm: float) -> str:
        """Return in words that two nets are joined."""
        wires = " and ".join(str(self._section.channels[net]) for net in (one, other))
        return (
            f"nets {one} and {other} are joined by {ohm:.3g} ohm: on the board, or in the harness (wires of channels "
            f"{wires}), nobody knows"
        )

    async def between_wires(self, deadline: Deadline) -> float:
        """Return the resistance between the needle's two wires; infinite: no metal joins them, or not steadily."""
        channel = self._section.contact_channel
        if channel is None:
            return math.inf
        values, steady = await self._settled(Method.CONTACT, (channel,), FLOOR["ohm"], deadline)
        return max(values) if steady else math.inf

    async def _settled(
        self, method: Method, channels: Sequence[int], floor: float, deadline: Deadline
    ) -> tuple[list[float], bool]:
        """Read until the last three agree; return them, and whether they do."""
        ladder, values = self._ladder, list[float]()
        with self._job.watch.spend("bus"):
            await self._meter.connect(channels, deadline)
            await self._meter.prepare(method, deadline)
            until_s = time.monotonic() + ladder.settle_max_ms / 1e3
            while True:
                values = [*values, (await self._meter.measure(method, deadline)).value][-READINGS:]
                steady = len(values) == READINGS and agree(values, ladder.settled_share, floor)
                if steady or (len(values) == READINGS and time.monotonic() >= until_s):
                    return values, steady


def _contact(test: PointTest, value: float) -> float | None:
    """Return what a reading says of the contact itself: that of method `contact` is nothing else."""
    return value if test.method == "contact" else None


def _no_pin(why: str) -> Fault:
    return Fault(FaultCode.UNKNOWN_TEST_POINT, why, advice="name the pin in [meter], or take another method")
