import numpy as np
import pytest

from tests.vision.scene import AXIS_DEG, Camera, Canvas
from vision.core.circle_fit import CircleFit, Contour, fit_circle
from vision.core.edges import find_edgels
from vision.core.view import UNKNOWN_VIEW, View, ellipse_of
from vision.pads.disc_fit import measure_disc
from vision.pads.hough_seeds import seeds

VIEW = View()


def disc(
    x: float, y: float, radius: float, ratio: float = 0.87, noise: float = 3.0, seed: int = 0, hole: float = 0.0
) -> np.ndarray:
    canvas = Canvas((100.0, 100.0), (70, 70), 35.0)
    canvas.paint(canvas.ellipse(x, y, radius, ratio, AXIS_DEG), 190.0)
    if hole:
        canvas.paint(canvas.ellipse(x, y, hole, ratio, AXIS_DEG), 25.0)
    return canvas.develop(Camera(noise=noise, falloff=0.0), np.random.default_rng(seed))


def fit(picture: np.ndarray, x: float, y: float, radius: float, view: View = VIEW, **more: object) -> CircleFit | None:
    seed = Contour(x, y, radius)
    return fit_circle(find_edgels(picture), seed, view, shape=picture.shape, reach_px=4.0, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [0.83, 0.87, 0.91])
@pytest.mark.parametrize("radius", [5.0, 8.0, 17.3, 42.0])
def test_centre_and_ellipse_come_back_from_a_rough_seed(radius: float, ratio: float) -> None:
    x, y = 71.37, 68.81
    found = fit(disc(x + 30, y + 30, radius, ratio), x + 1.2, y - 1.0, radius * 1.05)
    assert found is not None
    assert found.coverage > 0.9
    picture = disc(x + 30, y + 30, radius, ratio)
    usable = np.ones(picture.shape, bool)
    measured = measure_disc(picture.astype(np.float32), found.contour, VIEW, usable=usable, sectors=found.sectors)
    assert measured is not None
    assert (measured.contour.x_px, measured.contour.y_px) == pytest.approx((x, y), abs=0.1)
    assert measured.contour.ellipse(VIEW)[0] == pytest.approx(radius, rel=0.06)


def test_a_view_of_which_nothing_is_known_finds_square_and_oblique_circles() -> None:
    for ratio in (0.83, 0.9, 1.0):
        found = fit(disc(100.0, 100.0, 18.0, ratio), 70.8, 69.0, 18.0, UNKNOWN_VIEW)
        assert found is not None
        assert found.ratio == pytest.approx(ratio, abs=0.03)
        assert found.coverage > 0.9


def test_visible_is_what_nothing_hides() -> None:
    hidden = np.zeros((140, 140), dtype=bool)
    hidden[:, :70] = True
    picture = disc(100.0, 100.0, 17.0)
    edgels = find_edgels(picture).outside(hidden)
    half = fit_circle(edgels, Contour(70.5, 69.5, 17.0), VIEW, shape=picture.shape, reach_px=4.0, hidden=hidden)
    assert half is not None
    assert half.visible == pytest.approx(0.5, abs=0.06)
    assert (half.x_px, half.y_px) == pytest.approx((70.0, 70.0), abs=0.3)
    whole = fit(picture, 70.5, 69.5, 17.0)
    assert whole is not None
    assert half.sigma_px > 1.3 * whole.sigma_px


def test_what_may_be_hidden_counts_only_where_no_edge_shows() -> None:
    maybe = np.ones((140, 140), dtype=bool)
    found = fit(disc(100.0, 100.0, 17.0), 70.5, 69.5, 17.0, maybe_hidden=maybe)
    assert found is not None
    assert found.visible == pytest.approx(1.0, abs=0.05)


def test_nothing_round_gives_no_fit() -> None:
    flat = np.clip(np.random.default_rng(1).normal(60, 3, (100, 100)), 0, 255).astype(np.uint8)
    found = fit(flat, 50.0, 50.0, 10.0)
    assert found is None or found.coverage < 0.6
    assert fit(flat, -40.0, -40.0, 10.0) is None


def test_seeds_are_near_the_centre_and_the_radius() -> None:
    for ratio, view in ((1.0, UNKNOWN_VIEW), (0.87, UNKNOWN_VIEW), (0.87, VIEW)):
        picture = disc(100.0, 100.0, 17.0, ratio=ratio)
        found = seeds(find_edgels(picture), picture.shape, [(11.0, 26.0)], view)
        assert found
        assert np.hypot(found[0].x_px - 70, found[0].y_px - 70) < 2.5
        assert found[0].radius_px == pytest.approx(17.0, rel=0.12)
    flat = np.full((50, 50), 40, np.uint8)
    assert seeds(find_edgels(flat), flat.shape, [(5, 9)], VIEW) == []


