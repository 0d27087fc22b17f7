"""Focus, exposure, contrast and noise move with their cause and with nothing else."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tests.vision.scene import Camera, Needle, white_frame
from vision.core.image_quality import ImageQuality, measure_quality

CALM = settings(max_examples=60, deadline=None, derandomize=True)
BLURS_PX = (0.3, 0.6, 1.0, 1.3, 1.6, 2.0, 3.0, 4.0, 6.0)
WIDTH, HEIGHT, FINER = 400, 300, 4


def _step() -> np.ndarray:
    """One straight step, 17 degrees oblique, drawn four times finer than the picture."""
    ys, xs = np.mgrid[0 : HEIGHT * FINER, 0 : WIDTH * FINER].astype(np.float32)
    across = (xs - WIDTH * FINER / 2) * np.float32(0.9563) + (ys - HEIGHT * FINER / 2) * np.float32(0.2924)
    return np.where(across > 0, np.float32(180), np.float32(60))


def _board() -> np.ndarray:
    """Discs and rectangles of many sizes and levels."""
    rng = np.random.default_rng(0)
    level = np.full((HEIGHT * FINER, WIDTH * FINER), 70, np.float32)
    for _ in range(25):
        x, y = (int(v) for v in rng.integers(0, (WIDTH * FINER, HEIGHT * FINER)))
        if rng.random() < 0.5:
            cv2.circle(level, (x, y), int(rng.integers(30, 100)), float(rng.uniform(30, 200)), -1)
        else:
            w, h = (int(v) for v in rng.integers(30, 400, 2))
            cv2.rectangle(level, (x, y), (x + w, y + h), float(rng.uniform(30, 200)), -1)
    return level


def _frame(level: np.ndarray, blur_px: float = 1.0, gain: float = 1.0, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    fine = cv2.GaussianBlur(level, (0, 0), blur_px * FINER)
    plane = cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)[..., None] * gain
    noisy = plane + np.random.default_rng(seed).normal(0, 1, (HEIGHT, WIDTH, 3)) * noise
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gain", [1.0, 0.4])
@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_the_blur_of_a_straight_step_is_measured_as_it_is(gain: float, noise: float) -> None:
    step = _step()
    for blur_px in BLURS_PX:
        # The pixel's own width adds 1 / sqrt(12) px.
        expected = float(np.hypot(blur_px, 12**-0.5))
        # Six px of blur under the dim and noisy light leave slopes of 3 levels per px in noise of 2.
        within = 0.05 if blur_px <= 4.0 else 0.1
        measured = measure_quality(_frame(step, blur_px, gain, noise)).blur_px
        assert measured == pytest.approx(expected, rel=within, abs=0.03)


def test_focus_falls_with_every_step_of_blur_and_hardly_with_gain_or_noise() -> None:
    board = _board()
    clean = [measure_quality(_frame(board, blur_px)).focus_per_px for blur_px in BLURS_PX]
    falls = -np.diff(clean) / np.array(clean[:-1])
    assert (falls > 0.02).all()
    for gain, noise in ((0.5, 0.0), (1.2, 0.0), (1.0, 4.0), (0.5, 3.0)):
        other = [measure_quality(_frame(board, blur_px, gain, noise)).focus_per_px for blur_px in BLURS_PX]
        assert (np.diff(other) < 0).all()
        assert other == pytest.approx(clean, rel=0.02)


def test_focus_falls_on_the_station_s_own_frames() -> None:
    found = [
        measure_quality(white_frame(Needle(), Camera(blur_px=blur, noise=noise, gain=gain), seed=1)).focus_per_px
        for blur in (0.8, 1.2, 1.8, 2.6)
        for noise, gain in ((1.0, 1.0), (5.0, 0.8))
    ]
    groups = np.array(found).reshape(-1, 2)
    assert (groups.min(axis=1)[:-1] > groups.max(axis=1)[1:]).all()


@pytest.mark.parametrize("noise", [0.5, 1.0, 2.0, 5.0, 10.0])
def test_noise_is_measured_over_detail_as_over_nothing(noise: float) -> None:
    """Gray noise of sigma, with the 1/12 that rounding to levels adds, whatever is in the picture."""
    expected = float(np.hypot(noise, 12**-0.5))
    for level in (np.full((HEIGHT * FINER, WIDTH * FINER), 120, np.float32), _board()):
        gray = _frame(level)[..., :1] + np.random.default_rng(2).normal(0, noise, (HEIGHT, WIDTH, 1))
        frame = np.repeat(np.clip(np.round(gray), 0, 255).astype(np.uint8), 3, axis=2)
        assert measure_quality(frame).noise_levels == pytest.approx(expected, rel=0.06, abs=0.05)


def test_a_few_spikes_are_not_noise() -> None:
    frame = _frame(_board(), noise=2.0)
    dirty = frame.copy()
    dirty[np.random.default_rng(3).random(frame.shape[:2]) < 0.005] = 235
    assert measure_quality(dirty).noise_levels == pytest.approx(measure_quality(frame).noise_levels, rel=0.12)


def test_exposure_tells_the_share_of_black_and_of_clipped_pixels() -> None:
    frame = np.full((100, 200, 3), 120, np.uint8)
    frame[:, :50] = 3
    frame[:, 180:] = 255
    frame[:10, 60:80, 2] = 252  # one channel clipped is information lost
    quality = measure_quality(frame)
    assert quality.under_share == 0.25
    assert quality.over_share == pytest.approx(0.1 + 0.01)
    assert (quality.dark_level, quality.middle_level, quality.bright_level) == (3, 120, 255)
    assert quality.contrast == pytest.approx(252 / 258)


def test_contrast_keeps_its_value_when_the_light_fades() -> None:
    board = _board()
    bright, faded = measure_quality(_frame(board, gain=1.2)), measure_quality(_frame(board, gain=0.6))
    assert faded.contrast == pytest.approx(bright.contrast, abs=0.02)
    assert faded.middle_level == pytest.approx(bright.middle_level / 2, abs=1)
    veiled = cv2.addWeighted(_frame(board), 0.5, np.full((HEIGHT, WIDTH, 3), 100, np.uint8), 0.5, 0)
    assert measure_quality(veiled).contrast < 0.7 * bright.contrast


def test_a_red_lit_frame_is_judged_by_its_red_channel() -> None:
    frame = _frame(_board())
    red = frame.copy()
    red[..., :2] = 2
    ours, gray = measure_quality(red), measure_quality(frame)
    assert ours.focus_per_px == pytest.approx(gray.focus_per_px, rel=0.01)
    assert ours.middle_level == gray.middle_level


def test_only_the_area_counts() -> None:
    frame = np.zeros((400, 500, 3), np.uint8)
    frame[50 : 50 + HEIGHT, 80 : 80 + WIDTH] = _frame(_board(), noise=1.0)
    assert measure_quality(frame, (80, 50, WIDTH, HEIGHT)) == measure_quality(_frame(_board(), noise=1.0))


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_picture_of_nothing_has_no_focus_and_no_noise(level: int) -> None:
    quality = measure_quality(np.full((64, 64, 3), level, np.uint8))
    assert (quality.focus_per_px, quality.edge_share, quality.noise_levels, quality.contrast) == (0, 0, 0, 0)
    assert quality.blur_px == float("inf")


def test_noise_alone_is_no_edge() -> None:
    frame = np.clip(np.random.default_rng(4).normal(120, 8, (300, 300, 3)), 0, 255).astype(np.uint8)
    assert measure_quality(frame).focus_per_px == 0.0


@pytest.mark.parametrize("area", [(0, 0, 31, 64), (0, 0, 64, 0), (-1, 0, 40, 40), (30, 30, 40, 40), (0, 0, -64, -64)])
def test_an_area_that_is_too_small_or_outside_is_refused(area: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match="px"):
        measure_quality(np.zeros((64, 64, 3), np.uint8), area)


@pytest.mark.parametrize(
    "area", [(0.5, 0, 40, 40), (0, 0, 40.0, 40.1), (0, float("nan"), 40, 40), (0, 0, float("inf"), 40)]
)
def test_an_area_of_half_pixels_is_refused_and_one_of_whole_ones_is_measured_whatever_its_type(
    area: tuple[float, ...],
) -> None:
    board = _frame(_board())
    with pytest.raises(ValueError, match="whole pixels"):
        measure_quality(board, area)  # type: ignore[arg-type]
    assert measure_quality(board, (0.0, 0.0, 200.0, 100.0)) == measure_quality(board, (0, 0, 200, 100))


@CALM
@given(
    arrays(
        st.sampled_from([np.uint8, np.float32, np.bool_]),
        st.one_of(
            array_shapes(min_dims=1, max_dims=4, max_side=40),
            st.tuples(st.integers(30, 50), st.integers(30, 50), st.just(3)),
        ),
    )
)
def test_any_array_gives_a_value_error_or_finite_numbers(image: np.ndarray) -> None:
    try:
        quality = measure_quality(image)
    except ValueError:
        return
    assert isinstance(quality, ImageQuality)
    numbers = [getattr(quality, name) for name in ImageQuality.__slots__]
    assert np.isfinite(numbers).all()
    assert min(numbers) >= 0.0
    assert max(quality.edge_share, quality.under_share, quality.over_share, quality.contrast) <= 1.0
