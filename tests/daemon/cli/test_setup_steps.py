"""What is answered to the guided set-up is checked where it is answered, and paths may begin where it was typed."""

from __future__ import annotations

import os
import shlex
import socket
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import pytest
from typer.testing import CliRunner

from daemon.cli import setup as guided
from daemon.cli import setup_file_steps as file_steps
from daemon.cli import setup_station_steps as station_steps
from daemon.cli.app import app
from daemon.cli.last_resort import UNFORESEEN
from daemon.cli.progress import Interrupted
from daemon.cli.setup_dialogue import Dialogue, StepFailed
from daemon.cli.setup_file_steps import Setup
from daemon.client import Refused
from daemon.config.model import load_config
from daemon.tools.setup import Answering, Notes, read_value, with_values

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.usefixtures("logging_as_before")


@pytest.mark.parametrize("step", ["drives", "camera"])
def test_a_device_that_is_not_there_is_no_silent_one(tmp_path: Path, step: str) -> None:
    file = tmp_path / "station.toml"
    result = CliRunner().invoke(app, ["setup", "-c", str(file), "--only", step], input="ttyNOBODY\nq\n")
    assert result.exit_code == 1
    assert "there is no device 'ttyNOBODY'" in result.output
    assert "nobody answers" not in result.output


def test_a_board_may_be_named_as_it_is_seen_from_where_it_was_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT / "sim_hw")
    file = tmp_path / "station.toml"
    result = CliRunner().invoke(
        app, ["setup", "-c", str(file), "--only", "board"], input="demo_board\ntop\ny\n60\n40\n"
    )
    assert "Board demo_board, top" in result.output
    assert tomllib.loads(file.read_text())["board"]["file"] == "board.json"
    assert (tmp_path / "board.json").is_file()


def test_a_frame_servers_socket_given_as_a_path_is_no_camera_and_it_is_said_how_it_is_written(tmp_path: Path) -> None:
    there = tmp_path / "camera"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(there))
        written, said = _only(tmp_path / "station.toml", "camera", str(there), "", f"ipc://{there}")
    assert f"a frame server is written as ipc://{there}" in said
    assert (written["camera"]["kind"], written["camera"]["endpoint"]) == ("stream", f"ipc://{there}")


def _only(file: Path, step: str, *answers: str) -> tuple[dict[str, Any], str]:
    """Do one step; return the file's content and what was said."""
    result = CliRunner().invoke(app, ["setup", "-c", str(file), "--only", step], input="\n".join([*answers, ""]))
    return tomllib.loads(file.read_text()) if file.exists() else {}, result.output


def test_a_slip_in_the_mechanics_is_gone_back_to_and_what_came_before_it_stays(tmp_path: Path) -> None:
    x_axis = ["20", "0", "300", "999", "<", "298", "21"]
    written, said = _only(tmp_path / "station.toml", "mechanics", *x_axis, *[""] * 40)
    axis = written["axes"]["x"]
    assert (axis["maximum"], axis["homing_position"], axis["homing_method"]) == (300_000.0, 298_000.0, 21)
    assert said.count("travel with one turn of the motor, mm") == 3, "what was answered is not shown again"
    assert "< as an answer goes back" in said


def test_what_was_measured_or_written_by_hand_since_is_offered_and_a_direction_stays(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    _only(file, "mechanics", *[""] * 40)
    since = {"axes.x.increments_per_unit": -668.2, "axes.x.maximum": 195_000.0, "gantry.touch_z_um": 4_321.0,
             "axes.y.homing_method": 21}  # fmt: skip
    file.write_text(with_values(file.read_text(), since))
    written, _ = _only(file, "mechanics", *[""] * 40)
    assert written["axes"]["x"]["increments_per_unit"] == pytest.approx(-668.2, rel=1e-5)
    assert written["axes"]["x"]["maximum"] == pytest.approx(195_000.0)
    assert written["axes"]["y"]["homing_method"] == 21
    assert written["gantry"]["touch_z_um"] == pytest.approx(4_321.0)


@pytest.mark.parametrize(("step", "key"), [
    ("name", "station.name"), ("name", "station.data_dir"), ("sockets", "api.control"), ("meter", "meter.address"),
])  # fmt: skip
def test_what_was_written_by_hand_since_it_was_answered_stays(tmp_path: Path, step: str, key: str) -> None:
    file = tmp_path / "station.toml"
    answers = ["y", "127.0.0.1:5025", "none"] if step == "meter" else ["tcp://127.0.0.1:7001", "tcp://127.0.0.1:7002"]
    _only(file, step, *answers)
    file.write_text(with_values(file.read_text(), {key: "10.0.0.9:5025"}))
    _only(file, step, *[""] * 5)
    assert read_value(file.read_text(), key) == "10.0.0.9:5025"


@pytest.mark.parametrize("address", ["192.168.0.7:abc", "127.0.0.1:", "127.0.0.1:99999", ":502"])
def test_a_gateway_that_is_mistyped_is_said_with_how_it_is_written(tmp_path: Path, address: str) -> None:
    said = _only(tmp_path / "station.toml", "drives", address, "q")[1]
    assert "is no host:port" in said
    assert "192.168.0.7:502" in said


def test_from_the_first_question_it_goes_back_to_the_step_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guided, "STEPS", [one for one in guided.STEPS if one.name in ("name", "sockets")])
    file = tmp_path / "station.toml"
    answers = ["<", "wrong", "", "<", "right", "", "tcp://127.0.0.1:7001", ""]
    result = CliRunner().invoke(app, ["setup", "-c", str(file)], input="\n".join([*answers, ""]))
    assert result.exit_code == 0, result.output
    written = tomllib.loads(file.read_text())
    assert (written["station"]["name"], written["api"]["control"]) == ("right", "tcp://127.0.0.1:7001")


