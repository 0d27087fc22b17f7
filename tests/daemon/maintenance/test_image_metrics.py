"""Brightness is measured on the needle and follows the lamp, not the board; a needle that ends short is seen."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.maintenance.image_metrics import end_offset_px, measure_pictures
from tests.vision.scene import Camera, Needle, red_frame, white_frame
from vision import ProbeModel, Tip, find_tip

SEEDS = range(4)


@pytest.fixture(scope="module")
def model() -> ProbeModel:
    return ProbeModel.teach(white_frame(Needle(), Camera(), seed=0, clutter=0.0), (428.0, 620.0))


def _tip(frame: np.ndarray, model: ProbeModel) -> Tip:
    tip = find_tip(frame, model)
    assert isinstance(tip, Tip)
    return tip


def test_brightness_follows_the_lamp_and_hardly_the_board(model: ProbeModel) -> None:
    levels = []
    for seed in SEEDS:
        frame = white_frame(Needle(), Camera(), seed=seed, clutter=1.0)
        tip = _tip(frame, model)
        levels.append(measure_pictures(frame, None, tip, model)["light_white"])
        dimmed = np.asarray(frame * 0.9, np.uint8)
        assert measure_pictures(dimmed, None, tip, model)["light_white"] == pytest.approx(0.9 * levels[-1], rel=0.01)
    assert np.std(levels) < 0.02 * np.mean(levels)


def test_noise_is_measured_in_levels(model: ProbeModel) -> None:
    quiet, loud = (white_frame(Needle(), replace(Camera(), noise=n), seed=1, clutter=0.0) for n in (1.0, 4.0))
    numbers = [measure_pictures(f, None, _tip(f, model), model)["noise"] for f in (quiet, loud)]
    assert numbers[1] > 2.0 * numbers[0]


def test_the_red_ring_is_measured_on_the_same_needle(model: ProbeModel) -> None:
    white = white_frame(Needle(), Camera(), seed=1)
    red = red_frame((), Needle(), Camera(), seed=1)
    numbers = measure_pictures(white, red, _tip(white, model), model)
    assert 0.0 < numbers["light_red"] < 255.0


@pytest.mark.parametrize("short_px", [0, 8, 14])
def test_where_the_needle_ends_is_seen_itself_before_a_dark_ground(model: ProbeModel, short_px: int) -> None:
    seen = []
    for seed in SEEDS:
        frame = white_frame(Needle(), Camera(), seed=seed, clutter=0.0).copy()
        tip = _tip(frame, model)
        if short_px:  # worn off: ground where the end was
            _wear(frame, tip, short_px)
        offset = end_offset_px(frame, tip, model)
        if offset is not None:
            seen.append(offset)
    assert len(seen) >= 3
    assert np.median(seen) == pytest.approx(-short_px, abs=4.0)


def _wear(frame: np.ndarray, tip: Tip, short_px: int) -> None:
    """Paint the ground's level over the last pixels of the needle."""
    ground = np.median(frame[int(tip.y_px) + 10 : int(tip.y_px) + 30, int(tip.x_px) : int(tip.x_px) + 20], axis=(0, 1))
    ys, xs = np.mgrid[0 : frame.shape[0], 0 : frame.shape[1]]
    along = (xs - tip.x_px) * np.cos(tip.angle_rad) + (ys - tip.y_px) * np.sin(tip.angle_rad)
    near = np.hypot(xs - tip.x_px, ys - tip.y_px) < short_px + 25
    frame[near & (along > -short_px)] = ground


def test_pictures_too_small_for_the_needle_give_no_numbers(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), seed=1, clutter=0.0)
    tip = _tip(frame, model)
    assert measure_pictures(frame[:20, :20].copy(), None, tip, model) == {}
