"""A landing's picture says whether the needle meets the pad: by the place below it, not by its end's pixel."""

from __future__ import annotations

import numpy as np
import pytest

from vision.annotate import Landing, draw_landing
from vision.annotate.landing import landing_panel, verdict_on_landing
from vision.annotate.sheet import ANSWER, THROWN, USED, Colour

PAD = np.array([(480.0, 380.0), (520.0, 380.0), (520.0, 420.0), (480.0, 420.0)])
FRAME = np.full((1200, 1600, 3), 60, dtype=np.uint8)


def _landing(below_px: tuple[float, float], outline: np.ndarray | None = PAD) -> Landing:
    """Return one whose needle's end is seen 30 px above the place below it."""
    tip_px = below_px[0], below_px[1] - 30.0
    return Landing(tip_px, below_px, (500.0, 400.0), outline, float(np.hypot(below_px[0] - 500.0, below_px[1] - 400.0)))


def _count(picture: np.ndarray, colour: Colour) -> int:
    return int(np.count_nonzero(np.abs(picture.astype(int) - np.array(colour)).max(axis=2) < 20))


@pytest.mark.parametrize(
    ("below_px", "meets"), [((505.0, 402.0), True), ((481.0, 419.0), True), ((540.0, 400.0), False)]
)
def test_it_is_the_place_below_the_needle_that_decides(below_px: tuple[float, float], meets: bool) -> None:
    landing = _landing(below_px)
    assert landing.on_metal is meets
    assert ("meets" if meets else "misses") in verdict_on_landing(landing)
    assert f"{landing.off_um:.0f} um" in verdict_on_landing(landing)


def test_an_end_that_is_seen_over_the_pad_misses_it_where_the_place_below_does() -> None:
    landing = _landing((500.0, 430.0))
    assert landing.tip_px == (500.0, 400.0), "its pixel is in the pad's middle"
    assert landing.on_metal is False


def test_a_miss_and_a_hit_are_told_apart_by_colour() -> None:
    hit, miss = (landing_panel(FRAME, _landing(at)).pixels for at in ((503.0, 401.0), (550.0, 400.0)))
    assert _count(miss, THROWN) > 20 > _count(hit, THROWN)
    assert _count(hit, USED) > 20 > _count(miss, USED)


@pytest.mark.parametrize("below_px", [(503.0, 401.0), (900.0, 700.0), (5.0, 3.0)])
def test_pad_needles_end_and_the_place_below_are_all_in_the_picture(below_px: tuple[float, float]) -> None:
    pixels = landing_panel(FRAME, _landing(below_px)).pixels
    assert _count(pixels, ANSWER) > 20, "the pad's outline"
    assert min(pixels.shape[:2]) >= 640 - 2


def test_without_an_outline_nobody_says_whether_it_meets_metal() -> None:
    landing = _landing((503.0, 401.0), None)
    assert landing.on_metal is None
    assert "metal" not in verdict_on_landing(landing)
    assert draw_landing(FRAME, landing).shape[0] > 640
