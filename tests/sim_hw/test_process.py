"""The simulated station as a process: it starts, serves its wires, and goes when told."""

import json
import os
import select
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zmq

import sim_hw
from sim_hw.board.board import load_board
from sim_hw.bus.modbus import crc16, seal
from tests.sim_hw.small_board import write_board

ROOT = Path(sim_hw.__file__).parents[1]
BOARD = ROOT / "sim_hw" / "demo_board"
LIMIT_S = 30.0


def command(folder: Path, *more: str) -> list[str]:
    return [
        *(sys.executable, "-m", "sim_hw", "--board", str(BOARD), "--line", str(folder / "line")),
        *("--camera", f"ipc://{folder}/camera", "--bench", f"ipc://{folder}/bench"),
        *("--truth", str(folder / "truth.jsonl"), *more),
    ]


@dataclass
class Running:
    process: subprocess.Popen[str]
    folder: Path
    ready: dict[str, Any]

    def bench(self, **request: Any) -> dict[str, Any]:
        with zmq.Context() as context, context.socket(zmq.REQ) as socket:
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.RCVTIMEO, 10_000)
            socket.connect(self.ready["bench"])
            socket.send_json(request)
            return dict(socket.recv_json())

    def ask(self, body: str) -> bytes:
        """Exchange one frame over the line; the PDU's hex is without CRC."""
        line = os.open(self.ready["line"], os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(line, seal(bytes.fromhex(body)))
            reply = b""
            while len(reply) < 5 or crc16(reply):
                assert select.select([line], [], [], 5.0)[0], "no reply"
                reply += os.read(line, 4096)
        finally:
            os.close(line)
        return reply

    def write(self, address: int, index: int, sub: int, data: bytes) -> None:
        head = struct.pack(">BBBBBBHBHH", address, 0x2B, 0x0D, 1, 0, 1, index, sub, 0, len(data))
        assert self.ask((head + data).hex())[1] == 0x2B

    def events(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.folder / "truth.jsonl").read_text().splitlines()]

    def wait_for(self, event: str, count: int = 1) -> list[dict[str, Any]]:
        """Wait until the truth log holds so many events of a kind."""
        end_s = time.monotonic() + LIMIT_S
        while len(found := [item for item in self.events() if item["event"] == event]) < count:
            assert time.monotonic() < end_s, f"no {event}"
            select.select([], [], [], 0.02)
        return found


