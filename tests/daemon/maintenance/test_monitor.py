"""The keeper judges after the answer, tells each alert once, and picks up where a stop or a kill left it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.config.model import MaintenanceSection, load_config
from daemon.domain.errors import Fault, Kind
from daemon.domain.results import ErrorBody, JobResult
from daemon.maintenance.monitor import Keeper
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal
from daemon.tools.demo.settings import Places, write_settings

REFUSED = ErrorBody(code=2101, name="tip_not_found", message="", advice="")


class _Heard:
    """Stands for the event socket."""

    def __init__(self) -> None:
        self.alerts: list[dict[str, Any]] = []

    def publish(self, topic: str, body: dict[str, Any], seq: int | None = None) -> int:
        assert topic == "alert"
        assert seq is not None
        self.alerts.append({"seq": seq, **body})
        return seq


@asynccontextmanager
async def _running(
    tmp_path: Path, section: MaintenanceSection | None = None, *, ended: bool = False
) -> AsyncIterator[tuple[Keeper, _Heard]]:
    """Run a keeper on the journal in a folder; it is not saved at the end, as if it had been killed."""
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    config = config.model_copy(update={"maintenance": section or MaintenanceSection()})
    calibrations = Calibrations(tmp_path / "calibration", "demo")
    journal, heard = await Journal.open(tmp_path / "j.sqlite"), _Heard()
    daemon = SimpleNamespace(config=config, calibrations=calibrations, hardware=None)
    keeper = Keeper(cast("Any", daemon), journal, cast("Any", heard))
    await keeper.load()
    task = asyncio.create_task(asyncio.sleep(0) if ended else keeper.run())
    try:
        yield keeper, heard
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        await journal.close()


async def _settled(keeper: Keeper) -> None:
    """Wait until all that was handed in has been judged."""
    async with asyncio.timeout(20.0):
        await keeper._queue.join()


def _correct(keeper: Keeper, k: int, error: ErrorBody | None = None) -> None:
    result = JobResult(
        id=f"job-{k}", op="correct", ok=error is None, seq=k + 1, station="s", finished_at="t", outcome="x",
        error_before_um=None if error else 30.0, looks=1, error=error,
    )  # fmt: skip
    keeper.noted(result.id, "look", {})
    keeper.ended(cast("Any", SimpleNamespace(last_look=None)), result)


async def test_an_alert_is_told_once_and_kept_and_cleared_when_it_is_gone(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, heard):
        for k in range(12):
            _correct(keeper, k, REFUSED)
        await _settled(keeper)
        assert [(a["name"], a["change"], a["raised"]) for a in heard.alerts if a["name"] == "tip_refused"][:1] == [
            ("tip_refused", "raised", True)
        ]
        assert sum(a["change"] == "raised" for a in heard.alerts) == 1
        for k in range(12, 60):
            _correct(keeper, k)
        await _settled(keeper)
        assert heard.alerts[-1]["change"] == "cleared"
        assert keeper.overview()["healthy"]
        kept = await keeper._journal.alerts(0, 100)
        assert [a["change"] for a in kept] == [a["change"] for a in heard.alerts]


async def test_nothing_is_lost_by_a_kill_and_nothing_is_told_twice(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, heard):
        for k in range(12):
            _correct(keeper, k, REFUSED)
        await _settled(keeper)
        assert heard.alerts
        before = keeper._panel.to_dict()
    async with _running(tmp_path) as (keeper, heard):
        assert keeper._panel.to_dict() == before
        assert "tip_refused" in keeper.alerts.standing
        _correct(keeper, 13, REFUSED)
        await _settled(keeper)
        assert not [a for a in heard.alerts if a["change"] == "raised"]


async def test_acknowledging_needs_an_alert_and_mending_begins_anew(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, heard):
        for k in range(12):
            _correct(keeper, k, REFUSED)
        await _settled(keeper)
        known = await keeper.acknowledge("tip_refused", "Kim", "bent", mended=False)
        assert known.acknowledged is not None
        assert keeper.alerts.standing["tip_refused"].acknowledged == known.acknowledged
        await keeper.acknowledge("tip_refused", "Kim", "changed", mended=True)
        assert keeper.alerts.standing == {}
        assert [a["change"] for a in heard.alerts[-3:]] == ["acknowledged", "acknowledged", "cleared"]
        with pytest.raises(Fault) as caught:
            await keeper.acknowledge("tip_refused", "Kim", "", mended=False)
        assert caught.value.kind is Kind.UNKNOWN_ALERT


async def test_pictures_that_cannot_be_kept_are_an_alert_that_goes_by_itself(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, heard):
        keeper.flagged("pictures_not_kept", "No space left on device: /x")
        keeper.flagged("pictures_not_kept", "No space left on device: /y")
        keeper.flagged("pictures_not_kept", None)
        await _settled(keeper)
        assert [(a["change"], a["raised"]) for a in heard.alerts] == [("raised", True), ("cleared", False)]
        assert "No space left" in heard.alerts[0]["message"]


async def test_corrections_are_counted_among_the_touches_reported(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, _):
        for k in range(3):
            _correct(keeper, k)
        keeper.reported(100)
        await _settled(keeper)
        share = keeper._panel.watches["correction_share"]
        assert share.standing.figure == pytest.approx(0.03)
        assert keeper.overview()["touches"] == 100


async def test_touches_reported_one_by_one_are_written_twenty_at_a_time(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, _):
        _correct(keeper, 0)
        await _settled(keeper)
        for _ in range(4):
            for _ in range(10):
                keeper.reported(1)
            await _settled(keeper)
        rows = [body["numbers"] for *_, body in await keeper._journal.measurements(0, 100)]
        shares = [numbers["correction_share"] for numbers in rows if "correction_share" in numbers]
        assert shares == [[1.0, 20.0], [0.0, 20.0]]
        assert keeper.overview()["touches"] == 40


async def test_corrections_of_touches_that_nobody_reported_are_no_share_of_others(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, _):
        for k in range(100):
            _correct(keeper, k)
        await _settled(keeper)
        keeper.reported(20)
        await _settled(keeper)
        *_, body = (await keeper._journal.measurements(0, 1000))[-1]
        assert body["numbers"]["correction_share"] == [20.0, 20.0]


async def test_what_is_damaged_of_its_memory_stops_nothing(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, _):
        await keeper._journal.keep("maintenance", {"panel": 5, "row": "x", "probe": []})
        damaged: list[dict[str, Any]] = [
            {}, {"numbers": {"tip_refused": []}}, {"numbers": 7}, {"numbers": {"noise": ["x"]}}
        ]  # fmt: skip
        for body in damaged:
            await keeper._journal.add_measurement("t", 0, "job", body)
        await keeper._journal.set_standing("noise", {"name": "noise"})
    async with _running(tmp_path) as (keeper, _):
        _correct(keeper, 0)
        await _settled(keeper)
        assert keeper.overview()["healthy"]


async def test_a_busy_station_keeps_its_journal_within_bounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.maintenance.monitor.SAVE_EVERY_ROWS", 5)
    section = MaintenanceSection().model_copy(update={"keep_rows": 10})
    async with _running(tmp_path, section) as (keeper, _):
        for k in range(60):
            _correct(keeper, k)
        await _settled(keeper)
        assert len(await keeper._journal.measurements(0, 1000)) <= 10 + 5


async def test_an_alert_is_told_even_if_it_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with _running(tmp_path) as (keeper, heard):

        async def full(*_: Any) -> None:
            raise Fault(Kind.JOURNAL_FAILED, "database or disk is full")

        monkeypatch.setattr(keeper._journal, "set_standing", full)
        keeper.flagged("pictures_not_kept", "No space left on device")
        await _settled(keeper)
        assert [a["change"] for a in heard.alerts] == ["raised"]


async def test_what_still_waits_at_the_end_is_taken_in(tmp_path: Path) -> None:
    async with _running(tmp_path, ended=True) as (keeper, _):
        for k in range(3):
            _correct(keeper, k)
        keeper.reported(60)
        await keeper.close()
    async with _running(tmp_path) as (keeper, _):
        keeper.reported(40)
        await _settled(keeper)
        share = keeper._panel.watches["correction_share"].to_dict()
        assert [block[:2] for block in share["blocks"]] == [[3, 100]]


async def test_an_acknowledgement_outlives_the_daemon_and_what_is_gone_meanwhile_is_cleared(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, heard):
        keeper.flagged("pictures_not_kept", "No space left on device")
        await _settled(keeper)
        await keeper.acknowledge("pictures_not_kept", "Kim", "on my way", mended=False)
    async with _running(tmp_path) as (keeper, heard):
        assert keeper.alerts.standing["pictures_not_kept"].acknowledged is not None
        keeper.flagged("pictures_not_kept", None)
        await _settled(keeper)
        assert [a["change"] for a in heard.alerts] == ["cleared"]


async def test_a_watch_that_is_switched_off_raises_nothing(tmp_path: Path) -> None:
    async with _running(tmp_path, MaintenanceSection(off=("tip",))) as (keeper, heard):
        for k in range(12):
            _correct(keeper, k, REFUSED)
        await _settled(keeper)
        assert heard.alerts == []


async def test_more_than_it_can_take_is_dropped_and_never_waited_for(tmp_path: Path) -> None:
    async with _running(tmp_path) as (keeper, _):
        for k in range(1000):
            _correct(keeper, k)
        assert keeper._queue.full()


async def test_a_probe_past_its_life_is_told_with_its_touches(tmp_path: Path) -> None:
    async with _running(tmp_path, MaintenanceSection(probe_life_touches=100)) as (keeper, _):
        keeper._daemon.calibrations.fingerprint = "a probe"
        _correct(keeper, 0)
        await _settled(keeper)
        keeper.reported(150)
        _correct(keeper, 1)
        await _settled(keeper)
        alert = keeper.alerts.standing["probe_life"]
        assert (alert.figure, alert.severity) == (150.0, "serious")
        keeper._daemon.calibrations.fingerprint = "another"
        _correct(keeper, 2)
        await _settled(keeper)
        assert "probe_life" not in keeper.alerts.standing
