"""The command line says what is wrong, what to do next, and exits accordingly."""

import json
import random
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.demo import MARK
from daemon.domain.board import Board
from daemon.wire.operations.table import OPERATIONS

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
    code, output = _run("board", str(DEMO), "-o", str(tmp_path / "board.json"))
    assert code == 0, output
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
    code, output = _run("serve", "--config", str(tmp_path / "none.toml"))
    assert code == 2
    assert "check-config" in output
    assert "REPROBE_CONFIG" in output, "nobody can correct a file that is not there"


def test_a_start_that_cannot_be_says_why_and_what_to_do(station: Path, tmp_path: Path) -> None:
    text = station.read_text().replace("/var/lib/reprobe", str(tmp_path / "data"))
    board = tmp_path / "board.json"
    whole = board.read_text()

    def start(api: str, settings: str = text) -> tuple[int, str]:
        station.write_text(f"{settings}[api]\n{api}\n")
        return _run("serve", "--config", str(station))

    code, output = start('control = "ipc:///nonexistent/control"')
    assert (code, "make the folder" in output) == (1, True), output
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, output = start(f'control = "tcp://127.0.0.1:{taken.getsockname()[1]}"')
    assert (code, "another daemon" in output) == (1, True), output
    code, output = start('curve = true\nkeys_dir = "none"')
    assert (code, "keys new" in output) == (2, True), output
    (tmp_path / "file").write_text("")
    code, output = start("", text.replace(str(tmp_path / "data"), str(tmp_path / "file")))
    assert (code, "station.data_dir" in output) == (1, True), output
    for spoil in (lambda: board.write_text("{"), board.unlink, board.mkdir):
        spoil()
        code, output = start("")
        assert (code, "reprobe board" in output, "check-config" in output) == (2, True, True), output
    board.rmdir()
    board.write_text(whole)


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
    assert "no target on its top that may be touched" in output
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


def _clean(output: str) -> str:
    return re.sub(r"\s+", " ", output)


def test_board_says_the_net_coverage_first() -> None:
    code, output = _run("board", str(DEMO))
    assert code == 0
    said = _clean(output)
    assert (
        said.index("21 nets") < said.index("top │ 21 │ 100.0%") < said.index("bottom │ 6 │ 28.6%") < said.index("TP1")
    )
    facts = json.loads(_run("board", str(DEMO), "--side", "bottom", "--json")[1])
    assert {k: v for k, v in facts["coverage"].items() if k != "neither"} == {
        "nets": 21, "top": 21, "bottom": 6, "either": 21,
    }  # fmt: skip
    assert facts["unserved"]["DATA2"].startswith("TP5: it lies on the top")
    assert "layers" not in facts


def test_board_names_the_points_that_a_station_cannot_reach(station: Path) -> None:
    text = station.read_text()
    whole = json.loads(_run("board", str(DEMO), "-c", str(station), "--json")[1])
    assert whole["out_of_reach"] == {}
    assert "nest puts the board's lower left corner at" in whole["station"]
    station.write_text(text.replace("minimum = 0.0", "minimum = 120000.0", 1))
    short = json.loads(_run("board", str(DEMO), "-c", str(station), "--json")[1])
    assert short["out_of_reach"]["TP1"].startswith("out of reach at every head angle: x")


@pytest.mark.parametrize("text", ["[axes", "", "[station]\nname = 3\n"])
def test_a_station_file_that_lies_here_and_is_wrong_is_only_noted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("station.toml").write_text(text)
    code, output = _run("board", str(DEMO), "-o", "board.json")
    assert code == 0, output
    assert "note: station.toml" in output
    assert Path("board.json").is_file()
    facts = json.loads(_run("board", str(DEMO), "--json")[1])
    assert facts["station"] is None
    assert any(note.startswith("station.toml") for note in facts["notes"])


