"""A map simple enough to reckon by hand: what it answers to the last digit, and what is no map."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vision.geometry.frames import rotation
from vision.geometry.pose_map import LEAST_DISTANCE_UM, MapPoint, PoseMap, fit_pose_map, worst_shrink

TIP_PX = (400.0, 600.0)
# 12 um a pixel to the right, 15 um a pixel downwards, y up in the head frame; no perspective
PLAIN = np.array([[12.0, 0.0, 0.0], [0.0, -15.0, 0.0], [0.0, 0.0, 1.0]])
MAP = PoseMap(
    homography=PLAIN,
    covariance=np.zeros((8, 8)),
    below_tip_px=(2.0, 8.0),
    below_sigma_px=0.0,
    hover_um=200.0,
    radius_um=700.0,
    residual_um=0.0,
    work_z_um=5200.0,
)
GIVEN: dict[str, Any] = {"tip_px": TIP_PX, "below_tip_px": (2.0, 8.0), "work_z_um": 5200.0, "hover_um": 200.0}


@pytest.mark.parametrize(
    "change",
    [
        {"homography": np.eye(2)},
        {"homography": PLAIN * math.nan},
        {"covariance": np.zeros((7, 8))},
        {"covariance": np.full((8, 8), math.inf)},
        {"covariance": np.diag([1.0] * 7 + [-1.0])},
        {"covariance": np.triu(np.ones((8, 8)))},
        {"below_tip_px": (math.nan, 8.0)},
        {"below_tip_px": (2.0, math.inf)},
        {"below_sigma_px": math.nan},
        {"below_sigma_px": -1e-9},
        {"hover_um": math.inf},
        {"hover_um": 0.0},
        {"hover_um": -1.0},
        {"radius_um": math.inf},
        {"radius_um": 0.0},
        {"residual_um": math.nan},
        {"residual_um": -1e-9},
        {"work_z_um": math.nan},
    ],
    ids="-".join,
)
def test_what_is_no_map_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"not|negative|must"):
        replace(MAP, **change)


def test_a_low_hover_and_a_small_region_make_a_map_all_the_same() -> None:
    low = replace(MAP, hover_um=0.5, radius_um=0.5, work_z_um=-1.0)
    assert (low.hover_um, low.radius_um) == (0.5, 0.5)


def test_the_place_below_the_tip_moves_towards_it_as_the_surface_rises() -> None:
    assert MAP.below_px() == MAP.below_px(0.0) == (2.0, 8.0)
    assert MAP.below_px(50.0) == (1.5, 6.0)
    assert MAP.below_px(-100.0) == (3.0, 12.0)


def test_a_place_lies_as_far_from_below_the_tip_as_its_pixels_say() -> None:
    # 30 px right of and 20 px above the place below the tip
    pixel = (432.0, 588.0)
    assert MAP.from_tip_um(pixel, TIP_PX, 0.0) == pytest.approx((360.0, 300.0))
    assert MAP.from_tip_um([pixel], TIP_PX, 90.0) == pytest.approx(np.array([(-300.0, 360.0)]))
    assert MAP.from_tip_um(pixel, TIP_PX, 0.0, height_um=50.0) == pytest.approx((366.0, 270.0))
    assert MAP.to_head_um(pixel) == pytest.approx((5184.0, -8820.0))
    assert MAP.to_head_um([pixel]).shape == (1, 2)


@pytest.mark.parametrize("theta_deg", [0.0, 90.0])
def test_the_way_back_is_exact_with_and_without_a_height(theta_deg: float) -> None:
    place = rotation(theta_deg) @ (360.0, 300.0)
    assert MAP.to_px(place, TIP_PX, theta_deg) == pytest.approx(np.array([(432.0, 588.0)]))
    assert MAP.to_px(place, TIP_PX, theta_deg, height_um=50.0) == pytest.approx(np.array([(431.5, 586.0)]))


def test_the_scale_is_that_of_the_direction_in_which_most_pixels_go() -> None:
    assert MAP.scale_px_per_um(TIP_PX) == pytest.approx(1 / 12.0, rel=1e-9)
    upright = replace(MAP, homography=np.diag([15.0, -12.0, 1.0]))
    assert upright.scale_px_per_um(TIP_PX) == pytest.approx(1 / 12.0, rel=1e-9)


def test_the_scale_is_taken_where_the_tip_is_and_at_the_height_of_the_surface() -> None:
    """With perspective, it changes along the picture: here by a thousandth a pixel downwards."""
    deep = replace(
        MAP, below_tip_px=(0.0, 8.0), homography=np.array([[12.0, 0.0, 0.0], [0.0, -12.0, 0.0], [0.0, -1e-3, 1.0]])
    )

    def scale(tip_y_px: float, **height: float) -> float:
        return deep.scale_px_per_um((0.0, tip_y_px), **height)

    assert scale(0.0) == pytest.approx(scale(0.0, height_um=0.0), rel=1e-12)
    # Half the hover up the place below the tip is 4 px higher in the picture
    assert scale(4.0, height_um=0.0) == pytest.approx(scale(8.0, height_um=100.0), rel=1e-12)
    assert scale(0.0) != pytest.approx(scale(8.0), rel=1e-3)


@pytest.mark.parametrize("height_um", [0.0, 50.0, -100.0])
def test_what_is_seen_and_what_is_below_the_tip_add_up_in_the_covariance(height_um: float) -> None:
    seen = MAP.correction((432.0, 588.0), TIP_PX, 0.0, 0.3, height_um=height_um).covariance
    assert seen == pytest.approx(np.diag([(12.0 * 0.3) ** 2, (15.0 * 0.3) ** 2]))
    loose = replace(MAP, below_sigma_px=0.4)
    below = loose.correction((432.0, 588.0), TIP_PX, 0.0, 0.0, height_um=height_um).covariance
    share = 1.0 - height_um / 200.0
    assert below == pytest.approx(np.diag([(12.0 * 0.4 * share) ** 2, (15.0 * 0.4 * share) ** 2]))
    both = loose.correction((432.0, 588.0), TIP_PX, 0.0, 0.3, height_um=height_um).covariance
    assert both == pytest.approx(seen + below)


def test_the_map_s_own_doubt_is_that_of_the_difference() -> None:
    """The third element of a row shifts both ends alike and costs nothing; the first turns with the distance."""
    for element, expected in ((2, 0.0), (0, (30.0 * 0.1) ** 2)):
        doubt = np.zeros((8, 8))
        doubt[element, element] = 0.01
        found = replace(MAP, covariance=doubt).correction((432.0, 588.0), TIP_PX, 0.0, 0.0).covariance
        assert found == pytest.approx(np.diag([expected, 0.0]))


def test_a_tenth_of_a_pixel_and_the_nominal_plane_are_taken_where_nothing_is_told() -> None:
    doubtful = replace(MAP, below_sigma_px=0.4)
    told = doubtful.correction((432.0, 588.0), TIP_PX, 0.0, 0.1, height_um=0.0)
    silent = doubtful.correction((432.0, 588.0), TIP_PX, 0.0)
    assert (silent.dx_um, silent.dy_um) == (told.dx_um, told.dy_um) == pytest.approx((360.0, 300.0))
    assert np.array_equal(silent.covariance, told.covariance)


def test_an_almost_straight_view_still_shows_height() -> None:
    steep = replace(MAP, below_tip_px=(0.3, -0.4))
    assert steep.height_from_shift_um((0.3, -0.4)) == pytest.approx(-200.0)
    assert steep.height_from_shift_um((-0.6, 0.8)) == pytest.approx(400.0)
    assert steep.height_from_shift_um((0.4, 0.3)) == pytest.approx(0.0)
    steepest = replace(MAP, below_tip_px=(1e-3, 0.0))
    assert steepest.height_from_shift_um((1e-3, 0.0)) == pytest.approx(-200.0)
    with pytest.raises(ValueError, match="straight down"):
        replace(MAP, below_tip_px=(0.9e-3, 0.0)).height_from_shift_um((1e-3, 0.0))


def test_a_map_that_turns_no_hand_is_told_by_its_sign_however_fine_its_pixels() -> None:
    assert not MAP.mirrored
    assert not replace(MAP, homography=np.diag([0.5, -0.5, 1.0])).mirrored
    assert replace(MAP, homography=np.diag([0.5, 0.5, 1.0])).mirrored


def _sightings(n: int = 12, theta_deg: float = 0.0, reach_um: float = 600.0, wrong_um: float = 0.0) -> list[MapPoint]:
    """Return what MAP sees of a place from a ring of heads; `wrong_um`: how far off the first one stopped."""
    found = []
    for k in range(n):
        away = rotation(360.0 * k / n) @ (reach_um * (1.0 if k % 2 else 0.7), 0.0)
        px = MAP.to_px(-away, TIP_PX, theta_deg)[0]
        off = wrong_um if k == 0 else 0.0
        found.append(
            MapPoint((float(px[0]), float(px[1])), 3e4 + float(away[0]) + off, 4e4 + float(away[1]), theta_deg)
        )
    return found


@pytest.mark.parametrize("theta_deg", [0.0, 130.0])
def test_a_fit_tells_how_far_it_reaches_from_below_the_tip(theta_deg: float) -> None:
    found = fit_pose_map(_sightings(theta_deg=theta_deg)[:9], **GIVEN)  # not evenly round the tip
    assert found.radius_um == pytest.approx(600.0)
    assert found.from_tip_um((432.0, 588.0), TIP_PX, 0.0) == pytest.approx((360.0, 300.0))
    assert (found.below_tip_px, found.below_sigma_px) == ((2.0, 8.0), 0.0)
    assert (found.hover_um, found.work_z_um) == (200.0, 5200.0)
    assert found.residual_um == pytest.approx(0.0, abs=1e-6)


def test_no_sightings_and_one_that_is_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="at least"):
        fit_pose_map([], **GIVEN)
    first, *others = _sightings()
    for name in ("x_um", "y_um", "theta_deg"):
        with pytest.raises(ValueError, match="a sighting is not finite"):
            fit_pose_map([replace(first, **{name: math.inf}), *others], **GIVEN)
    with pytest.raises(ValueError, match="a sighting is not finite"):
        fit_pose_map([replace(first, target_px=(math.nan, 1.0)), *others], **GIVEN)


def test_a_stop_that_was_off_leaves_its_share_of_the_way() -> None:
    """Twelve sightings, one of which stopped 12 um off on a way of 420 um: the others' map leaves that error of it."""
    assert worst_shrink(_sightings(), **GIVEN) < 1e-9
    sightings = _sightings(wrong_um=12.0)
    assert worst_shrink(sightings, **GIVEN) == pytest.approx(12.0 / 432.0, rel=0.02)


def test_only_sightings_farther_from_the_tip_than_the_scatter_of_stops_are_asked() -> None:
    far = _sightings(reach_um=1.5 * LEAST_DISTANCE_UM)  # every other one at 1.05 times it
    assert worst_shrink(far, **GIVEN) < 1e-9
    with pytest.raises(ValueError, match="farther than 100 um"):
        worst_shrink(_sightings(reach_um=0.9 * LEAST_DISTANCE_UM), **GIVEN)
