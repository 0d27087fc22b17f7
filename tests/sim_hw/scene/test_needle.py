import math

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from sim_hw.scene.needle import Needle, NeedleImage
from sim_hw.scene.needle_shadow import shadow
from sim_hw.scene.optics import make_optics

NEEDLE = Needle(make_optics(), seed=5)


def _along(image: NeedleImage, field: npt.NDArray[np.float32], s_px: float, v_px: float = 0.0) -> float:
    """Return a field's value s px up the needle from its end and v px across."""
    x, y = NEEDLE.tip_px + s_px * NEEDLE.up + v_px * NEEDLE.across
    return float(cv2.getRectSubPix(field, (1, 1), (float(x) - image.left, float(y) - image.top))[0, 0])


def _width_px(image: NeedleImage, s_px: float) -> float:
    steps = np.arange(-60.0, 60.0, 0.1)
    return sum(_along(image, image.alpha, s_px, v) for v in steps) * 0.1


@pytest.fixture(scope="module")
def image() -> NeedleImage:
    return NEEDLE.draw()


def test_it_ends_at_the_tip(image: NeedleImage) -> None:
    # The end is a flat disc seen at a slant: the axis meets it at the tip, its near rim is 1.8 px lower.
    inside = [_along(image, image.alpha, s) for s in (6.0, 1.0)]
    assert min(inside) > 0.9
    assert _along(image, image.alpha, -3.2) < 0.1
    profile = [(s, _along(image, image.alpha, s)) for s in np.arange(-5.0, 5.0, 0.05)]
    edge = min(profile, key=lambda sv: abs(sv[1] - 0.5))[0]
    assert edge == pytest.approx(-1.8, abs=0.35)


def test_marking_rims_are_127_and_172_px_up(image: NeedleImage) -> None:
    s = np.arange(100.0, 200.0, 0.25)
    grey = np.array([np.mean([_along(image, image.white, k, v) for v in (-4.0, 0.0, 4.0)]) for k in s])
    slope = np.gradient(cv2.GaussianBlur(grey[None], (0, 0), 4.0)[0])
    assert s[int(np.argmin(slope))] == pytest.approx(127.0, abs=2.0)
    assert s[int(np.argmax(slope))] == pytest.approx(172.0, abs=2.5)
    assert 15.0 <= grey[((150 - 100) * 4)] <= 35.0


def test_widths_are_those_of_the_real_probe(image: NeedleImage) -> None:
    assert _width_px(image, 6.0) < 9.0
    assert _width_px(image, 150.0) == pytest.approx(40.5, abs=1.5)
    assert _width_px(image, 250.0) == pytest.approx(42.5, abs=1.5)
    assert _width_px(image, 560.0) == pytest.approx(75.0, abs=3.0)


def test_metal_is_brighter_than_the_board_and_has_a_highlight_along_it(image: NeedleImage) -> None:
    for s in (80.0, 250.0, 350.0):
        across = [_along(image, image.white, s, v) for v in np.linspace(-0.85, 0.85, 15) * _width_px(image, s) / 2]
        assert min(across) > 62.0
        assert max(across) > 1.6 * min(across)
        dim = [_along(image, image.red, s, v) for v in np.linspace(-0.85, 0.85, 15) * _width_px(image, s) / 2]
        assert max(dim) < 150.0


def test_a_sub_pixel_shift_moves_the_picture_by_just_that(image: NeedleImage) -> None:
    moved = NEEDLE.draw((0.4, -0.3))
    for step in (40.0, 90.0):
        offsets = np.arange(-30.0, 30.0, 0.1)
        before = np.array([_along(image, image.alpha, step, v) for v in offsets])
        after = np.array([_along(moved, moved.alpha, step, v) for v in offsets])
        shift = float((offsets * after).sum() / after.sum() - (offsets * before).sum() / before.sum())
        wanted = float(np.dot((0.4, -0.3), NEEDLE.bend_direction))
        # the taper is symmetric: its middle moves by the part of the shift that is across it
        assert shift == pytest.approx(wanted, abs=0.05)


def test_a_bent_probe_ends_aside_and_is_straight_higher_up(image: NeedleImage) -> None:
    bent = NEEDLE.draw(bent_px=10.0)
    assert _along(bent, bent.alpha, 3.0) < 0.1
    x, y = NEEDLE.tip_px + 10.0 * NEEDLE.bend_direction + 1.5 * NEEDLE.up
    assert bent.alpha[round(y) - bent.top, round(x) - bent.left] > 0.9
    assert _along(bent, bent.white, 350.0) == pytest.approx(_along(image, image.white, 350.0), abs=1.0)


def test_the_look_is_that_of_the_seed() -> None:
    again, other = Needle(make_optics(), seed=5).draw(), Needle(make_optics(), seed=6).draw()
    assert np.array_equal(again.white, NEEDLE.draw().white)
    assert not np.array_equal(other.white, again.white)


def test_the_shadow_is_soft_and_starts_near_the_foot_of_the_tip() -> None:
    light = shadow(make_optics(), NEEDLE, 200.0, 38.0, 0.75, (800, 760))
    assert light.shape == (760, 800)
    assert 0.3 < float(light.min()) < 0.9
    assert light[740, 700] == pytest.approx(1.0, abs=1e-3)
    foot = light[600:640, 410:450]
    assert float(foot.min()) < 1.0
    assert float(np.abs(np.diff(light, axis=1)).max()) < 0.1
    assert math.isfinite(float(light.sum()))