def test_a_station_that_is_named_and_wrong_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[axes")
    code, output = _run("board", str(DEMO), "-c", str(tmp_path / "mine.toml"), "-o", str(tmp_path / "board.json"))
    assert code == 2
    assert "error: " in output
    assert not (tmp_path / "board.json").exists()


def test_a_layer_option_may_name_several_files(tmp_path: Path) -> None:
    shutil.copytree(DEMO, tmp_path / "board")
    drills = sorted(p.name for p in (tmp_path / "board").glob("*.drl"))
    assert len(drills) > 1
    ignored = [word for name in drills for word in ("--layer", f"ignored={name}")]
    code, output = _run("board", str(tmp_path / "board"), *ignored)
    assert code == 0, output
    assert "no drill file was found" in output


def test_board_writes_a_packed_file_that_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "board.json.gz"
    code, output = _run("board", str(DEMO), "--bare", "-o", str(path))
    assert code == 0
    board = Board.load(path)
    assert len(board.seat) >= 3
    assert re.search(r"seat: [3-9] places are found once on the board; `reprobe align` looks at them", _clean(output))
    assert board.point("U1.3").net == "DATA0"
    assert board.side_layers("bottom") is not None


def test_board_takes_a_zip(tmp_path: Path) -> None:
    packed = shutil.make_archive(str(tmp_path / "cad"), "zip", DEMO)
    assert json.loads(_run("board", packed, "--json")[1])["coverage"]["either"] == 21


def test_board_is_told_what_a_file_is_and_keeps_it(tmp_path: Path) -> None:
    folder = tmp_path / "board"
    shutil.copytree(DEMO, folder)
    next(folder.glob("*F_Mask*")).rename(folder / "art7.pho")
    code, output = _run("board", str(folder), "--layer", "top_mask=art7.pho", "--json")
    assert code == 0, output
    assert json.loads(output)["coverage"]["top"] == 21
    assert json.loads(_run("board", str(folder), "--json")[1])["coverage"]["top"] == 21


def test_board_prints_names_with_brackets_as_they_are(tmp_path: Path) -> None:
    folder = tmp_path / "P[" / "rev]"
    shutil.copytree(DEMO, folder)
    netlist = next(folder.glob("*.d356"))
    text = netlist.read_text()
    odd = {"DATA0": "BUS[/x]", "DATA1": "A[red]B", "DATA2": "C:x:D"}
    for net, name in odd.items():
        text = re.sub(rf"^(...){net} {{{len(name) - len(net)}}}", rf"\1{name}", text, flags=re.MULTILINE)
    netlist.write_text(text)
    # Covered on both sides: a net of which is said why no point is on it.
    netlist.write_text(re.sub(r"^(...A\[red\]B.*)S2$", r"\1S3", netlist.read_text(), flags=re.MULTILINE))
    result = runner.invoke(app, ["board", str(folder)])
    assert result.exit_code == 0, result.output
    assert all(name in result.output for name in odd.values())
    assert "no point on A[red]B: " in result.output
    assert "rev], 40.00 x" in result.output


def test_board_names_a_folder_with_brackets_in_its_errors(tmp_path: Path) -> None:
    folder = tmp_path / "P[" / "rev]"
    folder.mkdir(parents=True)
    for arguments in (
        [str(folder)],
        [str(tmp_path / "P[red]:x:")],
        [str(DEMO), "--layer", "[/x]"],
        [str(DEMO), "-o", str(tmp_path / "no[/y]" / "board.json")],
    ):
        result = runner.invoke(app, ["board", *arguments])
        assert result.exit_code == 2
        assert isinstance(result.exception, SystemExit)
        assert arguments[-1] in result.output.replace("\n", "")


@pytest.mark.parametrize(
    "arguments",
    [
        ["nowhere"],
        [str(EXAMPLE)],
        [str(DEMO), "--layer", "top_mask"],
        [str(DEMO), "--layer", "lid=demo-F_Cu.gtl"],
        [str(DEMO), "--layer", "top_mask=nothing.gbr"],
        [str(DEMO), "--netlist", "nothing.ipc"],
        [str(DEMO), "--copy", "7"],
        [str(DEMO), "-o", "/nonexistent/board.json"],
        [str(DEMO), "-c", "/nonexistent/station.toml"],
    ],
)
def test_board_refuses_what_makes_no_sense_in_a_sentence(arguments: list[str]) -> None:
    code, output = _run("board", *arguments)
    assert code == 2
    assert "error: " in output
    assert "Traceback" not in output


@pytest.mark.parametrize("seed", range(6))
def test_board_ends_kindly_on_files_that_were_damaged(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)
    folder = tmp_path / "board"
    shutil.copytree(DEMO, folder)
    for file in sorted(folder.iterdir()):
        content = bytearray(file.read_bytes())
        for _ in range(3):
            start = chance.randrange(len(content))
            content[start : start + chance.randrange(1, 40)] = chance.randbytes(chance.randrange(40))
        file.write_bytes(bytes(content))
    result = runner.invoke(app, ["board", str(folder)])
    assert result.exit_code in (0, 2)
    assert result.exception is None or isinstance(result.exception, SystemExit)


def test_every_job_that_takes_a_board_id_takes_it_on_the_command_line(tmp_path: Path) -> None:
    words = {
        "correct": ["trigger", "TP1"], "place": ["place", "TP1"], "align": ["align"], "touch": ["touch", "TP1"],
        "probe": ["probe", "TP1"], "run": ["run", "power"],
        "history": ["history"], "point": ["point", "TP1"],
    }  # fmt: skip
    taking = {row.op for row in OPERATIONS.rows if "board_id" in row.request.model_fields}
    assert taking == set(words)
    endpoint = f"ipc://{tmp_path}/control"
    for op, command in words.items():
        with _refusing(endpoint) as asked:
            code, _ = _run(*command, "--board-id", "SN-17", "--endpoint", endpoint)
        assert code == (3 if op == "probe" else 1), "1 is what probe says of a net that is at fault"
        (request,) = [request for request in asked if request["op"] == op]
        assert request["board_id"] == "SN-17"


@contextmanager
def _refusing(endpoint: str) -> Iterator[list[dict[str, Any]]]:
    """Answer status, refuse the rest; what was asked is in the list."""
    asked: list[dict[str, Any]] = []
    context = zmq.Context()
    router = context.socket(zmq.ROUTER)
    router.bind(endpoint)
    error = {"code": 1001, "name": "bad_request", "message": "not here", "advice": "none", "detail": {}}

    def answer() -> None:
        while True:
            *envelope, body = router.recv_multipart()
            if body == b"end":
                return
            request = json.loads(body)
            asked.append(request)
            good = request["op"] in ("status", "snapshot", "describe")
            reply = (
                {"v": 1, "ok": good, "events": f"{endpoint}-events"} if good else {"v": 1, "ok": False, "error": error}
            )
            router.send_multipart([*envelope, json.dumps(reply).encode()])

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield asked
    finally:
        with context.socket(zmq.DEALER) as ending:
            ending.connect(endpoint)
            ending.send(b"end")
            thread.join()
        router.close(linger=0)
        context.term()
