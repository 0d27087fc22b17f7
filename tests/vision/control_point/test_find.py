import numpy as np
import pytest

from tests.vision.scene import Camera, Canvas, Needle, draw_needle, frame_of
from tests.vision.studio.mark import mark_scene
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


@pytest.mark.parametrize("hard", [False, True])
@pytest.mark.parametrize("hidden_arms", [0, 1, 2])
def test_another_artists_marks_are_found_to_0_2_px_from_25_px_away(hidden_arms: int, hard: bool) -> None:
    errors, pulls = [], []
    for seed in range(6):
        scene = mark_scene(400 + seed, hidden_arms=hidden_arms, hard=hard)
        way = np.random.default_rng(seed).uniform(0, 2 * np.pi)
        around = scene.centre_px[0] + 25 * np.cos(way), scene.centre_px[1] + 25 * np.sin(way)
        point = find_control_point(scene.frame, around)
        assert isinstance(point, ControlPoint)
        assert len(point.arms) >= max(3 - hidden_arms, 2)
        errors.append(np.hypot(point.x_px - scene.centre_px[0], point.y_px - scene.centre_px[1]))
        pulls.append(errors[-1] / point.sigma_px)
    assert np.sqrt(np.mean(np.square(errors))) <= 0.2
    assert max(errors) < 0.5
    assert max(pulls) < 5.0


def drawn(*arms: tuple[float, float, float, float]) -> np.ndarray:
    """Return a frame of dark arms (x, y, direction in degrees, length), each beginning at (x, y)."""
    canvas = Canvas(AROUND, (200, 200), 205.0)
    for x, y, angle, length in arms:
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        canvas.paint(canvas.bar((x + length / 2 * c, y + length / 2 * s), angle, length + 5, 6), 40.0)
    return frame_of(canvas.develop(Camera(), np.random.default_rng(1)), canvas, True, 205.0)


@pytest.mark.parametrize("directions", [(10, 100), (10, 100, 190), (33, 123, 303)])
def test_a_corner_or_a_junction_on_bare_paper_is_no_control_point(directions: tuple[int, ...]) -> None:
    result = find_control_point(drawn(*((*AROUND, angle, 90) for angle in directions)), AROUND)
    assert isinstance(result, NotFound)
    assert "missing though nothing hides it" in result.message


def test_one_crossing_of_many_is_not_picked() -> None:
    x, y = AROUND
    across = [(x - 150, y + 30 * k, 0.0, 300.0) for k in range(-6, 7)]
    down = [(x + 30 * k, y - 150, 90.0, 300.0) for k in range(-6, 7)]
    result = find_control_point(drawn(*across, *down), AROUND)
    assert isinstance(result, NotFound)
    assert result.reason is Reason.AMBIGUOUS


def test_dashed_lines_are_no_arms() -> None:
    x, y = AROUND
    dashes = []
    for angle in (0.0, 90.0, 180.0, 270.0):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        dashes += [(x + r * c, y + r * s, angle, 12.0) for r in range(0, 100, 28)]
    assert isinstance(find_control_point(drawn(*dashes), AROUND), NotFound)
