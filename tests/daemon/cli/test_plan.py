"""Plans and runs on the command line: every mistake in one go, and what a call lacks is said with an exit code of 2."""

from __future__ import annotations

import io
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from daemon.cli import board_run
from daemon.cli.app import app
from daemon.cli.board_run import View, in_words
from daemon.cli.plan_text import plan_text
from daemon.config.model import load_config
from daemon.config.plan_file import read_plan
from daemon.domain.board import Board
from daemon.domain.board_run import BoardRun
from daemon.domain.plan import Plan
from daemon.domain.point_test import Cause, PointRecord, PointTest, PointVerdict, Rung
from daemon.storage.plan_store import PlanStore, plans_folder
from tests.daemon.domain.test_board_run import a_record, a_run

ROOT = Path(__file__).parents[3]
DEMO = ROOT / "sim_hw" / "demo_board"
EXAMPLE = ROOT / "systemd" / "station.example.toml"
runner = CliRunner()
pytestmark = pytest.mark.usefixtures("logging_as_before")


def _run(*arguments: str) -> tuple[int, str]:
    result = runner.invoke(app, list(arguments))
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("board")
    assert _run("board", str(DEMO), "-o", str(folder / "board.json"))[0] == 0
    return folder / "board.json"


@pytest.fixture
def station(made: Path, tmp_path: Path) -> Path:
    shutil.copy(made, tmp_path / "board.json")
    text = re.sub(r"(?m)^data_dir = .*$", 'data_dir = "state"', EXAMPLE.read_text())
    (tmp_path / "station.toml").write_text(text)
    return tmp_path / "station.toml"


def _write(folder: Path, name: str, text: str) -> str:
    (folder / name).write_text(text)
    return str(folder / name)


def test_a_good_plan_is_checked_without_a_daemon_and_shown(station: Path) -> None:
    board = Board.load(load_config(station).board.file)
    text = f'[plan]\nboard = "{board.name}"\nnets = "all"\n[defaults]\nhigh = "5 ohm"\n'
    plan = _write(station.parent, "power.toml", text)
    code, output = _run("plan", "check", plan, "-c", str(station))
    assert code == 0, output
    assert "good" in output
    assert "5 ohm" in output
    told = json.loads(_run("plan", "check", plan, "-c", str(station), "--json")[1])
    assert len(told["plan"]["tests"]) == len({point.net for point in board.test_points() if point.net})


def test_all_mistakes_of_a_plan_are_told_in_one_go_with_exit_code_2(station: Path) -> None:
    board = Board.load(load_config(station).board.file)
    text = f"# board: {board.name}\npoint,net,high\n,VCCC,5 ohm\nTP999,,5 ohm\n,GND,5\n"
    plan = _write(station.parent, "bad.csv", text)
    code, output = _run("plan", "check", plan, "-c", str(station))
    assert code == 2
    assert [f"line {n}: " in output for n in (3, 4, 5)] == [True] * 3
    told = _run("plan", "check", plan, "-c", str(station), "--json")
    assert told[0] == 2
    assert [one["line"] for one in json.loads(told[1])["mistakes"]] == [3, 4, 5]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("run",), "say what to test"),
        (("run", "power"), "--board-id"),
        (("run", "power", "-c", "station.toml"), "do not go together"),
        (("plan", "check", "power.xls"), "neither in .toml nor in .csv"),
        (("plan", "check", "absent.toml"), "cannot be read"),
        (("board-report", "-o", "x", "-c", "station.toml"), "Missing argument"),
    ],
)
def test_what_a_call_lacks_is_said_with_exit_code_2(arguments: tuple[str, ...], says: str) -> None:
    code, output = _run(*arguments)
    assert (code, says in " ".join(output.split())) == (2, True), output


def test_a_report_of_a_run_that_is_not_there_names_those_that_are(station: Path, tmp_path: Path) -> None:
    code, output = _run("board-report", "last", "-c", str(station), "-o", str(tmp_path / "out"))
    assert code == 1
    assert "does not exist" in output  # the station has no journal yet
    assert not (tmp_path / "out").exists()


