"""The monitor judges after the answer, tells each alert once, and picks up where a stop or a kill left it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.config.sections.service import MaintenanceSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointVerdict
from daemon.domain.results import ErrorBody, JobResult
from daemon.maintenance.monitor import QUEUE, Monitor
from daemon.maintenance.repeated_failures import IN_A_ROW
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.tools.demo.settings import Places, write_settings
from tests.daemon.domain.test_board_run import a_record

REFUSED = ErrorBody(code=2101, name="tip_not_found", message="", advice="")


class _Heard:
    """Stands for the event socket."""

    def __init__(self) -> None:
        self.alerts: list[dict[str, Any]] = []

    def publish(self, topic: str, body: dict[str, Any]) -> int:
        assert topic == "alert"
        self.alerts.append(body)
        return len(self.alerts)

    async def publish_written(self, topic: str, write: Callable[[int], Awaitable[dict[str, Any]]]) -> int:
        seq = len(self.alerts) + 1
        body = await write(seq)
        self.publish(topic, {"seq": seq, **body})
        return seq


@dataclass
class _Station:
    """A monitor and what it stands on."""

    monitor: Monitor
    heard: _Heard
    journal: Journal
    calibrations: Calibrations


@asynccontextmanager
async def _station(
    tmp_path: Path, section: MaintenanceSection | None = None, *, ended: bool = False
) -> AsyncIterator[_Station]:
    """Run a monitor on the journal in a folder; it is not saved at the end, as if it had been killed."""
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    config = config.model_copy(update={"maintenance": section or MaintenanceSection()})
    calibrations = Calibrations(tmp_path / "calibration", "demo")
    journal, heard = await Journal.open(tmp_path / "j.sqlite"), _Heard()
    settings = CurrentSettings(config, cast("Any", None))
    monitor = Monitor(settings, calibrations, lambda: None, journal, cast("Any", heard))
    await monitor.load()
    task = asyncio.create_task(asyncio.sleep(0) if ended else monitor.run())
    try:
        yield _Station(monitor, heard, journal, calibrations)
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        await journal.close()


@asynccontextmanager
async def _running(
    tmp_path: Path, section: MaintenanceSection | None = None, *, ended: bool = False
) -> AsyncIterator[tuple[Monitor, _Heard]]:
    """Run a monitor, for tests that ask for nothing else."""
    async with _station(tmp_path, section, ended=ended) as station:
        yield station.monitor, station.heard


async def _settled(monitor: Monitor) -> None:
    """Wait until all that was handed in has been judged."""
    async with asyncio.timeout(20.0):
        await monitor.settled()


def _correct(monitor: Monitor, k: int, error: ErrorBody | None = None) -> None:
    result = JobResult(
        id=f"job-{k}", op="correct", ok=error is None, seq=k + 1, station="s", finished_at="t", outcome="x",
        error_before_um=None if error else 30.0, looks=1, error=error,
    )  # fmt: skip
    monitor.on_step(result.id, "look", {})
    monitor.on_result(cast("Any", SimpleNamespace(last_look=None)), result)


async def test_an_alert_is_told_once_and_kept_and_cleared_when_it_is_gone(tmp_path: Path) -> None:
    async with _station(tmp_path) as station:
        monitor, heard = station.monitor, station.heard
        for k in range(12):
            _correct(monitor, k, REFUSED)
        await _settled(monitor)
        assert [(a["name"], a["change"], a["raised"]) for a in heard.alerts if a["name"] == "tip_refused"][:1] == [
            ("tip_refused", "raised", True)
        ]
        assert sum(a["change"] == "raised" and a["name"] == "tip_refused" for a in heard.alerts) == 1
        for k in range(12, 60):
            _correct(monitor, k)
        await _settled(monitor)
        assert heard.alerts[-1]["change"] == "cleared"
        assert monitor.overview()["healthy"]
        kept = await station.journal.alerts(0, 100)
        assert [a["change"] for a in kept] == [a["change"] for a in heard.alerts]


async def test_the_third_failure_in_the_same_way_is_no_healthy_station(tmp_path: Path) -> None:
    """Of any operation, and before anything was learned."""
    async with _running(tmp_path) as (monitor, heard):
        for k in range(3):
            assert monitor.overview()["healthy"]
            failed = JobResult(
                id=f"job-{k}", op="align", ok=False, seq=k + 1, station="s", finished_at="t", outcome="failed",
                error=ErrorBody(code=2404, name="no_board", message="no board", advice="lay it in"),
            )  # fmt: skip
            monitor.on_result(cast("Any", SimpleNamespace(last_look=None)), failed)
            await _settled(monitor)
        assert not monitor.overview()["healthy"]
        assert [a["name"] for a in heard.alerts] == ["repeated_failures"]
        assert "align failed 3 times of its last 3 by no_board: no board; lay it in" in heard.alerts[0]["message"]
        well = JobResult(
            id="job-4", op="align", ok=True, seq=5, station="s", finished_at="t", outcome="aligned"
        )  # fmt: skip
        monitor.on_result(cast("Any", SimpleNamespace(last_look=None)), well)
        await _settled(monitor)
        assert monitor.overview()["healthy"]


async def test_failures_that_repeat_are_known_after_a_restart(tmp_path: Path) -> None:
    async def fails(station: _Station, k: int) -> None:
        failed = JobResult(
            id=f"job-{k}", op="align", ok=False, seq=k, station="s", outcome="failed",
            finished_at="2026-11-01T00:00:00+00:00",
            error=ErrorBody(code=2404, name="no_board", message="no board", advice="lay it in"),
        )  # fmt: skip
        await station.journal.add_job(failed.id, "align", "{}")
        await station.journal.finish_job(failed)
        station.monitor.on_result(cast("Any", SimpleNamespace(last_look=None)), failed)
        await _settled(station.monitor)

    async with _station(tmp_path) as station:
        for k in (1, 2):
            await fails(station, k)
    async with _station(tmp_path) as station:
        assert station.monitor.overview()["healthy"]
        await fails(station, 3)
        assert "repeated_failures" in station.monitor.alerts.standing
    async with _station(tmp_path) as station:
        assert "repeated_failures" in station.monitor.alerts.standing


async def test_points_of_a_run_that_fail_in_a_row_are_an_alert_also_after_a_restart(tmp_path: Path) -> None:
    async def ends(station: _Station, verdict: PointVerdict, fault: str | None) -> None:
        record = a_record("TP1", verdict, fault=fault, reason="nothing is seen")
        await station.journal.add_point("run-1", record)
        station.monitor.on_point(record)
        await _settled(station.monitor)

    async with _station(tmp_path) as station:
        for _ in range(IN_A_ROW + 3):
            await ends(station, PointVerdict.NOT_TESTED, "tip_not_found")
        alert = station.monitor.alerts.standing["repeated_failures"]
        assert "in a row ended by tip_not_found" in alert.message
        assert len(station.heard.alerts) == 1
    async with _station(tmp_path) as station:
        await _settled(station.monitor)
        assert "repeated_failures" in station.monitor.alerts.standing
        await ends(station, PointVerdict.PASS_FIRST, None)
        assert "repeated_failures" not in station.monitor.alerts.standing


async def test_nothing_is_lost_by_a_kill_and_nothing_is_told_twice(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, heard):
        for k in range(12):
            _correct(monitor, k, REFUSED)
        await _settled(monitor)
        assert heard.alerts
        before = monitor.panel.to_dict()
    async with _running(tmp_path) as (monitor, heard):
        assert monitor.panel.to_dict() == before
        assert "tip_refused" in monitor.alerts.standing
        _correct(monitor, 13, REFUSED)
        await _settled(monitor)
        assert not [a for a in heard.alerts if a["change"] == "raised"]


async def test_acknowledging_needs_an_alert_and_mending_begins_anew(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, heard):
        for k in range(12):
            _correct(monitor, k, REFUSED)
        await _settled(monitor)
        await monitor.acknowledge("repeated_failures", "Kim", "changed", mended=True)
        known = await monitor.acknowledge("tip_refused", "Kim", "bent", mended=False)
        assert known.acknowledged is not None
        assert monitor.alerts.standing["tip_refused"].acknowledged == known.acknowledged
        await monitor.acknowledge("tip_refused", "Kim", "changed", mended=True)
        assert monitor.alerts.standing == {}
        assert [a["change"] for a in heard.alerts[-3:]] == ["acknowledged", "acknowledged", "cleared"]
        with pytest.raises(Fault) as caught:
            await monitor.acknowledge("tip_refused", "Kim", "", mended=False)
        assert caught.value.kind is FaultCode.UNKNOWN_ALERT


async def test_pictures_that_cannot_be_kept_are_an_alert_that_goes_by_itself(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, heard):
        monitor.on_flag("pictures_not_kept", "No space left on device: /x")
        monitor.on_flag("pictures_not_kept", "No space left on device: /y")
        monitor.on_flag("pictures_not_kept", None)
        await _settled(monitor)
        assert [(a["change"], a["raised"]) for a in heard.alerts] == [("raised", True), ("cleared", False)]
        assert "No space left" in heard.alerts[0]["message"]


async def test_corrections_are_counted_among_the_touches_reported(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, _):
        for k in range(3):
            _correct(monitor, k)
        monitor.on_touches(100)
        await _settled(monitor)
        share = monitor.panel.watches["correction_share"]
        assert share.standing.figure == pytest.approx(0.03)
        assert monitor.overview()["touches"] == 100


async def test_the_daemons_own_touches_wear_the_probe_and_are_no_touches_that_could_have_missed(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, _):
        for k in range(3):
            _correct(monitor, k)
        for _ in range(50):
            monitor.on_own_touch()
        monitor.on_touches(100)
        await _settled(monitor)
        assert monitor.panel.watches["correction_share"].standing.figure == pytest.approx(0.03)
        assert monitor.overview()["touches"] == 150


async def test_touches_reported_one_by_one_are_written_twenty_at_a_time(tmp_path: Path) -> None:
    async with _station(tmp_path) as station:
        monitor = station.monitor
        _correct(monitor, 0)
        await _settled(monitor)
        for _ in range(4):
            for _ in range(10):
                monitor.on_touches(1)
            await _settled(monitor)
        rows = [body["numbers"] for *_, body in await station.journal.measurements(0, 100)]
        shares = [numbers["correction_share"] for numbers in rows if "correction_share" in numbers]
        assert shares == [[1.0, 20.0], [0.0, 20.0]]
        assert monitor.overview()["touches"] == 40


async def test_points_are_written_twenty_at_a_time_and_the_rest_when_the_daemon_ends(tmp_path: Path) -> None:
    async with _station(tmp_path) as station:
        monitor = station.monitor
        monitor.on_step("run-1", "move", {"on": "reference pad", "ohm": 0.25, "good": True})
        for number in range(25):
            verdict = PointVerdict.PASS_FIRST if number % 5 else PointVerdict.CONTACT_NOT_MADE
            monitor.on_point(a_record(str(number), verdict))
        await _settled(monitor)
        await monitor.close()
        rows = [body["numbers"] for *_, body in await station.journal.measurements(0, 100)]
        assert [numbers["first_touch_misses"] for numbers in rows if "first_touch_misses" in numbers] == [
            [4.0, 20.0], [1.0, 5.0],
        ]  # fmt: skip
        assert [numbers["reference_ohms"] for numbers in rows if "reference_ohms" in numbers] == [[0.25]]


async def test_corrections_of_touches_that_nobody_reported_are_no_share_of_others(tmp_path: Path) -> None:
    async with _station(tmp_path) as station:
        monitor = station.monitor
        for k in range(100):
            _correct(monitor, k)
        await _settled(monitor)
        monitor.on_touches(20)
        await _settled(monitor)
        *_, body = (await station.journal.measurements(0, 1000))[-1]
        assert body["numbers"]["correction_share"] == [20.0, 20.0]


async def test_what_is_damaged_of_its_memory_stops_nothing(tmp_path: Path) -> None:
    async with _station(tmp_path) as station:
        monitor = station.monitor
        await station.journal.keep("maintenance", {"panel": 5, "row": "x", "probe": []})
        damaged: list[dict[str, Any]] = [
            {}, {"numbers": {"tip_refused": []}}, {"numbers": 7}, {"numbers": {"noise": ["x"]}}
        ]  # fmt: skip
        for body in damaged:
            await station.journal.add_measurement("t", 0, "job", body)
        await station.journal.set_standing("noise", {"name": "noise"})
    async with _station(tmp_path) as station:
        monitor = station.monitor
        _correct(monitor, 0)
        await _settled(monitor)
        assert monitor.overview()["healthy"]


async def test_a_busy_station_keeps_its_journal_within_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.maintenance.monitor.SAVE_EVERY_ROWS", 5)
    section = MaintenanceSection().model_copy(update={"keep_rows": 10})
    async with _station(tmp_path, section) as station:
        monitor = station.monitor
        for k in range(60):
            _correct(monitor, k)
        await _settled(monitor)
        assert len(await station.journal.measurements(0, 1000)) <= 10 + 5


async def test_an_alert_is_told_even_if_it_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with _station(tmp_path) as station:
        monitor, heard = station.monitor, station.heard

        async def full(*_: Any) -> None:
            raise Fault(FaultCode.JOURNAL_FAILED, "database or disk is full")

        monkeypatch.setattr(station.journal, "set_standing", full)
        monitor.on_flag("pictures_not_kept", "No space left on device")
        await _settled(monitor)
        assert [a["change"] for a in heard.alerts] == ["raised"]


async def test_what_still_waits_at_the_end_is_taken_in(tmp_path: Path) -> None:
    async with _running(tmp_path, ended=True) as (monitor, _):
        for k in range(3):
            _correct(monitor, k)
        monitor.on_touches(60)
        await monitor.close()
    async with _running(tmp_path) as (monitor, _):
        monitor.on_touches(40)
        await _settled(monitor)
        share = monitor.panel.watches["correction_share"].to_dict()
        assert [block[:2] for block in share["blocks"]] == [[3, 100]]


async def test_an_acknowledgement_outlives_the_daemon_and_what_is_gone_meanwhile_is_cleared(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, heard):
        monitor.on_flag("pictures_not_kept", "No space left on device")
        await _settled(monitor)
        await monitor.acknowledge("pictures_not_kept", "Kim", "on my way", mended=False)
    async with _running(tmp_path) as (monitor, heard):
        assert monitor.alerts.standing["pictures_not_kept"].acknowledged is not None
        monitor.on_flag("pictures_not_kept", None)
        await _settled(monitor)
        assert [a["change"] for a in heard.alerts] == ["cleared"]


async def test_a_watch_that_is_switched_off_raises_nothing(tmp_path: Path) -> None:
    async with _running(tmp_path, MaintenanceSection(off=("tip", "repeated_failures"))) as (monitor, heard):
        for k in range(12):
            _correct(monitor, k, REFUSED)
        await _settled(monitor)
        assert heard.alerts == []


async def test_more_than_it_can_take_is_dropped_and_never_waited_for(tmp_path: Path) -> None:
    async with _running(tmp_path) as (monitor, _):
        for k in range(1000):
            _correct(monitor, k)
        assert monitor.waiting == QUEUE


async def test_a_probe_past_its_life_is_told_with_its_touches(tmp_path: Path) -> None:
    async with _station(tmp_path, MaintenanceSection(probe_life_touches=100)) as station:
        monitor = station.monitor
        calibrations = station.calibrations
        calibrations.in_force = replace(calibrations.in_force, fingerprint="a probe")
        _correct(monitor, 0)
        await _settled(monitor)
        monitor.on_touches(150)
        _correct(monitor, 1)
        await _settled(monitor)
        alert = monitor.alerts.standing["probe_life"]
        assert (alert.figure, alert.severity) == (150.0, "serious")
        calibrations.in_force = replace(calibrations.in_force, fingerprint="another")
        _correct(monitor, 2)
        await _settled(monitor)
        assert "probe_life" not in monitor.alerts.standing
