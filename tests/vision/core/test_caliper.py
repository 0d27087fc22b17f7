import cv2
import numpy as np
import pytest

from vision.core.caliper import edges, fit_straight_edge, profile, robust_fit


def step(at: float, length: int = 60, blur: float = 1.0, low: float = 40.0, high: float = 160.0) -> np.ndarray:
    fine = np.arange(length * 20) / 20.0 - 0.475
    values = np.where(fine < at, low, high).astype(np.float32)[None, :]
    soft = cv2.GaussianBlur(values, (0, 0), blur * 20)
    return soft.reshape(length, 20).mean(axis=1)


@pytest.mark.parametrize("at", [25.0, 25.3, 25.5, 27.8])
@pytest.mark.parametrize("blur", [0.7, 1.4])
def test_an_edge_is_found_to_a_few_hundredths_of_a_pixel(at: float, blur: float) -> None:
    found = edges(step(at, blur=blur))
    assert len(found) == 1
    assert found[0].at_px == pytest.approx(at, abs=0.06)
    assert found[0].strength > 0


def test_edges_come_in_order_with_their_signs() -> None:
    values = step(20.0) - step(40.4) + 50
    found = edges(values.astype(np.float32))
    assert [round(edge.at_px) for edge in found] == [20, 40]
    assert [edge.strength > 0 for edge in found] == [True, False]
    assert edges(np.zeros(2, np.float32)) == []


def test_a_profile_reads_along_the_line_and_its_width_beats_spikes() -> None:
    picture = np.tile(np.arange(80, dtype=np.uint8) * 3, (40, 1))
    picture[20, 30] = 255
    values = profile(picture, (10.0, 20.0), (60.0, 20.0), width_px=5)
    assert values == pytest.approx(3.0 * np.arange(10, 61), abs=0.01)
    with pytest.raises(ValueError, match="1 px"):
        profile(picture, (5.0, 5.0), (5.2, 5.0))


def test_a_straight_edge_is_fitted_through_clutter() -> None:
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[0:120, 0:120]
    true_angle = np.radians(87.0)
    distance = (columns - 60.3) * np.sin(true_angle) - (rows - 60.0) * np.cos(true_angle)
    picture = 50.0 + 100.0 * np.clip(distance + 0.5, 0, 1)
    picture[40:55, 40:60] = 150.0  # something bright leans on the edge
    noisy = np.clip(picture + rng.normal(0, 4, picture.shape), 0, 255).astype(np.uint8)
    line = fit_straight_edge(noisy, (58.0, 10.0), (62.0, 110.0), reach_px=8)
    assert line is not None
    assert abs(line.offset_px(60.3, 60.0)) < 0.1
    assert np.degrees(line.angle_rad) == pytest.approx(87.0, abs=0.15)
    assert line.used < line.offered


def test_no_edge_gives_no_line() -> None:
    assert fit_straight_edge(np.full((60, 60), 90, np.uint8), (30.0, 5.0), (30.0, 55.0), reach_px=6) is None


def test_a_robust_fit_ignores_a_quarter_of_wild_points() -> None:
    rng = np.random.default_rng(8)
    x = np.linspace(0, 1, 60)
    y = 2.0 + 3.0 * x + rng.normal(0, 0.05, 60)
    y[::4] += 4.0
    fit = robust_fit(np.stack([np.ones(60), x], axis=1), y, rounds=12)
    assert fit.parameters == pytest.approx([2.0, 3.0], abs=0.1)
    assert np.all(fit.weights[::4] < 0.05)
