"""The command line says what is wrong, what to do next, and exits accordingly."""

import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.demo import MARK

ROOT = Path(__file__).parents[3]
DEMO = ROOT / "sim_hw" / "demo_board"
EXAMPLE = ROOT / "systemd" / "station.example.toml"
NOBODY = "ipc:///nonexistent/reprobe-test"
runner = CliRunner()
pytestmark = pytest.mark.usefixtures("logging_as_before")


def _run(*arguments: str) -> tuple[int, str]:
    result = runner.invoke(app, list(arguments))
    return result.exit_code, result.output


@pytest.fixture
def station(tmp_path: Path) -> Path:
    shutil.copy(EXAMPLE, tmp_path / "station.toml")
    assert _run("board", str(DEMO), "-o", str(tmp_path / "board.json"))[0] == 0
    return tmp_path / "station.toml"


def test_check_config_accepts_the_example_with_its_board(station: Path) -> None:
    code, output = _run("check-config", str(station))
    assert code == 0, output
    assert "good" in output
    assert "floor: Z 4200 um" in output, "an axis' minimum lower than that is not used"
    notes = json.loads(_run("check-config", str(station), "--json")[1])["notes"]
    assert [note.partition(",")[0] for note in notes] == ["floor: Z 4200 um"]


def test_check_config_names_every_problem(station: Path) -> None:
    station.write_text(station.read_text().replace("address = 1", "address = 900").replace('"E"', '"X"'))
    code, output = _run("check-config", str(station), "--json")
    assert code == 2
    assert {p["path"] for p in json.loads(output)["problems"]} == {"axes.x.address", "bus.main.parity"}


def test_check_config_names_the_points_that_no_approach_leaves_room_for(station: Path) -> None:
    text = station.read_text()
    station.write_text(text.replace("minimum = 0.0", "minimum = 120000.0", 1))
    code, output = _run("check-config", str(station), "--json")
    assert code == 2
    problems = [p["problem"] for p in json.loads(output)["problems"]]
    assert problems
    assert all("out of reach at every head angle: x" in problem and "approach_um" in problem for problem in problems)


def test_check_config_misses_the_board_file(station: Path) -> None:
    (station.parent / "board.json").unlink()
    code, output = _run("check-config", str(station))
    assert code == 2
    assert "reprobe board" in output


def test_run_refuses_a_bad_configuration(tmp_path: Path) -> None:
    code, output = _run("run", "--config", str(tmp_path / "none.toml"))
    assert code == 2
    assert "check-config" in output


def test_a_second_daemon_on_the_same_sockets_is_told_so(station: Path, tmp_path: Path) -> None:
    api = f'[api]\ncontrol = "ipc://{tmp_path}/control"\nevents = "ipc:///nonexistent/events"\n'
    station.write_text(station.read_text().replace("/var/lib/reprobe", str(tmp_path)) + api)
    code, output = _run("run", "--config", str(station))
    assert code == 1
    assert "another daemon" in output


@pytest.mark.parametrize(
    "command", [["status"], ["trigger", "TP1", "--timeout-s", "0.2"], ["home"], ["lift"], ["reset"]]
)
def test_without_a_daemon_the_tester_is_told_so(command: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.cli.tester.ANSWER_WITHIN_S", 0.2)
    code, output = _run(*command, "--endpoint", NOBODY)
    assert code == 1
    assert "is the daemon running?" in output


def test_board_lists_what_can_be_probed_and_why_not() -> None:
    code, output = _run("board", str(DEMO), "--json")
    assert code == 0
    points = {p["name"]: p["why_not"] for p in json.loads(output)["points"]}
    assert points["TP12"] is None
    assert points["FID1"] == "a fiducial"


def test_a_board_without_targets_is_refused_kindly(tmp_path: Path) -> None:
    folder = tmp_path / "bare"
    shutil.copytree(DEMO, folder)
    netlist = next(folder.glob("*.d356"))
    netlist.write_text(re.sub(r"S[012]$", "S3", netlist.read_text(), flags=re.MULTILINE))
    code, output = _run("demo", "--board", str(folder), "-o", str(tmp_path / "out"))
    assert code == 2
    assert "no probe-able round target" in output
    assert "reprobe board" in output


@pytest.mark.parametrize("found", ["station/journal.sqlite", "station.toml", "notes.txt"])
def test_a_demonstration_touches_no_folder_that_it_did_not_make(tmp_path: Path, found: str) -> None:
    kept = tmp_path / "mine" / found
    kept.parent.mkdir(parents=True)
    kept.write_text("mine")
    code, output = _run("demo", "-o", str(tmp_path / "mine"))
    assert code == 2
    assert "was not made by" in output
    assert kept.read_text() == "mine"
    assert [path for path in (tmp_path / "mine").rglob("*") if path.is_file()] == [kept]


def test_a_demonstration_follows_no_link_to_a_stations_folder(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / MARK).touch()
    (tmp_path / "real").mkdir()
    (tmp_path / "out" / "station").symlink_to(tmp_path / "real")
    code, _ = _run("demo", "-o", str(tmp_path / "out"))
    assert code == 2
    assert [*(tmp_path / "real").iterdir()] == []


def test_a_demonstration_that_is_ended_ends_its_processes(tmp_path: Path) -> None:
    demo = subprocess.Popen(
        [sys.executable, "-m", "daemon.cli", "demo", "-o", str(tmp_path / "out")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    started = Path(f"/proc/{demo.pid}/task/{demo.pid}/children")
    give_up_s = time.monotonic() + 60.0
    while len(children := started.read_text().split()) < 2:
        assert time.monotonic() < give_up_s
        assert demo.poll() is None
        time.sleep(0.05)
    demo.terminate()
    demo.wait(60.0)
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]


def test_calibrate_tip_wants_a_pixel() -> None:
    code, output = _run("calibrate", "tip", "--tip", "middle", "--endpoint", NOBODY)
    assert code == 1
    assert "X,Y" in output
