"""The supervisor: nothing is cleared before it is known to be well, and nothing runs while it asks."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.app import supervisor
from daemon.app.supervisor import DOUBT, StationSupervisor
from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Lifecycle, State
from daemon.jobs.context import Outcome
from daemon.jobs.fault_latch import AXES, FaultLatch
from daemon.jobs.runner import JobRunner
from daemon.jobs.station_lock import StationLock
from daemon.jobs.watchdog import Watchdog
from daemon.station.needle import NeedlePlace
from daemon.storage.calibration_store import Calibrations
from daemon.tools.demo.settings import Places, write_settings
from daemon.wire.operations.table import OPERATIONS
from drivers.errors import CameraError, DeadlinePassed, DriveFault, EmergencyStop, LightError, LinkTimeout
from drivers.gantry import Position
from tests.daemon.app.fake_hardware import FakeHardware, Gate, hardware
from tests.daemon.jobs.memory_journal import MemoryJournal
from tests.daemon.jobs.surroundings import surroundings
from tests.daemon.procedures.fake_station import pose_map as a_pose_map
from tests.daemon.procedures.fake_station import probe_model

JOBS: dict[str, dict[str, Any]] = {
    "correct": {"test_point": "TP1"},
    "place": {"test_point": "TP1"},
    "look": {},
    "align": {},
    "calibrate": {"what": "backlash"},
    "home": {},
    "lift": {},
}


class _Images:
    full = None

    def folder_for(self, _request: Any, *, failed: bool) -> None:  # noqa: ARG002
        return


class Station:
    """A supervisor and a job runner on devices that answer at once."""

    def __init__(self, folder: Path, journal: MemoryJournal | None = None) -> None:
        config = load_config(write_settings(Places(folder, folder)))
        board = cast("Board", _AnyBoard())
        self.journal, self.latch, self.lock = journal or MemoryJournal(), FaultLatch(), StationLock()
        self.hardware = hardware()
        self.opened: list[FakeHardware] = []
        self.open_error: Exception | None = None
        self.asked_to_rest: list[list[str]] = []
        self.answering: set[str] = set()
        self.began: list[str] = []
        self.settings = CurrentSettings(config, board)
        self.supervisor = StationSupervisor(
            self.settings, self.latch, self.lock, Calibrations(folder / "calibration", "demo"),
            cast("Any", self.journal), self._open, stop_unopened=self._stop_unopened,
        )  # fmt: skip
        self.runner = JobRunner(
            surroundings(
                latch=self.latch, lock=self.lock, journal=self.journal, images=_Images(),
                context=self.supervisor.context, procedures=dict.fromkeys(JOBS, self._procedure),
            )
        )  # fmt: skip

    def check_every(self, seconds: float) -> None:
        """Have the drives checked at rest that often."""
        config = self.settings.config
        often = config.maintenance.model_copy(update={"idle_check_s": seconds})
        changed = config.model_copy(update={"maintenance": often})
        self.settings.replace(cast("Any", SimpleNamespace(config=changed, board=self.settings.board)))

    async def _open(self, _config: Any, _deadline: Any) -> Any:
        if self.open_error is not None:
            raise self.open_error
        self.opened.append(self.hardware)
        return self.hardware

    async def _stop_unopened(self, _config: Any, names: Iterable[str]) -> frozenset[str]:
        assert self.lock.holder == "stop", "a reset would open the same lines"
        self.asked_to_rest.append(list(names))
        return frozenset(self.answering & set(names))

    async def _procedure(self, job: Any, _context: Any) -> Outcome:
        self.began.append(job.request.op)
        return Outcome("done")

    def watch(self, gate: Gate) -> None:
        """Have every question to a device pass a gate from here on."""
        self.hardware.gate = gate

    async def submit(self, op: str, job_id: str) -> str:
        """Send a job and return how it was taken."""
        try:
            await self.runner.submit(OPERATIONS.parse({"op": op, "id": job_id, **JOBS[op]}))  # type: ignore[arg-type]
        except Fault as fault:
            return fault.kind.wire_name
        return "accepted"


class _AnyBoard:
    """A board that has every point."""

    name, side, revision = "any", "top", "1"
    layers, points = None, ()

    def point(self, _name: str) -> None:
        return

    find = point


@pytest.fixture
def station(tmp_path: Path) -> Station:
    return Station(tmp_path)


async def _turns(count: int = 30) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


async def _until(holds: Callable[[], bool]) -> None:
    """Let others have their turn until something is true."""
    async with asyncio.timeout(30.0):
        while not holds():  # noqa: ASYNC110  # what is waited for has no event of its own
            await asyncio.sleep(0)


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
        await _turns()
        assert station.began == [], f"{op} began at question {asked}"
        assert set(before) <= set(station.latch.causes), "a fault is not cleared before the last answer"
        assert station.latch.state is (State.FAULT if before else State.IDLE)

    station.watch(gate)
    running = asyncio.create_task(station.runner.run())
    still = await station.supervisor.reset()
    station.watch(_let_pass)
    await _turns()
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


async def _let_pass(_what: str) -> None:
    return


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
    await _until(lambda: DOUBT in first.journal.things)
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


async def _job_leaves_a_lamp_on(station: Station) -> None:
    async with station.lock.hold("job"):
        station.hardware.lit_level = 90
    await _until(lambda: station.latch.fault is not None)
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LIGHT_FAILED


async def test_a_lamp_that_shines_at_rest_is_a_fault_until_a_picture_is_dark(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    looking = asyncio.create_task(station.supervisor.run())
    await _until(lambda: station.hardware.delivered == 1)
    await _until(lambda: station.hardware.did.count("check_health") > 500)
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
    await _until(lambda: station.hardware.delivered == 1)  # the look at the start is done
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
    await _until(lambda: station.hardware.did.count("check_health") > 500)
    assert (station.latch.fault, station.hardware.did.count("frame")) == (None, 0)
    async with station.lock.hold("lamp"):
        await go_dark()
    await _until(lambda: station.latch.fault is not None)
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
    await _until(lambda: station.latch.fault is not None)
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
    await _until(lambda: station.hardware.delivered == 1)
    station.hardware.errors["frame"] = CameraError("no picture", device="cam")
    asked = station.hardware.did.count("frame")
    async with station.lock.hold("job"):
        station.hardware.lit_level = 90
    await _until(lambda: station.hardware.did.count("frame") > asked)
    del station.hardware.errors["frame"]
    await _until(lambda: station.latch.fault is not None)
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
    await _until(lambda: station.latch.fault is not None)
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.EMERGENCY_STOP
    await _until(lambda: not station.latch.doubtful)
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
    await _until(lambda: len(station.asked_to_rest) > 2)
    assert station.asked_to_rest[-1] == ["theta", "x", "y", "z"]
    station.answering = {"x", "z"}
    await _until(lambda: station.asked_to_rest[-1] == ["theta", "y"])
    station.answering = set(AXES)
    await _until(lambda: station.lock.holder is None)
    await asyncio.sleep(0.05)
    asked = len(station.asked_to_rest)
    await asyncio.sleep(0.05)
    assert len(station.asked_to_rest) == asked, "none is asked again that was found to stand"
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.LINK_LOST, "the station stays closed until a reset"
    station.open_error = None
    assert await station.supervisor.reset() is None
    looking.cancel()


async def test_a_needle_that_sinks_at_rest_is_a_latched_fault_and_is_raised(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    looking = asyncio.create_task(station.supervisor.run())
    await _until(lambda: station.hardware.did.count("check_health") > 3)
    assert station.latch.state is State.IDLE
    station.hardware.z_um -= 40.0
    seen = station.hardware.did.count("check_health")
    await _until(lambda: station.hardware.did.count("check_health") > seen + 3)
    assert station.latch.state is State.IDLE, "a brake may give a little"
    for _ in range(3):
        station.hardware.z_um -= 10.0
    await _until(lambda: station.hardware.lifted_to_um != [])
    looking.cancel()
    assert station.latch.fault is not None
    assert station.latch.fault.kind is FaultCode.NEEDLE_DOWN
    assert "sank by 70 um" in station.latch.fault.message
    assert station.hardware.lifted_to_um == [12_000.0]
    assert station.supervisor.needle.is_up
    still = await station.supervisor.reset()
    assert still is not None
    assert still.kind is FaultCode.NEEDLE_DOWN, "only a lift settles it"


def _stopped_descent(station: Station, at_um: float) -> None:
    """Have a move down to the height of looks begin, and be stopped on its way."""
    station.supervisor.needle.departs(Position(0.0, 0.0, station.settings.config.gantry.work_z_um, 0.0))
    station.hardware.z_um = at_um


async def test_a_z_that_was_stopped_on_its_way_did_not_sink(station: Station) -> None:
    await station.supervisor.open()
    _stopped_descent(station, at_um=8_600.0)
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is None
    assert station.hardware.lifted_to_um == [], "nobody asked for it"
    station.hardware.z_um = 8_530.0
    await station.supervisor.first_check(Watchdog())
    assert station.latch.fault is not None, "from where it was found it must not sink either"
    assert "sank by 70 um" in station.latch.fault.message


async def test_a_z_that_was_stopped_on_its_way_and_is_found_below_its_target_sank(station: Station) -> None:
    await station.supervisor.open()
    _stopped_descent(station, at_um=8_600.0)
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
    await _until(lambda: station.hardware.did.count("position") > 3)
    assert [cause.kind for cause in station.latch.causes] == [standing]
    station.hardware.z_um = 4_900.0
    await _until(lambda: FaultCode.NEEDLE_DOWN in [cause.kind for cause in station.latch.causes])
    await _until(lambda: station.lock.holder is None)
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
    await _until(lambda: station.supervisor.needle.z_um == 4_700.0)
    await _until(lambda: station.lock.holder is None)
    looking.cancel()
    assert station.hardware.lifted_to_um == [], "a person looks first, and sends `lift`"


async def test_drives_that_do_not_answer_in_a_fault_are_asked_again_and_change_nothing(station: Station) -> None:
    station.check_every(0.001)
    await station.supervisor.open()
    station.latch.latch(Fault(FaultCode.LINK_LOST))
    station.hardware.errors["homed"] = LinkTimeout("no answer", device="z")
    looking = asyncio.create_task(station.supervisor.run())
    await _until(lambda: station.hardware.did.count("homed") > 3)
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
    await _until(lambda: station.hardware.did.count("stop again") > 1)
    del station.hardware.errors["stop again"]
    await _until(lambda: not gantry.unstopped)
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


# --- the needle -------------------------------------------------------------------------------------------------------


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