def _walk(monkeypatch: pytest.MonkeyPatch, file: Path, *names: str, answers: list[str]) -> str:
    """Do some steps; return what was said."""
    monkeypatch.setattr(guided, "STEPS", [one for one in guided.STEPS if one.name in names])
    result = CliRunner().invoke(app, ["setup", "-c", str(file)], input="\n".join([*answers, ""]))
    assert result.exit_code == 0, result.output
    return result.output


def test_back_in_the_boards_step_bare_is_still_bare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board = [str(ROOT / "sim_hw" / "demo_board"), "top", "y", "60", "40"]
    said = _walk(monkeypatch, tmp_path / "station.toml", "board", "sockets", answers=[*board, "<", *[""] * 8])
    asked = [line for line in said.splitlines() if "Is the board bare" in line]
    assert ["[y/N]" in asked[0], "[Y/n]" in asked[1]] == [True, True], "what was answered is offered"


def test_the_line_is_asked_once_while_addresses_are_gone_back_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[object] = []

    async def who(section: object) -> Answering:
        asked.append(section)
        return Answering(115200, "N", (1, 2, 3, 4), (5,))

    monkeypatch.setattr(file_steps, "who_answers", who)
    written, _ = _only(tmp_path / "station.toml", "drives", "127.0.0.1:502", "1", "3", "<", "2", "", "4", "7.5", "5")
    assert [written["axes"][axis]["address"] for axis in ("x", "y", "z", "theta")] == [1, 2, 3, 4]
    assert written["lights"]["address"] == 5
    assert len(asked) == 1
    _only(tmp_path / "station.toml", "drives", "127.0.0.1:502", *[""] * 5)
    assert len(asked) == 2, "who comes again may have plugged in another"


def test_who_goes_back_sees_the_one_question_again_and_not_all_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = [str(ROOT / "sim_hw" / "demo_board"), "top", "y", "60", "<", "70", "40"]
    said = _walk(monkeypatch, tmp_path / "station.toml", "board", answers=board)
    times = [
        said.count(one) for one in ("Board file, or", "Side that is probed", "Is the board bare", "X of the board")
    ]
    assert times == [1, 1, 1, 2], said


@pytest.mark.parametrize(("names", "hinted"), [(("check",), False), (("camera",), False), (("name", "check"), True)])
def test_going_back_is_offered_where_there_is_something_to_go_back_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...], hinted: bool
) -> None:
    file = tmp_path / "station.toml"
    file.write_text((ROOT / "systemd" / "station.example.toml").read_text())
    said = _walk(
        monkeypatch, file, *names, answers=[f"ipc://{tmp_path}/frames" if "camera" in names else "s", "s", "s"]
    )
    assert ("goes back" in said or "<: the step before" in said) == hinted


def test_of_what_is_unlikely_it_is_said_how_to_mend_it_before_the_head_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "station.toml"
    example = (ROOT / "systemd" / "station.example.toml").read_text()
    file.write_text(with_values(example, {"axes.x.homing_position": -300_000.0}))
    said = _walk(monkeypatch, file, "check", answers=[])
    assert "homing_position" in said
    assert "before anything moves" in said
    assert "--only NAME" in said


def test_at_the_very_first_question_nothing_is_before_it(tmp_path: Path) -> None:
    written, said = _only(tmp_path / "station.toml", "name", "<", "left", "")
    assert "there is no question before this one" in said
    assert written["station"]["name"] == "left"


