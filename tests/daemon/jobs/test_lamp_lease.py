"""A lamp that a person switched on burns for its lease, and never beside work."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.lamp_lease import LampLease
from daemon.jobs.station_lock import Holder, StationLock
from drivers.deadline import Deadline
from drivers.errors import LightError
from drivers.lights import Light

LONG_S = 3600.0


class Lamps:
    """Two lamps that remember."""

    settle_s = 0.0

    def __init__(self) -> None:
        self.told: list[Light] = []
        self.trouble: LightError | None = None
        self.dark = asyncio.Event()

    async def set(self, light: Light, deadline: Deadline) -> float:  # noqa: ARG002  # it is never late
        if self.trouble is not None:
            trouble, self.trouble = self.trouble, None
            raise trouble
        self.told.append(light)
        if light is Light.OFF:
            self.dark.set()
        return 0.0

    async def check(self, deadline: Deadline) -> None:
        """It is as it was told."""

    async def close(self) -> None:
        """Nothing is open."""


class Room:
    """An idle station with a lamp."""

    def __init__(self) -> None:
        self.latch, self.lock, self.lamps = FaultLatch(), StationLock(), Lamps()
        self.latch.opened()
        self.lease = LampLease(self.latch, self.lock, lambda: self.lamps)

    async def goes_dark(self) -> None:
        async with asyncio.timeout(10.0):
            await self.lamps.dark.wait()


@pytest.fixture
async def room() -> AsyncIterator[Room]:
    yield Room()
    for task in asyncio.all_tasks() - {asyncio.current_task()}:
        task.cancel()


async def test_a_lamp_goes_dark_when_its_lease_ends(room: Room) -> None:
    await room.lease.switch(Light.WHITE, 0.01)
    assert room.lock.leave is not None, "nobody would know that a person has it on"
    await room.goes_dark()
    assert room.lock.leave is None
    assert room.lamps.told == [Light.WHITE, Light.OFF]


async def test_a_lease_that_is_renewed_does_not_end_with_the_first(room: Room) -> None:
    await room.lease.switch(Light.WHITE, LONG_S)
    await room.lease.switch(Light.RED, 0.01)
    await room.goes_dark()
    assert room.lamps.told == [Light.WHITE, Light.RED, Light.OFF]


@pytest.mark.parametrize("holder", ["job", "reset", "reload", "stop"])
async def test_who_works_with_the_station_finds_it_dark(room: Room, holder: Holder) -> None:
    await room.lease.switch(Light.WHITE, LONG_S)
    async with room.lock.hold(holder):
        assert room.lamps.told == [Light.WHITE, Light.OFF]


async def test_a_look_after_the_stations_health_leaves_the_lamp_on(room: Room) -> None:
    await room.lease.switch(Light.WHITE, LONG_S)
    async with room.lock.hold("health check"):
        assert room.lamps.told == [Light.WHITE]


async def test_a_fault_makes_it_dark(room: Room) -> None:
    await room.lease.switch(Light.WHITE, LONG_S)
    room.latch.latch(Fault(FaultCode.LINK_LOST))
    await room.goes_dark()
    assert room.lamps.told[-1] is Light.OFF


async def test_beside_work_and_in_fault_no_lamp_is_switched(room: Room) -> None:
    async with room.lock.hold("job"):
        with pytest.raises(Fault) as busy:
            await room.lease.switch(Light.WHITE, LONG_S)
    room.latch.latch(Fault(FaultCode.NOT_HOMED))
    with pytest.raises(Fault) as at_fault:
        await room.lease.switch(Light.WHITE, LONG_S)
    assert (busy.value.kind, at_fault.value.kind) == (FaultCode.BUSY, FaultCode.IN_FAULT)
    assert room.lamps.told == []


async def test_a_lamp_that_did_not_obey_is_told_off_by_who_works_next(room: Room) -> None:
    room.lamps.trouble = LightError("stuck", device="lights")
    with pytest.raises(LightError):
        await room.lease.switch(Light.WHITE, LONG_S)
    async with room.lock.hold("job"):
        assert room.lamps.told == [Light.OFF]


async def test_nothing_is_switched_for_work_where_nobody_lit_a_lamp(room: Room) -> None:
    async with room.lock.hold("job"):
        assert room.lamps.told == []
