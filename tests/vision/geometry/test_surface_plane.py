"""A plane is found with its sigma, one wrong place in ten does not tilt it, and what is no plane is refused."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.geometry.surface_plane import LEAST_PLACES, Surface, fit_plane

CALM = settings(max_examples=150, deadline=None, derandomize=True)


def _places(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.uniform((0.0, 0.0), (60000.0, 40000.0), (n, 2))


def _plane(places: np.ndarray) -> np.ndarray:
    return 12.0 + 0.9 * places[:, 0] / 1e3 - 0.4 * places[:, 1] / 1e3


@CALM
@given(st.integers(LEAST_PLACES, 25), st.floats(-500, 500), st.floats(-20, 20), st.floats(-20, 20))
def test_any_plane_is_found_exactly(n: int, height: float, tilt_x: float, tilt_y: float) -> None:
    places = _places(np.random.default_rng(n), n)
    surface = fit_plane(places, height + (places @ (tilt_x, tilt_y)) / 1e3)
    assert (surface.tilt_x_um_per_mm, surface.tilt_y_um_per_mm) == pytest.approx((tilt_x, tilt_y), abs=1e-6)
    assert surface.height_um(0.0, 0.0) == pytest.approx(height, abs=1e-6)
    assert surface.height_um(surface.x_um, surface.y_um) == surface.reference_um
    assert surface.flatness_um < 1e-6
    assert surface.tilt_um_per_mm == pytest.approx(math.hypot(tilt_x, tilt_y), abs=1e-6)
    assert surface.used.all()


def test_the_sigma_of_a_height_is_honest_within_a_tenth() -> None:
    rng = np.random.default_rng(1)
    places = _places(rng, 10)
    for where in ((30000.0, 20000.0), (60000.0, 40000.0)):
        errors, variances = [], []
        for _ in range(400):
            surface = fit_plane(places, _plane(places) + rng.normal(0.0, 3.0, 10))
            errors.append(surface.height_um(*where) - float(_plane(np.array([where]))[0]))
            variances.append(surface.sigma_um(*where) ** 2)
        assert math.sqrt(np.mean(variances)) == pytest.approx(math.sqrt(np.mean(np.square(errors))), rel=0.1)


def test_honest_heights_are_hardly_ever_left_out() -> None:
    rng = np.random.default_rng(2)
    left_out = 0
    for n in (6, 10, 20):
        for _ in range(100):
            places = _places(rng, n)
            left_out += int((~fit_plane(places, _plane(places) + rng.normal(0.0, 3.0, n)).used).sum())
    assert left_out <= 10


@pytest.mark.parametrize("n", [6, 10, 20, 30])
@pytest.mark.parametrize("by_um", [-5000.0, 150.0])
def test_one_wrong_place_in_ten_does_not_tilt_it(n: int, by_um: float) -> None:
    """At whichever places, a corner included, which has the longest lever."""
    rng = np.random.default_rng(n)
    for _ in range(20):
        places = _places(rng, n)
        heights = _plane(places) + rng.normal(0.0, 1.5, n)
        wrong = rng.choice(n, max(1, n // 10), replace=False)
        wrong[0] = int(np.argmax(places.sum(axis=1))) if int(np.argmax(places.sum(axis=1))) not in wrong else wrong[0]
        heights[wrong] += by_um
        surface = fit_plane(places, heights, 1.5)
        assert set(np.flatnonzero(~surface.used)) == set(wrong)
        assert surface.residuals_um[wrong] == pytest.approx([by_um] * len(wrong), abs=30.0)
        assert abs(surface.height_um(30000.0, 20000.0) - float(_plane(np.array([(30000.0, 20000.0)]))[0])) < 4.0
        assert surface.flatness_um < 12.0


def test_a_bump_of_many_places_is_seen_as_unflat_and_not_left_out() -> None:
    places = _places(np.random.default_rng(3), 20)
    heights = _plane(places) + np.where(places[:, 0] > 40000.0, 80.0, 0.0)
    surface = fit_plane(places, heights, 3.0)
    assert surface.flatness_um > 40.0
    assert surface.rms_um > 10.0
    # The plane is then no surer than its residuals, whatever the probe could do.
    assert surface.sigma_um(surface.x_um, surface.y_um) > 2.0


def test_sigma_is_never_less_than_the_measurement_s() -> None:
    places = _places(np.random.default_rng(4), 4)
    lucky, known = fit_plane(places, _plane(places)), fit_plane(places, _plane(places), 3.0)
    assert lucky.sigma_um(lucky.x_um, lucky.y_um) < 1e-6
    assert known.sigma_um(known.x_um, known.y_um) == pytest.approx(3.0 / 2.0)
    assert known.sigma_um(known.x_um + 1e5, known.y_um) > 5.0


def test_too_few_or_lined_up_or_not_finite_places_are_refused() -> None:
    places = _places(np.random.default_rng(5), 8)
    heights = _plane(places)
    with pytest.raises(ValueError, match="needs 4"):
        fit_plane(places[:3], heights[:3])
    with pytest.raises(ValueError, match="on a line"):
        fit_plane(places * (1.0, 1e-3), heights)
    with pytest.raises(ValueError, match="on one spot"):
        fit_plane(np.full((5, 2), 300.0), np.arange(5.0))
    with pytest.raises(ValueError, match="heights_um must be finite"):
        fit_plane(places, np.where(np.arange(8) == 2, math.nan, heights))
    with pytest.raises(ValueError, match="places_um must be finite"):
        fit_plane(places * math.inf, heights)
    with pytest.raises(ValueError, match="pair up"):
        fit_plane(places, heights[:5])
    with pytest.raises(ValueError, match="must be numbers"):
        fit_plane(places, ["high"] * 8)
    with pytest.raises(ValueError, match="units"):
        fit_plane(places, heights * 1e12)
    for sigma in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="sigma_um"):
            fit_plane(places, heights, sigma)


def test_a_surface_survives_its_file() -> None:
    places = _places(np.random.default_rng(6), 10)
    heights = _plane(places) + np.random.default_rng(7).normal(0.0, 2.0, 10)
    heights[3] += 400.0
    surface = fit_plane(places, heights)
    again = Surface.from_dict(json.loads(json.dumps(surface.to_dict())))
    assert again.height_um(1e4, 2e4) == surface.height_um(1e4, 2e4)
    assert again.sigma_um(1e4, 2e4) == surface.sigma_um(1e4, 2e4)
    assert np.array_equal(again.used, surface.used)
    assert again.flatness_um == surface.flatness_um


def test_any_other_content_is_refused_and_says_to_measure() -> None:
    places = _places(np.random.default_rng(6), 6)
    raw = fit_plane(places, _plane(places)).to_dict()
    spoiled: list[object] = [None, 3, [], "x", {}]
    spoiled += [
        raw | change
        for change in (
            {"format": "reprobe-surface-0"},
            {"x_um": "far"},
            {"y_um": 10**400},
            {"tilt_x_um_per_mm": math.nan},
            {"residuals_um": [1.0]},
            {"residuals_um": [math.inf] * 6},
            {"residuals_um": 1.0, "used": [True]},
            {"used": [False] * 6},
            {"used": [1] * 6},
            {"used": None},
            {"covariance": [[1.0, 0.0], [0.0, 1.0]]},
            {"covariance": [[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
            {"covariance": [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
        )
    ]
    spoiled += [{k: v for k, v in raw.items() if k != gone} for gone in raw]
    for content in spoiled:
        with pytest.raises(ValueError, match="measure the planarity again"):
            Surface.from_dict(content)


@CALM
@given(st.lists(st.tuples(*[st.floats()] * 3), max_size=8))
def test_any_numbers_give_a_value_error_or_a_plane(rows: list[tuple[float, float, float]]) -> None:
    table = np.array(rows, dtype=float).reshape(-1, 3)
    try:
        surface = fit_plane(table[:, :2], table[:, 2])
    except ValueError:
        return
    assert math.isfinite(surface.height_um(0.0, 0.0))
    assert math.isfinite(surface.sigma_um(0.0, 0.0))
