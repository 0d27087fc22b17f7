"""Where the tip, the board and its surface are: as configured, and as calibrated the moment that is stored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.config.model import Config, load_config
from daemon.domain.board import Board
from daemon.station.kinematics import Geometry
from daemon.storage.calibration_records import AlignmentRecord
from daemon.storage.calibration_store import Calibrations
from drivers.gantry import Position
from vision.geometry.surface_plane import Surface
from vision.head.model import CircleHead

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"
BOARD = Board(name="b", side="top", width_um=60000.0, height_um=40000.0, points=())
PLACE = (12000.0, 7000.0)
SURFACE = Surface(50000.0, 40000.0, 30.0, 2.0, -3.0, np.zeros(4), np.ones(4, bool), np.zeros((3, 3)))
ALIGNED = AlignmentRecord(
    made_at="2026-01-01T00:00:00+00:00", station="s1", probe="", board="b", side="top",
    job="j", seconds=1.0, looks=6, theta_deg=90.0, scale=2.0, tx_um=100.0, ty_um=-50.0, rms_um=3.0, fiducials=(),
)  # fmt: skip


@pytest.fixture
def calibrations(tmp_path: Path) -> Calibrations:
    return Calibrations(tmp_path, "s1")


@pytest.fixture
def config(tmp_path: Path) -> Config:
    text = EXAMPLE.read_text()
    (tmp_path / "station.toml").write_text(text)
    loaded = load_config(tmp_path / "station.toml")
    board = loaded.board.model_copy(update={"origin_x_um": 80000.0, "origin_y_um": 60000.0, "rotation_deg": 180.0})
    head = loaded.head.model_copy(update={"radius_um": 15000.0, "phase_deg": 0.0})
    return loaded.model_copy(update={"board": board, "head": head})


@pytest.fixture
def geometry(config: Config, calibrations: Calibrations) -> Geometry:
    return Geometry(config, BOARD, calibrations)


def test_a_board_never_aligned_lies_as_configured(geometry: Geometry) -> None:
    assert geometry.board_to_robot_um(PLACE) == pytest.approx((68000.0, 53000.0))
    assert geometry.nominal_um([PLACE, (0.0, 0.0)]) == pytest.approx(np.array([(68000.0, 53000.0), (80000.0, 60000.0)]))


def test_an_aligned_board_lies_as_it_was_seen_and_its_nominal_place_stays(
    geometry: Geometry, calibrations: Calibrations
) -> None:
    calibrations.store(ALIGNED)
    # Turned by 90 deg, twice as large, shifted
    assert geometry.board_to_robot_um(PLACE) == pytest.approx((-14000.0 + 100.0, 24000.0 - 50.0))
    both = geometry.board_to_robot_um([PLACE, (0.0, 0.0)])
    assert both == pytest.approx(np.array([(-13900.0, 23950.0), (100.0, -50.0)]))
    assert geometry.nominal_um(PLACE) == pytest.approx((68000.0, 53000.0))


@pytest.mark.parametrize("other", [{"board": "c"}, {"side": "bottom"}])
def test_the_alignment_of_another_board_or_side_is_not_used(
    geometry: Geometry, calibrations: Calibrations, other: dict[str, str]
) -> None:
    calibrations.store(ALIGNED.model_copy(update=other))
    assert geometry.board_to_robot_um(PLACE) == pytest.approx((68000.0, 53000.0))


def test_the_tip_goes_round_the_configured_circle_until_a_head_is_calibrated(
    geometry: Geometry, calibrations: Calibrations
) -> None:
    at = Position(1000.0, 2000.0, 5000.0, 90.0)
    assert geometry.tip_um(at) == pytest.approx((1000.0, 17000.0))
    calibrations.in_force = replace(calibrations.in_force, head=CircleHead(10000.0, 90.0))
    assert geometry.head is calibrations.head
    assert geometry.tip_um(at) == pytest.approx((-9000.0, 2000.0))


@pytest.mark.parametrize("theta_deg", [0.0, 77.0, 250.0])
def test_the_head_goes_where_the_tip_is_over_the_place_free_of_any_surface(
    geometry: Geometry, config: Config, theta_deg: float
) -> None:
    over = geometry.position_over(PLACE, theta_deg)
    assert (over.z_um, over.theta_deg) == (config.gantry.touch_z_um + 500.0 + 100.0, theta_deg)
    assert geometry.tip_um(over) == pytest.approx((68000.0, 53000.0))
    assert geometry.from_tip_um(PLACE, over) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_place_is_told_relative_to_the_tip(geometry: Geometry) -> None:
    over = geometry.position_over(PLACE, 30.0)
    beside = replace(over, x_um=over.x_um + 40.0, y_um=over.y_um - 70.0)
    assert geometry.from_tip_um(PLACE, beside) == pytest.approx((-40.0, 70.0))


def test_a_surface_never_measured_is_at_the_nominal_height_and_a_measured_one_where_it_was_found(
    geometry: Geometry, calibrations: Calibrations
) -> None:
    at = replace(geometry.position_at((51000.0, 42000.0), 120.0), z_um=5200.0)
    assert geometry.height_um((51000.0, 42000.0)) == geometry.height_below_um(at) == 0.0
    calibrations.in_force = replace(calibrations.in_force, surface=SURFACE)
    # 1 mm along x rises by 2 um, 2 mm along y fall by 6 um
    assert geometry.height_um((51000.0, 42000.0)) == pytest.approx(26.0)
    assert geometry.height_below_um(at) == pytest.approx(26.0)
