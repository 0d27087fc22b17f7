"""The studio's needle: what is drawn ends, leans and is painted where its truth says, measured from the drawing."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.vision.studio.lens import develop
from tests.vision.studio.needle import DEFECTS, NOMINAL_ANGLE_DEG, NOMINAL_TIP_PX, golden, white_scene
from tests.vision.studio.needle_body import Array, Body, cast
from tests.vision.studio.needle_kit import KITS
from tests.vision.studio.needle_paint import shade

ALL_KITS = range(len(KITS))
END_PX = (431.37, 617.81)


def _direction(angle_deg: float) -> tuple[Array, Array]:
    angle = np.radians(angle_deg)
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


def _coverage(body: Body) -> Array:
    picture = np.zeros((1200, 1600))
    for hits in cast(body):
        picture[hits.rows, hits.cols] = hits.met.mean(axis=1)
    return picture


def _sample(picture: Array, places: Array) -> Array:
    x, y = (places[..., i].astype(np.float32) for i in (0, 1))
    # cv2 rounds bilinear weights to 1/32; the four corners by hand do not.
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - x0, y - y0
    upper = picture[y0, x0] * (1 - fx) + picture[y0, x0 + 1] * fx
    lower = picture[y0 + 1, x0] * (1 - fx) + picture[y0 + 1, x0 + 1] * fx
    return np.asarray(upper * (1 - fy) + lower * fy)


@pytest.mark.parametrize("kit", ALL_KITS)
@pytest.mark.parametrize("angle_deg", [59.9, 62.8, 65.7])
def test_the_last_ray_to_meet_the_needle_on_its_axis_is_the_true_end(kit: int, angle_deg: float) -> None:
    """1/40 px rays over the end: the outermost one met in a hairline along the axis lies within 0.05 px of truth."""
    body = KITS[kit].body(END_PX, angle_deg)
    last = body.seen_end_px()
    along, across = _direction(angle_deg)
    count = 40
    step = (np.arange(count) + 0.5) / count - 0.5
    close = cast(body, fine_px=6.0, fine_rays=count)[0]
    x = close.cols[:, None] + np.tile(step, count)
    y = close.rows[:, None] + np.repeat(step, count)
    u = (x - last[0]) * across[0] + (y - last[1]) * across[1]
    t = (x - last[0]) * along[0] + (y - last[1]) * along[1]
    assert t[close.met & (np.abs(u) < 0.03)].max() == pytest.approx(0.0, abs=0.05)


def _seen_through_window(picture: Array, centre: Array) -> float:
    """Return the covered area under a round soft window (6 px), which depends smoothly on where it is put."""
    x0, y0 = (int(v) - 40 for v in centre)
    y, x = np.mgrid[y0 : y0 + 81, x0 : x0 + 81]
    window = np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / 72.0)
    return float((window * picture[y0 : y0 + 81, x0 : x0 + 81]).sum())


@pytest.mark.parametrize("kit", ALL_KITS)
def test_the_drawn_end_moves_exactly_as_its_truth(kit: int) -> None:
    """A window that moves with the truth sees the same area at every sub-pixel place, to 0.05 px along the axis."""
    along, _ = _direction(62.8)
    seen = []
    for shift in ((0.0, 0.0), (0.31, 0.0), (0.5, 0.5), (-0.2, 0.73)):
        body = KITS[kit].body((END_PX[0] + shift[0], END_PX[1] + shift[1]), 62.8)
        picture, end = _coverage(body), body.seen_end_px()
        per_px = _seen_through_window(picture, end - along) - _seen_through_window(picture, end)
        seen.append(_seen_through_window(picture, end) / per_px)
    assert np.ptp(seen) < 0.05


@pytest.mark.parametrize("kit", ALL_KITS)
def test_the_needle_is_symmetric_about_the_true_axis(kit: int) -> None:
    """The centroid across the axis of each 8 px of its length lies on it within 0.05 px, from end to marking."""
    body = KITS[kit].body(END_PX, 64.0)
    along, across = _direction(64.0)
    t, u = np.meshgrid(np.arange(2.0, 162.0, 0.5), np.arange(-40.0, 40.05, 0.1), indexing="ij")
    covered = _sample(_coverage(body), body.seen_end_px() - t[..., None] * along + u[..., None] * across)
    pieces = covered.reshape(20, 16, -1).sum(axis=1)
    centroid = (pieces * u[0]).sum(axis=1) / pieces.sum(axis=1)
    assert np.abs(centroid).max() < 0.05


@pytest.mark.parametrize("kit", ALL_KITS)
def test_the_markings_rims_are_drawn_at_their_distance_above_the_end(kit: int) -> None:
    """With straight rims, half of the step to black lies at the kit's distances, on the line seen as the axis."""
    needle = replace(KITS[kit], ragged_px=0.0)
    body = needle.body(END_PX, 62.0)
    picture, bare = np.zeros((1200, 1600)), np.zeros((1200, 1600))
    for hits in cast(body):
        picture[hits.rows, hits.cols] = shade(hits, needle.metal, needle.marking(body)).mean(axis=1)
        bare[hits.rows, hits.cols] = shade(hits, needle.metal, None).mean(axis=1)
    along, _ = _direction(62.0)
    t = np.arange(needle.rim_px - 20.0, needle.rim_px + needle.band_px + 20.0, 0.05)
    places = body.seen_end_px() - t[:, None] * along
    dark = 1.0 - _sample(picture, places) / _sample(bare, places)
    inside = t[dark > dark.max() / 2]
    assert inside[0] == pytest.approx(needle.rim_px, abs=0.15)
    assert inside[-1] == pytest.approx(needle.rim_px + needle.band_px, abs=0.15)


