import numpy as np
import pytest

from tests.vision.registration.drawn import box, circle
from vision.registration import free_site


def test_a_round_pad_is_touched_in_its_middle() -> None:
    site = free_site(circle(1000.0, 2000.0, 500.0), [], 100.0)
    assert site is not None
    assert (site.x_um, site.y_um) == pytest.approx((1000.0, 2000.0), abs=4.0)
    assert site.room_um == pytest.approx(250.0, abs=6.0)
    assert site.fits


def test_a_long_pad_is_touched_in_its_middle_though_all_along_it_there_is_as_much_room() -> None:
    site = free_site(box(0.0, 0.0, 400.0, 3000.0), [], 100.0)
    assert site is not None
    assert (site.x_um, site.y_um) == pytest.approx((0.0, 0.0), abs=12.0)


def test_a_hole_sends_the_needle_to_the_ring() -> None:
    site = free_site(box(0.0, 0.0, 1600.0, 1600.0), [circle(0.0, 0.0, 700.0)], 150.0)
    assert site is not None
    away = np.hypot(site.x_um, site.y_um)
    assert away - 350.0 >= site.room_um - 8.0
    assert site.room_um > 220.0
    assert site.fits


def test_the_ring_is_touched_on_the_side_asked_for() -> None:
    for away in ((1.0, 0.0), (0.0, -1.0)):
        site = free_site(circle(0.0, 0.0, 1700.0), [circle(0.0, 0.0, 900.0)], 150.0, away_um=away)
        assert site is not None
        assert np.dot((site.x_um, site.y_um), away) > 500.0
        assert site.fits


def test_earlier_marks_are_avoided_until_none_is_left() -> None:
    pad = box(0.0, 0.0, 600.0, 600.0)
    marks: list[np.ndarray] = []
    sites = []
    for _ in range(60):
        site = free_site(pad, marks, 60.0)
        if site is None or not site.fits:
            break
        sites.append((site.x_um, site.y_um))
        marks.append(circle(site.x_um, site.y_um, 80.0))
    assert 4 <= len(sites) < 60
    apart = [np.hypot(a[0] - b[0], a[1] - b[1]) for i, a in enumerate(sites) for b in sites[:i]]
    assert min(apart) >= 95.0


def test_what_does_not_fit_is_told_with_the_room_there_is() -> None:
    site = free_site(box(0.0, 0.0, 200.0, 900.0), [], 120.0)
    assert site is not None
    assert not site.fits
    assert site.room_um == pytest.approx(100.0, abs=5.0)


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 45.0, 88.0])
@pytest.mark.parametrize("width_um", [250.0, 400.0])
def test_there_is_never_less_room_than_is_told_on_a_long_pad(width_um: float, turn_deg: float) -> None:
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    site = free_site(box(0.0, 0.0, width_um, 8000.0) @ np.array([[c, s], [-s, c]]), [], 100.0)
    assert site is not None
    across = abs(c * site.x_um + s * site.y_um)
    assert site.room_um <= width_um / 2 - across + 1.0
    assert site.room_um > width_um / 2 - 40.0


def test_metal_that_is_wholly_covered_has_no_site() -> None:
    assert free_site(circle(0.0, 0.0, 400.0), [box(0.0, 0.0, 1000.0, 1000.0)], 50.0) is None
