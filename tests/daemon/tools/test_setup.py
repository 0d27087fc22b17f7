"""What the guided set-up writes keeps everything else in the file, and what it finds is found by reading alone."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from daemon.tools.setup import Notes, corrected_increments, increments_per_unit, read_value, serial_ports, with_values
from daemon.tools.setup.edit import example

REMARKS = [line.partition("#")[2] for line in example().splitlines() if "#" in line]


def test_values_are_put_in_their_lines_and_every_remark_stays() -> None:
    values = {"axes.x.address": 7, "bus.main.parity": "N", "station.name": 'a "b"', "axes.y.speed": 12.5,
              "camera.endpoint": "ipc:///x", "api.control": "ipc:///c", "camera.device": None}  # fmt: skip
    text = with_values(example(), values)
    for path, value in values.items():
        assert read_value(text, path) == value
    before, after = tomllib.loads(example()), tomllib.loads(text)
    assert {key for key in before if before[key] != after[key]} == {"axes", "bus", "station", "camera"}
    kept = [line.partition("#")[2] for line in text.splitlines() if "#" in line]
    assert kept == REMARKS, "no line with a remark was lost"
    assert with_values(text, values) == text, "twice is once"


def test_a_line_that_cannot_be_changed_safely_is_left_to_the_person() -> None:
    with pytest.raises(ValueError, match="by hand"):
        with_values('[a]\nb = """\ntext"""\n', {"a.b": 1})


def test_the_scale_of_the_example_is_that_of_its_spindles() -> None:
    assert increments_per_unit(5000.0) == pytest.approx(read_value(example(), "axes.x.increments_per_unit"))
    assert increments_per_unit(2000.0) == pytest.approx(read_value(example(), "axes.z.increments_per_unit"))
    assert increments_per_unit(360.0) == pytest.approx(read_value(example(), "axes.theta.increments_per_unit"))


@pytest.mark.parametrize(("moved", "becomes"), [(5.0, 655.36), (2.5, 1310.72), (-5.0, -655.36), (10.0, 327.68)])
def test_a_measured_move_corrects_scale_and_direction(moved: float, becomes: float) -> None:
    assert corrected_increments(655.36, 5.0, moved) == pytest.approx(becomes)


@pytest.mark.parametrize("moved", [0.0, 0.01, 1000.0, float("nan"), float("inf")])
def test_what_is_no_measurement_corrects_nothing(moved: float) -> None:
    with pytest.raises(ValueError, match="no measurement"):
        corrected_increments(655.36, 5.0, moved)


def test_notes_outlive_the_set_up_and_a_file_of_noise_begins_them_anew(tmp_path: Path) -> None:
    path = tmp_path / "notes.json"
    notes = Notes(path)
    notes.note_answer("a", "1")
    notes.note_done("first")
    again = Notes(path)
    assert (again.answer("a"), again.done) == ("1", ("first",))
    again.forget()
    assert (Notes(path).answer("a"), Notes(path).done) == ("1", ()), "answers are offered again"
    path.write_bytes(b"\xff\x00")
    assert Notes(path).done == ()


def test_a_port_of_two_names_is_offered_once_by_the_stable_one(tmp_path: Path) -> None:
    (tmp_path / "dev/serial/by-id").mkdir(parents=True)
    (tmp_path / "dev/ttyUSB0").touch()
    (tmp_path / "dev/ttyUSB1").touch()
    (tmp_path / "dev/serial/by-id/usb-FTDI").symlink_to(tmp_path / "dev/ttyUSB0")
    assert serial_ports(tmp_path) == [str(tmp_path / "dev/serial/by-id/usb-FTDI"), str(tmp_path / "dev/ttyUSB1")]
