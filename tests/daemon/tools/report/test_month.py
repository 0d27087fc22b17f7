"""A month's page is drawn from the journal alone, says what stood, and draws every group that has numbers."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest

from daemon.storage.journal import Journal
from daemon.tools.report.month import main, month_span
from daemon.tools.report.month_facts import Month, read_month
from daemon.tools.report.month_page import verdict
from tests.bench.maintenance.model import StationModel
from tests.bench.maintenance.wrong import Wrong

NOVEMBER = (datetime(2026, 11, 1, tzinfo=UTC), datetime(2026, 12, 1, tzinfo=UTC))


def _add_alerts(path: Path, rows: list[tuple[int, str, str]]) -> None:
    with closing(sqlite3.connect(path)) as db, db:
        db.executemany("INSERT INTO alerts VALUES (?, ?, ?)", rows)


async def keep_a_month(path: Path, touches: int = 700) -> None:
    journal = await Journal.open(path)
    station = StationModel(3)
    while station.touches < touches:
        for row in station.rows(Wrong()):
            await journal.add_measurement(row.at, row.touches, row.job, row.to_dict())
    known = {"by": "Kim", "at": "2026-11-04", "note": "ring <ordered>"}
    rows: list[tuple[int, str, str]] = []
    for seq, name, change, raised in (
        (1, "light_white", "raised", True), (2, "light_white", "acknowledged", True),
        (3, "noise", "raised", True), (4, "noise", "cleared", False),
    ):  # fmt: skip
        body = {"name": name, "raised": raised, "change": change, "message": f"{name} & more",
                "acknowledged": known if change == "acknowledged" else None}  # fmt: skip
        rows.append((seq, f"2026-11-0{seq}T08:00:00.000+00:00", json.dumps(body)))
    await journal.close()
    _add_alerts(path, rows)


async def test_touches_of_runs_count_which_no_tester_reported(tmp_path: Path) -> None:
    """A station that walks boards by itself had touched nothing, by its month's page."""
    journal = await Journal.open(tmp_path / "j.sqlite")
    points = {"numbers": {"contact_not_made": [0.0, 20.0]}, "bases": {}}
    for at, touches in (("2026-10-31", 100), ("2026-11-01", 125), ("2026-11-30", 160), ("2026-12-01", 900)):
        await journal.add_measurement(f"{at}T08:00:00.000+00:00", touches, "", points)
    await journal.close()
    assert read_month(tmp_path / "j.sqlite", "s", *NOVEMBER).touches == 60


async def test_touches_before_the_oldest_measurement_that_is_kept_are_of_no_month(tmp_path: Path) -> None:
    """Measurements are dropped for their age: the first that is left tells of a station's whole life."""
    journal = await Journal.open(tmp_path / "j.sqlite")
    points = {"numbers": {"contact_not_made": [0.0, 20.0]}, "bases": {}}
    for at, touches in (("2026-10-31", 500_000), ("2026-11-02", 500_010), ("2026-11-30", 500_060)):
        await journal.add_measurement(f"{at}T08:00:00.000+00:00", touches, "", points)
    await journal.close()
    with closing(sqlite3.connect(tmp_path / "j.sqlite")) as db, db:
        db.execute("DELETE FROM measurements WHERE n=1")
    assert read_month(tmp_path / "j.sqlite", "s", *NOVEMBER).touches == 50


async def test_a_clock_that_was_behind_for_a_while_moves_no_touches_into_another_month(tmp_path: Path) -> None:
    """A computer whose clock has no battery wakes up some months ago; its page said -740 touches."""
    journal = await Journal.open(tmp_path / "j.sqlite")
    points = {"numbers": {"contact_not_made": [0.0, 20.0]}, "bases": {}}
    for at, touches in (("2026-10-31", 100), ("2026-11-01", 125), ("2026-11-30", 160), ("2026-12-05", 890),
                        ("2026-10-01", 900), ("2026-12-05", 910)):  # fmt: skip
        await journal.add_measurement(f"{at}T08:00:00.000+00:00", touches, "", points)
    await journal.close()
    assert read_month(tmp_path / "j.sqlite", "s", *NOVEMBER).touches == 60


