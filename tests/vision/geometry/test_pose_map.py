"""A map drawn from a known camera is found again, and bad data are refused."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim_hw.scene.optics import make_optics
from vision.geometry.frames import Rigid2, rotation
from vision.geometry.pose_map import MapPoint, PoseMap, fit_pose_map, worst_shrink
from vision.head.model import CircleHead

TIP_PX = (428.0, 620.0)
BELOW_PX = (3.8, 7.4)
# An oblique view: 12 um/px across, foreshortened along, with a little perspective.
TRUE = np.array([[11.0, 5.2, 0.0], [-4.9, 12.6, 0.0], [4e-6, 9e-6, 1.0]]) @ np.array(
    [[1, 0, -TIP_PX[0]], [0, 1, -TIP_PX[1]], [0, 0, 1.0]]
)


def _to_px(head_um: np.ndarray) -> tuple[float, float]:
    q = np.linalg.inv(TRUE) @ (*head_um, 1.0)
    return float(q[0] / q[2]), float(q[1] / q[2])


def _sightings(rng: np.random.Generator, n: int = 19, theta_deg: float = 30.0, noise_px: float = 0.0) -> list[MapPoint]:
    mark = np.array([1000.0, 2000.0])
    found = []
    for _ in range(n):
        offset = rng.uniform(-700, 700, 2)
        px = (
            np.array(_to_px(rotation(-theta_deg) @ -offset)) + rng.normal(0, noise_px, 2)
            if noise_px
            else _to_px(rotation(-theta_deg) @ -offset)
        )
        found.append(MapPoint((float(px[0]), float(px[1])), *(float(v) for v in mark + offset), theta_deg))
    return found


GIVEN = {"tip_px": TIP_PX, "below_tip_px": BELOW_PX, "work_z_um": 5200.0, "hover_um": 200.0}


def _fit(sightings: list[MapPoint], below_sigma_px: float = 0.0) -> PoseMap:
    return fit_pose_map(sightings, **GIVEN, below_sigma_px=below_sigma_px)


@pytest.mark.parametrize("theta_deg", [0.0, 77.0, 250.0])
def test_the_map_holds_at_any_head_angle(theta_deg: float) -> None:
    pose_map = _fit(_sightings(np.random.default_rng(1)))
    below = np.add(TIP_PX, BELOW_PX)
    origin = TRUE @ (*below, 1.0)
    target_head = origin[:2] / origin[2] + (250.0, -310.0)
    way = pose_map.correction(_to_px(target_head), TIP_PX, theta_deg)
    assert (way.dx_um, way.dy_um) == pytest.approx(tuple(rotation(theta_deg) @ (250.0, -310.0)), abs=0.01)


def test_noise_of_a_tenth_of_a_pixel_costs_a_few_um() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(2), noise_px=0.1))
    assert pose_map.residual_um < 3.0
    exact = _fit(_sightings(np.random.default_rng(2)))
    places = np.array([(300.0, 0.0), (0.0, -400.0), (-350.0, 350.0)])
    pixels = exact.to_px(places, TIP_PX, 0.0)
    assert np.abs(pose_map.from_tip_um(pixels, TIP_PX, 0.0) - places).max() < 5.0


def test_to_px_is_the_inverse() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(3)))
    places = np.array([(120.0, -333.0), (-600.0, 210.0)])
    assert pose_map.from_tip_um(pose_map.to_px(places, TIP_PX, 200.0), TIP_PX, 200.0) == pytest.approx(places, abs=1e-6)


def test_scale_is_the_larger_one_of_an_oblique_view() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(4)))
    singular = np.linalg.svd(TRUE[:2, :2], compute_uv=False)
    assert 1 / pose_map.scale_px_per_um(TIP_PX) == pytest.approx(singular[1], rel=0.02)


def test_one_outlier_does_not_bend_the_map() -> None:
    sightings = _sightings(np.random.default_rng(5))
    bad = sightings[4]
    sightings[4] = MapPoint((bad.target_px[0] + 25.0, bad.target_px[1]), bad.x_um, bad.y_um, bad.theta_deg)
    places = np.array([(300.0, 100.0)])
    pixels = _fit(_sightings(np.random.default_rng(5))).to_px(places, TIP_PX, 0.0)
    assert np.abs(_fit(sightings).from_tip_um(pixels, TIP_PX, 0.0) - places).max() < 20.0


def test_too_few_or_lined_up_or_not_finite_sightings_are_refused() -> None:
    sightings = _sightings(np.random.default_rng(6))
    with pytest.raises(ValueError, match="at least"):
        _fit(sightings[:5])
    line = [MapPoint((428.0 + k, 620.0 + 2 * k), 10.0 * k, 20.0 * k, 0.0) for k in range(10)]
    with pytest.raises(ValueError, match="line"):
        _fit(line)
    with pytest.raises(ValueError, match="finite"):
        _fit([*sightings, MapPoint((math.nan, 0.0), 0.0, 0.0, 0.0)])


def test_a_map_survives_its_file_and_a_torn_file_is_refused(tmp_path: Path) -> None:
    pose_map = _fit(_sightings(np.random.default_rng(7)))
    path = tmp_path / "map.json"
    path.write_text(pose_map.to_json())
    again = PoseMap.load(path)
    assert np.array_equal(again.homography, pose_map.homography)
    assert again.below_tip_px == pose_map.below_tip_px
    path.write_text(pose_map.to_json()[:100])
    with pytest.raises(ValueError, match="calibrate"):
        PoseMap.load(path)


def test_the_corrected_pose_of_the_thesis() -> None:
    """Eq. 6.12..6.14 with the misprints put right: the error (-1.2322, -0.2322) is (-1.0355, 0.7071) on the head."""
    to_b = Rigid2(45.0, 10.0, 5.0)
    camera = to_b.apply((2.5, 0.0))
    assert camera == pytest.approx((11.7678, 6.7678), abs=1e-4)
    on_head = rotation(-45.0) @ (-1.2322, -0.2322)
    assert on_head == pytest.approx((-1.0355, 0.7071), abs=2e-4)
    assert to_b.apply(np.array((2.5, 0.0)) - on_head) == pytest.approx((13.0, 7.0), abs=1e-3)
    assert to_b.inverse().apply(camera) == pytest.approx((2.5, 0.0))
    assert to_b.then(to_b.inverse()).apply((3.0, 4.0)) == pytest.approx((3.0, 4.0))


def test_the_head_draws_a_circle() -> None:
    head = CircleHead(14938.26, -3.054)
    offsets = np.array([head.tip_offset_um(t) for t in (0.0, 90.0, 180.0)])
    assert np.linalg.norm(offsets, axis=1) == pytest.approx([14938.26] * 3)
    assert offsets[0] == pytest.approx(-offsets[2])
    assert offsets[1] == pytest.approx(rotation(90.0) @ offsets[0])


# The camera of the simulated station, as far as a plane under the tip goes.
OPTICS, HOVER_UM = make_optics(), 200.0


def _below_px(height_um: float) -> tuple[float, float]:
    """From the tip's picture to the place below it on a surface `height_um` above the nominal touching plane."""
    place = OPTICS.project((0.0, 0.0, height_um - HOVER_UM))[0]
    return float(place[0] - TIP_PX[0]), float(place[1] - TIP_PX[1])