@pytest.mark.parametrize("step", ["name", "mechanics", "camera", "board", "meter", "sockets"])
def test_a_file_that_is_damaged_is_said_with_its_line_and_stays(tmp_path: Path, step: str) -> None:
    file = tmp_path / "station.toml"
    damaged = (ROOT / "systemd" / "station.example.toml").read_text() + "\n[meter]\nchannels = {\n"
    file.write_text(damaged)
    answers = [str(ROOT / "sim_hw" / "demo_board"), "", ""] if step == "board" else [f"ipc://{tmp_path}/x", "", "", ""]
    result = CliRunner().invoke(app, ["setup", "-c", str(file), "--only", step], input="\n".join([*answers, "q", ""]))
    assert result.exit_code == 1
    assert f"{file} cannot be read" in result.output
    assert "at line" in result.output
    assert "Traceback" not in result.output
    assert UNFORESEEN not in result.output
    assert file.read_text() == damaged


@pytest.mark.parametrize("step", ["name", "mechanics", "meter", "sockets"])
def test_a_pipe_is_no_file_to_wait_for(tmp_path: Path, step: str) -> None:
    os.mkfifo(tmp_path / "station.toml")
    said = CliRunner().invoke(app, ["setup", "-c", str(tmp_path / "station.toml"), "--only", step], input="q\n").output
    assert "cannot be read" in said


@pytest.mark.parametrize(("step", "key", "value"), [
    ("meter", "meter", "5"), ("meter", "meter", "[]"), ("mechanics", "gantry.safe_z_um", '"high"'),
    ("mechanics", "axes.x.increments_per_unit", '"fast"'), ("mechanics", "axes.x.increments_per_unit", "0"),
    ("mechanics", "axes.x.minimum", "1" + 400 * "0"), ("mechanics", "axes.x.homing_method", "nan"),
    ("board", "board.origin_x_um", "[1]"),
])  # fmt: skip
def test_a_value_of_another_kind_ends_no_step_unforeseen(tmp_path: Path, step: str, key: str, value: str) -> None:
    file = tmp_path / "station.toml"
    example = (ROOT / "systemd" / "station.example.toml").read_text()
    if key == "meter":
        file.write_text(f"meter = {value}\n" + example.replace("[meter]", "[other]"))
    else:
        file.write_text(with_values(example, {key: 12345.0}).replace("12345.0", value))
    answers = [str(ROOT / "sim_hw" / "demo_board"), "", ""] if step == "board" else ["y", "127.0.0.1:5025", "none"]
    said = _only(file, step, *(answers if step != "mechanics" else []), *[""] * 60)[1]
    assert "Traceback" not in said
    assert UNFORESEEN not in said


@pytest.mark.parametrize("channel", ["101.5", "nan", "-1", "1e3", "2000000"])
def test_a_scanner_channel_is_a_whole_number(tmp_path: Path, channel: str) -> None:
    written, said = _only(tmp_path / "station.toml", "meter", "y", "127.0.0.1:5025", channel, "101")
    assert f"{channel} is not a channel" in said.replace("'", "")
    assert written["meter"]["contact_channel"] == 101


def test_its_last_words_are_the_next_commands_and_can_be_pasted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = _walk(monkeypatch, tmp_path / "station.toml", "name", answers=["left", ""])
    typed = [shlex.split(line, comments=True) for line in said.rpartition("then type:")[2].strip().splitlines()]
    assert [" ".join(one) for one in typed] == [
        "reprobe home", "reprobe align", "reprobe calibrate surface", "reprobe place TP7",
    ]  # fmt: skip
    assert f"`reprobe serve --config {tmp_path / 'station.toml'}`" in said, "no unit of systemd serves this file"


