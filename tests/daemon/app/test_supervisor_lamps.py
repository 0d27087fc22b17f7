"""A lamp that shines at rest is found, though others work or look meanwhile."""

from __future__ import annotations

import asyncio

import pytest

from daemon.app import supervisor
from daemon.domain.errors import FaultCode
from daemon.domain.states import State
from daemon.jobs.watchdog import Watchdog
from drivers.errors import CameraError
from tests.daemon.app.supervised_station import Station, until


async def _job_leaves_a_lamp_on(station: Station) -> None:
    async with station.lock.hold("job"):
        station.hardware.lit_level = 90
    await until(lambda: station.latch.fault is not None)
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LIGHT_FAILED


async def test_a_lamp_that_shines_at_rest_is_a_fault_until_a_picture_is_dark(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.delivered == 1)
    await until(lambda: station.hardware.did.count("check_health") > 500)
    assert (station.hardware.delivered, station.latch.state) == (1, State.IDLE), "nobody has used the lamps since"
    await _job_leaves_a_lamp_on(station)
    looking.cancel()
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.LIGHT_FAILED
    station.hardware.lit_level = 5
    assert await station.supervisor.reset() is None
    assert station.latch.state is State.IDLE


async def test_a_lamp_that_stays_on_is_found_when_the_job_ends_not_with_the_next_check(station: Station) -> None:
    station.check_every(3600.0)
    await station.supervisor.open()
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.delivered == 1)  # the look at the start is done
    await _job_leaves_a_lamp_on(station)
    looking.cancel()


async def test_pictures_for_viewers_do_not_hide_a_lamp_that_shines(station: Station) -> None:
    await station.supervisor.open()
    station.hardware.lit_level = 90

    async def viewers(what: str) -> None:
        station.hardware.delivered += what == "frame"

    station.watch(viewers)
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is not None


async def test_a_lamp_that_a_person_has_on_is_no_fault_and_is_looked_after_once_it_is_given_back(
    station: Station,
) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    station.hardware.lit_level = 90

    async def go_dark() -> None:
        station.lock.leave = None  # and the lamp shines on

    async with station.lock.hold("lamp"):
        station.lock.leave = go_dark
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.did.count("check_health") > 500)
    assert (station.latch.fault, station.hardware.did.count("frame")) == (None, 0)
    async with station.lock.hold("lamp"):
        await go_dark()
    await until(lambda: station.latch.fault is not None)
    looking.cancel()


async def test_work_done_while_a_picture_was_taken_has_another_taken(station: Station) -> None:
    """That picture tells of the lamps before the work."""
    await station.supervisor.open()

    async def work(what: str) -> None:
        if what == "frame" and station.hardware.did.count("frame") == 0:
            async with station.lock.hold("job"):
                station.hardware.lit_level = 90

    station.watch(work)
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.latch.fault is not None)
    looking.cancel()
    assert station.hardware.did.count("frame") == 2


async def test_a_lamp_that_shines_is_found_though_the_drives_are_asked_meanwhile(station: Station) -> None:
    """A picture takes as long as a check does: its finding was dropped, and nobody looked again for a while."""
    await station.supervisor.open()
    station.hardware.lit_level = 90
    asked, seen = asyncio.Event(), asyncio.Event()

    async def drives_are_asked() -> None:
        async with station.lock.hold("health check"):
            asked.set()
            await seen.wait()

    async def gate(what: str) -> None:
        if what == "frame":
            checks.append(asyncio.create_task(drives_are_asked()))
            await asked.wait()

    checks: list[asyncio.Task[None]] = []
    station.watch(gate)
    await station.supervisor.first_check(Watchdog())
    seen.set()
    await asyncio.gather(*checks)
    assert len(checks) == 1
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LIGHT_FAILED


async def test_a_lamp_that_shines_is_found_as_soon_as_a_camera_that_was_away_gives_a_picture(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "LOOK_EVERY_S", 3600.0)
    station.check_every(0.001)
    await station.supervisor.open()
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.delivered == 1)
    station.hardware.errors["frame"] = CameraError("no picture", device="cam")
    asked = station.hardware.did.count("frame")
    async with station.lock.hold("job"):
        station.hardware.lit_level = 90
    await until(lambda: station.hardware.did.count("frame") > asked)
    del station.hardware.errors["frame"]
    await until(lambda: station.latch.fault is not None)
    looking.cancel()


async def test_a_picture_taken_at_rest_is_void_once_a_job_has_begun_and_holds_none_up(station: Station) -> None:
    await station.supervisor.open()
    station.hardware.lit_level = 90

    async def gate(what: str) -> None:
        if what == "frame":
            assert station.lock.holder is None
            station.latch.begin("look", "l1")

    station.watch(gate)
    await station.supervisor.first_check(Watchdog())
    assert "frame" in station.hardware.did
    assert station.latch.fault is None
