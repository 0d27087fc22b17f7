"""A needle is taught where the picture shows its end, and nowhere else: every landing would inherit the difference."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Needle, white_frame
from tests.vision.studio.needle import WhiteScene, golden
from tests.vision.studio.needle_kit import HEADS
from vision import ProbeModel
from vision.tip.end import BEYOND_PX, check_end, find_end
from vision.tip.strip import ProbeStrip

EVERY_KIND = [*HEADS, 0, 1, 2, 3]
RIM_PX = -120.0


@cache
def picture(kind: str | int) -> WhiteScene:
    return golden(3, kit=kind)


def taught_off(kind: str | int, along_px: float) -> ProbeModel:
    """Teach a needle before dark cloth by a click that is off along it."""
    scene = picture(kind)
    assert scene.tip_px is not None
    return ProbeModel.teach(scene.frame, moved(scene.tip_px, scene.angle_deg, along_px))


def moved(at: tuple[float, float], angle_deg: float, by_px: float) -> tuple[float, float]:
    angle = np.radians(angle_deg)
    return float(at[0] + by_px * np.cos(angle)), float(at[1] + by_px * np.sin(angle))


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_a_click_past_the_end_on_quiet_ground_is_refused_and_told_where_the_end_is(kind: str | int) -> None:
    with pytest.raises(ValueError, match=r"does not end .* its end ([789]|10) px nearer to its marking; click"):
        taught_off(kind, 8.0)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_a_click_a_few_px_before_the_end_is_refused_and_told_where_the_end_is(kind: str | int) -> None:
    with pytest.raises(ValueError, match=r"does not end .* its end [4-6] px farther from its marking; click"):
        taught_off(kind, -6.0)


@pytest.mark.parametrize(("from_px", "to_px"), [(30.0, 54.0), (40.0, 64.0), (46.0, 70.0)])
def test_where_print_ends_beyond_the_needle_it_does_not_end(from_px: float, to_px: float) -> None:
    middle = moved(NOMINAL_TIP, AXIS_DEG, (from_px + to_px) / 2.0)

    def print_line(canvas: Canvas) -> None:
        canvas.paint(canvas.bar(middle, AXIS_DEG, to_px - from_px, 10.0), 170.0)

    frame = white_frame(Needle(), Camera(), seed=1, clutter=0.0, more=print_line)
    assert ProbeModel.teach(frame, NOMINAL_TIP).tip_px == pytest.approx(NOMINAL_TIP, abs=0.5)
    with pytest.raises(ValueError, match=rf"does not end .* its end {to_px:.0f} px nearer to its marking"):
        ProbeModel.teach(frame, moved(NOMINAL_TIP, AXIS_DEG, to_px))


def strip(levels: np.ndarray, end_v_px: np.ndarray | None = None) -> ProbeStrip:
    """Return a strip from u = -200 with one level a row; columns may end some px earlier."""
    pixels = np.repeat(levels[:, None].astype(np.float32), 129, axis=1)
    if end_v_px is not None:
        for column, early in enumerate(end_v_px):
            pixels[:, column] = np.interp(np.arange(levels.size) + early, np.arange(levels.size), levels)
    blurred = np.asarray(cv2.GaussianBlur(pixels, (1, 5), 1.0), dtype=np.float32)
    return ProbeStrip(blurred, 0.0, 0.0, 0.0, -200, 64, 5.0)


def needle_rows(end_u_px: float, metal: float = 140.0, ground: float = 25.0) -> np.ndarray:
    u = np.arange(-200, BEYOND_PX + 1)
    return np.asarray(ground + (metal - ground) * np.clip(end_u_px - u + 0.5, 0.0, 1.0))


@pytest.mark.parametrize("end_u_px", [-3.0, 0.0, 0.4, 12.7, 40.0])
def test_the_end_is_found_to_parts_of_a_pixel(end_u_px: float) -> None:
    assert find_end(strip(needle_rows(end_u_px)), 12.0, RIM_PX) == pytest.approx(end_u_px, abs=0.3)


def test_the_end_of_a_round_needle_is_that_of_its_middle() -> None:
    v = np.arange(-64, 65) / 12.0
    early = 6.0 * (1.0 - np.sqrt(np.clip(1.0 - v**2, 0.0, 1.0)))
    assert find_end(strip(needle_rows(0.0), early), 12.0, RIM_PX) == pytest.approx(0.0, abs=0.5)


def test_a_groove_in_the_metal_is_no_end() -> None:
    rows = needle_rows(0.0)
    rows[170:174] = 30.0
    assert find_end(strip(rows), 12.0, RIM_PX) == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize("rows", [needle_rows(500.0), needle_rows(0.0, 140.0, 130.0), needle_rows(0.0, 60.0, 200.0)])
def test_where_no_ground_follows_the_metal_no_end_is_made_up(rows: np.ndarray) -> None:
    assert find_end(strip(rows), 12.0, RIM_PX) is None
    with pytest.raises(ValueError, match="does not end at the given point"):
        check_end(strip(rows), 0.0, 12.0, RIM_PX)