def _camera_px(from_tip_um: np.ndarray, theta_deg: float, height_um: float = 0.0) -> np.ndarray:
    """Pixels (N, 2) of places given from below the tip in the robot frame."""
    head = np.atleast_2d(from_tip_um) @ rotation(theta_deg)
    return np.asarray(OPTICS.project(np.c_[head, np.full(len(head), height_um - HOVER_UM)]))


def _camera_sightings(
    rng: np.random.Generator, angles: tuple[float, ...] = (30.0,), n: int = 17, stop_um: float = 0.0, px: float = 0.0
) -> list[MapPoint]:
    """A target at a place of the robot frame, seen while the head stands round it; the tip's circle has run-out."""
    found = []
    for theta_deg in angles:
        head_um = np.array([3e4, 4e4]) - rotation(theta_deg) @ (15000.0, 0.0) + rng.normal(0.0, 100.0, 2)
        for k in range(n):
            offset = rotation(360.0 * k / n) @ (rng.uniform(250.0, 700.0), 0.0)
            stop, seen = rng.normal(0.0, stop_um, 2), rng.normal(0.0, px, 2)
            pixel = _camera_px(-(offset + stop), theta_deg)[0] + seen
            place = head_um + offset
            found.append(MapPoint((float(pixel[0]), float(pixel[1])), float(place[0]), float(place[1]), theta_deg))
    return found


def _camera_map(sightings: list[MapPoint], below_sigma_px: float = 0.0) -> PoseMap:
    return fit_pose_map(
        sightings,
        tip_px=TIP_PX,
        below_tip_px=_below_px(0.0),
        work_z_um=5200.0,
        hover_um=HOVER_UM,
        below_sigma_px=below_sigma_px,
    )


