"""What is in force is written once, and again when it changes."""

from pathlib import Path
from typing import Any, cast

from daemon.app.circumstances import CircumstancesWatch
from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.config.reload import Change
from daemon.domain.board import Board
from daemon.storage.calibration_store import Calibrations

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"


class _Stream:
    def __init__(self) -> None:
        self.told: list[dict[str, Any]] = []

    def set_circumstances(self, facts: dict[str, Any]) -> None:
        self.told.append(facts)


def test_a_new_needle_in_the_configuration_is_told_with_a_new_hash_and_the_same_is_told_once(tmp_path: Path) -> None:
    config = load_config(EXAMPLE)
    board = Board(name="demo", side="top", width_um=1.0, height_um=1.0, points=())
    settings = CurrentSettings(config, board)
    stream = _Stream()
    watch = CircumstancesWatch(cast("Any", stream), "1.0", settings, Calibrations(tmp_path, "s"))
    watch.refresh()
    watch.refresh()
    station = config.station.model_copy(update={"needle": "N-2"})
    settings.replace(Change(config.model_copy(update={"station": station}), board, ("station.needle",)))
    watch.refresh()
    before, after = stream.told
    assert before | {"program": "1.0", "board": "demo", "needle": None, "tip": None, "calibrated": {}} == before
    assert after["needle"] == "N-2"
    assert after["configuration"] != before["configuration"]
