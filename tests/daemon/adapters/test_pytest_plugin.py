"""The pytest plugin, in runs of pytest of its own."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.adapters.simulated import own_board
from tests.daemon.adapters.station import Listed, listed_station, reading, record

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "doc" / "examples"


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Listed]:
    points = {name: record(name) for name in ("TP1", "TP5", "TP6", "TP7")}
    with listed_station(f"ipc://{tmp_path}/control", points) as listed:
        yield listed


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("board") / "board.json"
    own_board().save(path)
    return path


def run(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run pytest in a folder with the plugin, and nothing of this run's settings."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "REPROBE_"))}
    command = [sys.executable, "-m", "pytest", "-p", "daemon.adapters.pytest_plugin", "-p", "no:cacheprovider", "-rA",
               "--strict-markers", "--rootdir", str(folder), "-c", os.devnull, *arguments]  # fmt: skip
    settings = {**kept, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", **environment}
    return subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True, check=False, timeout=100)


def write(folder: Path, body: str) -> None:
    (folder / "test_it.py").write_text("import pytest\n\n\n" + body)


def test_the_example_tests_each_point_of_its_plan(station: Listed, board: Path, tmp_path: Path) -> None:
    ran = run(tmp_path, str(EXAMPLES / "test_nets.py"), "--reprobe-station", station.endpoint, "--reprobe-board",
              str(board), "--reprobe-board-id", "4711")  # fmt: skip
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "6 passed" in ran.stdout
    for case in ("TP1-continuity", "TP5-continuity", "TP6-continuity", "test_the_needle_makes_contact[TP6]"):
        assert case in ran.stdout
    probes = [asked for asked in station.asked if asked["op"] == "probe"]
    assert {asked["board_id"] for asked in probes} == {"4711"}
    assert [asked["test_point"] for asked in probes] == ["TP1", "TP1", "TP5", "TP6", "TP6", "TP7"]


def test_what_does_not_pass_fails_its_case_and_shows_why(tmp_path: Path) -> None:
    told = {
        "OPEN": record("OPEN", "open_confirmed", readings=[reading(None)], reason="proved at two sites"),
        "DIRT": record("DIRT", "contact_not_made", readings=[reading(None)], reason="three touches"),
    }
    write(
        tmp_path,
        """@pytest.mark.reprobe_points(["OPEN", "DIRT", "GONE"])
def test_net(probe, point):
    assert probe(point).ohms < 2


def test_word(probe):
    assert probe("OPEN")
""",
    )
    with listed_station(f"ipc://{tmp_path}/control", told) as station:
        ran = run(tmp_path, REPROBE_STATION=station.endpoint)
    assert ran.returncode == 1
    assert "4 failed" in ran.stdout
    assert "assert inf < 2" in ran.stdout
    assert "DIRT was not measured: contact_not_made. three touches" in ran.stdout
    assert "unknown_test_point" in ran.stdout
    assert "<OPEN: open_confirmed, proved at two sites>" in ran.stdout


def test_without_a_station_nothing_passes(tmp_path: Path) -> None:
    write(tmp_path, "def test_net(probe):\n    assert probe('TP1')\n")
    ran = run(tmp_path)
    assert ran.returncode == 1
    assert "1 error" in ran.stdout
    assert "no station: give --reprobe-station ENDPOINT" in ran.stdout
    assert "Traceback" not in ran.stdout


def test_tests_that_need_no_station_run_without_one(tmp_path: Path) -> None:
    write(tmp_path, "def test_it():\n    assert True\n")
    assert run(tmp_path).returncode == 0


BAD = {
    "both": ("def test_it(probe): pass", ["--reprobe-sim", "--reprobe-station", "ipc:///x"], "not both"),
    "no argument": ("@pytest.mark.reprobe_points(['TP1'])\ndef test_it(): pass", [], "takes no argument `point`"),
    "no plan": ("@pytest.mark.reprobe_points()\ndef test_it(point): pass", [], "takes one plan"),
    "number": ("@pytest.mark.reprobe_points(7)\ndef test_it(point): pass", [], "takes a plan file or a list"),
    "not there": ("@pytest.mark.reprobe_points('gone.toml')\ndef test_it(point): pass", [], "cannot be read"),
    "no form": ("@pytest.mark.reprobe_points('plan.txt')\ndef test_it(point): pass", [], "has to end in .toml or .csv"),
    "no board": ("@pytest.mark.reprobe_points('plan.toml')\ndef test_it(point): pass", [], "give --reprobe-board"),
    "bad board": ("@pytest.mark.reprobe_points('plan.toml')\ndef test_it(point): pass",
                  ["--reprobe-board", "gone.json"], "gone.json cannot be read"),
    "bad plan": ("@pytest.mark.reprobe_points('plan.toml')\ndef test_it(point): pass", ["BOARD"], "no net 'CLOCK'"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_what_is_asked_wrongly_is_refused_in_words(kind: str, board: Path, tmp_path: Path) -> None:
    body, arguments, words = BAD[kind]
    write(tmp_path, body)
    (tmp_path / "plan.toml").write_text('[plan]\nboard = "demo_board"\n[[point]]\nnet = "CLOCK"\nhigh = "1 ohm"\n')
    given = ["--reprobe-board", str(board)] if arguments == ["BOARD"] else arguments
    ran = run(tmp_path, *given)
    assert ran.returncode != 0
    assert words in ran.stdout + ran.stderr
    assert "INTERNALERROR" not in ran.stdout + ran.stderr
