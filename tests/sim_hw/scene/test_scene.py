from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from sim_hw.board.board import Board, Target, load_board
from sim_hw.plant.faults import Faults
from sim_hw.scene.scene import Scene, Shot, watch
from sim_hw.scene.sensor import Image
from tests.sim_hw.pinhole import pinhole_px
from tests.sim_hw.scene_double import DEMO, FakeKnobs, FakePlant, FakePose

Point = npt.NDArray[np.float64]


class Bench:
    """One scene with everything round it; plant and faults are put back before each test."""

    def __init__(self, side: str) -> None:
        self.board = load_board(DEMO, side)
        self.plant = FakePlant()
        self.faults = Faults()
        self.scene = Scene(self.plant, self.board, self.faults, seed=11)

    def reset(self) -> "Bench":
        self.plant.board_pose, self.plant.knobs, self.plant.motion = FakePose(), FakeKnobs(), None
        for name in ("bent", "missing"):
            self.faults.switch(name, on=False)
        return self

    def shoot(self, sequence: int = 1, start_s: float = 0.0, exposure_s: float = 0.02) -> Image:
        return self.scene.render(Shot(sequence, exposure_s, watch(self.plant, start_s, exposure_s)))

    def where(self, name: str) -> Point:
        target = self.board.target(name)
        return np.array(self.scene.board_px(self.plant.head, target.x_mm, target.y_mm))


@pytest.fixture(scope="module")
def top_bench() -> Bench:
    return Bench("top")


@pytest.fixture
def bench(top_bench: Bench) -> Bench:
    return top_bench.reset()


def _centroid(frame: Image, about: Point, reach: int) -> Point:
    """Return the centre of the bright blob round a place, rims weighted by how bright they are."""
    column, row = (round(float(value)) for value in about)
    window = frame[row - reach : row + reach + 1, column - reach : column + reach + 1, 2].astype(float)
    low, high = np.percentile(window, 15), np.percentile(window, 92)
    weight = np.clip((window - low - 0.25 * (high - low)) / (0.35 * (high - low)), 0.0, 1.0)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return np.array([column + (weight * columns).sum() / weight.sum(), row + (weight * rows).sum() / weight.sum()])


def _pinhole(plant: FakePlant, board: Board, target: Target) -> Point:
    return pinhole_px(plant.head, (*board.nominal_um(target.x_mm, target.y_mm), 0.0))


@pytest.mark.parametrize("light", ["white", "red"])
@pytest.mark.parametrize(("name", "theta_deg"), [("FID2", 0.0), ("FID2", 250.0), ("TP1", 160.0), ("FID3", 40.0)])
def test_a_pad_is_drawn_where_a_pinhole_camera_sees_it(bench: Bench, name: str, theta_deg: float, light: str) -> None:
    on = {"white": float(light == "white"), "red": float(light == "red")}
    turn = np.radians(theta_deg)
    # keep the pad to the lower right of the tip in the picture, clear of the needle
    aside = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ (-2000.0, 1500.0)
    bench.plant.aim(bench.board, name, dx_um=aside[0], dy_um=aside[1], theta_deg=theta_deg, **on)
    target = bench.board.target(name)
    expected = _pinhole(bench.plant, bench.board, target)
    assert bench.where(name) == pytest.approx(expected, abs=0.02)
    reach = round(target.pad_diameter_mm * 500.0 / 12.0) + 6
    assert _centroid(bench.shoot(), expected, reach) == pytest.approx(expected, abs=0.3)


def test_the_bottom_side_is_drawn_where_it_is() -> None:
    bench = Bench("bottom")
    bench.plant.aim(bench.board, "TP10", dx_um=-1500.0, dy_um=1500.0)
    target = bench.board.target("TP10")
    expected = _pinhole(bench.plant, bench.board, target)
    assert _centroid(bench.shoot(), expected, 12) == pytest.approx(expected, abs=0.3)


