"""The needle in a part: noticed while it moves and when it rests, by its end and by its shaft."""

import math

import numpy as np
import pytest

from sim_hw.board.parts import Bodies, Body
from sim_hw.plant.motion import Ramps, plan_move
from sim_hw.plant.plant import Plant
from sim_hw.plant.pose import ORIGIN_UM, TOUCH_Z_UM
from sim_hw.scene.collision import hit_at, hits_between
from sim_hw.scene.needle import Needle
from sim_hw.scene.optics import make_optics
from tests.sim_hw.rig import make_plant

NEEDLE = Needle(make_optics(), seed=1)
FLAT = {"board_dx_um": 0.0, "board_dy_um": 0.0, "board_rotation_deg": 0.0, "board_dz_um": 0.0}
LEVEL = {"board_tilt_x_um_per_mm": 0.0, "board_tilt_y_um_per_mm": 0.0}
BODIES = Bodies([Body("C7", np.array([[40.0, 20.0], [42.0, 20.0], [42.0, 21.0], [40.0, 21.0]]), 1_000.0, 80, 60)])


TALL = Bodies([Body("J1", BODIES.all[0].outline_mm, 10_500.0, 80, 60)])


def plant_at(x_mm: float, y_mm: float, above_um: float, theta_deg: float = 0.0, **knobs: float) -> Plant:
    knobs |= {"theta_start_deg": theta_deg}
    place = {"x_start_um": ORIGIN_UM[0] + 1e3 * x_mm, "y_start_um": ORIGIN_UM[1] + 1e3 * y_mm}
    plant = make_plant(head_runout_scale=0.0, z_start_um=TOUCH_Z_UM + above_um, **place, **FLAT, **LEVEL, **knobs)
    # Without run-out the tip still turns about the head; put it over the place asked for.
    state = plant.state_at(0.0)
    start = {"x_start_um": 2 * state.x_um - state.tip_x_um, "y_start_um": 2 * state.y_um - state.tip_y_um}
    return make_plant(head_runout_scale=0.0, z_start_um=TOUCH_Z_UM + above_um, **start, **FLAT, **LEVEL, **knobs)


@pytest.mark.parametrize(
    ("x_mm", "above_um", "hit"),
    [
        (41.0, 1_050.0, False),  # over it
        (41.0, 900.0, True),  # in it
        (39.9, 900.0, False),  # beside it, and thin enough
        (39.94, -100.0, True),  # beside it, but the shaft is too thick there
        (39.0, -100.0, False),
    ],
)
def test_end_and_shaft_are_in_a_part_or_not(x_mm: float, above_um: float, hit: bool) -> None:
    found = hit_at(plant_at(x_mm, 20.5, above_um), BODIES, NEEDLE, 0.0)
    assert (found is not None) == hit
    if found is not None:
        assert (found.part, found.moving) == ("C7", False)
        assert found.below_um == pytest.approx(1_000.0 - above_um, abs=1.0)
        assert found.cad_mm == pytest.approx((x_mm, 20.5), abs=1e-3)


@pytest.mark.parametrize(("above_um", "parts"), [(600.0, ["C7"]), (1_500.0, [])])
def test_a_part_that_is_run_through_on_the_way_is_noticed_once(above_um: float, parts: list[str]) -> None:
    plant = plant_at(35.0, 20.5, above_um)
    start = plant.axes["x"].position(0.0)
    plant.axes["x"].follow(plan_move(1.0, start, 0.0, start + 12_000.0, Ramps(30_000.0, 1e5, 1e5)))
    hits = list(hits_between(plant, BODIES, NEEDLE, 0.5, plant.rest_s()))
    assert [hit.part for hit in hits] == parts
    assert all(hit.moving and math.isclose(hit.cad_mm[0], 40.0, abs_tol=0.3) for hit in hits)


@pytest.mark.parametrize(
    ("x_mm", "above_um", "by"),
    [
        (39.8, 200.0, "needle"),  # its shaft
        (39.7, 200.0, "barrel"),
        (39.7, 1_200.0, None),  # the barrel is above the part's top
        (39.6, 200.0, None),
    ],
)
def test_the_barrel_hits_what_the_needle_passes(x_mm: float, above_um: float, by: str | None) -> None:
    found = hit_at(plant_at(x_mm, 20.5, above_um), TALL, NEEDLE, 0.0)
    assert (found.by if found is not None else None) == by


@pytest.mark.parametrize(
    ("x_mm", "theta_deg", "head_from_um", "hit"),
    [
        (50.8, 0.0, 10_000.0, True),  # it reaches 9 mm to the left at head angle 0
        (51.2, 0.0, 10_000.0, False),
        (33.2, 0.0, 10_000.0, True),  # and 7 mm to the right
        (32.8, 0.0, 10_000.0, False),
        (50.8, 90.0, 10_000.0, False),
        (50.8, 0.0, 10_400.0, False),  # just over it
    ],
)
def test_the_head_hits_what_is_taller_than_it_hangs_low(
    x_mm: float, theta_deg: float, head_from_um: float, hit: bool
) -> None:
    found = hit_at(plant_at(x_mm, 20.5, 200.0, theta_deg, head_from_um=head_from_um), TALL, NEEDLE, 0.0)
    assert (found is not None) == hit
    assert found is None or (found.by, found.part) == ("head", "J1")


def test_nothing_is_hit_where_no_board_lies() -> None:
    plant = plant_at(41.0, 20.5, 500.0)
    plant.faults.switch("board_gone", on=True)
    assert hit_at(plant, BODIES, NEEDLE, 0.0) is None
