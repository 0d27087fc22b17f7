"""What the guided set-up offers is what the file says now, and a slip costs one question, not all the rest."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli import setup as guided
from daemon.cli import setup_file_steps as file_steps
from daemon.cli.app import app
from daemon.cli.last_resort import UNFORESEEN
from daemon.tools.setup import Answering, Notes, read_value, with_values
from daemon.tools.setup.edit import example

ROOT = Path(__file__).parents[3]
BOARD = str(ROOT / "sim_hw" / "demo_board")
pytestmark = pytest.mark.usefixtures("logging_as_before")


def _only(file: Path, step: str, *answers: str) -> str:
    """Do one step; return what was said."""
    asked = "\n".join([*answers, ""])
    return CliRunner().invoke(app, ["setup", "-c", str(file), "--only", step], input=asked).output


def _written(file: Path, key: str) -> object:
    return read_value(file.read_text(), key)


def test_a_board_file_that_was_written_by_hand_since_is_offered(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    _only(file, "board", BOARD, "top", "y", "60", "40")
    (tmp_path / "board.json").rename(tmp_path / "other.json")
    file.write_text(with_values(file.read_text(), {"board.file": "other.json"}))
    said = _only(file, "board", *[""] * 5)
    assert "[other.json]" in said
    assert _written(file, "board.file") == "other.json"


def test_of_another_board_nobody_knows_whether_it_is_bare(tmp_path: Path) -> None:
    file, copy = tmp_path / "station.toml", tmp_path / "another"
    copy.symlink_to(BOARD)
    _only(file, "board", BOARD, "top", "y", "60", "40")
    assert "bare, without parts? [Y/n]" in _only(file, "board", BOARD, *[""] * 4), "the same board is offered as it was"
    assert "bare, without parts? [y/N]" in _only(file, "board", str(copy), *[""] * 4)


@pytest.fixture
def two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Two devices, the second plugged in."""
    first, second = tmp_path / "first", tmp_path / "second"
    second.touch()

    async def who(_section: object) -> Answering:
        return Answering(115200, "N", (1, 2, 3, 4), (5,))

    for listed in ("cameras", "serial_ports"):
        monkeypatch.setattr(file_steps, listed, lambda: [str(one) for one in (first, second) if one.exists()])
    monkeypatch.setattr(file_steps, "who_answers", who)
    return first, second


@pytest.mark.parametrize(("step", "key"), [("camera", "camera.device"), ("drives", "bus.main.port")])
def test_a_device_that_was_chosen_by_its_number_is_offered_by_its_name(
    tmp_path: Path, two: tuple[Path, Path], step: str, key: str
) -> None:
    file = tmp_path / "station.toml"
    _only(file, step, "1", *[""] * 5)
    two[0].touch()
    said = _only(file, step, *[""] * 6)
    assert f"[{two[1]}]" in said
    assert _written(file, key) == str(two[1]), "what came first into the list since is another device"


@pytest.mark.parametrize(("step", "key"), [("camera", "camera.device"), ("drives", "bus.main.port")])
def test_a_device_that_was_written_by_hand_since_is_offered(
    tmp_path: Path, two: tuple[Path, Path], step: str, key: str
) -> None:
    file = tmp_path / "station.toml"
    two[0].touch()
    _only(file, step, "2", *[""] * 5)
    file.write_text(with_values(file.read_text(), {key: str(two[0])}))
    _only(file, step, *[""] * 6)
    assert _written(file, key) == str(two[0])


