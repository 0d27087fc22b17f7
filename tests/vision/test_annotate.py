import numpy as np
import pytest

from tests.vision.scene import NOMINAL_TIP, Camera, Needle, Pad, red_frame, white_frame
from vision import NotFound, ProbeModel, Reason, crop, draw_test_points, draw_tip, find_test_points, find_tip


def test_a_found_tip_is_drawn_on_a_copy(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), 1, 0.3)
    before = frame.copy()
    tip = find_tip(frame, model)
    picture = draw_tip(frame, tip)
    assert picture.shape == (660, 560, 3)
    assert np.array_equal(frame, before)
    bare = crop(frame, (int(tip.x_px) - 190, int(tip.y_px) - 270, 280, 330), 2)
    assert np.mean(np.any(picture != bare, axis=2)) > 0.01


def test_what_was_seen_is_drawn_whatever_it_is(model: ProbeModel) -> None:
    frame = red_frame((Pad(431, 627, 17.0, 4.0), Pad(465, 600, 11.0)), Needle(), Camera(), 2)
    for around in (NOMINAL_TIP, (600.0, 600.0), (1.0, 1.0), (1599.0, 1199.0)):
        seen = find_test_points(frame, around)
        picture = draw_test_points(frame, seen, around)
        assert picture.dtype == np.uint8
        assert picture.max() > 100
    failure = NotFound(Reason.NO_NEEDLE, "a long message " * 20)
    assert draw_tip(frame, failure).shape == draw_tip(frame, failure, NOMINAL_TIP).shape


def test_a_crop_is_magnified_and_black_outside() -> None:
    frame = np.full((50, 60, 3), 9, np.uint8)
    part = crop(frame, (-5, -5, 20, 10), zoom=3)
    assert part.shape == (30, 60, 3)
    assert np.all(part[:15] == 0)
    assert np.all(part[15:, 15:] == 9)
    with pytest.raises(ValueError, match="crop"):
        crop(frame, (0, 0, 0, 5))
