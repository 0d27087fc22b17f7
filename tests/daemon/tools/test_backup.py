"""A backup holds the station as it was at one moment, and putting it back loses nothing at any point."""

from __future__ import annotations

import io
import json
import shutil
import sqlite3
import tarfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.domain.board import Board
from daemon.domain.results import JobResult
from daemon.platform.clock import utc_now
from daemon.platform.instance_lock import NotAloneError, alone
from daemon.storage.alignment_void import read_void
from daemon.storage.journal import Journal
from daemon.storage.unfinished_restore import HalfRestoredError, begin, require_whole
from daemon.tools.backup import BackupError, make_backup, read_manifest, restore
from daemon.tools.board_import import Options, import_board
from daemon.tools.demo.settings import Places, write_settings
from daemon.wire.curve_keys import new_server

pytestmark = pytest.mark.usefixtures("logging_as_before")
DEMO = Path(__file__).parents[3] / "sim_hw/demo_board"
MADE_AT = "2026-01-31T12:00:00.000+00:00"


@cache
def _board() -> Board:
    return import_board(DEMO, "top", Options(bare=True))


def _station(folder: Path, text: str = "first") -> Path:
    """Write a station with something of everything; return its configuration."""
    folder.mkdir(parents=True, exist_ok=True)
    config = write_settings(Places(folder, folder))
    if not (folder / "board.json").exists():
        _board().save(folder / "board.json")
    data = folder / "station"
    for name in ("calibration/history", "calibration/reports", "plans", "pictures/j1"):
        (data / name).mkdir(parents=True, exist_ok=True)
    (data / "calibration/map.json").write_text(text)
    (data / "calibration/history/map-1.json").write_text(f"{text}, old")
    (data / "calibration/alignment.json").write_text(json.dumps({"made_at": MADE_AT}))
    (data / "plans/board.json").write_text(f"{text} plan")
    (data / "pictures/j1/before.jpg").write_text("a picture")
    return config


async def _journal(config: Path, *ids: str) -> None:
    journal = await Journal.open(config.parent / "station/journal.sqlite")
    for job_id in ids:
        await _job(journal, job_id)
    await journal.close()


async def _job(journal: Journal, job_id: str) -> None:
    await journal.add_job(job_id, "look", "{}")
    seq = journal.take_seq()
    await journal.finish_job(
        JobResult(id=job_id, op="look", ok=True, seq=seq, station="demo", finished_at=utc_now(), outcome="looked")
    )


def _jobs(config: Path) -> list[str]:
    with sqlite3.connect(config.parent / "station/journal.sqlite") as db:
        return [row[0] for row in db.execute("SELECT id FROM jobs ORDER BY received_at, id")]


def _all_bytes(folder: Path) -> bytes:
    return b"\n".join(path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file())


