"""What was measured for another touching plane, pose, board or time is not used, and says why."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.board import Board
from daemon.domain.errors import Fault
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_conditions import Conditions
from daemon.storage.calibration_records import Record
from daemon.storage.calibration_store import Calibrations
from tests.daemon.tools.report.synthetic import alignment_record, backlash_record, rotation_record, surface_record

STATION = "bench-1"
HERE = Conditions(
    touch_z_um=5000.0, origin_x_um=60_000.0, origin_y_um=40_000.0, rotation_deg=0.0, board="nucleo", side="top",
    board_revision="a",
)  # fmt: skip
NOW = "2025-03-04T09:30:12+00:00"


def _records() -> list[Record]:
    facts: dict[str, Any] = {"station": STATION, "probe": "", "made_at": NOW}
    made = [rotation_record(**facts), surface_record(**facts), backlash_record(**facts), alignment_record(**facts)]
    return [record.model_copy(update={"conditions": HERE}) for record in made]


def _under(folder: Path, conditions: Conditions) -> Calibrations:
    """Store everything as measured here, and read it under other conditions."""
    first = Calibrations(folder, STATION)
    first.fit_to(HERE)
    for record in _records():
        first.store(record)
    assert not first.problems
    second = Calibrations(folder, STATION)
    second.fit_to(conditions)
    return second


@pytest.mark.parametrize(
    ("change", "not_used", "reason"),
    [
        ({}, set(), ""),
        (
            {"touch_z_um": 5060.0},
            {"rotation", "surface", "alignment"},
            "at 5000 um, now it is at 5060 um",
        ),
        ({"origin_x_um": 65_000.0}, {"surface", "alignment"}, "nominal pose of the board (moved by 5000 um)"),
        ({"rotation_deg": 0.5}, {"surface", "alignment"}, "nominal pose"),
        ({"board_revision": "b"}, {"surface", "alignment"}, "another revision of the board file"),
        ({"board": "other"}, {"surface", "alignment"}, "board nucleo (top)"),
        ({"side": "bottom"}, {"surface", "alignment"}, "board nucleo (top)"),
    ],
)
def test_what_was_measured_under_other_conditions_is_not_used_and_says_why(
    tmp_path: Path, change: dict[str, Any], not_used: set[str], reason: str
) -> None:
    calibrations = _under(tmp_path, HERE.model_copy(update=change))
    assert set(calibrations.problems) == not_used
    assert all(reason in why for why in calibrations.problems.values())
    assert set(calibrations.records) == {"rotation", "surface", "backlash", "alignment"} - not_used
    calibrations.fit_to(HERE)
    assert not calibrations.problems, "the files are as they were"


def test_a_record_of_an_older_version_that_says_no_conditions_is_used(tmp_path: Path) -> None:
    calibrations = Calibrations(tmp_path, STATION)
    calibrations.store(alignment_record(station=STATION, probe="", made_at=NOW))
    calibrations.fit_to(HERE)
    assert not calibrations.problems


def test_what_is_dated_in_the_future_is_not_used(tmp_path: Path) -> None:
    ahead = datetime.now(UTC) + timedelta(hours=1)
    calibrations = Calibrations(tmp_path, STATION)
    calibrations.store(backlash_record(station=STATION, probe="", made_at=NOW))
    file = calibrations.file("backlash")
    file.write_text(file.read_text().replace(NOW, ahead.isoformat()))
    calibrations.load()
    assert "dated in the future" in calibrations.problems["backlash"]
    assert "backlash" not in calibrations.records


def test_an_edited_board_file_of_the_same_name_is_another_revision() -> None:
    board = Board(name="b", side="top", width_um=1.0, height_um=1.0, points=())
    assert board.revision == Board.model_validate_json(board.model_dump_json()).revision
    assert board.revision != board.model_copy(update={"height_um": 2.0}).revision


def test_which_board_lies_there_instead_is_known_after_a_start_too(tmp_path: Path) -> None:
    board = Board(name="b", side="top", width_um=1.0, height_um=1.0, points=())
    Calibrations(tmp_path, STATION).void_alignment(Void("board x 1 was put into the nest", "x 1"))
    again = Calibrations(tmp_path, STATION)
    again.load()
    for board_id, typed in ((None, "--board-id 'x 1'"), ("y", "--board-id y")):
        with pytest.raises(Fault, match="board x 1 was put into the nest") as refused:
            again.require_board(board, board_id)
        assert typed in refused.value.advice


@pytest.mark.parametrize("unfit", [False, True])
def test_an_alignment_that_was_made_void_twice_is_void_after_a_start(tmp_path: Path, unfit: bool) -> None:
    """A refused `align` does so: before its first look, and where it ends."""
    calibrations = Calibrations(tmp_path, STATION)
    record = alignment_record(station=STATION, probe="", made_at=NOW)
    calibrations.store(record.model_copy(update={"conditions": HERE}) if unfit else record)
    for why in ("did not pass", "did not pass: too far off"):
        calibrations.void_alignment(Void(why))
    again = Calibrations(tmp_path, STATION)
    if unfit:
        again.fit_to(HERE.model_copy(update={"board_revision": "b"}))
    again.load()
    assert again.in_force.void == Void("did not pass: too far off")
    assert "alignment" not in again.records


def test_a_void_of_a_version_before_that_named_no_moment_is_of_what_lies_there(tmp_path: Path) -> None:
    """Where the alignment was void already; a note of today means what it names, be it that there is none."""
    Calibrations(tmp_path, STATION).store(alignment_record(station=STATION, probe="", made_at=NOW))
    for board, void in (("", Void("refused")), (', "board_id": null', None)):
        (tmp_path / "alignment.void.json").write_text(f'{{"made_at": "", "why": "refused"{board}}}')
        again = Calibrations(tmp_path, STATION)
        again.load()
        assert again.in_force.void == void


def test_a_void_that_could_not_be_removed_is_not_of_the_next_alignment(tmp_path: Path) -> None:
    calibrations = Calibrations(tmp_path, STATION)
    calibrations.store(alignment_record(station=STATION, probe="", made_at=NOW))
    calibrations.void_alignment(Void("refused"))
    note = tmp_path / "alignment.void.json"
    left = note.read_bytes()
    again = Calibrations(tmp_path, STATION)
    again.load()
    assert again.in_force.void == Void("refused")
    assert again.problems == {"alignment": "refused"}
    again.store(alignment_record(station=STATION, probe="", made_at="2025-03-05T09:30:12+00:00"))
    note.write_bytes(left)
    again.load()
    assert again.in_force.void is None
    assert "alignment" in again.records
