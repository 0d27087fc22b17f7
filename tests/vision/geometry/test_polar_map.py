"""The thesis' array corrects as well as an array can, at its angles and between, behind the maps' one interface."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_hw.scene.optics import TIP_PX, make_optics
from tests.bench import maps as bench
from vision.geometry.frames import rotation
from vision.geometry.image_map import ImageMap, MapPoint, angle_groups
from vision.geometry.polar_map import PolarMap, direction_deg, fit_polar_map
from vision.geometry.pose_map import fit_pose_map

OPTICS, HOVER_UM = make_optics(), 200.0
BELOW = OPTICS.project((0.0, 0.0, -HOVER_UM))[0] - TIP_PX
GIVEN = {
    "tip_px": TIP_PX,
    "below_tip_px": (float(BELOW[0]), float(BELOW[1])),
    "work_z_um": 5200.0,
    "hover_um": HOVER_UM,
}


def _ask(image_map: ImageMap, truth_um: tuple[float, float], theta_deg: float, height_um: float = 0.0) -> float:
    """Return how far from the truth the map's correction is."""
    head = rotation(-theta_deg) @ truth_um
    x, y = OPTICS.project((*head, height_um - HOVER_UM))[0]
    way = image_map.correction((float(x), float(y)), TIP_PX, theta_deg, height_um=height_um)
    return math.dist((way.dx_um, way.dy_um), truth_um)


@pytest.fixture(scope="module")
def array() -> PolarMap:
    sightings = [s for a in (10.0, 95.0, 150.0, 330.0) for s in bench.walk(np.random.default_rng(1), a, 0.0)]
    return fit_polar_map(sightings, **GIVEN)


@pytest.mark.parametrize("theta_deg", [10.0, 95.0, 150.0, 330.0, 0.0, 52.0, 240.0, 359.9])
def test_a_correction_of_half_a_millimetre_is_right_to_a_pixel_at_and_between_its_angles(
    array: PolarMap, theta_deg: float
) -> None:
    for k in range(12):
        assert _ask(array, tuple(rotation(30.0 * k + 7.0) @ (500.0, 0.0)), theta_deg) < 12.0


def test_distances_are_taken_in_proportion(array: PolarMap) -> None:
    below = np.add(TIP_PX, array.below_tip_px)
    short, far = (array.from_tip_um(below + scale * np.array([3.0, -4.0]), TIP_PX, 52.0) for scale in (1.0, 9.0))
    assert far == pytest.approx(9.0 * short)
    assert array.from_tip_um(below, TIP_PX, 52.0) == pytest.approx((0.0, 0.0))


def test_it_turns_with_the_head_between_its_rows(array: PolarMap) -> None:
    """With rows that say the same, what the head's angle changes is the direction alone."""
    same = replace(
        array,
        um_per_px=np.repeat(array.um_per_px[:1], 4, axis=0),
        gamma_deg=np.repeat(array.gamma_deg[:1], 4, axis=0),
    )
    places = np.array([(440.0, 600.0), (400.0, 640.0)])
    straight = same.from_tip_um(places, TIP_PX, 0.0)
    for theta_deg in (5.0, 10.0, 200.0, 359.0):
        assert same.from_tip_um(places, TIP_PX, theta_deg) == pytest.approx(straight @ rotation(theta_deg).T)


def test_between_rows_and_columns_it_is_bilinear(array: PolarMap) -> None:
    """Exactly half way between two angles and two directions it is the mean of four elements."""
    omega = math.radians(1.5 * 15.0)
    target = np.add(TIP_PX, array.below_tip_px) + 10.0 * np.array([math.sin(omega), math.cos(omega)])
    way = array.from_tip_um(target, TIP_PX, 52.5)
    assert np.linalg.norm(way) == pytest.approx(10.0 * array.um_per_px[:2, 1:3].mean())
    gamma = np.unwrap(np.radians(array.gamma_deg[:2, 1:3].ravel())).mean() + math.radians(52.5)
    assert way / np.linalg.norm(way) == pytest.approx((math.cos(gamma), math.sin(gamma)))


def test_omega_is_the_thesis_angle_and_gamma_is_omega_and_a_constant(array: PolarMap) -> None:
    """Table 6.2 has gamma = omega + pi / 2; on the simulated station the constant is another, and the tilt bends it."""
    omega = 15.0 * np.arange(24)
    turn = (array.gamma_deg[0] - omega + 180.0) % 360.0 - 180.0
    assert np.ptp(turn) < 12.0
    # Rows a, b, c of the table; d, the one to the right of the tip, is positive.
    rows = [(426, 624, 412, 638, -0.78), (442, 621, 434, 636, -0.49), (421, 613, 416, 626, -0.36)]
    rows.append((424, 628, 428, 638, 0.38))
    for xe, ye, xg, yg, printed in rows:
        assert math.radians(direction_deg(np.array([xg - xe, yg - ye]))) == pytest.approx(printed, abs=0.01)


def test_a_board_that_lies_higher_is_corrected_as_well(array: PolarMap) -> None:
    for height_um in (-60.0, 80.0):
        assert _ask(array, (300.0, -200.0), 95.0, height_um) < 10.0
        untold = array.from_tip_um(
            OPTICS.project((*(rotation(-95.0) @ (300.0, -200.0)), height_um - HOVER_UM))[0], TIP_PX, 95.0
        )
        assert math.dist(untold, (300.0, -200.0)) > 0.4 * abs(height_um)