async def test_facts_are_of_that_month_only(tmp_path: Path) -> None:
    await keep_a_month(tmp_path / "j.sqlite", 600)
    month = read_month(tmp_path / "j.sqlite", "s", *NOVEMBER)
    assert month.touches == 600
    assert month.still_standing == ("light_white",)
    assert [line.change for line in month.alerts] == ["raised", "acknowledged", "raised", "cleared"]
    assert len(month.courses["light_white"].values) > 10
    events, trials = (sum(c) for c in zip(*month.courses["correction_share"].by_day.values(), strict=True))
    assert (trials, 10 < events < 60) == (600, True)
    later = read_month(tmp_path / "j.sqlite", "s", datetime(2026, 12, 1, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC))
    assert (later.courses, later.alerts, later.still_standing) == ({}, (), ("light_white",))


async def test_the_page_says_what_stood_and_escapes_what_people_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    await keep_a_month(tmp_path / "j.sqlite")
    page = tmp_path / "out" / "page.html"
    arguments = ["--journal", str(tmp_path / "j.sqlite"), "--station", "s", "--month", "2026-11", "-o", str(page)]
    assert main(arguments) == 0
    text = page.read_text()
    assert "light_white stood at its end" in text
    assert "ring &lt;ordered&gt;" in text
    for title in (
        "Placement",
        "Corrections",
        "The needle",
        "Light on the needle",
        "Camera",
        "Axes",
        "Lines",
        "Calibrations",
        "The probe",
    ):
        assert f"<h2>{title}" in text
    assert text.count("<svg") == 9
    assert "<script" not in text
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("text", ["2026", "2026-13", "2026-00", "november", "2026-1", "0000-01"])
def test_what_is_no_month_is_refused(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert month_span(text) is None
    assert main(["--journal", "j", "--station", "s", "--month", text, "-o", str(tmp_path / "p.html")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_december_ends_with_the_year() -> None:
    assert month_span("2026-12") == (datetime(2026, 12, 1, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC))


def test_a_journal_that_is_not_there_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = str(tmp_path / "none.sqlite")
    assert main(["--journal", missing, "--station", "s", "--month", "2026-11", "-o", str(tmp_path / "p.html")]) == 1
    assert "does not exist" in capsys.readouterr().err


async def test_what_was_told_before_a_clock_was_set_back_hides_nothing(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    rows: list[tuple[int, str, str]] = []
    for seq, at in ((1, "2026-12-30"), (2, "2026-11-05")):
        body = json.dumps({"name": f"alert {seq}", "raised": True, "change": "raised", "message": "m"})
        rows.append((seq, f"{at}T08:00:00.000+00:00", body))
    await journal.close()
    _add_alerts(tmp_path / "j.sqlite", rows)
    month = read_month(tmp_path / "j.sqlite", "s", *NOVEMBER)
    assert [line.name for line in month.alerts] == ["alert 2"]
    assert month.still_standing == ("alert 2",)


def test_a_month_in_which_much_failed_is_not_called_healthy() -> None:
    def month(jobs: int, **failures: int) -> Month:
        return Month("s", *NOVEMBER, touches=0, jobs=jobs, failures=failures, courses={}, alerts=(), still_standing=())

    assert verdict(month(34)).good
    bad = verdict(month(34, frame_unusable=16))
    assert not bad.good
    assert "16 of 34 jobs failed, 16 of them at the station's own work" in bad.because
    asked_wrongly = verdict(month(34, cancelled=9, not_at_test_point=7))
    assert asked_wrongly.good
    assert "16 of 34 jobs failed, 0 of them" in asked_wrongly.because