def start(folder: Path, *more: str) -> Running:
    process = subprocess.Popen(
        command(folder, *more), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        _, errors = process.communicate(timeout=LIMIT_S)
        pytest.fail(errors)
    return Running(process, folder, json.loads(line))


def end(running: Running, how: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
    running.process.send_signal(how)
    _, errors = running.process.communicate(timeout=LIMIT_S)
    return running.process.returncode, errors


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = start(tmp_path_factory.mktemp("sim"), "--seed", "3", "--speed", "20", "--unpaced")
    yield running
    if running.process.poll() is None:
        end(running)


def test_ready_names_every_wire(station: Running) -> None:
    assert station.ready["ready"] is True
    assert station.ready["pid"] == station.process.pid
    assert str(Path(station.ready["line"]).readlink()) == station.ready["pty"]
    wires = {"line", "pty", "camera", "bench", "meter", "meter_pty", "truth"}
    assert set(station.ready) == {"ready", "pid"} | wires


def test_a_homing_and_a_move_come_to_rest_in_the_truth_log_unasked(station: Running) -> None:
    before = len([item for item in station.events() if item["event"] == "settled"])
    for index, data in ((0x6098, b"\x15"), (0x6060, b"\x06")):
        station.write(1, index, 0, data)
    station.write(1, 0x6099, 1, struct.pack("<I", 300))
    station.write(1, 0x609A, 0, struct.pack("<I", 6000))
    for word in (0x06, 0x07, 0x0F, 0x1F):
        station.write(1, 0x6040, 0, struct.pack("<H", word))
    record = station.wait_for("settled", before + 1)[-1]
    assert abs(record["axes"]["x_um"]) < 500.0
    assert record["t_s"] > 0.0
    station.write(1, 0x6060, 0, b"\x01")
    station.write(1, 0x607A, 0, struct.pack("<i", round(60_000 * 655.36)))
    station.write(1, 0x6040, 0, struct.pack("<H", 0x0F))
    station.write(1, 0x6040, 0, struct.pack("<H", 0x1F))
    record = station.wait_for("settled", before + 2)[-1]
    assert record["axes"]["x_um"] == pytest.approx(60_000.0, abs=50.0)
    truth = station.bench(cmd="truth")
    assert truth["ok"] is True
    assert truth["moving"] is False
    assert truth["axes"]["x_um"] == pytest.approx(record["axes"]["x_um"])


def test_lights_and_faults_reach_the_log(station: Running) -> None:
    station.ask("05050001ff00")
    assert station.wait_for("light")[-1]["lamp"] == "red"
    assert station.bench(cmd="fault", name="dead_lamp", on=True, lamp="red") == {"ok": True}
    assert station.bench(cmd="status")["faults"] == ["dead_lamp"]
    assert station.bench(cmd="truth")["red"] == 0.0
    assert station.bench(cmd="fault", name="dead_lamp", on=False) == {"ok": True}
    fault = station.wait_for("fault", 2)
    assert [item["on"] for item in fault[-2:]] == [True, False]
    assert station.bench(cmd="faults")["faults"]["frozen"] == {"on": False}


def test_the_bench_moves_the_card_and_makes_an_axis_slip(station: Running) -> None:
    for name, value in (("card_dx_um", 1500.0), ("card_dy_um", -700.0)):
        assert station.bench(cmd="set", name=name, value=value) == {"ok": True}
    before = station.bench(cmd="truth")
    settled = len([item for item in station.events() if item["event"] == "settled"])
    assert station.bench(cmd="fault", name="slip", on=True, axis="y", um=-90.0) == {"ok": True}
    assert station.bench(cmd="fault", name="slip", on=False) == {"ok": True}
    after = station.bench(cmd="truth")
    assert after["axes"]["y_um"] - before["axes"]["y_um"] == pytest.approx(-90.0)
    assert after["axes"]["x_um"] == before["axes"]["x_um"]
    assert after["pressed_um"] == 0.0
    assert station.wait_for("settled", settled + 1)[-1]["axes"]["y_um"] == pytest.approx(after["axes"]["y_um"])
    assert station.bench(cmd="fault", name="slip", on=True, axis="z")["ok"] is False


def test_the_head_is_told_as_in_the_truth_without_what_lies_about_the_tip(station: Running) -> None:
    truth, head = station.bench(cmd="truth"), station.bench(cmd="head")
    left_out = {"targets", "side", "cad_mm", "board_um", "on", "pads"}
    assert set(truth) - set(head) == left_out
    assert head["t_s"] > truth["t_s"]
    for lamp in ("white", "red"):
        assert head[lamp] == pytest.approx(truth[lamp], abs=0.2), "it may still glow"
    for name in ("axes", "tip_um", "pressed_um", "moving"):
        assert head[name] == truth[name], name


def test_the_bench_turns_knobs_and_power(station: Running) -> None:
    assert station.bench(cmd="set", name="board_dx_um", value=50.0) == {"ok": True}
    station.write(4, 0x2400, 0x20, struct.pack("<i", 7))
    assert station.bench(cmd="power_cycle") == {"ok": True}
    station.wait_for("power_cycle")
    # The drives boot for half a simulated second.
    end_s = time.monotonic() + LIMIT_S
    while station.bench(cmd="status")["t_s"] < station.wait_for("power_cycle")[-1]["t_s"] + 0.6:
        assert time.monotonic() < end_s
    reply = station.ask("042b0d0000012400200000" + "0004")
    assert reply[13:17] == bytes(4)


@pytest.mark.parametrize(
    ("request_", "says"),
    [
        ({"cmd": "dance"}, "unknown command 'dance'"),
        ({}, "unknown command None"),
        ({"cmd": "fault", "name": "dance", "on": True}, "unknown fault"),
        ({"cmd": "fault", "name": "stall", "on": "yes"}, "true or false"),
        ({"cmd": "set", "name": "board_dx_um"}, 'exactly "name" and "value"'),
        ({"cmd": "set", "name": "board_dx_um", "value": "left"}, "must be a number"),
        ({"cmd": "truth", "deep": True}, "takes nothing else"),
        ({"cmd": "board", "folder": "/nonexistent"}, "no board folder at /nonexistent"),
        ({"cmd": "board", "side": "left"}, "neither 'top' nor 'bottom'"),
        ({"cmd": "board", "upside": "down"}, "takes a text"),
        ({"cmd": "set", "name": "board_mask", "value": "pink"}, "must be one of green"),
    ],
)
def test_the_bench_says_what_is_wrong_and_goes_on(station: Running, request_: dict[str, Any], says: str) -> None:
    reply = station.bench(**request_)
    assert reply["ok"] is False
    assert says in reply["error"]
    assert station.bench(cmd="status")["ok"] is True


def test_left_alone_it_comes_to_idle(station: Running) -> None:
    """It draws the board ahead for some seconds; after that nothing turns over."""

    def used_s() -> float:
        fields = Path(f"/proc/{station.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    end_s, spent_s = time.monotonic() + LIMIT_S, 1.0
    while spent_s > 0.1:
        assert time.monotonic() < end_s, f"{spent_s} s of processor time in the last second"
        before_s = used_s()
        select.select([], [], [], 1.0)
        spent_s = used_s() - before_s


LEVEL = {"board_dx_um": 0, "board_dy_um": 0, "board_rotation_deg": 0, "head_runout_scale": 0, "board_marks": 1}


@pytest.fixture(scope="module")
def assembled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A small assembled board under a pressed needle (its free end 100 um below the surface)."""
    folder = tmp_path_factory.mktemp("assembled")
    board = write_board(folder / "small")
    knobs = [f"--set={name}={value}" for name, value in {**LEVEL, "z_start_um": 4_900}.items()]
    running = start(folder, "--unpaced", "--assembled", *knobs, "--board", str(board))
    yield running
    end(running)


def bring(station: Running, x_um: float, y_um: float) -> dict[str, Any]:
    """Let X and Y slip until the tip is over a place of the board; return the last record at rest."""
    for axis, wanted_um, k in (("x", x_um, 0), ("y", y_um, 1)):
        way_um = wanted_um - station.bench(cmd="truth")["board_um"][k]
        settled = len([item for item in station.events() if item["event"] == "settled"])
        assert station.bench(cmd="fault", name="slip", on=True, axis=axis, um=way_um)["ok"]
        record = station.wait_for("settled", settled + 1)[-1]
    return record


def test_a_touch_is_told_by_net_and_pin_and_leaves_a_dent(assembled: Running) -> None:
    record = bring(assembled, 13_000.0, 3_000.0)
    assert (record["on"]["what"], record["on"]["pin"], record["on"]["net"]) == ("metal", "TP1.1", "VIN")
    assert record["on"]["inside_um"] == pytest.approx(500.0, abs=5.0)
    assert record["pressed_um"] > 50.0
    marks = assembled.bench(cmd="status")["marks"]
    assert marks >= 1
    assert assembled.bench(cmd="board") == {
        "ok": True,
        "board": str(assembled.folder / "small"),
        "side": "top",
        "assembled": True,
        "seat": 1,
    }
    assert assembled.bench(cmd="status")["marks"] == marks, "the same board, laid in again"


def test_a_part_in_the_needles_way_is_told(assembled: Running) -> None:
    record = bring(assembled, 3_700.0, 3_000.0)
    assert (record["on"]["what"], record["on"]["part"]) == ("body", "R1")
    assert assembled.wait_for("hit_body")[-1]["part"] == "R1"


def test_boards_are_exchanged_while_the_station_runs(station: Running) -> None:
    on_top = {pad["pin"] for pad in station.bench(cmd="pads")["pads"]}
    assert {"TP1.1", "J1.1"} <= on_top
    pose = station.bench(cmd="truth")
    reply = station.bench(cmd="board", side="bottom")
    assert (reply["ok"], reply["side"], reply["seat"]) == (True, "bottom", 1)
    assert station.wait_for("board")[-1]["side"] == "bottom"
    assert station.bench(cmd="truth")["side"] == "bottom"
    assert station.bench(cmd="pads")["side"] == "bottom"
    other = write_board(station.folder / "other")
    assert station.bench(cmd="board", folder=str(other), side="top", assembled=True)["ok"] is True
    assert {pad["pin"] for pad in station.bench(cmd="pads")["pads"]} == {pad.name for pad in load_board(other).pads}
    assert station.bench(cmd="board", folder="/nonexistent")["ok"] is False
    assert station.bench(cmd="status")["board"] == str(other)
    assert station.bench(cmd="board", folder=str(BOARD), assembled=False)["ok"] is True
    assert station.bench(cmd="truth")["tip_um"][:2] == pytest.approx(pose["tip_um"][:2])


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT, None])
def test_it_ends_cleanly_and_leaves_nothing_behind(tmp_path: Path, how: signal.Signals | None) -> None:
    running = start(tmp_path)
    if how is None:
        assert running.bench(cmd="shutdown") == {"ok": True}
        assert running.process.wait(LIMIT_S) == 0
        running.process.communicate()
    else:
        assert end(running, how) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["truth.jsonl"]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("--set", "backlash=3"), "unknown knob 'backlash'"),
        (("--set", "board_dx_um"), "needs KNOB=VALUE"),
        (("--speed", "0"), "--speed must be above 0"),
        (("--side", "left"), "invalid choice"),
        (("--tiles", "0"), "--tiles must be 1 or more"),
        (("--meter-port", "70000"), "--meter-port must be 0 to 65535"),
        (("--meter-line", "/nonexistent/meter"), "No such file"),
        (("--board", "/nonexistent"), "is not a folder"),
        (("--truth", "/nonexistent/truth.jsonl"), "No such file"),
        (("--bench", "nowhere"), "Invalid argument"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_2(tmp_path: Path, more: tuple[str, ...], says: str) -> None:
    done = subprocess.run(
        command(tmp_path, *more), capture_output=True, text=True, timeout=LIMIT_S, cwd=ROOT, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert says in done.stderr
