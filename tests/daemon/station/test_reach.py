"""Which points the configured ranges let the tip come over."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.config.model import Config, load_config
from daemon.domain.board import BoardPoint
from daemon.station.reach import beyond_reach, in_reach_at_all_angles

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"


@pytest.fixture
def config(tmp_path: Path) -> Config:
    path = tmp_path / "station.toml"
    path.write_text(EXAMPLE.read_text())
    path.chmod(0o600)
    return load_config(path)


def _at(config: Config, x_um: float) -> BoardPoint:
    """Return a point that lies at robot X, in the middle of Y's range."""
    middle_um = (config.axes.y.minimum + config.axes.y.maximum) / 2
    x, y = config.board.pose().inverse().apply((x_um, middle_um))
    return BoardPoint(name=f"P{x_um:.0f}", kind="site", x_um=float(x), y_um=float(y), diameter_um=500.0)


def test_a_point_near_the_end_of_an_axis_is_reached_at_some_angles_only(config: Config) -> None:
    """The tip turns about the head's axis: beyond the end of X by less than its arm, half a turn reaches there."""
    x = config.axes.x
    middle, end, beyond = _at(config, (x.minimum + x.maximum) / 2), _at(config, x.maximum), _at(config, 2 * x.maximum)
    assert in_reach_at_all_angles(config, (middle, end, beyond)) == (middle,)
    assert set(beyond_reach(config, (middle, end, beyond))) == {beyond.name}