def test_a_file_of_many_commas_says_the_same_when_it_is_sent(made: Path, tmp_path: Path) -> None:
    board = Board.load(made)
    net = next(point.net for point in board.test_points() if point.net)
    rows = f'# board: {board.name}\npoint,net,method,low,high,note\n,{net},,,5 ohm,"left, beside ""U1"""\n'
    file = Path(_write(tmp_path, "a b.csv", rows))
    text, form, name = plan_text(file)
    assert (form, name) == ("csv", "a-b")
    assert text.splitlines()[1].count(",") == 0
    sent, written = (read_plan(one, "csv", board, name) for one in (text, rows))
    assert sent == written
    assert sent.tests[0].note == 'left, beside "U1"'


def test_a_point_is_told_in_a_line() -> None:
    recovered = a_record("TP7", PointVerdict.PASS_RECOVERED, 2, recovered_by=Rung.LOOK, cause=Cause.MISPLACED)
    assert in_words(recovered) == "TP7 (NTP7) pass recovered by look (misplaced): 200 mohm, 2 touches, 1.00 s"
    silent = a_record("TP8", PointVerdict.NOT_TESTED, 0, readings=(), reason="out of reach")
    assert in_words(silent) == "TP8 (NTP8) not tested: 0 touches, 1.00 s, out of reach"


def _page(run: BoardRun, records: list[PointRecord], first: int) -> dict[str, Any]:
    """Return what `points` answers."""
    points = [{"n": first + n, **record.model_dump(mode="json")} for n, record in enumerate(records)]
    return {"run": run.model_dump(mode="json"), "points": points}


@pytest.mark.parametrize(("terminal", "lines"), [(False, ["1/3 A", "2/3 B"]), (True, ["2/3 B"])])
def test_a_terminal_has_a_bar_and_lines_of_trouble_alone_elsewhere_each_point_has_a_line(
    terminal: bool, lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = io.StringIO()
    for console in (board_run.out, board_run.err):
        monkeypatch.setattr(console, "_force_terminal", terminal)
        monkeypatch.setattr(console, "_file", written)
    run = a_run(("A", "B", "C"))
    records = [a_record("A", PointVerdict.PASS_FIRST), a_record("B", PointVerdict.CONTACT_NOT_MADE)]
    with View(as_json=False) as view:
        view.progress(0, 3, "A")
        view.records_from(_page(run, records[:1], 7))
        view.records_from(_page(run, records[1:], 8))
    told = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", written.getvalue())
    assert re.findall(r"\d/3 [AB]\b", told) == lines
    assert (view.bar is not None) == terminal
    assert view.since == 9


def test_what_an_earlier_job_of_the_run_did_is_not_shown_again(capsys: pytest.CaptureFixture[str]) -> None:
    run = a_run(("A", "B", "C"))
    with View(as_json=True) as view:
        view.progress(1, 3, "B")
        both = [a_record("A", PointVerdict.PASS_FIRST), a_record("B", PointVerdict.PASS_FIRST)]
        view.records_from(_page(run, both, 7))
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["point"] == "B"


def test_check_config_warns_of_stored_plans_that_no_run_would_take(station: Path) -> None:
    config = load_config(station)
    board = Board.load(config.board.file)
    store = PlanStore(plans_folder(config.station.data_dir))
    test = PointTest(point=board.test_points()[0].name, method="contact")
    good = Plan(name="good", board=board.name, board_revision=board.revision, tests=(test,))
    for changed in ({}, {"name": "other", "board": "c"}, {"name": "old", "board_revision": "x"}, {"name": "torn"}):
        store.store(good.model_copy(update=changed), "ada")
    (plans_folder(config.station.data_dir) / "torn" / "0001.json").write_text("{")
    code, output = _run("check-config", str(station), "--json")
    warned = [warning["warning"] for warning in json.loads(output)["warnings"]]
    assert code == 0
    assert any("torn/0001.json cannot be read" in text for text in warned)
    assert any("plan old was written for revision x" in text for text in warned)
    assert any("plan other is for board c" in text for text in warned)
    assert not any("good" in text for text in warned)