@pytest.mark.parametrize("kit", ALL_KITS)
def test_golden_stands_at_the_nominal_place_before_a_dark_ground(kit: int) -> None:
    scene = golden(kit=kit)
    assert scene.frame.shape == (1200, 1600, 3)
    assert scene.frame.dtype == np.uint8
    assert scene.tip_px is not None
    assert np.hypot(*np.subtract(scene.tip_px, NOMINAL_TIP_PX)) < 4.0
    assert scene.angle_deg == pytest.approx(NOMINAL_ANGLE_DEG, abs=0.01)
    assert scene.frame[700:, 800:].mean() < 40


@pytest.mark.parametrize("hard", [False, True])
def test_good_scenes_stay_within_their_bounds_and_repeat(hard: bool) -> None:
    for seed in range(4):
        scene = white_scene(seed, hard=hard, kit=seed % len(KITS))
        assert scene.what == "good"
        assert scene.tip_px is not None
        assert np.abs(np.subtract(scene.tip_px, NOMINAL_TIP_PX)).max() < 15.0 + 4.0
        assert abs(scene.angle_deg - NOMINAL_ANGLE_DEG) <= 3.01
    again = white_scene(3, hard=hard, kit=3 % len(KITS))
    assert np.array_equal(scene.frame, again.frame)


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_defect_is_named_and_changes_the_frame(defect: str) -> None:
    scene, good = white_scene(5, defect=defect), white_scene(5)
    assert scene.what == defect
    assert cv2.absdiff(scene.frame, good.frame)[300:700, 200:500].mean() > 1.0
    assert (scene.tip_px is None) == (defect == "no_needle")


def test_defects_are_as_large_as_promised() -> None:
    for seed in range(2):
        good = white_scene(seed)
        assert abs(white_scene(seed, defect="turned").angle_deg - NOMINAL_ANGLE_DEG) > 6.99
        assert abs(white_scene(seed, defect="bent").angle_deg - good.angle_deg) > 4.9
        x, y = white_scene(seed, defect="out_of_frame").tip_px or (0.0, 0.0)
        assert not (0 <= x <= 1599 and 0 <= y <= 1199)


@pytest.mark.parametrize("seed", range(2))
def test_a_worn_marking_keeps_less_than_a_quarter_of_its_contrast(seed: int) -> None:
    good, worn, bare = (white_scene(seed, defect=d).frame.astype(float) for d in (None, "worn_marking", "no_marking"))
    band = (bare - good).mean(axis=2) > 40
    assert band.sum() > 800
    assert (bare - worn).mean(axis=2)[band].mean() < 0.25 * (bare - good).mean(axis=2)[band].mean()


def test_unknown_defects_are_refused() -> None:
    with pytest.raises(ValueError, match="no_needle"):
        white_scene(0, defect="rusty")


def test_the_lens_keeps_its_promises_on_light_noise_and_spikes() -> None:
    rng = np.random.default_rng(1)
    grey = np.full((400, 500), 80.0, np.float32)
    noisy = develop(grey, gain=1.25, blur_px=1.0, noise=5.0, spikes=0.0, rng=rng)
    assert noisy[..., 1].mean() == pytest.approx(100.0, abs=0.2)
    assert noisy[..., 1].std() == pytest.approx(5.0, abs=0.1)
    spiked = develop(grey, gain=1.0, blur_px=0.0, noise=0.0, spikes=0.01, rng=rng)
    assert np.isin(spiked[..., 1], (0, 255)).mean() == pytest.approx(0.01, abs=0.002)
    dim = develop(grey, gain=1.0, blur_px=0.0, noise=0.0, spikes=0.0, rng=rng, falloff=0.5, colour="red")
    assert dim[0, 0, 2] == pytest.approx(40, abs=1)
    assert dim[200, 250, 2] == pytest.approx(80, abs=1)
    assert dim[..., 0].max() < 10
    with pytest.raises(ValueError, match="float32"):
        develop(grey.astype(np.uint8), gain=1.0, blur_px=0.0, noise=0.0, spikes=0.0, rng=rng)