def test_pose_error_of_the_board_moves_its_picture(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP1", dx_um=-1500.0, dy_um=1200.0)
    before = bench.where("TP1")
    bench.plant.board_pose = FakePose(dx_um=120.0, rotation_deg=0.5)
    assert np.linalg.norm(bench.where("TP1") - before) > 5.0
    assert _centroid(bench.shoot(), bench.where("TP1"), 12) == pytest.approx(bench.where("TP1"), abs=0.3)


def test_a_higher_board_is_a_shifted_picture(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP1", dx_um=-1500.0, dy_um=1200.0)
    low = _centroid(bench.shoot(), bench.where("TP1"), 12)
    bench.plant.board_pose = FakePose(dz_um=100.0)
    bench.plant.head = replace(bench.plant.head, tip_height_um=100.0)  # the surface 100 um nearer to the same tip
    high = _centroid(bench.shoot(), bench.where("TP1"), 12)
    assert float((low - high) @ (0.456, 0.890)) == pytest.approx(4.1, abs=0.5)


def test_the_needle_hides_what_is_behind_it_and_nothing_else(bench: Bench) -> None:
    bench.plant.aim(bench.board, "FID2", dx_um=500.0, dy_um=-1500.0)  # the fiducial lies behind the taper
    with_needle = bench.shoot()
    bench.faults.switch("missing", on=True)
    without = bench.shoot()
    changed = np.abs(with_needle.astype(int) - without).max(axis=2) > 25
    tip = np.array(bench.scene.tip_px(bench.plant.head))
    rows, columns = np.nonzero(changed)
    up_along = (np.stack((columns, rows), axis=1) - tip) @ bench.scene.needle.up
    assert up_along.min() > -6.0
    middle = tip + 90.0 * bench.scene.needle.up
    assert changed[round(middle[1]), round(middle[0])]


def test_the_tip_is_where_it_is_said_to_be(bench: Bench) -> None:
    bench.plant.knobs = FakeKnobs(camera_flex_px=0.7, camera_noise_grey=0.5)
    bench.plant.aim(bench.board, "FID2", dx_um=-4500.0, dy_um=23_500.0 - 2000.0)  # over the free dark area
    tip = np.array(bench.scene.tip_px(bench.plant.head))
    assert 0.0 < np.abs(tip - (428.0, 620.0)).max() <= 2.0
    frame = bench.shoot().astype(float).mean(axis=2)
    needle = bench.scene.needle
    profile = []
    for s in np.arange(-12.0, 12.0, 0.25):
        x, y = tip + s * needle.up
        column, row = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - column, y - row
        patch = frame[row : row + 2, column : column + 2]
        profile.append(
            float(np.array([1 - fy, fy]) @ patch @ np.array([1 - fx, fx])),
        )
    level = (np.mean(profile[:8]) + np.mean(profile[-8:])) / 2.0
    edge = -12.0 + 0.25 * int(np.argmax(np.array(profile) > level))
    assert edge == pytest.approx(0.0, abs=3.0)


def test_flex_is_one_value_a_stop_and_moves_tip_and_board_alike(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP1", dx_um=-1500.0)
    stiff = bench.where("TP1") - bench.scene.tip_px(bench.plant.head)
    bench.plant.knobs = FakeKnobs(camera_flex_px=0.7)
    first = bench.scene.tip_px(bench.plant.head)
    assert first == bench.scene.tip_px(bench.plant.head)
    assert bench.where("TP1") - first == pytest.approx(stiff)
    bench.plant.head = replace(bench.plant.head, tip_x_um=bench.plant.head.tip_x_um + 50.0)
    assert first != bench.scene.tip_px(bench.plant.head)


def test_a_bent_probe_ends_elsewhere(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP1")
    straight = np.array(bench.scene.tip_px(bench.plant.head))
    before = bench.shoot()
    bench.faults.switch("bent", on=True, px=12.0)
    bent = np.array(bench.scene.tip_px(bench.plant.head))
    assert np.linalg.norm(bent - straight) == pytest.approx(12.0)
    assert (np.abs(before.astype(int) - bench.shoot()).max(axis=2) > 40).any()


def test_without_light_it_is_nearly_black(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP4", white=0.0, red=0.0)
    frame = bench.shoot()
    assert frame.mean() < 6.0
    assert np.percentile(frame, 99.9) < 20


def test_red_light_leaves_blue_and_green_nearly_dark(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP4", white=0.0, red=1.0)
    frame = bench.shoot()
    assert frame[..., :2].mean() < 8.0
    x, y = bench.where("TP9")
    assert 140 <= frame[round(y), round(x), 2] <= 235


def test_light_that_changes_during_the_exposure_is_integrated(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP4")
    full = bench.shoot().astype(float).mean()
    bench.plant.motion = lambda t_s, head: replace(head, white=1.0 if t_s > 0.01 else 0.0)
    half = bench.shoot().astype(float).mean()
    assert half == pytest.approx(full / 2.0, rel=0.15)


def test_a_moving_head_smears_the_board_but_not_the_needle(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP1", dx_um=-1500.0, dy_um=1200.0)
    still = bench.shoot()
    about = bench.where("TP1")
    bench.plant.motion = lambda t_s, head: replace(head, tip_x_um=head.tip_x_um + 20_000.0 * (t_s - 0.01), moving=True)
    smeared = bench.shoot()
    column, row = (round(float(value)) for value in about)
    window = np.s_[row - 30 : row + 31, column - 30 : column + 31, 1]
    assert smeared[window].max() < 0.75 * still[window].max()
    x, y = np.array(bench.scene.tip_px(bench.plant.head)) + 150.0 * bench.scene.needle.up
    needle = np.s_[round(y) - 5 : round(y) + 5, round(x) - 5 : round(x) + 5]
    assert smeared[needle].mean() == pytest.approx(still[needle].mean(), abs=4.0)


def test_the_same_shot_is_the_same_frame_and_another_differs(bench: Bench) -> None:
    bench.plant.knobs = FakeKnobs(camera_glint=1.0)
    bench.plant.aim(bench.board, "TP8")
    assert np.array_equal(bench.shoot(3), bench.shoot(3))
    assert not np.array_equal(bench.shoot(3), bench.shoot(4))


def test_too_long_an_exposure_saturates_pads_before_the_mask(bench: Bench) -> None:
    bench.plant.aim(bench.board, "TP9", dx_um=-1500.0, dy_um=1200.0)
    frame = bench.shoot(exposure_s=0.06)
    x, y = bench.where("TP9")
    assert frame[round(y), round(x)].min() > 240
    assert np.median(frame) < 200


def test_far_from_the_board_there_is_only_the_bench(bench: Bench) -> None:
    bench.plant.head = replace(bench.plant.head, tip_x_um=180_000.0, tip_y_um=140_000.0, white=1.0, red=0.0)
    frame = bench.shoot()
    assert frame[900:, 900:].mean() < 35.0
