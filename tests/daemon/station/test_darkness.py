"""The darkness check: a lit needle's end is enough, and hot pixels are not."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from daemon.station.darkness import bright_level, require_dark
from drivers.camera import Frame
from drivers.deadline import Deadline
from drivers.errors import LightError

LIMIT_LEVEL = 60.0


def _picture(level: int = 4) -> Any:
    noise = np.random.default_rng(1).normal(level, 2.0, (1200, 1600, 3))
    return np.clip(noise, 0, 255).astype(np.uint8)


def _hardware(pixels: Any) -> Any:
    async def frame_after(t_s: float, _deadline: Deadline) -> Frame:
        assert t_s >= time.monotonic()
        return Frame(pixels, t_s, 0.02, 1, t_s)

    lights = SimpleNamespace(settle_s=60.0)
    return cast("Any", SimpleNamespace(camera=SimpleNamespace(frame_after=frame_after), lights=lights))


async def test_a_dark_picture_passes_with_its_noise_and_its_hot_pixels() -> None:
    pixels = _picture()
    pixels[::100, ::100] = 255
    await require_dark(_hardware(pixels), LIMIT_LEVEL, Deadline.after(1.0))


@pytest.mark.parametrize("channel", [0, 1, 2])
async def test_a_lit_end_of_a_needle_is_a_light_that_should_be_off(channel: int) -> None:
    """It should see a red lamp as well as a white one, on 100 px by 60 px of metal."""
    pixels = _picture()
    pixels[500:560, 700:800, channel] = 120
    with pytest.raises(LightError, match=r"both lamps are switched off, but the picture is lit: 120 of 255"):
        await require_dark(_hardware(pixels), LIMIT_LEVEL, Deadline.after(1.0))
    assert bright_level(pixels) == 120.0


async def test_a_station_that_stands_in_daylight_does_without_the_check() -> None:
    await require_dark(_hardware(_picture(200)), 0.0, Deadline.after(1.0))