@pytest.mark.parametrize("height_um", [-80.0, 0.0, 50.0, 100.0])
def test_a_board_that_lies_higher_or_lower_costs_a_micrometre_once_its_height_is_told(height_um: float) -> None:
    pose_map = _camera_map(_camera_sightings(np.random.default_rng(8)))
    places = np.array([(0.0, 0.0), (400.0, 0.0), (-250.0, 300.0), (0.0, -500.0)])
    pixels = _camera_px(places, 77.0, height_um)
    told = pose_map.from_tip_um(pixels, TIP_PX, 77.0, height_um=height_um)
    assert np.abs(told - places).max() < 1.5
    assert pose_map.to_px(places, TIP_PX, 77.0, height_um=height_um) == pytest.approx(pixels, abs=0.1)
    assert pose_map.below_px(height_um) == pytest.approx(_below_px(height_um), abs=0.05)
    way = pose_map.correction((float(pixels[1, 0]), float(pixels[1, 1])), TIP_PX, 77.0, height_um=height_um)
    assert (way.dx_um, way.dy_um) == pytest.approx((400.0, 0.0), abs=1.5)
    if height_um:
        untold = pose_map.from_tip_um(pixels, TIP_PX, 77.0)
        # tan 30 deg of the height, whichever way the head is turned.
        assert np.linalg.norm(untold - places, axis=1) == pytest.approx([0.577 * abs(height_um)] * 4, rel=0.1)


@pytest.mark.parametrize("pushed_um", [-30.0, 20.0, 150.0])
def test_a_tip_pushed_up_by_the_board_tells_how_far(pushed_um: float) -> None:
    pose_map = _camera_map(_camera_sightings(np.random.default_rng(9)))
    pushed = OPTICS.project((0.0, 0.0, pushed_um))[0]
    assert pose_map.height_from_shift_um(pushed - TIP_PX) == pytest.approx(pushed_um, rel=0.01)
    along = np.array(pose_map.below_tip_px)
    aside = np.array([-along[1], along[0]])
    assert pose_map.height_from_shift_um(pushed - TIP_PX + aside) == pytest.approx(pushed_um, rel=0.01)


def test_raising_the_head_moves_the_board_along_below_tip_px() -> None:
    """The tip stays in the picture, so for the board's sake the head going up is the board going down."""
    pose_map = _camera_map(_camera_sightings(np.random.default_rng(9)))
    at_work, raised = (OPTICS.project((0.0, 0.0, -hover))[0] for hover in (HOVER_UM, HOVER_UM + 60.0))
    assert (raised - at_work) @ pose_map.below_tip_px > 0.0
    assert pose_map.height_from_shift_um(raised - at_work) == pytest.approx(-60.0, rel=0.02)


def test_a_view_from_straight_above_shows_no_height() -> None:
    sightings = _camera_sightings(np.random.default_rng(9))
    flat = fit_pose_map(sightings, tip_px=TIP_PX, below_tip_px=(0.0, 0.0), work_z_um=5200.0, hover_um=200.0)
    with pytest.raises(ValueError, match="straight down"):
        flat.height_from_shift_um((1.0, 1.0))


def test_the_predicted_sigma_is_honest_within_a_fifth() -> None:
    """300 maps from noisy stops and pixels, one new look each: the errors are as large as their covariances say."""
    rng = np.random.default_rng(10)
    errors, covariances, maps_only = [], [], []
    truth = np.array([300.0, -350.0])
    for _ in range(300):
        below_error = rng.normal(0.0, 0.2, 2)
        given = {"below_tip_px": tuple(np.add(_below_px(0.0), below_error)), "work_z_um": 5200.0, "hover_um": HOVER_UM}
        sightings = _camera_sightings(rng, stop_um=5.66, px=0.15)
        pose_map = fit_pose_map(sightings, tip_px=TIP_PX, **given, below_sigma_px=0.2)
        tip, target = TIP_PX + rng.normal(0, 0.12, 2), _camera_px(truth, 200.0)[0] + rng.normal(0, 0.12, 2)
        way = pose_map.correction(
            (float(target[0]), float(target[1])), (float(tip[0]), float(tip[1])), 200.0, math.hypot(0.12, 0.12)
        )
        errors.append(np.array([way.dx_um, way.dy_um]) - truth)
        covariances.append(way.covariance)
        clean = pose_map.from_tip_um(_camera_px(truth, 200.0)[0], tuple(np.subtract(TIP_PX, below_error)), 200.0)
        blind = replace(pose_map, below_sigma_px=0.0)
        pixel = _camera_px(truth, 200.0)[0]
        alone = blind.correction((float(pixel[0]), float(pixel[1])), TIP_PX, 200.0, 0.0)
        maps_only.append((clean - truth, alone.covariance))
    found = np.cov(np.array(errors).T)
    predicted = np.mean(covariances, axis=0)
    assert np.sqrt(np.diag(predicted)) == pytest.approx(np.sqrt(np.diag(found)), rel=0.2)
    assert math.sqrt(np.trace(predicted)) == pytest.approx(math.sqrt(np.trace(found)), rel=0.2)
    normalised = [e @ np.linalg.solve(c, e) for e, c in zip(errors, covariances, strict=True)]
    assert np.mean(normalised) == pytest.approx(2.0, rel=0.2)
    # And the part of the homography alone, without any sight.
    rms = math.sqrt(np.mean([e @ e for e, _ in maps_only]))
    assert math.sqrt(np.mean([np.trace(c) for _, c in maps_only])) == pytest.approx(rms, rel=0.2)


