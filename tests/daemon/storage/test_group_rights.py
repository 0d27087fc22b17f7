"""What the station keeps can be read by the daemon's group, and by nobody else's; private keys by their owner alone."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import utc_now
from daemon.storage import alignment_void
from daemon.storage.calibration_store import Calibrations
from daemon.storage.pinned_state import PinnedState
from daemon.wire.curve_keys import new_client
from tests.daemon.tools.report.synthetic import backlash_record


def _mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_calibrations_and_their_history_are_for_the_group(tmp_path: Path) -> None:
    calibrations = Calibrations(tmp_path, "s")
    for job in ("first", "second"):
        calibrations.store(backlash_record(station="s", probe="", made_at=utc_now(), job=job))
    alignment_void.write_void(tmp_path, alignment_void.Void("why"))
    PinnedState(tmp_path / "journal.pinned").store("a", 1)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) >= 4
    assert {_mode(path) for path in files} == {0o640}


def test_whatever_else_is_written_stays_its_owners_unless_told(tmp_path: Path) -> None:
    replace_whole(tmp_path / "a", lambda path: path.write_text("x"))
    assert _mode(tmp_path / "a") == 0o600
    new_client(tmp_path / "keys", "tester-1", "operate", tmp_path / "tester-1.key")
    assert _mode(tmp_path / "tester-1.key") == 0o600


@pytest.mark.parametrize("mode", [0o640, 0o644])
def test_a_mode_that_is_asked_for_is_the_files_from_the_start(tmp_path: Path, mode: int) -> None:
    replace_whole(tmp_path / "a", lambda path: path.write_text("x"), mode)
    assert _mode(tmp_path / "a") == mode
