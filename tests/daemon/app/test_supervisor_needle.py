"""A needle that is down or sinks at rest is said so, and raised where that is safe."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import State
from daemon.jobs.watchdog import Watchdog
from daemon.station.needle import NeedlePlace
from daemon.storage.calibration_store import Calibrations
from drivers.errors import LinkTimeout
from drivers.gantry import Position
from tests.daemon.app.supervised_station import JOBS, Station, until
from tests.daemon.procedures.fake_station import pose_map as a_pose_map
from tests.daemon.procedures.fake_station import probe_model


async def test_a_needle_that_sinks_at_rest_is_a_latched_fault_and_is_raised(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.did.count("check_health") > 3)
    assert station.latch.state is State.IDLE
    station.hardware.z_um -= 40.0
    seen = station.hardware.did.count("check_health")
    await until(lambda: station.hardware.did.count("check_health") > seen + 3)
    assert station.latch.state is State.IDLE, "a brake may give a little"
    for _ in range(3):
        station.hardware.z_um -= 10.0
    await until(lambda: station.hardware.lifted_to_um != [])
    looking.cancel()
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.NEEDLE_DOWN
    assert "sank by 70 um" in station.latch.fault.message
    assert station.hardware.lifted_to_um == [12_000.0]
    assert station.supervisor.needle.is_up
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.NEEDLE_DOWN, "only a lift settles it"


def stopped_descent(station: Station, at_um: float) -> None:
    """Have a move down to the height of looks begin, and be stopped on its way."""
    station.supervisor.needle.departs(Position(0.0, 0.0, station.settings.config.gantry.work_z_um, 0.0))
    station.hardware.z_um = at_um


async def test_a_z_that_was_stopped_on_its_way_did_not_sink(station: Station) -> None:
    await station.supervisor.open()
    stopped_descent(station, at_um=8_600.0)
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is None
    assert station.hardware.lifted_to_um == [], "nobody asked for it"
    station.hardware.z_um = 8_530.0
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is not None, "from where it was found it must not sink either"
    assert "sank by 70 um" in station.latch.fault.message


async def test_a_z_that_was_stopped_on_its_way_and_is_found_below_its_target_sank(station: Station) -> None:
    await station.supervisor.open()
    stopped_descent(station, at_um=8_600.0)
    station.hardware.z_um = station.settings.config.gantry.work_z_um - 60.0
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.NEEDLE_DOWN
    assert station.hardware.lifted_to_um == [12_000.0]


@pytest.mark.parametrize(
    ("standing", "raised"),
    [(FaultCode.CAMERA_FAILED, True), (FaultCode.JOURNAL_FAILED, True), (FaultCode.LINK_LOST, False)],
)
async def test_a_needle_that_sinks_while_another_fault_stands_is_seen_and_raised_where_that_is_safe(
    station: Station, standing: FaultCode, *, raised: bool
) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    station.latch.latch(Fault(standing))
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.did.count("position") > 3)
    assert [cause.kind for cause in station.latch.causes] == [standing]
    station.hardware.z_um = 4_900.0
    await until(lambda: FaultCode.NEEDLE_DOWN in [cause.kind for cause in station.latch.causes])
    await until(lambda: station.lock.holder is None)
    looking.cancel()
    assert station.latch.fault is not None
    assert station.latch.fault.kind is standing, "the first cause stays first"
    assert station.hardware.lifted_to_um == ([12_000.0] if raised else [])
    assert station.supervisor.needle.place is (NeedlePlace.UP if raised else NeedlePlace.DOWN)


async def test_a_needle_that_is_known_to_be_down_is_not_raised_because_it_sinks_further(station: Station) -> None:
    station.check_every(0.001)
    station.hardware.z_um = 4_900.0
    await station.supervisor.open()
    assert [cause.kind for cause in station.latch.causes] == [FaultCode.NEEDLE_DOWN]
    looking = asyncio.create_task(station.supervisor.run())
    station.hardware.z_um = 4_700.0
    await until(lambda: station.supervisor.needle.z_um == 4_700.0)
    await until(lambda: station.lock.holder is None)
    looking.cancel()
    assert station.hardware.lifted_to_um == [], "a person looks first, and sends `lift`"


async def test_drives_that_do_not_answer_in_a_fault_are_asked_again_and_change_nothing(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    station.hardware.errors["homed"] = LinkTimeout("no answer", device="z")
    looking = asyncio.create_task(station.supervisor.run())
    await until(lambda: station.hardware.did.count("homed") > 3)
    assert [cause.kind for cause in station.latch.causes] == [FaultCode.LINK_LOST]
    looking.cancel()


@pytest.mark.parametrize("against", [FaultCode.LINK_LOST, FaultCode.DEVICE_REFUSED])
async def test_a_needle_that_sank_is_not_raised_where_no_axis_can_be_trusted(
    station: Station, against: FaultCode
) -> None:
    await station.supervisor.open()
    station.hardware.z_um = 5_000.0
    station.latch.latch(Fault(against))
    await station.supervisor.first_check(Watchdog())
    assert FaultCode.NEEDLE_DOWN in [cause.kind for cause in station.latch.causes]
    assert station.hardware.lifted_to_um == []


async def test_a_start_with_the_needle_below_working_height_says_so_and_moves_nothing(station: Station) -> None:
    station.hardware.z_um = 4_900.0
    await station.supervisor.open()
    assert [cause.kind for cause in station.latch.causes] == [FaultCode.NEEDLE_DOWN]
    assert (station.supervisor.needle.place, station.supervisor.needle.z_um) == (NeedlePlace.DOWN, 4_900.0)
    assert not [asked for asked in station.hardware.did if asked.startswith("move")]
    assert {op: await station.submit(op, op) for op in JOBS} == {
        op: "accepted" if op in ("home", "lift") else "in_fault" for op in JOBS
    }


async def test_no_reset_clears_needle_down_not_even_with_the_needle_up(station: Station) -> None:
    station.hardware.z_um = 4_900.0
    await station.supervisor.open()
    for z_um in (4_900.0, 12_000.0):
        station.hardware.z_um = z_um
        still = await station.supervisor.reset()
        assert still is not None
        assert still.kind is FaultCode.NEEDLE_DOWN
        assert station.latch.state is State.FAULT


@pytest.mark.parametrize(("z_um", "seen"), [(4_900.0, True), (12_000.0, False)])
async def test_a_needle_that_somebody_else_left_down_is_to_be_seen_free_after_its_lift(
    tmp_path: Path, z_um: float, seen: bool
) -> None:
    """A daemon that was killed over a pressed pin took along where it stood free; Z's count alone is no proof."""
    station = Station(tmp_path)
    probe, pose_map = probe_model(), a_pose_map()
    known = {"probe": probe, "pose_map": pose_map}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in known.items():
            patch.setattr(Calibrations, name, property(lambda _self, value=value: value))
        station.hardware.z_um = z_um
        await station.supervisor.open()
    free = station.supervisor.needle.free_pin
    assert (free is not None) == seen
    if free is not None:
        assert free.tip_px == probe.tip_px
        per_um = math.hypot(*pose_map.below_tip_px) / pose_map.hover_um
        pressed_by_um = 100.0
        assert pressed_by_um * per_um > free.within_px > 3.0 * 23.0 * per_um, "a push is told from three sigma of flex"


async def test_a_reset_clears_the_cause_and_leaves_that_the_needle_is_down(station: Station) -> None:
    await station.supervisor.open()
    station.hardware.z_um = 4_900.0
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    station.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
    assert await station.supervisor.reset() is not None
    assert [cause.kind for cause in station.latch.causes] == [FaultCode.NEEDLE_DOWN]


async def test_a_lost_reference_is_named_first_and_leaves_needle_down_behind_it(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.EMERGENCY_STOP))
    station.latch.latch(Fault(FaultCode.NEEDLE_DOWN))
    assert station.supervisor.needle.place is NeedlePlace.UNKNOWN
    assert await station.supervisor.reset() is not None
    assert [cause.kind for cause in station.latch.causes] == [FaultCode.NOT_HOMED, FaultCode.NEEDLE_DOWN]
    assert station.supervisor.needle.place is NeedlePlace.UNKNOWN, "settling the doubt has not made it known"
    assert await station.submit("lift", "l") == "in_fault"
    assert await station.submit("home", "h") == "accepted"