def test_sigma_tells_what_is_seen_and_residual_tells_how_it_stops() -> None:
    pose_map = _camera_map(_camera_sightings(np.random.default_rng(11), stop_um=5.66))
    assert pose_map.residual_um == pytest.approx(8.0, rel=0.35)
    near, far = (pose_map.correction(pixel, TIP_PX, 0.0, 0.0).sigma_um for pixel in ((433.0, 629.0), (470.0, 640.0)))
    assert near < 1.0 < far < 8.0
    seen = pose_map.correction((433.0, 629.0), TIP_PX, 0.0, 0.15).sigma_um
    assert seen == pytest.approx(0.15 * 12.0 * math.sqrt(1.0 + 1 / math.cos(math.radians(30.0)) ** 2), rel=0.15)


def test_the_covariance_turns_with_the_head() -> None:
    pose_map = _camera_map(_camera_sightings(np.random.default_rng(12), stop_um=5.66))
    straight, turned = (pose_map.correction((470.0, 640.0), TIP_PX, theta).covariance for theta in (0.0, 70.0))
    assert turned == pytest.approx(rotation(70.0) @ straight @ rotation(-70.0))


def test_sightings_at_several_angles_make_one_map_whatever_the_run_out() -> None:
    rng = np.random.default_rng(13)
    pose_map = _camera_map(_camera_sightings(rng, angles=(10.0, 150.0, 330.0), n=6))
    places = np.array([(300.0, 0.0), (-200.0, 350.0)])
    assert pose_map.from_tip_um(_camera_px(places, 250.0), TIP_PX, 250.0) == pytest.approx(places, abs=0.05)
    assert pose_map.residual_um < 0.01
    # Six pairs at each of three angles know less than eighteen at one: two further shifts had to be found.
    several, one = (
        np.mean([_camera_map(_camera_sightings(rng, angles=a, n=n, stop_um=5.66)).correction(
            (470.0, 640.0), TIP_PX, 0.0, 0.0).covariance for _ in range(20)], axis=0)
        for a, n in (((10.0, 150.0, 330.0), 6), ((10.0,), 18))
    )  # fmt: skip
    assert 0.5 < np.trace(several) / np.trace(one) < 3.0


def test_a_flipped_picture_is_told_and_not_refused() -> None:
    straight = _camera_sightings(np.random.default_rng(14))
    flipped = [MapPoint((1599.0 - s.target_px[0], s.target_px[1]), s.x_um, s.y_um, s.theta_deg) for s in straight]
    assert not _camera_map(straight).mirrored
    assert _camera_map(flipped).mirrored
    turned = [MapPoint((1599.0 - s.target_px[0], 1199.0 - s.target_px[1]), s.x_um, s.y_um, 0.0) for s in straight]
    assert not _camera_map(turned).mirrored


