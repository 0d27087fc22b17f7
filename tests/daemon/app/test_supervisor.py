"""The supervisor: nothing is cleared before it is known to be well, and nothing runs while it asks."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from daemon.app import supervisor
from daemon.app.supervisor import DOUBT
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Lifecycle, State
from daemon.jobs.fault_latch import AXES
from daemon.jobs.watchdog import Watchdog
from daemon.platform.clock import utc_now
from daemon.storage.calibration_records import AxisBacklash, BacklashRecord
from drivers.errors import CameraError, DeadlinePassed, DriveFault, EmergencyStop, LightError, LinkTimeout
from drivers.gantry import Approach
from tests.daemon.app.supervised_station import JOBS, Station, let_pass, turns, until


def _latched(station: Station) -> None:
    """A latched fault whose judgement fails at the last question."""
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    station.hardware.errors["check_health"] = DriveFault("too hot", device="x", code=0x4310)


def _not_homed(station: Station) -> None:
    station.latch.latch(Fault(FaultCode.EMERGENCY_STOP))


def _healthy(_station: Station) -> None:
    return


@pytest.mark.parametrize("situation", [_latched, _not_homed, _healthy])
@pytest.mark.parametrize("op", JOBS)
async def test_no_job_begins_at_any_await_of_a_reset(
    tmp_path: Path, op: str, situation: Callable[[Station], None]
) -> None:
    questions = await _reset_with(tmp_path / "count", op, situation, at=-1)
    assert questions >= 3
    for at in range(questions):
        assert await _reset_with(tmp_path / str(at), op, situation, at=at) >= 3


async def _reset_with(folder: Path, op: str, situation: Callable[[Station], None], *, at: int) -> int:
    """Reset, and send a job at the `at`-th question to the devices; return how many there were."""
    folder.mkdir()
    station = Station(folder)
    await station.supervisor.open()
    assert station.latch.state is State.IDLE
    situation(station)
    before = station.latch.causes
    asked = 0
    taken: list[str] = []

    async def gate(_what: str) -> None:
        nonlocal asked
        if asked == at:
            taken.append(await station.submit(op, "meanwhile"))
        asked += 1
        await turns()
        assert station.began == [], f"{op} began at question {asked}"
        assert set(before) <= set(station.latch.causes), "a fault is not cleared before the last answer"
        assert station.latch.state is (State.FAULT if before else State.IDLE)

    station.watch(gate)
    running = asyncio.create_task(station.runner.run())
    still = await station.supervisor.reset()
    station.watch(let_pass)
    await turns()
    if before:
        assert taken == ([] if at < 0 else ["in_fault"]), "only homing is taken, and only in `not_homed`"
        assert still is not None
        assert station.latch.state is State.FAULT
        assert station.began == []
    elif at >= 0:
        assert taken == ["accepted"]
        assert still is None
        assert station.began == [op], "it runs when the reset is over"
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    return asked


async def test_opening_ends_in_idle_or_names_what_is_missing(tmp_path: Path) -> None:
    good = Station(tmp_path)
    await good.supervisor.open()
    assert (good.latch.state, good.latch.lifecycle) == (State.IDLE, Lifecycle.READY)
    assert good.supervisor.context() is not None
    bad = Station(tmp_path)
    bad.open_error = CameraError("no such device", device="camera")
    await bad.supervisor.open()
    assert bad.latch.fault is not None
    assert (bad.latch.fault.kind, bad.latch.lifecycle) == (FaultCode.CAMERA_FAILED, Lifecycle.READY)
    assert bad.supervisor.context() is None
    bad.open_error = None
    assert await bad.supervisor.reset() is None
    assert bad.latch.state is State.IDLE


async def test_a_station_that_is_not_homed_says_so_last(station: Station) -> None:
    station.hardware.homed["y"] = False
    await station.supervisor.open()
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.NOT_HOMED
    station.hardware.errors["recover"] = LinkTimeout("no answer", device="x")
    still = await station.supervisor.reset()
    assert still is not None
    assert [c.kind for c in station.latch.causes] == [FaultCode.LINK_LOST, FaultCode.NOT_HOMED]
    station.hardware.errors.clear()
    await station.supervisor.reset()
    assert [c.kind for c in station.latch.causes] == [FaultCode.NOT_HOMED], "the link is known to be well"


async def test_a_lost_reference_is_taken_from_every_axis_before_anything_is_cleared(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.AXIS_STALLED))
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.NOT_HOMED
    assert station.hardware.homed == dict.fromkeys(AXES, False)
    assert station.latch.doubtful == frozenset()


async def test_a_doubt_stays_over_a_reset_that_fails_and_each_axis_is_settled_by_itself(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.LIMIT_HIT))
    station.hardware.errors["forget x"] = LinkTimeout("no answer", device="x")
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.LINK_LOST
    assert station.latch.doubtful == {"x"}
    assert station.hardware.homed == {"x": True, "y": False, "z": False, "theta": False}
    station.hardware.errors.clear()
    station.hardware.homed = dict.fromkeys(AXES, True)  # somebody else's marker: the doubt about x alone is left
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.NOT_HOMED
    assert station.hardware.homed == {"x": False, "y": True, "z": True, "theta": True}


async def test_a_drive_that_held_an_error_puts_every_axis_in_doubt(station: Station) -> None:
    await station.supervisor.open()
    station.hardware.drive_error = True
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.NOT_HOMED
    assert station.hardware.homed == dict.fromkeys(AXES, False)


async def test_a_doubt_is_kept_for_a_daemon_that_is_killed(tmp_path: Path) -> None:
    first = Station(tmp_path)
    await first.supervisor.open()
    looking = asyncio.create_task(first.supervisor.run())
    first.hardware.errors |= {f"forget {axis}": LinkTimeout("no answer", device=axis) for axis in AXES}
    first.latch.latch(Fault(FaultCode.AXIS_STALLED))
    await until(lambda: DOUBT in first.journal.things)
    looking.cancel()
    assert first.journal.things[DOUBT] == {"axes": sorted(AXES)}
    second = Station(tmp_path, first.journal)
    await second.supervisor.open()
    assert second.latch.fault is not None
    assert second.latch.fault.kind is FaultCode.NOT_HOMED, "its drives still say that they are homed"
    assert first.journal.things[DOUBT] == {"axes": []}


@pytest.mark.parametrize(
    ("kind", "question", "error"),
    [(FaultCode.CAMERA_FAILED, "frame", CameraError("no frame", device="camera"))],
)
async def test_a_fault_that_the_drives_know_nothing_of_is_asked_for_where_it_is(
    station: Station, kind: FaultCode, question: str, error: Exception
) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(kind))
    station.hardware.errors[question] = error
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is kind
    del station.hardware.errors[question]
    assert await station.supervisor.reset() is None
    assert station.latch.state is State.IDLE


async def test_a_reset_opens_a_camera_again_that_gives_no_picture_whatever_was_latched(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    station.hardware.errors["frame"] = CameraError("gives no more pictures", device="camera")

    async def gate(what: str) -> None:
        if what == "open camera":
            station.hardware.errors.clear()

    station.watch(gate)
    assert await station.supervisor.reset() is None
    looked = [what for what in station.hardware.did if "camera" in what or what == "frame"]
    assert looked[-4:] == ["frame", "close camera", "open camera", "frame"]
    assert station.latch.state is State.IDLE


async def test_a_reset_does_not_end_a_fault_while_the_camera_gives_nothing(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    station.hardware.errors["frame"] = CameraError("gives no more pictures", device="camera")
    still = await station.supervisor.reset()
    assert still is not None
    assert [cause.kind for cause in station.latch.causes] == [FaultCode.CAMERA_FAILED, FaultCode.LINK_LOST]


async def test_a_journal_that_cannot_be_written_keeps_the_fault(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.JOURNAL_FAILED))
    station.journal.broken = True
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.JOURNAL_FAILED
    station.journal.broken = False
    assert await station.supervisor.reset() is None
    assert station.latch.state is State.IDLE


async def test_a_fault_latched_while_a_reset_works_is_not_cleared_by_it(station: Station) -> None:
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.LIGHT_FAILED))
    disk = Fault(FaultCode.JOURNAL_FAILED)

    async def gate(what: str) -> None:
        if what == "check_health":
            station.latch.latch(disk)

    station.watch(gate)
    assert await station.supervisor.reset() is None
    assert (station.latch.causes, station.latch.state) == ((disk,), State.FAULT)


async def test_what_closes_a_station_is_latched_whatever_its_kind(station: Station) -> None:
    await station.supervisor.open()
    station.hardware.errors["recover"] = RuntimeError("a bug")
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.INTERNAL
    station.hardware.errors["recover"] = Fault(FaultCode.TIP_NOT_FOUND, "odd")
    still = await station.supervisor.reset()
    assert still is not None
    assert (still.kind, still.detail["was"]) == (FaultCode.INTERNAL, "tip_not_found")


async def test_reset_is_refused_while_a_job_runs(station: Station) -> None:
    await station.supervisor.open()
    async with station.lock.hold("job"):
        with pytest.raises(Fault) as refused:
            await station.supervisor.reset()
    assert refused.value.kind is FaultCode.BUSY
    station.latch.begin("look", "l1")
    with pytest.raises(Fault):
        await station.supervisor.reset()
    assert "recover" not in station.hardware.did


async def test_a_reset_that_waited_while_a_job_began_is_refused_and_does_not_wait_for_its_end(station: Station) -> None:
    await station.supervisor.open()
    held, may_end = asyncio.Event(), asyncio.Event()

    async def job() -> None:
        async with station.lock.hold("job"):
            held.set()
            await may_end.wait()

    async with station.lock.hold("health check"):
        running = asyncio.create_task(job())
        await asyncio.sleep(0)
        resetting = asyncio.create_task(station.supervisor.reset())
        await asyncio.sleep(0)
    await held.wait()
    async with asyncio.timeout(10.0):
        with pytest.raises(Fault) as refused:
            await resetting
    assert refused.value.kind is FaultCode.BUSY
    may_end.set()
    await running


async def test_the_first_check_feeds_the_watchdog_while_a_reset_is_before_it(station: Station) -> None:
    await station.supervisor.open()
    fed = asyncio.Event()
    async with station.lock.hold("reset"):
        checking = asyncio.create_task(station.supervisor.first_check(Watchdog(fed.set, every_s=0.001)))
        async with asyncio.timeout(10.0):
            await fed.wait()
    await checking
    assert "check_health" in station.hardware.did


async def test_the_idle_station_is_looked_after_and_never_beside_somebody_else(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    station.hardware.did.clear()
    looking = asyncio.create_task(station.supervisor.run())
    async with station.lock.hold("reset"):
        await asyncio.sleep(0.02)
        assert station.hardware.did == []
    station.hardware.errors["check_health"] = EmergencyStop("pressed", device="x")
    await until(lambda: station.latch.fault is not None)
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.EMERGENCY_STOP
    await until(lambda: not station.latch.doubtful)
    assert station.hardware.homed == dict.fromkeys(AXES, False), "the drives hear of the doubt at once"
    assert station.latch.fault.kind is FaultCode.EMERGENCY_STOP, "and nothing is cleared by that"
    looking.cancel()


async def test_drives_that_could_not_be_opened_are_stopped_as_soon_as_each_answers(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "STOP_AGAIN_S", 0.001)
    monkeypatch.setattr(supervisor, "ASK_UNOPENED_S", 0.001)
    looking = asyncio.create_task(station.supervisor.run())
    station.open_error = LinkTimeout("no answer", device="x")
    await station.supervisor.open()
    await until(lambda: len(station.asked_to_rest) > 2)
    assert station.asked_to_rest[-1] == ["theta", "x", "y", "z"]
    station.answering = {"x", "z"}
    await until(lambda: station.asked_to_rest[-1] == ["theta", "y"])
    station.answering = set(AXES)
    await until(lambda: station.lock.holder is None)
    await asyncio.sleep(0.05)
    asked = len(station.asked_to_rest)
    await asyncio.sleep(0.05)
    assert len(station.asked_to_rest) == asked, "none is asked again that was found to stand"
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LINK_LOST, "the station stays closed until a reset"
    station.open_error = None
    assert await station.supervisor.reset() is None
    looking.cancel()


async def test_a_check_that_is_late_without_a_missing_answer_is_no_lost_link(station: Station) -> None:
    await station.supervisor.open()
    late = DeadlinePassed("deadline passed during FC 43", device="x")
    station.hardware.errors["check_health"] = late
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is None

    async def gate(what: str) -> None:
        station.hardware.missing_answers += what == "check_health"

    station.watch(gate)
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LINK_LOST
    assert "1 answers were missing" in station.latch.fault.message
    assert "more time" not in station.latch.fault.advice


@pytest.mark.parametrize("state", [State.IDLE, State.FAULT])
async def test_what_may_still_run_is_stopped_as_soon_as_its_drive_answers_in_every_state(
    station: Station, state: State
) -> None:
    await station.supervisor.open()
    if state is State.FAULT:
        station.latch.latch(Fault(FaultCode.LINK_LOST))
    gantry = cast("Any", station.hardware.gantry)
    looking = asyncio.create_task(station.supervisor.run())
    gantry.unstopped = ("x",)
    station.hardware.errors["stop again"] = LinkTimeout("no answer", device="x")
    await until(lambda: station.hardware.did.count("stop again") > 1)
    del station.hardware.errors["stop again"]
    await until(lambda: not gantry.unstopped)
    assert station.latch.state is state
    looking.cancel()


async def test_the_first_check_of_a_start_latches_what_it_finds(station: Station) -> None:
    await station.supervisor.open()
    station.hardware.errors["check_health"] = LightError("dark", device="lights")
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LIGHT_FAILED


@pytest.mark.parametrize(
    ("latched", "raised"),
    [
        ([], True),
        ([FaultCode.CAMERA_FAILED], True),
        ([FaultCode.CAMERA_FAILED, FaultCode.LINK_LOST], False),
        ([FaultCode.LIGHT_FAILED, FaultCode.NOT_HOMED], False),
    ],
)
async def test_at_the_end_the_needle_is_raised_unless_any_fault_speaks_against_it(
    station: Station, latched: list[FaultCode], *, raised: bool
) -> None:
    await station.supervisor.open()
    for kind in latched:
        station.latch.latch(Fault(kind))
    station.hardware.did.clear()
    await station.supervisor.release()
    assert station.hardware.did[-1] == "close"
    assert ("position" in station.hardware.did) is raised


async def test_at_the_end_nothing_moves_while_an_axis_is_in_doubt(station: Station) -> None:
    await station.supervisor.open()
    station.latch.doubt(["z"])
    station.hardware.did.clear()
    await station.supervisor.release()
    assert station.hardware.did == ["close"]


async def test_a_station_that_was_never_opened_has_nothing_to_release(station: Station) -> None:
    await station.supervisor.release()
    assert station.hardware.did == []


async def test_the_axes_come_to_their_targets_from_as_far_as_the_measured_play_asks_for(tmp_path: Path) -> None:
    station = Station(tmp_path)
    await station.supervisor.open()
    context = station.supervisor.context()
    assert context is not None
    assert context.station.approach == Approach(200.0, 200.0, 0.5)
    play = AxisBacklash(from_below_um=(0.0,), from_above_um=(15.0,), backlash_um=15.0, sigma_um=3.0)
    context.calibrations.store(
        BacklashRecord(
            station="demo",
            made_at=utc_now(),
            job="j",
            seconds=1.0,
            looks=1,
            probe="",
            x=play,
            y=play,
            approach_um=200.0,
        )
    )
    assert context.station.approach is not None
    assert 24.0 < context.station.approach.x_um < 100.0, "as soon as it is measured"
