import numpy as np
import pytest

from tests.vision.scene import Camera, Canvas, Needle, draw_needle, frame_of
from vision import ControlPoint, NotFound, Reason, find_control_point

AROUND = (428.0, 620.0)


def cross(seed: int, needle: bool = True, noise: float = 4.0) -> tuple[np.ndarray, tuple[float, float]]:
    rng = np.random.default_rng(seed)
    canvas = Canvas(AROUND, (200, 200), 205.0)
    x, y = AROUND[0] + rng.uniform(-40, 40), AROUND[1] + rng.uniform(-40, 40)
    first, width = rng.uniform(0, 90), rng.uniform(4, 7)
    for angle in (first, first + rng.uniform(76, 94)):
        canvas.paint(canvas.bar((x, y), angle, 140, width), 40.0)
    if needle:
        tip = x - 3.6 + rng.uniform(-3, 3), y - 7.0 + rng.uniform(-3, 3)
        draw_needle(canvas, Needle(tip=tip), True)
    return frame_of(canvas.develop(Camera(noise=noise), rng), canvas, True, 205.0), (x, y)


@pytest.mark.parametrize("needle", [False, True])
def test_the_centre_is_found_to_0_15_px_with_the_needle_in_the_way(needle: bool) -> None:
    found = []
    for seed in range(12):
        frame, centre = cross(seed, needle)
        point = find_control_point(frame, AROUND, 60, 70)
        if not point:
            continue
        assert len(point.arms) >= 2
        found.append((point.x_px - centre[0], point.y_px - centre[1]))
    assert len(found) >= 11
    assert np.sqrt(np.mean(np.sum(np.square(found), axis=1))) <= 0.15
    assert np.max(np.abs(found)) < 0.5


def test_one_line_is_no_control_point() -> None:
    canvas = Canvas(AROUND, (200, 200), 205.0)
    canvas.paint(canvas.bar(AROUND, 20.0, 140, 5), 40.0)
    frame = frame_of(canvas.develop(Camera(), np.random.default_rng(0)), canvas, True, 205.0)
    result = find_control_point(frame, AROUND)
    assert isinstance(result, NotFound)
    assert result.reason is Reason.NO_CONTROL_POINT


def test_lines_that_cross_at_a_slant_are_no_control_point() -> None:
    canvas = Canvas(AROUND, (200, 200), 205.0)
    for angle in (20.0, 65.0):
        canvas.paint(canvas.bar(AROUND, angle, 140, 5), 40.0)
    frame = frame_of(canvas.develop(Camera(), np.random.default_rng(0)), canvas, True, 205.0)
    assert not isinstance(find_control_point(frame, AROUND), ControlPoint)


def test_blank_dark_and_outside_are_named() -> None:
    blank = np.full((1200, 1600, 3), 200, np.uint8)
    for frame, around, reason in (
        (blank, AROUND, Reason.NO_CONTROL_POINT),
        (blank // 16, AROUND, Reason.TOO_DARK),
        (np.full_like(blank, 255), AROUND, Reason.SATURATED),
        (blank, (5.0, 5.0), Reason.OUT_OF_FRAME),
    ):
        result = find_control_point(frame, around)
        assert isinstance(result, NotFound)
        assert result.reason is reason
    with pytest.raises(ValueError, match="reach_px"):
        find_control_point(blank, AROUND, reach_px=float("nan"))
