"""The probe's plunger gives way when its end is lowered below the surface, in truth and in the picture."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from sim_hw.board.board import load_board
from sim_hw.plant.plant import Plant
from sim_hw.plant.pose import TOUCH_Z_UM
from sim_hw.scene.needle import Needle
from sim_hw.scene.optics import make_optics
from sim_hw.scene.scene import Scene, Shot, watch
from sim_hw.scene.sensor import Image
from sim_hw.truth import truth_record
from tests.sim_hw.pinhole import pinhole_px
from tests.sim_hw.rig import make_plant
from tests.sim_hw.scene_double import DEMO
from vision import ProbeModel, find_tip

FLAT = {"board_dz_um": 40.0, "board_tilt_x_um_per_mm": 0.0, "board_tilt_y_um_per_mm": 0.0}
#: Free bench beside the board: a dark, quiet ground.
PLACE = {"x_start_um": 150_000.0, "y_start_um": 120_000.0, "theta_start_deg": 30.0}
Field = npt.NDArray[np.floating[Any]]
NEEDLE = Needle(make_optics(), seed=5)


def lowered(by_um: float, **knobs: float) -> Plant:
    """Return a plant whose free end of the pin would be so far below the real surface."""
    values = {**FLAT, **PLACE, "z_start_um": TOUCH_Z_UM + FLAT["board_dz_um"] - by_um}
    return make_plant(**values, camera_flex_px=0.0, camera_glint=0.0, **knobs)


def shoot(plant: Plant) -> tuple[Image, tuple[float, float]]:
    """Return a white frame and where the scene says the tip is."""
    plant.switch_lamp("white", 0.0, on=True)
    scene = Scene(plant, load_board(DEMO, "top"), plant.faults, seed=5)
    return scene.render(Shot(1, 0.02, watch(plant, 1.0, 0.02))), scene.tip_px(plant.state_at(1.0))


def test_above_the_surface_the_pin_is_free() -> None:
    plant = lowered(-200.0)
    state, record = plant.state_at(0.0), truth_record(plant, [], 0.0)
    assert (state.pressed_um, record["pressed_um"]) == (0.0, 0.0)
    assert record["tip_um"][2] == state.tip_height_um == pytest.approx(200.0)


@pytest.mark.parametrize(("by_um", "pressed_um", "end_um"), [(120.0, 120.0, 0.0), (1_300.0, 1_000.0, -300.0)])
def test_below_it_the_pin_is_pushed_in_as_far_as_it_goes(by_um: float, pressed_um: float, end_um: float) -> None:
    plant = lowered(by_um)
    record = truth_record(plant, [], 0.0)
    assert record["pressed_um"] == pytest.approx(pressed_um)
    assert record["tip_um"][2] == pytest.approx(end_um, abs=1e-9)
    assert plant.state_at(0.0).tip_z_um == pytest.approx(FLAT["board_dz_um"] - by_um)


def test_the_travel_is_a_knob() -> None:
    assert lowered(300.0, pin_travel_um=250.0).state_at(0.0).pressed_um == 250.0


@pytest.mark.parametrize("by_um", [50.0, 150.0, 300.0])
def test_the_drawn_tip_moves_by_the_projection_of_what_is_pushed_in(by_um: float) -> None:
    free_frame, free_px = shoot(lowered(-200.0))
    model = ProbeModel.teach(free_frame, tip_px=free_px)
    plant = lowered(by_um)
    frame, tip_px = shoot(plant)
    state = plant.state_at(1.0)
    contact_px = pinhole_px(state, (state.tip_x_um, state.tip_y_um, FLAT["board_dz_um"]))
    assert tip_px == pytest.approx(contact_px, abs=0.02), "the pin ends on the surface"
    up_px = _end_px(frame, contact_px) - _end_px(free_frame, np.array(free_px))
    assert up_px == pytest.approx(0.0, abs=0.2), "the end is drawn where the scene says it is"
    before, after = find_tip(free_frame, model), find_tip(frame, model)
    assert before
    assert after
    # The marking is nearer to the camera than the end, so the same way is more pixels there.
    rim_px = NEEDLE.end_px(NEEDLE.rim2_um + by_um) - NEEDLE.end_px(NEEDLE.rim2_um)
    assert np.subtract(after.rim2_px, before.rim2_px) == pytest.approx(rim_px, abs=0.2)
    assert float(np.linalg.norm(contact_px - free_px)) == pytest.approx(by_um / 23.0, rel=0.03)


def _end_px(frame: Image, about_px: Field) -> float:
    """Return how far up the needle from a place the dark ground ends, px."""
    steps = np.arange(-8.0, 8.0, 0.05)
    places = (about_px + steps[:, None] * NEEDLE.up).T[:, None].astype(np.float32)
    grey = cv2.remap(frame.mean(axis=2).astype(np.float32), *places, cv2.INTER_LINEAR)[0]
    return float(steps[int(np.argmax(grey > 50.0))])


def test_the_barrel_stays_where_it_is_and_the_marking_goes_along() -> None:
    free, pressed = NEEDLE.draw(), NEEDLE.draw(pressed_um=600.0)
    assert free.left == pressed.left
    moved_px = float(np.linalg.norm(NEEDLE.end_px(600.0) - NEEDLE.tip_px))
    assert moved_px == pytest.approx(25.0, abs=1.5)

    def profile(field: Field, s_px: Field) -> Field:
        places = NEEDLE.tip_px + s_px[:, None].astype(np.float64) * NEEDLE.up - (free.left, 0.0)
        return np.asarray(cv2.remap(field, *(places.T[:, None].astype(np.float32)), cv2.INTER_LINEAR)[0])

    barrel = np.arange(475.0, 640.0)
    assert np.array_equal(profile(free.white, barrel), profile(pressed.white, barrel))
    near = np.arange(110.0, 190.0, 0.25)
    fits = [
        np.abs(profile(free.red, near) - profile(pressed.red, near + shift)).mean() for shift in np.arange(0, 40, 0.25)
    ]
    middle_um = (NEEDLE.rim1_um + NEEDLE.rim2_um) / 2.0
    marking_px = float(np.linalg.norm(NEEDLE.end_px(middle_um + 600.0) - NEEDLE.end_px(middle_um)))
    assert 0.25 * int(np.argmin(fits)) == pytest.approx(marking_px, abs=0.5)
    assert profile(pressed.alpha, np.array([moved_px - 4.0]))[0] < 0.1
    assert profile(pressed.alpha, np.array([moved_px + 3.0]))[0] > 0.9


def test_a_pressed_bent_needle_ends_aside_by_its_bend() -> None:
    plant = lowered(200.0)
    plant.faults.switch("bent", on=True, px=10.0)
    _, bent_px = shoot(plant)
    assert np.array(bent_px) - NEEDLE.end_px(200.0) == pytest.approx(10.0 * NEEDLE.bend_direction)
    image = NEEDLE.draw(bent_px=10.0, pressed_um=200.0)
    inside = np.array(bent_px) + 3.0 * NEEDLE.up
    assert image.alpha[round(inside[1]), round(inside[0]) - image.left] > 0.8
