"""What maintenance follows of the calibrations is what is in force, and what it replaced."""

from pathlib import Path

from daemon.maintenance.calibration_signals import Learned
from daemon.maintenance.signals import Numbers
from daemon.storage.calibration_store import Calibrations
from tests.daemon.tools.report.synthetic import rotation_record


def _numbers(calibrations: Calibrations) -> Numbers:
    learned = Learned(calibrations)
    learned.read_history()
    return learned.numbers(touches=0, max_age_days=30.0, probe_life=100_000)


def test_a_rotation_is_compared_with_the_one_it_replaced(tmp_path: Path) -> None:
    calibrations = Calibrations(tmp_path, "s1")
    calibrations.store(rotation_record(station="s1", probe=""))
    assert "head_total_error" not in _numbers(calibrations)
    calibrations.store(rotation_record(station="s1", probe="", seed=2, made_at="2026-05-04T07:00:00+00:00"))
    assert "head_total_error" in _numbers(calibrations)


def test_a_rotation_is_never_compared_with_itself(tmp_path: Path) -> None:
    """A writer killed between two steps leaves a second name of the present rotation in the history."""
    calibrations = Calibrations(tmp_path, "s1")
    calibrations.store(rotation_record(station="s1", probe=""))
    history = tmp_path / "history"
    history.mkdir()
    (history / "rotation-20260304T050607000.json").hardlink_to(calibrations.file("rotation"))
    assert "head_total_error" not in _numbers(calibrations)