def test_its_covariance_grows_with_the_way_and_with_what_is_seen_badly() -> None:
    array = fit_polar_map(bench.walk(np.random.default_rng(2), 30.0, 1.0), **GIVEN)
    below = np.add(TIP_PX, array.below_tip_px)
    near, far = (array.correction((below[0] + d, below[1]), TIP_PX, 30.0, 0.0) for d in (5.0, 50.0))
    assert far.sigma_um == pytest.approx(10.0 * near.sigma_um)
    assert 2.0 < far.sigma_um < 15.0
    blurred = array.correction((below[0] + 5.0, below[1]), TIP_PX, 30.0, 1.0)
    assert blurred.sigma_um == pytest.approx(12.0 * math.sqrt(2.0), rel=0.2)
    assert 4.0 < array.residual_um < 12.0


def test_a_flipped_picture_makes_an_array_that_corrects() -> None:
    sightings = bench.walk(np.random.default_rng(3), 30.0, 0.0)
    flipped = [MapPoint((1599.0 - s.target_px[0], s.target_px[1]), s.x_um, s.y_um, s.theta_deg) for s in sightings]
    tip = (1599.0 - TIP_PX[0], TIP_PX[1])
    array = fit_polar_map(flipped, **(GIVEN | {"tip_px": tip, "below_tip_px": (-float(BELOW[0]), float(BELOW[1]))}))
    for k in range(8):
        truth = rotation(45.0 * k) @ (400.0, 0.0)
        x, y = OPTICS.project((*(rotation(-30.0) @ truth), -HOVER_UM))[0]
        assert math.dist(array.from_tip_um(np.array([1599.0 - x, y]), tip, 30.0), truth) < 10.0


def test_one_outlier_does_not_bend_it() -> None:
    sightings = bench.walk(np.random.default_rng(4), 30.0, 0.5)
    bad = sightings[9]
    sightings[9] = MapPoint((bad.target_px[0] - 25.0, bad.target_px[1]), bad.x_um, bad.y_um, bad.theta_deg)
    array = fit_polar_map(sightings, **GIVEN)
    assert max(_ask(array, tuple(rotation(30.0 * k) @ (500.0, 0.0)), 30.0) for k in range(12)) < 20.0


def test_one_look_by_the_projective_map_is_better_than_by_the_array_and_both_beat_one_factor() -> None:
    tallies = bench.run(rounds=3, trials=40, noise=1.0)
    rms = {name: here.figures()[0] for name, (here, _) in tallies.items()}
    assert rms["projective, 1 angle"] < rms["polar array, 1 angle"] < 0.5 * rms["one factor, 1 angle"]
    assert rms["projective, 1 angle"] < 10.0


def test_what_makes_no_array_is_refused() -> None:
    sightings = bench.walk(np.random.default_rng(5), 30.0, 1.0)
    with pytest.raises(ValueError, match="no sightings"):
        fit_polar_map([], **GIVEN)
    with pytest.raises(ValueError, match="needs 8 at each angle"):
        fit_polar_map(sightings[:7], **GIVEN)
    with pytest.raises(ValueError, match=r"at 40\.00 deg"):
        fit_polar_map([*sightings, *bench.walk(np.random.default_rng(5), 40.0, 1.0)[:5]], **GIVEN)
    with pytest.raises(ValueError, match="not finite"):
        fit_polar_map([*sightings, MapPoint((math.nan, 0.0), 0.0, 0.0, 30.0)], **GIVEN)
    with pytest.raises(ValueError, match="gap"):
        fit_polar_map([s for s in sightings * 2 if s.target_px[0] > TIP_PX[0]], **GIVEN)
    with pytest.raises(ValueError, match="line"):
        fit_polar_map([MapPoint((428.0 + k, 620.0 + 2 * k), 10.0 * k, 20.0 * k, 0.0) for k in range(10)], **GIVEN)
    with pytest.raises(ValueError, match="columns"):
        fit_polar_map(sightings, **GIVEN, columns=3)
    with pytest.raises(ValueError, match="hover"):
        fit_polar_map(sightings, **(GIVEN | {"hover_um": 0.0}))


def test_both_maps_agree_where_the_axes_do_not_scatter() -> None:
    sightings = bench.walk(np.random.default_rng(6), 30.0, 0.0)
    both: list[ImageMap] = [fit_pose_map(sightings, **GIVEN), fit_polar_map(sightings, **GIVEN)]
    first, second = (m.correction((450.0, 600.0), TIP_PX, 75.0) for m in both)
    assert (first.dx_um, first.dy_um) == pytest.approx((second.dx_um, second.dy_um), abs=8.0)
    assert both[0].radius_um == pytest.approx(both[1].radius_um, rel=0.03)


def test_angles_of_one_stop_are_one_group() -> None:
    assert angle_groups([10.0, 359.0, 10.004, 9.996, 0.0]).tolist() == [1, 2, 1, 1, 0]
    assert angle_groups([]).tolist() == []
