from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from sim_hw.scene.sensor import BLACK_LEVEL, Exposed, Image, Sensor, SensorSettings, blurred

GREY = np.full((1200, 1600, 3), 100, dtype=np.uint8)
RED = np.full((1200, 1600), 100, dtype=np.uint8)
SENSOR = Sensor(seed=1)


def _read(light: Exposed, seed: int = 0, **settings: Any) -> Image:
    return SENSOR.read(light, SensorSettings(**{"exposure_s": 0.02, **settings}), np.random.default_rng(seed))


def _centre(frame: Image) -> npt.NDArray[np.float64]:
    return frame[560:610, 735:785].reshape(-1, 3).mean(axis=0)


def test_grey_levels_follow_exposure_gain_and_light_until_they_clip() -> None:
    white = Exposed(GREY, 1.0, None, 0.0)
    plain = _centre(_read(white))[1] - BLACK_LEVEL
    assert plain == pytest.approx(100.0, abs=1.5)
    assert _centre(_read(white, exposure_s=0.01))[1] - BLACK_LEVEL == pytest.approx(plain / 2, abs=1.0)
    assert _centre(_read(white, gain=1.5))[1] - BLACK_LEVEL == pytest.approx(plain * 1.5, abs=1.5)
    half = Exposed(GREY, 0.5, None, 0.0)
    assert _centre(_read(half))[1] - BLACK_LEVEL == pytest.approx(plain / 2, abs=1.0)
    bright = _read(white, exposure_s=0.1)
    assert float(_centre(bright)[1]) > 252.0


def test_red_light_reaches_only_the_red_channel_but_for_a_little() -> None:
    blue, green, red = _centre(_read(Exposed(None, 0.0, RED, 1.0))) - BLACK_LEVEL
    assert red == pytest.approx(100.0, abs=1.5)
    assert green < 8.0
    assert blue < 6.0


def test_both_lamps_add_up() -> None:
    both = _centre(_read(Exposed(GREY, 1.0, RED, 1.0)))
    assert both[2] - BLACK_LEVEL == pytest.approx(200.0, abs=2.0)


def test_darkness_is_nearly_black_with_noise() -> None:
    frame = _read(Exposed(None, 0.0, None, 0.0))
    assert frame.mean() < 6.0
    assert frame.max() < 30


def test_noise_is_as_strong_as_asked_and_differs_from_frame_to_frame() -> None:
    light = Exposed(GREY, 1.0, None, 0.0)
    one, other = (_read(light, seed=k, noise_grey=3.0, blur_px=0.0) for k in (1, 2))
    patch = one[560:610, 735:785, 1].astype(float)
    assert patch.std() == pytest.approx(3.0, abs=0.3)
    assert not np.array_equal(one, other)
    assert np.array_equal(one, _read(light, seed=1, noise_grey=3.0, blur_px=0.0))


def test_corners_are_darker_and_balance_tints() -> None:
    light = Exposed(GREY, 1.0, None, 0.0)
    frame = _read(light, falloff=0.2)
    assert frame[:40, -40:].mean() < 0.88 * frame[570:600, 750:780].mean()
    blue, _, red = _centre(_read(light, balance=(1.2, 1.0, 0.8))) - BLACK_LEVEL
    assert blue / red == pytest.approx(1.5, abs=0.05)


def test_blur_spreads_a_point_and_keeps_its_light() -> None:
    point = np.zeros((41, 41), dtype=np.uint8)
    point[20, 20] = 255
    spread = blurred(point, 1.0).astype(float)
    assert spread.sum() == pytest.approx(255.0, rel=0.06)
    columns = np.arange(41) - 20.0
    sigma = float(np.sqrt((spread.sum(axis=0) * columns**2).sum() / spread.sum()))
    assert sigma == pytest.approx(1.0, abs=0.15)
    assert np.array_equal(blurred(point, 0.0), point)
