"""What every older version wrote is read and gone on with by today's program; nothing of it is lost."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.config.model import load_config
from daemon.domain.point_test import PointVerdict
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.storage.journal_reader import JournalReader
from daemon.storage.journal_schema import SCHEMA_VERSION
from daemon.tools.backup import make_backup, restore
from daemon.tools.demo.settings import Places, write_settings
from tests.daemon.domain.test_board_run import a_record

RELEASED = Path(__file__).parent / "released"
JOURNALS = sorted(RELEASED.glob("journal-*.sql"))
CONFIGURATIONS = sorted(RELEASED.glob("station-*.toml"))
pytestmark = pytest.mark.usefixtures("logging_as_before")


def _version(path: Path) -> int:
    return int(re.findall(r"-(\d+)", path.name)[0])


def _written(dump: Path, file: Path) -> Path:
    """Write the journal as it lay on the disk of its time."""
    file.parent.mkdir(parents=True, exist_ok=True)
    db = sqlite3.connect(file, isolation_level=None)
    db.execute("PRAGMA journal_mode=WAL")
    db.executescript(dump.read_text())
    db.close()
    return file


def _rows(file: Path) -> list[tuple[object, ...]]:
    with sqlite3.connect(file) as db:
        found = db.execute("SELECT id, op, request, received_at, seq, finished_at, ok, result FROM jobs ORDER BY id")
        rows = found.fetchall()
        return rows + db.execute("SELECT n, job, at, kind, body FROM steps ORDER BY n").fetchall()


def test_there_is_a_journal_and_a_configuration_of_every_version_before_this_one() -> None:
    before = set(range(1, SCHEMA_VERSION))
    assert before <= {_version(path) for path in JOURNALS}, "see tests/released/README.md"
    assert before <= {_version(path) for path in CONFIGURATIONS}


@pytest.mark.parametrize("dump", JOURNALS, ids=lambda path: path.stem)
async def test_an_older_journal_is_brought_up_to_date_with_all_that_is_in_it(dump: Path, tmp_path: Path) -> None:
    file = _written(dump, tmp_path / "journal.sqlite")
    before = _rows(file)
    assert before
    with JournalReader(file) as reader:
        assert reader.version == _version(dump)
        assert sum(1 for _ in reader.jobs()) == sum(1 for row in before if len(row) == 8), "read before it is upgraded"
    journal = await Journal.open(file)
    assert journal.trouble is None
    assert journal.moved_to is None
    old = await journal.results(0, 100)
    numbers = [result.seq for result in old]
    await journal.add_job("new", "look", "{}")
    seq = journal.take_seq()
    assert seq > max(numbers), "numbers go on rising"
    await journal.finish_job(
        JobResult(id="new", op="look", ok=True, seq=seq, station="demo", finished_at=utc_now(), outcome="looked")
    )
    touch = await journal.begin_touch("new", None, "TP1")
    await journal.tell_touch(touch, {"pressed_um": 200.0})
    await journal.close()
    assert {row for row in before} <= set(_rows(file))  # noqa: C416  # rows of two shapes
    again = await Journal.open(file)
    assert [result.seq for result in await again.results(0, 100)] == [*numbers, seq]
    await again.close()


async def test_records_of_an_older_run_come_to_name_its_plan(tmp_path: Path) -> None:
    file = _written(RELEASED / "journal-4.sql", tmp_path / "journal.sqlite")
    record = a_record("TP1", PointVerdict.PASS_FIRST, run="r")
    with sqlite3.connect(file) as db:
        db.execute(
            "INSERT INTO runs(id, board_id, plan, plan_hash, state, begun_at, body, jobs, stopped_by)"
            " VALUES ('r', 'b', 'p', '5d41', 'done', ?, '{}', '[]', '')",
            (utc_now(),),
        )
        for run in ("r", None):
            row = (
                utc_now(),
                "j",
                run,
                "b",
                "TP1",
                "pass_first",
                record.model_copy(update={"run": run}).model_dump_json(),
            )
            db.execute("INSERT INTO points(at, job, run, board_id, point, verdict, record) VALUES (?,?,?,?,?,?,?)", row)
    journal = await Journal.open(file)
    assert [r.plan_hash for r in await journal.runs.records_of("r")] == ["5d41"]
    alone = [r for _, _, r in await journal.tests_of("TP1", None, None, 10) if r.run is None]
    assert [r.plan_hash for r in alone] == [None]
    await journal.close()


@pytest.mark.parametrize("dump", JOURNALS, ids=lambda path: path.stem)
async def test_a_backup_taken_before_an_upgrade_is_put_back_after_it(dump: Path, tmp_path: Path) -> None:
    config = write_settings(Places(tmp_path, tmp_path))
    file = _written(dump, tmp_path / "station/journal.sqlite")
    before = _rows(file)
    assert make_backup(config, tmp_path / "b.tar.gz").journal_version == _version(dump)
    file.unlink()
    restore(tmp_path / "b.tar.gz", config)
    journal = await Journal.open(file)
    assert journal.trouble is None
    await journal.close()
    assert set(before) <= set(_rows(file))


@pytest.mark.parametrize("path", CONFIGURATIONS, ids=lambda path: path.stem)
def test_an_older_configuration_is_good_as_it_is(path: Path, tmp_path: Path) -> None:
    config = tmp_path / "station.toml"
    config.write_text(path.read_text())
    config.chmod(0o644)
    assert load_config(config).station.name
    said = CliRunner().invoke(app, ["check-config", str(config)]).output
    problems = re.findall(r"^problem (?:line \d+: )?(\S+):", said, re.MULTILINE)
    assert set(problems) == {"board.file"}, said  # no board file lies beside it here