def test_a_good_map_leaves_a_small_share_and_one_half_made_of_chance_leaves_half_and_more() -> None:
    rng = np.random.default_rng(15)
    given = {"tip_px": TIP_PX, "below_tip_px": _below_px(0.0), "work_z_um": 5200.0, "hover_um": HOVER_UM}
    assert worst_shrink(_camera_sightings(rng), **given) < 1e-4
    assert 0.005 < worst_shrink(_camera_sightings(rng, stop_um=5.66, px=0.15), **given) < 0.15
    chance = _camera_sightings(rng, px=18.0)
    assert worst_shrink(chance, **given) > 0.5
    near = [MapPoint((428.0 + k % 3, 620.0 + k // 3), 10.0 * (k % 3), -10.0 * (k // 3), 0.0) for k in range(9)]
    with pytest.raises(ValueError, match="farther"):
        worst_shrink(near, **given)


def test_a_single_bad_sighting_among_many_is_left_out_of_the_shares() -> None:
    sightings = _camera_sightings(np.random.default_rng(16), stop_um=5.66)
    bad = sightings[3]
    sightings[3] = MapPoint((bad.target_px[0] + 30.0, bad.target_px[1]), bad.x_um, bad.y_um, bad.theta_deg)
    given = {"tip_px": TIP_PX, "below_tip_px": _below_px(0.0), "work_z_um": 5200.0, "hover_um": HOVER_UM}
    assert worst_shrink(sightings, **given) < 0.15
    assert _camera_map(sightings).residual_um < 15.0


def test_a_map_of_an_older_file_and_one_out_of_bounds_are_refused() -> None:
    raw = json.loads(_fit(_sightings(np.random.default_rng(7))).to_json())
    assert PoseMap.from_json(json.dumps(raw)).hover_um == 200.0
    spoiled: list[dict[str, object]] = [
        {"format": "reprobe-posemap-1"},
        {"hover_um": 0.0},
        {"hover_um": None},
        {"hover_um": 10**400},
        {"radius_um": math.nan},
        {"below_tip_px": [1.0]},
        {"homography": [[1.0, 2.0], [3.0, 4.0]]},
        {"covariance": [[0.0] * 8] * 7},
        {"covariance": [[-1.0] * 8] * 8},
        {"below_sigma_px": -0.1},
    ]
    for change in spoiled:
        with pytest.raises(ValueError, match="calibrate the map again"):
            PoseMap.from_json(json.dumps(raw | change))
    with pytest.raises(ValueError, match="hover"):
        fit_pose_map(_sightings(np.random.default_rng(7)), **(GIVEN | {"hover_um": -5.0}))
    for text in ("[]", "3", "null", '"x"'):
        with pytest.raises(ValueError, match="calibrate the map again"):
            PoseMap.from_json(text)


def test_the_covariance_survives_the_file() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(2), noise_px=0.1), below_sigma_px=0.3)
    again = PoseMap.from_json(pose_map.to_json())
    assert np.array_equal(again.covariance, pose_map.covariance)
    assert (again.below_sigma_px, again.hover_um) == (0.3, 200.0)


def test_sightings_that_contradict_each_other_put_no_horizon_into_the_picture() -> None:
    """A plane cannot be seen from both sides at once: such a fit is refused or leaves a residual no one accepts."""
    rng = np.random.default_rng(17)
    for _ in range(20):
        wild = [
            MapPoint(tuple(rng.uniform(300, 600, 2)), *(float(v) for v in rng.uniform(-700, 700, 2)), 0.0)
            for _ in range(9)
        ]
        try:
            pose_map = _fit(wild)
        except ValueError:
            continue
        assert pose_map.residual_um > 50.0


def test_a_map_that_hangs_on_each_of_its_sightings_leaves_everything() -> None:
    given = {"tip_px": TIP_PX, "below_tip_px": _below_px(0.0), "work_z_um": 5200.0, "hover_um": HOVER_UM}
    six = _camera_sightings(np.random.default_rng(18), n=6)
    assert fit_pose_map(six, **given).residual_um < 0.01
    assert worst_shrink(six, **given) == math.inf


def test_a_sighting_alone_at_its_angle_neither_helps_nor_harms() -> None:
    rng = np.random.default_rng(19)
    one, lone = _camera_sightings(rng, stop_um=5.66), _camera_sightings(rng, angles=(200.0,), n=1, stop_um=5.66)
    given = {"tip_px": TIP_PX, "below_tip_px": _below_px(0.0), "work_z_um": 5200.0, "hover_um": HOVER_UM}
    with_it, without = fit_pose_map([*one, *lone], **given), fit_pose_map(one, **given)
    pixel = (470.0, 640.0)
    assert with_it.from_tip_um(pixel, TIP_PX, 5.0) == pytest.approx(without.from_tip_um(pixel, TIP_PX, 5.0), abs=0.01)
    assert worst_shrink([*one, *lone], **given) == pytest.approx(worst_shrink(one, **given), rel=0.01)