async def test_what_was_put_in_comes_out_again_and_what_was_there_is_kept(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    await _journal(config, "a", "b")
    manifest = make_backup(config, tmp_path / "b.tar.gz")
    assert manifest.journal_version is not None
    assert not manifest.has_keys
    _station(tmp_path / "s", "second")
    await _journal(config, "c")
    config.write_text(config.read_text() + "\n# edited\n")
    done = restore(tmp_path / "b.tar.gz", config)
    data = tmp_path / "s/station"
    assert (data / "calibration/map.json").read_text() == "first"
    assert (data / "calibration/history/map-1.json").read_text() == "first, old"
    assert (data / "plans/board.json").read_text() == "first plan"
    assert _jobs(config) == ["a", "b"]
    assert "# edited" not in config.read_text()
    (aside,) = done.aside
    assert (aside / "calibration/map.json").read_text() == "second"
    assert "# edited" in (aside / config.name).read_text()
    with sqlite3.connect(aside / "journal.sqlite") as db:
        assert db.execute("SELECT count(*) FROM jobs").fetchone() == (3,)
    assert (data / "pictures/j1/before.jpg").exists(), "pictures stay as they are"


async def test_a_backup_is_taken_while_the_daemon_writes_its_journal(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    journal = await Journal.open(config.parent / "station/journal.sqlite")
    await _job(journal, "a")
    with alone(config.parent / "station"):
        make_backup(config, tmp_path / "b.tar.gz")
        await _job(journal, "b")
    assert journal.trouble is None, "a reader disturbs nobody"
    await journal.close()
    restore(tmp_path / "b.tar.gz", _station(tmp_path / "new"))
    assert _jobs(tmp_path / "new" / config.name) == ["a"]


async def test_event_numbers_go_on_rising_and_an_alignment_is_void_after_a_restore(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    await _journal(config, "a")
    make_backup(config, tmp_path / "b.tar.gz")
    journal = await Journal.open(config.parent / "station/journal.sqlite")
    last = 0
    for _ in range(50):
        last = journal.take_seq()
    await journal.close()
    restore(tmp_path / "b.tar.gz", config)
    journal = await Journal.open(config.parent / "station/journal.sqlite")
    assert journal.take_seq() > last
    await journal.close()
    assert "align" in str(read_void(config.parent / "station/calibration"))


def test_private_keys_are_in_it_only_when_asked_for(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    keys = tmp_path / "s/keys"
    secret = new_server(keys).secret
    make_backup(config, tmp_path / "without.tar.gz")
    make_backup(config, tmp_path / "with.tar.gz", with_keys=True)
    for name, holds in (("without", False), ("with", True)):
        with tarfile.open(tmp_path / f"{name}.tar.gz") as archive:
            archive.extractall(tmp_path / name, filter="data")
        assert (secret.encode() in _all_bytes(tmp_path / name)) is holds
        assert (tmp_path / f"{name}.tar.gz").stat().st_mode & 0o077 == 0
    shutil.rmtree(keys)
    restore(tmp_path / "with.tar.gz", config)
    assert not keys.exists(), "nor put back without being asked for"
    restore(tmp_path / "with.tar.gz", config, with_keys=True)
    assert secret.encode() in _all_bytes(keys)
    assert all(path.stat().st_mode & 0o077 == 0 for path in (keys, *keys.rglob("*")))
    with pytest.raises(BackupError, match="no keys"):
        restore(tmp_path / "without.tar.gz", config, with_keys=True)


def test_another_stations_backup_is_refused_unless_told(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    make_backup(config, tmp_path / "b.tar.gz")
    other = _station(tmp_path / "other", "theirs")
    other.write_text(other.read_text().replace('name = "demo"', 'name = "station-9"'))
    before = _all_bytes(tmp_path / "other")
    with pytest.raises(BackupError, match="station-9"):
        restore(tmp_path / "b.tar.gz", other)
    assert _all_bytes(tmp_path / "other") == before
    restore(tmp_path / "b.tar.gz", other, other_station=True)
    assert (tmp_path / "other/station/calibration/map.json").read_text() == "first"


def test_nothing_is_put_back_below_a_running_daemon(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    make_backup(config, tmp_path / "b.tar.gz")
    (tmp_path / "s/station/calibration/map.json").write_text("now")
    with alone(tmp_path / "s/station"), pytest.raises(NotAloneError):
        restore(tmp_path / "b.tar.gz", config)
    assert (tmp_path / "s/station/calibration/map.json").read_text() == "now"


def test_a_restore_onto_a_bare_computer_makes_all_that_is_missing(tmp_path: Path) -> None:
    make_backup(_station(tmp_path / "s"), tmp_path / "b.tar.gz")
    target = tmp_path / "etc/reprobe/station.toml"
    restore(tmp_path / "b.tar.gz", target)
    assert target.is_file()
    assert (target.parent / "station/calibration/map.json").read_text() == "first"


def _changed(archive: Path, change: Callable[[str, bytes], Iterator[tuple[str, bytes]]], to: Path) -> Path:
    with tarfile.open(archive) as source, tarfile.open(to, "w:gz") as target:
        for member in source:
            file = source.extractfile(member)
            assert file is not None
            for name, body in change(member.name, file.read()):
                info = tarfile.TarInfo(name)
                info.size = len(body)
                target.addfile(info, io.BytesIO(body))
    return to


def _other_byte(name: str, body: bytes) -> Iterator[tuple[str, bytes]]:
    yield name, body.replace(b"first", b"fiRst") if name.endswith("map.json") else body


def _left_out(name: str, body: bytes) -> Iterator[tuple[str, bytes]]:
    if not name.endswith("map.json"):
        yield name, body


def _one_more(name: str, body: bytes) -> Iterator[tuple[str, bytes]]:
    yield name, body
    if name.endswith("map.json"):
        yield "data/calibration/extra.json", b"x"


def _out_of_it(name: str, body: bytes) -> Iterator[tuple[str, bytes]]:
    yield (
        (name, body.replace(b"data/plans/board.json", b"data/plans/../../x"))
        if name == "manifest.json"
        else (name, body)
    )


@pytest.mark.parametrize("change", [_other_byte, _left_out, _one_more, _out_of_it])
def test_an_archive_that_is_not_what_its_manifest_says_changes_nothing(
    tmp_path: Path, change: Callable[[str, bytes], Iterator[tuple[str, bytes]]]
) -> None:
    config = _station(tmp_path / "s")
    bad = _changed(_made(config, tmp_path), change, tmp_path / "bad.tar.gz")
    (tmp_path / "s/station/calibration/map.json").write_text("now")
    with pytest.raises(BackupError, match="damaged"):
        restore(bad, config)
    assert (tmp_path / "s/station/calibration/map.json").read_text() == "now"
    require_whole(tmp_path / "s/station")


def _made(config: Path, folder: Path) -> Path:
    make_backup(config, folder / "b.tar.gz")
    return folder / "b.tar.gz"


@pytest.mark.parametrize("part", [0.0, 0.3, 0.7, 0.99])
def test_an_archive_that_ends_too_early_is_refused_by_name(tmp_path: Path, part: float) -> None:
    config = _station(tmp_path / "s")
    whole = _made(config, tmp_path).read_bytes()
    (tmp_path / "cut.tar.gz").write_bytes(whole[: int(len(whole) * part)])
    with pytest.raises(BackupError, match="cut"):
        restore(tmp_path / "cut.tar.gz", config)
    require_whole(tmp_path / "s/station")


class Killed(BaseException):
    """What a kill looks like from inside: no handler of the program's runs."""


def _renames(monkeypatch: pytest.MonkeyPatch, allowed: int) -> list[int]:
    """Let so many renames happen, then kill; return a list whose length says how many happened."""
    seen: list[int] = []
    real = Path.replace

    def rename(path: Path, target: Path) -> Path:
        if len(seen) >= allowed:
            raise Killed
        seen.append(1)
        return real(path, target)

    monkeypatch.setattr(Path, "replace", rename)
    return seen


def test_killed_at_any_rename_nothing_is_lost_no_daemon_starts_and_a_second_run_ends_it(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    archive = _made(config, tmp_path)
    allowed, ended = 0, False
    while not ended:
        shutil.rmtree(tmp_path / "s")
        _station(tmp_path / "s", f"present {allowed}")
        data = tmp_path / "s/station"
        with pytest.MonkeyPatch.context() as patch:
            _renames(patch, allowed)
            try:
                restore(archive, config)
                ended = True
            except Killed:
                pass
        there = _all_bytes(tmp_path / "s")
        for piece in (f"present {allowed}", f"present {allowed}, old", f"present {allowed} plan"):
            assert piece.encode() in there, (allowed, piece)
        if not ended:
            untouched = (data / "calibration/map.json").exists() and not list(data.glob("before-restore-*/calibration"))
            if not untouched:
                with pytest.raises(HalfRestoredError, match="interrupted") as refused:
                    require_whole(data)
                assert str(archive) in refused.value.advice
            restore(archive, config)
        require_whole(data)
        assert (data / "calibration/map.json").read_text() == "first"
        allowed += 1
    assert allowed > 5


def test_no_backup_takes_the_place_of_an_older_one(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    before = _made(config, tmp_path).read_bytes()
    with pytest.raises(BackupError, match="there already"):
        make_backup(config, tmp_path / "b.tar.gz")
    assert (tmp_path / "b.tar.gz").read_bytes() == before
    assert [path.name for path in tmp_path.glob(".*")] == []


def test_a_backup_of_a_newer_program_says_which_program_reads_it(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")

    def newer(name: str, body: bytes) -> Iterator[tuple[str, bytes]]:
        if name == "manifest.json":
            body = json.dumps({**json.loads(body), "journal_version": 99, "program": "9.9"}).encode()
        yield name, body

    with pytest.raises(BackupError) as refused:
        restore(_changed(_made(config, tmp_path), newer, tmp_path / "new.tar.gz"), config)
    assert "99" in str(refused.value)
    assert "9.9" in refused.value.advice


def test_on_the_command_line_it_says_what_is_in_it_asks_and_says_where_the_old_is(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    run = CliRunner()
    made = run.invoke(app, ["backup", "-c", str(config), "-o", str(tmp_path / "b.tar.gz")])
    assert made.exit_code == 0, made.output
    assert "calibrations" in made.output
    assert "private keys: none" in made.output
    no = run.invoke(app, ["restore", str(tmp_path / "b.tar.gz"), "-c", str(config)], input="n\n")
    nobody = run.invoke(app, ["restore", str(tmp_path / "b.tar.gz"), "-c", str(config)], input="")
    assert (no.exit_code, nobody.exit_code) == (1, 1)
    assert "nothing was changed" in no.output
    assert "say --yes" in nobody.output
    assert not list((tmp_path / "s/station").glob("before-restore-*"))
    yes = run.invoke(app, ["restore", str(tmp_path / "b.tar.gz"), "-c", str(config), "--yes"])
    assert yes.exit_code == 0, yes.output
    assert "before-restore-" in yes.output
    assert read_manifest(tmp_path / "b.tar.gz").station == "demo"


def test_the_daemon_does_not_start_with_half_a_restore(tmp_path: Path) -> None:
    config = _station(tmp_path / "s")
    begin(tmp_path / "s/station", tmp_path / "b.tar.gz")
    run = CliRunner().invoke(app, ["serve", "--config", str(config)])
    assert run.exit_code == 1
    assert "interrupted" in run.output
    assert "reprobe restore" in run.output