def test_a_station_may_have_no_instrument_and_is_told_what_that_means(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    _, said = _only(file, "meter", "")
    assert f"`reprobe setup -c {file} --only meter` adds it" in said
    assert "`reprobe probe` and `reprobe run` need one" in said
    written, said = _only(file, "meter", "y", "192.168.0.7", "192.168.0.7:5025", "none")
    assert "neither host:port" in said
    assert 'ground_net = "GND"' in said, "else voltage in a plan is not tested, and only the run says so"
    assert written["meter"] == {"kind": "scpi", "address": "192.168.0.7:5025"}
    assert _only(file, "meter", "", "", "7")[0]["meter"]["contact_channel"] == 7, "what is there is offered"
    assert "contact_channel" not in _only(file, "meter", "", "", "none")[0]["meter"]
    assert load_config(file).meter is not None


class _Station:
    """Stands for a client of a daemon in a fault that `reset` clears, whose axes are then to be homed, or not."""

    def __init__(self, *, homed: bool) -> None:
        self.homed, self.in_fault = homed, True
        self.asked: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def request(self, op: str) -> dict[str, Any]:
        self.asked.append(op)
        if op == "status":
            return {"station": "left", "fault": None if self.homed else {"name": "not_homed"}}
        if op == "reset":
            self.in_fault = False
            if not self.homed:
                error = {"code": 5101, "name": "not_homed", "message": "not homed", "advice": "`home`", "detail": {}}
                raise Refused(error)
        return {}

    def job(self, op: str, **_: object) -> Any:
        self.asked.append(op)
        self.homed = True
        return SimpleNamespace(error=None)


@pytest.mark.parametrize(("homed", "asked"), [(True, ["reset"]), (False, ["reset", "home"])])
def test_a_step_is_tried_again_after_the_fault_that_stopped_it_was_cleared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, homed: bool, asked: list[str]
) -> None:
    """A reset only clears what is gone; and what has to be homed again is announced before it moves."""
    station = _Station(homed=homed)
    said: list[str] = []

    def enter(_: Dialogue, question: str) -> str:
        said.append(question)
        return ""

    monkeypatch.setattr(station_steps, "Client", lambda *_, **__: station)
    monkeypatch.setattr(station_steps.Daemon, "start", lambda _: None)
    monkeypatch.setattr(station_steps.Daemon, "endpoint", "ipc://none")
    monkeypatch.setattr(Dialogue, "_line", enter)

    def works(_setup: Setup, _daemon: station_steps.Daemon) -> None:
        if station.in_fault:
            raise StepFailed("the daemon is in fault: x does not answer", "check its cable")

    setup = Setup(tmp_path / "station.toml", Dialogue(Notes(tmp_path / "notes.json")))
    step = guided.Step("tip", "Tip", None, of_station=works)
    assert guided.do_step(step, "1 of 1: Tip", setup, station_steps.Daemon(setup))
    assert station.asked == asked
    assert len(said) == 1 + (not homed)  # to try again, and to home


@pytest.mark.parametrize(("homed", "asked"), [(True, ["status"]), (False, ["status", "home"])])
def test_where_it_goes_on_after_an_interruption_the_axes_are_homed_before_anything_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, homed: bool, asked: list[str]
) -> None:
    station, said = _Station(homed=homed), list[str]()
    monkeypatch.setattr(station_steps, "Client", lambda *_, **__: station)
    monkeypatch.setattr(station_steps.Daemon, "start", lambda _: None)
    monkeypatch.setattr(station_steps.Daemon, "endpoint", "ipc://none")
    monkeypatch.setattr(Dialogue, "_line", lambda _, question: said.append(question) or "")

    def works(_setup: Setup, _daemon: station_steps.Daemon) -> None:
        if not station.homed:
            raise StepFailed("the axes are not homed", "type `reprobe home`")

    setup = Setup(tmp_path / "station.toml", Dialogue(Notes(tmp_path / "notes.json")))
    step = guided.Step("tip", "Tip", "the head", of_station=works)
    assert guided.do_step(step, "1 of 1: Tip", setup, station_steps.Daemon(setup))
    assert station.asked == asked
    assert len(said) == 1 + (not homed)  # before the step, and before homing


@pytest.mark.parametrize(("name", "words"), [("right", "nothing is moved there"), ("left", "")])
def test_a_daemon_of_another_station_at_the_same_socket_is_not_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    monkeypatch.setattr(station_steps, "Client", lambda *_, **__: _Station(homed=True))
    monkeypatch.setattr(station_steps, "whole_file", lambda _: _config_of(name))
    daemon = station_steps.Daemon(Setup(tmp_path / "x.toml", Dialogue(Notes(tmp_path / "notes.json"))))
    if words:
        with pytest.raises(StepFailed, match=words):
            daemon.start()
    else:
        daemon.start()


def _config_of(name: str) -> Any:
    return SimpleNamespace(station=SimpleNamespace(name=name), api=SimpleNamespace(control="tcp://127.0.0.1:5555"))


def test_a_step_done_alone_that_is_interrupted_names_itself_to_go_on(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    assert f"`reprobe setup -c {file} --only mechanics` goes on" in _only(file, "mechanics", "5")[1]


def test_a_socket_that_is_mistyped_is_said_at_its_question(tmp_path: Path) -> None:
    written, said = _only(tmp_path / "station.toml", "sockets", "5555", "localhost:5556", "", "")
    assert said.count("is no socket; write it as tcp://127.0.0.1:5555") == 2
    assert written["api"]["control"] == "tcp://127.0.0.1:5555"


def test_a_long_job_that_was_stopped_by_hand_did_not_fail_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise Interrupted(1)

    monkeypatch.setattr(station_steps, "run_with_bar", stopped)
    monkeypatch.setattr(station_steps.Daemon, "start", lambda _: None)
    monkeypatch.setattr(station_steps.Daemon, "endpoint", "ipc://none")
    with pytest.raises(StepFailed, match="stopped by Ctrl-C"):
        station_steps.Daemon(None).long_job("calibrate", what="rotation")  # type: ignore[arg-type]