def test_addresses_that_were_written_by_hand_since_are_offered_while_those_drives_answer(
    tmp_path: Path, two: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "station.toml"
    _only(file, "drives", str(two[1]), *[""] * 5)
    file.write_text(with_values(file.read_text(), {"axes.x.address": 2, "axes.y.address": 1}))
    _only(file, "drives", *[""] * 6)
    assert (_written(file, "axes.x.address"), _written(file, "axes.y.address")) == (2, 1)

    async def others(_section: object) -> Answering:
        return Answering(115200, "N", (11, 12, 13, 14), (5,))

    monkeypatch.setattr(file_steps, "who_answers", others)
    _only(file, "drives", *[""] * 6)
    assert (_written(file, "axes.x.address"), _written(file, "axes.y.address")) == (11, 12)


@pytest.mark.parametrize(
    "step", ["name", "drives", "mechanics", "camera", "board", "meter", "sockets", "check", "home"]
)
def test_a_damaged_file_is_said_before_the_first_question_of_a_step(tmp_path: Path, step: str) -> None:
    file = tmp_path / "station.toml"
    file.write_text(example() + "\n[station\n")
    said = _only(file, step, "q")
    asked = [line for line in said.splitlines() if line.rstrip().endswith(">") or " > " in line]
    assert "cannot be read" in said
    assert "mend it, or move it away" in said
    assert len(asked) == 1, "to try again, skip or end"
    assert asked[0].startswith("Enter: try again")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_another_encoding_is_said_by_its_name(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "station.toml"
    file.write_bytes(example().encode(encoding))
    for said in (_only(file, "name", "q"), CliRunner().invoke(app, ["check-config", str(file)]).output):
        assert f"saved as {encoding[:6].upper()}: save it as UTF-8" in said
        assert "byte" not in said


def test_a_file_that_is_mended_meanwhile_is_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "station.toml"
    file.write_bytes(b"\xff")

    def after(self: guided.Dialogue, _failure: object, **_: object) -> str:
        file.write_text(example())
        return "go"

    monkeypatch.setattr(guided.Dialogue, "after_failure", after)
    _only(file, "name", "left", "")
    assert _written(file, "station.name") == "left"


def test_a_file_with_mistakes_stops_a_step_of_the_station_with_all_of_them(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    file.write_text(with_values(example(), {"axes.x.address": 999}))
    said = _only(file, "start", "q")
    assert "axes.x.address" in said
    assert UNFORESEEN not in said


def test_a_link_stays_a_link_and_the_file_keeps_its_mode(tmp_path: Path) -> None:
    kept, file = tmp_path / "kept" / "station.toml", tmp_path / "station.toml"
    kept.parent.mkdir()
    kept.write_text(example())
    kept.chmod(0o640)
    file.symlink_to(kept)
    _only(file, "name", "left", "")
    assert file.is_symlink()
    assert _written(kept, "station.name") == "left"
    assert kept.stat().st_mode & 0o777 == 0o640
    assert [one.name for one in kept.parent.iterdir()] == ["station.toml"]


@pytest.mark.parametrize("name", ["Prüfplatz 3", "needle \U0001f600", "a\x85b", "a\x7fb", "\u6e2c\u8a66"])
def test_a_name_stays_as_it_was_typed(tmp_path: Path, name: str) -> None:
    file = tmp_path / "station.toml"
    file.write_text(example() + "# a remark\u2028of one line\n")
    _only(file, "name", name, "")
    assert tomllib.loads(file.read_text())["station"]["name"] == name
    assert file.read_text().endswith("# a remark\u2028of one line\n")


@pytest.mark.parametrize("step", ["name", "drives", "camera", "board", "meter", "sockets"])
def test_a_long_line_that_was_pasted_is_asked_again(tmp_path: Path, step: str) -> None:
    file = tmp_path / "station.toml"
    yes = ["y"] if step == "meter" else []
    said = _only(file, step, *yes, "x" * 100_000)
    assert "100000 letters" in said
    assert UNFORESEEN not in said
    assert "File name too long" not in said
    assert len(said) < 10_000
    name_of_no_file = _only(file, step, *yes, "x" * 300)
    assert UNFORESEEN not in name_of_no_file
    assert "File name too long" not in name_of_no_file or step == "board", "the board's is told as a board's"


def test_the_last_words_of_one_step_are_of_that_step(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    said = _only(file, "name", "left", "")
    assert "station is set up" not in said
    assert "Name and folder: done" in said
    assert "Not done yet: drives, mechanics" in said
    assert "skipped, so nothing of it has changed" in _only(file, "home", "s")


def test_notes_of_another_version_are_kept_and_noise_is_said(tmp_path: Path) -> None:
    path = tmp_path / "station.setup.json"
    path.write_text('{"answers": {"a": "1", "b": ["2"]}, "done": ["first", 3], "asked_by": "me"}')
    notes = Notes(path)
    assert (notes.answer("a"), notes.answer("b"), notes.done, notes.lost) == ("1", None, ("first",), None)
    notes.note_done("second")
    assert '"asked_by": "me"' in path.read_text()
    assert '"2"' in path.read_text()
    assert Notes(path).done == ("first", "second")
    path.write_bytes(b"\xff\x00")
    assert f"{path} cannot be read" in _only(tmp_path / "station.toml", "name", "", "")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_of_few_letters_ends_no_command(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "station.toml"
    file.write_text(with_values(example(), {"station.name": "needle \U0001f600 \u0394"}), encoding="utf-8")
    environment = os.environ | {"PYTHONIOENCODING": encoding, "LANG": "C", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "daemon.cli", "setup", "-c", str(file), "--only", "name"],
        input=b"\n\xff\xfe\n\n", capture_output=True, env=environment, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert b"\\U0001f600" in done.stdout
    assert _written(file, "station.name") == "needle \U0001f600 \u0394"