def test_an_ellipse_comes_back_from_its_contour() -> None:
    view = View(0.8, 0.7)
    assert ellipse_of(11.0 * view.unflattening()) == pytest.approx((11.0, 0.8, 0.7), abs=1e-9)
    flat = Contour(0.0, 0.0, 10.0, 0.5, 0.0)
    assert flat.ellipse(View(1.0)) == pytest.approx((10.5, 9.5 / 10.5, np.pi / 2), abs=1e-9)
    assert np.allclose(view.flattening() @ view.unflattening(), np.eye(2))


def errors(
    noise: float, radius: float, hole: float = 0.0, view: View = UNKNOWN_VIEW
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    error, sigma, steps = [], [], []
    for seed in range(40):
        x, y = 70.0 + np.random.default_rng(seed).uniform(-0.5, 0.5, 2)
        picture = disc(x + 30, y + 30, radius, noise=noise, seed=seed, hole=hole)
        found = fit(picture, 70.0, 70.0, radius, view)
        assert found is not None
        idea = Contour(70.0, 70.0, hole) if hole else None
        measured = measure_disc(
            picture.astype(np.float32),
            found.contour,
            view,
            hole=idea,
            usable=np.ones(picture.shape, bool),
            sectors=found.sectors,
        )
        assert measured is not None
        centre = measured.hole or measured.contour
        error.append((centre.x_px - x, centre.y_px - y))
        sigma.append(measured.hole_sigma_px if hole else measured.sigma_px)
        steps.append((measured.step, measured.hole_step, measured.noise, measured.blur_px))
    return np.array(error), np.array(sigma), np.median(np.array(steps), axis=0)


@pytest.mark.parametrize(("noise", "radius"), [(3.0, 6.5), (8.0, 18.0), (3.0, 18.0)])
def test_a_disc_is_measured_near_the_cramer_rao_bound_and_says_so(noise: float, radius: float) -> None:
    error, sigma, (step, _, measured_noise, blur) = errors(noise, radius)
    bound = 1.062 * noise / 155.0 * np.sqrt(1.0 / radius)
    rms = np.sqrt(np.mean(error**2))
    assert rms < 1.7 * np.hypot(bound, 0.008)
    assert 0.25 < rms / sigma.mean() < 1.5
    assert step == pytest.approx(155.0, rel=0.1)
    assert measured_noise == pytest.approx(noise, rel=0.2)
    assert blur == pytest.approx(1.0, abs=0.2)


def test_a_hole_of_two_pixels_is_measured_with_its_pad() -> None:
    error, sigma, (_, hole_step, _, _) = errors(3.0, 6.5, hole=2.2)
    assert np.sqrt(np.mean(error**2)) < 0.06
    assert 0.4 < np.sqrt(np.mean(error**2)) / sigma.mean() < 1.8
    assert hole_step == pytest.approx(165.0, rel=0.2)


def test_a_trace_and_a_dirty_spot_move_the_centre_little() -> None:
    canvas = Canvas((100.0, 100.0), (70, 70), 35.0)
    canvas.paint(canvas.bar((200.0, 100.0), 0.0, 200.0, 5.0), 190.0)
    canvas.paint(canvas.ellipse(100.3, 99.6, 17.0, 0.87, AXIS_DEG), 190.0)
    canvas.paint(canvas.ellipse(92.0, 84.0, 3.0, 1.0, 0.0), 90.0)
    picture = canvas.develop(Camera(noise=2.0, falloff=0.0), np.random.default_rng(2))
    found = fit(picture, 70.0, 70.0, 17.0)
    assert found is not None
    usable = np.ones(picture.shape, bool)
    measured = measure_disc(picture.astype(np.float32), found.contour, VIEW, usable=usable, sectors=found.sectors)
    assert measured is not None
    assert (measured.contour.x_px, measured.contour.y_px) == pytest.approx((70.3, 69.6), abs=0.08)


def test_what_is_no_disc_is_not_measured_as_one() -> None:
    noise = np.random.default_rng(3).normal(100.0, 30.0, (80, 80)).astype(np.float32)
    usable, sectors = np.ones(noise.shape, bool), np.ones(40, bool)
    found = measure_disc(noise, Contour(40.0, 40.0, 12.0), VIEW, usable=usable, sectors=sectors)
    assert found is None or found.noise > 20.0
    assert measure_disc(noise, Contour(-300.0, 40.0, 12.0), VIEW, usable=usable, sectors=sectors) is None
    assert measure_disc(noise, Contour(40.0, 40.0, 12.0), VIEW, usable=~usable, sectors=sectors) is None
