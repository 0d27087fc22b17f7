import numpy as np
import pytest

from tests.vision.scene import AXIS_DEG, Camera, Canvas
from vision.circle import View, fit_circle
from vision.circle_seeds import radii, seeds

VIEW = View()


def disc(x: float, y: float, radius: float, ratio: float = 0.87, noise: float = 3.0, seed: int = 0) -> np.ndarray:
    canvas = Canvas((100.0, 100.0), (70, 70), 35.0)
    canvas.paint(canvas.ellipse(x, y, radius, ratio, AXIS_DEG), 190.0)
    return canvas.develop(Camera(noise=noise, falloff=0.0), np.random.default_rng(seed))


@pytest.mark.parametrize("ratio", [0.83, 0.87, 0.91])
@pytest.mark.parametrize("radius", [5.0, 8.0, 17.3, 42.0])
def test_centre_and_radius_come_back_from_a_rough_seed(radius: float, ratio: float) -> None:
    x, y = 71.37 + 30, 68.81 + 30
    found = fit_circle(
        disc(x, y, radius, ratio).astype(np.float32), (x - 30 + 1.2, y - 30 - 1.0), radius * 1.05, VIEW, reach_px=4.0
    )
    assert found is not None
    assert (found.x_px + 30, found.y_px + 30) == pytest.approx((x, y), abs=0.1)
    assert found.radius_px == pytest.approx(radius, abs=0.06 * radius)
    assert found.coverage > 0.9


def test_sigma_grows_when_half_of_the_contour_is_hidden() -> None:
    picture = disc(100.0, 100.0, 17.0).astype(np.float32)
    hidden = np.zeros(picture.shape, dtype=bool)
    hidden[:, :70] = True
    whole = fit_circle(picture, (70.5, 69.5), 17.0, VIEW, reach_px=4.0)
    half = fit_circle(picture, (70.5, 69.5), 17.0, VIEW, reach_px=4.0, hidden=hidden)
    assert whole is not None
    assert half is not None
    assert half.visible == pytest.approx(0.5, abs=0.06)
    assert half.sigma_px > 1.3 * whole.sigma_px
    assert (half.x_px, half.y_px) == pytest.approx((70.0, 70.0), abs=0.3)


def test_nothing_round_gives_no_fit() -> None:
    flat = np.random.default_rng(1).normal(60, 3, (100, 100)).astype(np.float32)
    found = fit_circle(flat, (50.0, 50.0), 10.0, VIEW, reach_px=3.0)
    assert found is None or found.coverage < 0.6
    assert fit_circle(flat, (-40.0, -40.0), 10.0, VIEW, reach_px=3.0) is None


def test_seeds_are_near_the_centre_and_the_radius() -> None:
    picture = disc(100.0, 100.0, 17.0, ratio=1.0)
    found = seeds(picture, radii(11.0, 26.0))
    assert found
    assert np.hypot(found[0].x_px - 70, found[0].y_px - 70) < 2.5
    assert found[0].radius_px == pytest.approx(17.0, rel=0.12)
    assert seeds(np.full((50, 50), 40, np.uint8), radii(5, 9)) == []
