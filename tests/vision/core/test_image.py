import numpy as np
import pytest

from vision.core.image import check_bgr, check_exposure, check_point, despike, gray, highlight, intensity, red_signal
from vision.core.not_found import NotFound, Reason


def test_highlight_computes_the_worked_example_of_figure_5_9() -> None:
    picture = np.array([[85, 82, 96], [118, 108, 120], [128, 131, 96]], dtype=np.uint8)
    expected = (10 * 108 - (85 + 82 + 96 + 118 + 120 + 128 + 131 + 96)) / 2
    assert highlight(picture)[1, 1] == expected == 112


def test_intensity_is_the_mean_of_the_three_channels() -> None:
    picture = np.zeros((4, 5, 3), dtype=np.uint8)
    picture[:] = (30, 60, 210)
    assert np.all(intensity(picture) == 100)
    assert gray(picture).shape == (4, 5)


def test_under_red_light_the_red_channel_alone_is_the_signal() -> None:
    picture = np.zeros((4, 5, 3), dtype=np.uint8)
    picture[:] = (4, 4, 180)
    assert np.all(red_signal(picture) == 180)
    picture[:] = (100, 130, 130)
    assert np.all(red_signal(picture) == 120)


def test_despike_removes_salt_and_pepper_and_touches_nothing_else() -> None:
    rng = np.random.default_rng(3)
    clean = np.clip(rng.normal(100, 5, (60, 60)), 0, 255).astype(np.uint8)
    dirty = clean.copy()
    spots = [(10, 10), (20, 31), (44, 7)]
    for row, column in spots:
        dirty[row, column] = 255 if row % 20 else 0
    repaired = despike(dirty)
    changed = np.argwhere(repaired != dirty)
    assert {tuple(spot) for spot in changed.tolist()} == set(spots)


def test_exposure_names_dark_and_saturated_pictures() -> None:
    assert check_exposure(np.full((30, 30), 100, np.uint8), 60, 90, 0.2) is None
    dark = check_exposure(np.full((30, 30), 10, np.uint8), 60, 90, 0.2)
    assert isinstance(dark, NotFound)
    assert dark.reason is Reason.TOO_DARK
    bright = check_exposure(np.full((30, 30), 255, np.uint8), 60, 90, 0.2)
    assert isinstance(bright, NotFound)
    assert bright.reason is Reason.SATURATED
    assert not bright


@pytest.mark.parametrize(
    "bad",
    [
        None,
        [[1, 2, 3]],
        np.zeros((10, 10), np.uint8),
        np.zeros((10, 10, 4), np.uint8),
        np.zeros((10, 10, 3), np.float32),
        np.zeros((0, 10, 3), np.uint8),
        np.zeros((10, 0, 3), np.uint8),
    ],
)
def test_a_picture_of_another_shape_or_type_is_a_value_error(bad: object) -> None:
    with pytest.raises(ValueError, match="expected"):
        check_bgr(bad)


@pytest.mark.parametrize("bad", [(np.nan, 3.0), (np.inf, 1.0), (1.0,), "ab", None, 5.0, (1, 2, 3)])
def test_a_point_that_is_not_two_finite_numbers_is_a_value_error(bad: object) -> None:
    with pytest.raises(ValueError, match="tip_px"):
        check_point(bad, "tip_px")
