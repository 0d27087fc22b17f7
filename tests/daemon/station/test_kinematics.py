"""The places the station goes to follow from head, board and surface, as calibrated, else as configured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.station.kinematics import Geometry
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_records import SurfaceRecord, Touch
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import WORK_Z_UM, World, a_board
from vision.geometry import fit_plane
from vision.geometry.frames import Rigid2
from vision.head.model import CircleHead

PLACE_UM = (10_000.0, 5_000.0)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path, a_board(("A", *PLACE_UM)), {}).teach()


def test_without_calibration_the_board_lies_where_the_configuration_has_it(world: World) -> None:
    assert world.geometry.nominal_um(PLACE_UM) == pytest.approx((70_000.0, 45_000.0))
    assert world.geometry.board_to_robot_um(PLACE_UM) == pytest.approx((70_000.0, 45_000.0))
    many = world.geometry.board_to_robot_um([PLACE_UM, (0.0, 0.0)])
    assert many == pytest.approx(np.array([(70_000.0, 45_000.0), (60_000.0, 40_000.0)]))


def test_an_aligned_board_is_turned_scaled_and_shifted_and_the_nominal_place_stays(world: World) -> None:
    world.with_alignment(Rigid2(90.0, 61_000.0, 42_000.0), scale=1.001)
    assert world.geometry.board_to_robot_um(PLACE_UM) == pytest.approx((61_000.0 - 5_005.0, 42_000.0 + 10_010.0))
    many = world.geometry.board_to_robot_um([PLACE_UM, (1_000.0, 0.0)])
    assert many == pytest.approx(np.array([(55_995.0, 52_010.0), (61_000.0, 43_001.0)]))
    assert world.geometry.nominal_um(PLACE_UM) == pytest.approx((70_000.0, 45_000.0))


def test_the_alignment_of_another_board_does_not_count(world: World) -> None:
    world.with_alignment(Rigid2(0.0, 0.0, 0.0))
    other = world.board.model_copy(update={"name": "another"})
    geometry = Geometry(world.config, other, world.calibrations)
    assert geometry.board_to_robot_um(PLACE_UM) == pytest.approx((70_000.0, 45_000.0))


def test_the_head_stands_beside_a_place_by_the_tips_offset(world: World) -> None:
    head = CircleHead(10_000.0, 0.0)
    world.with_head(head)
    assert world.geometry.head == head
    over = world.geometry.position_over(PLACE_UM, 90.0)
    assert (over.x_um, over.y_um) == pytest.approx((70_000.0, 35_000.0))
    assert over.theta_deg == 90.0
    assert world.geometry.position_at((1_000.0, 2_000.0), 0.0) == Position(-9_000.0, 2_000.0, 5_600.0, 0.0)


def test_the_configurations_head_counts_until_one_is_calibrated(world: World) -> None:
    nominal = world.config.head.model()
    assert world.geometry.head == nominal
    assert world.geometry.tip_um(Position(100.0, 200.0, 0.0, 30.0)) == pytest.approx(
        np.add((100.0, 200.0), nominal.tip_offset_um(30.0))
    )


def test_over_a_place_the_tip_is_on_it_and_the_way_to_another_points_there(world: World) -> None:
    over = world.geometry.position_over(PLACE_UM, 200.0)
    assert world.geometry.tip_um(over) == pytest.approx((70_000.0, 45_000.0))
    assert world.geometry.from_tip_um(PLACE_UM, over) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert world.geometry.from_tip_um((10_300.0, 4_900.0), over) == pytest.approx((300.0, -100.0))


def test_the_surface_is_flat_until_it_is_measured_then_its_height_is_that_below_the_tip(world: World) -> None:
    over = replace(world.geometry.position_over(PLACE_UM, 0.0), z_um=WORK_Z_UM)
    assert world.geometry.height_um((70_000.0, 45_000.0)) == 0.0
    assert world.geometry.height_below_um(over) == 0.0
    world.with_surface(raised_um=25.0)
    surface = world.calibrations.surface
    assert surface is not None
    assert world.geometry.height_below_um(over) == pytest.approx(surface.height_um(70_000.0, 45_000.0))
    assert world.geometry.height_um((70_000.0, 45_000.0)) != pytest.approx(
        world.geometry.height_um((45_000.0, 70_000.0))
    )


# --- height ---------------------------------------------------------------------------------------------------------


def _surface(world: World, height_um: float = -40.0, **changes: object) -> None:
    """Measure a level surface all over the board, 40 x 30 mm."""
    corners = [(x, y) for x in (62_000.0, 98_000.0) for y in (42_000.0, 68_000.0)]
    plane = fit_plane(np.array(corners), np.full(4, height_um))
    touches = tuple(Touch(x_um=x, y_um=y, height_um=height_um) for x, y in corners)
    whole = world.made() | {
        "touches": touches, "residuals_um": (0.0,) * 4, "surface": plane.to_dict(),
        "flatness_um": 0.0, "rms_um": 0.0, "limit_um": 50.0, "planar": True,
    }  # fmt: skip
    world.calibrations.store(SurfaceRecord(**whole | changes))


def test_over_a_board_of_unknown_height_the_needle_stays_above_the_highest_possible_one(world: World) -> None:
    place = 70_000.0, 45_000.0
    assert world.geometry.measured_um(place) is None
    assert world.geometry.look_z_um(place) == 5_000.0 + 500.0 + 100.0
    assert world.geometry.slow_z_um(world.geometry.position_at(place, 0.0)) == 5_500.0


@pytest.mark.parametrize("height_um", [-480.0, -40.0, 0.0, 300.0])
def test_working_height_follows_the_measured_surface(world: World, height_um: float) -> None:
    _surface(world, height_um)
    over = world.geometry.position_over(PLACE_UM, 30.0)
    assert over.z_um == pytest.approx(WORK_Z_UM + height_um)
    assert world.geometry.height_below_um(over) == pytest.approx(0.0, abs=1e-6), "the picture is the map's own"
    assert world.geometry.slow_z_um(over) == 5_500.0, "nobody has seen that this board still lies there"
    world.station.needle.board.seen_free()
    assert world.geometry.slow_z_um(over) == pytest.approx(5_000.0 + height_um + 100.0)


def test_the_map_is_told_how_far_the_surface_is_from_the_head_wherever_z_is(world: World) -> None:
    over = world.geometry.position_over(PLACE_UM, 0.0)
    assert world.geometry.height_below_um(over) == -400.0
    _surface(world, 30.0)
    assert world.geometry.height_below_um(over) == pytest.approx(-370.0)


@pytest.mark.parametrize(("beyond_um", "known"), [(-1_000.0, True), (9_900.0, True), (10_100.0, False)])
def test_far_from_the_touched_places_height_is_unknown(world: World, beyond_um: float, known: bool) -> None:
    _surface(world)
    for place in ((98_000.0 + beyond_um, 50_000.0), (80_000.0, 42_000.0 - beyond_um)):
        assert (world.geometry.measured_um(place) is not None) is known


def test_a_surface_older_than_the_boards_alignment_is_of_the_board_before(world: World) -> None:
    place = 80_000.0, 50_000.0
    _surface(world, made_at="2026-01-01T00:00:00.000+00:00")
    assert world.geometry.measured_um(place) is not None
    world.with_alignment(Rigid2(0.0, 60_000.0, 40_000.0))
    assert world.geometry.measured_um(place) is None
    assert world.geometry.height_um(place) == pytest.approx(-40.0), "for the picture it is still the best guess"
    _surface(world)
    assert world.geometry.measured_um(place) is not None


def test_while_a_board_that_was_not_aligned_lies_there_its_height_is_unknown(world: World) -> None:
    place = 80_000.0, 50_000.0
    _surface(world)
    world.calibrations.void_alignment(Void("board 18 was put into the nest and has not been aligned"))
    assert world.geometry.measured_um(place) is None
