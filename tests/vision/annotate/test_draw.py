from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Needle, Pad, red_frame, white_frame
from vision import NotFound, ProbeModel, Reason, crop, draw_test_points, draw_tip, find_test_points, find_tip
from vision.annotate.draw import Searched, draw_control_point, draw_look, draw_untaught
from vision.annotate.labels import Box, Label, Spot, arrange
from vision.annotate.pads import MOST_LABELS, pads_panel
from vision.annotate.page import PANEL_ROOM, fitting_zoom, page
from vision.annotate.sheet import ANSWER, FRAME, INK, THROWN, UNDECIDED, USED, Colour, Sheet, brightened
from vision.annotate.tip import tip_panel


def _count(picture: np.ndarray, colour: Colour) -> int:
    """Return how many pixels have about this colour: drawn ones, for the frames themselves are gray."""
    return int(np.count_nonzero(_near(picture, colour)))


def _near(picture: np.ndarray, colour: Colour) -> np.ndarray:
    return np.abs(picture.astype(int) - np.array(colour)).max(axis=2) < 70


def _crowd(canvas: Canvas, rng: np.random.Generator) -> None:
    for _ in range(60):
        at = NOMINAL_TIP[0] + rng.uniform(-58, 58), NOMINAL_TIP[1] + rng.uniform(-58, 58)
        if rng.random() < 0.5:
            canvas.paint(canvas.ellipse(*at, rng.uniform(1.5, 3.5), 0.87, AXIS_DEG), 160.0)
        else:
            canvas.paint(canvas.bar(at, rng.uniform(0, 180), 14, 12), 170.0)


def test_a_found_tip_is_drawn_on_a_copy(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), 1, 0.3)
    before = frame.copy()
    tip = find_tip(frame, model)
    panel = tip_panel(frame, tip)
    assert np.array_equal(frame, before)
    bare = crop(frame, (int(tip.x_px) - 205, int(tip.y_px) - 275, 300, 350), 2)
    assert panel.pixels.shape == bare.shape
    assert np.mean(np.any(panel.pixels != bare, axis=2)) > 0.01
    for colour in (ANSWER, USED, THROWN):
        assert _count(panel.pixels, colour) > 10
    assert draw_tip(frame, tip).shape[0] > panel.pixels.shape[0]


def test_the_tip_itself_is_left_free(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), 1, 0.0)
    tip = find_tip(frame, model)
    close = tip_panel(frame, tip).pixels[700 - 8 - 204 : 700 - 8, 8 : 8 + 204]
    middle = close[102 - 8 : 102 + 8, 102 - 8 : 102 + 8]
    assert _count(middle, ANSWER) == 0
    assert _count(close, ANSWER) > 20


def test_what_was_seen_is_drawn_whatever_it_is(model: ProbeModel) -> None:
    frame = red_frame((Pad(431, 627, 17.0, 4.0), Pad(465, 600, 11.0)), Needle(), Camera(), 2)
    for around in (NOMINAL_TIP, (600.0, 600.0), (1.0, 1.0), (1599.0, 1199.0)):
        seen = find_test_points(frame, around)
        picture = draw_test_points(frame, seen, around)
        assert picture.dtype == np.uint8
        assert picture.max() > 100
    failure = NotFound(Reason.NO_NEEDLE, "a long message " * 20)
    assert draw_tip(frame, failure).shape == draw_tip(frame, failure, NOMINAL_TIP).shape


def test_each_verdict_has_its_colour() -> None:
    pads = (Pad(431, 627, 17.0, 4.0), Pad(465, 600, 11.0), Pad(468, 640, 6.5, 2.5))
    frame = red_frame(pads, None, Camera(), 2, lambda at, _: at.paint(at.ellipse(395, 600, 2.4, 0.87, AXIS_DEG), 150.0))
    seen = find_test_points(frame, NOMINAL_TIP)
    assert seen.taken[1:]
    assert seen.thrown
    assert seen.undecided
    panel = pads_panel(frame, seen, NOMINAL_TIP, None, None)
    for colour in (ANSWER, USED, THROWN, UNDECIDED):
        assert _count(panel.pixels, colour) > 15
    only = Searched(find_test_points(frame, NOMINAL_TIP, 30, 17.0), NOMINAL_TIP)
    assert _count(pads_panel(frame, *only, None, None).pixels, USED) == 0


def test_a_ring_lies_on_the_contour_it_stands_for() -> None:
    pad = Pad(431.3, 620.7, 17.0)
    frame = red_frame((pad,), None, Camera(noise=0.0), 2)
    seen = find_test_points(frame, NOMINAL_TIP)
    pixels = pads_panel(frame, seen, (600.0, 600.0), None, 5).pixels
    x, y, _, _ = seen.window_px
    rows, columns = np.nonzero(_near(pixels, ANSWER))
    drawn_x, drawn_y = (columns + 0.5) / 5 - 0.5 + x - 6, (rows + 0.5) / 5 - 0.5 + y - 6
    axis = np.radians(AXIS_DEG)
    along = (drawn_x - pad.x) * np.cos(axis) + (drawn_y - pad.y) * np.sin(axis)
    across = (drawn_y - pad.y) * np.cos(axis) - (drawn_x - pad.x) * np.sin(axis)
    rho = np.hypot(along / pad.ratio, across)
    near = (rho > 12.0) & (rho < 20.0)
    assert np.count_nonzero(near) > 100
    assert abs(float(np.median(rho[near])) - pad.radius_px) < 0.3


def test_both_frames_of_a_look_come_side_by_side(model: ProbeModel) -> None:
    needle = Needle(tip=(429.0, 619.0))
    white, red = white_frame(needle, Camera(), 1, 0.3), red_frame((Pad(431, 640, 17.0, 4.0),), needle, Camera(), 2)
    tip = find_tip(white, model)
    assert tip
    around = tip.x_px, tip.y_px
    searched = Searched(find_test_points(red, around, needle=tip), around)
    found = draw_look(white, tip, red, searched, model)
    assert found.shape[1] > draw_tip(white, tip).shape[1] + 500
    nothing = NotFound(Reason.NO_NEEDLE, "it is not there")
    for unfound in (
        draw_look(white, nothing, red, None, model),
        draw_look(white, nothing, red, Searched(find_test_points(red, around), around), None),
    ):
        # The verdict's ground tells at a glance.
        assert unfound[2, 2, 2] > unfound[2, 2, 1]
    assert found[2, 2, 1] > found[2, 2, 2]
    assert draw_untaught(white, NOMINAL_TIP, "no needle").shape[0] > 700


def test_without_a_tip_the_needle_is_shown_as_it_was_taught(model: ProbeModel) -> None:
    frame = white_frame(Needle(bend_deg=4.0), Camera(), 1, 0.0)
    bent = find_tip(frame, model)
    assert isinstance(bent, NotFound)
    assert _count(tip_panel(frame, bent, taught=model).pixels, FRAME) > 300
    assert _count(tip_panel(frame, bent, model.tip_px).pixels, FRAME) == 0


def test_the_close_up_is_as_bright_as_the_rest(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(gain=0.4), 1, 0.0)
    tip = find_tip(frame, model)
    assert tip
    pixels = tip_panel(frame, tip).pixels
    close = pixels[700 - 8 - 204 : 700 - 8, 8 : 8 + 204]
    assert abs(float(np.median(close)) - float(np.median(pixels))) < 15


def test_a_control_point_that_was_not_found_is_drawn_too() -> None:
    white = white_frame(None, Camera(), 1, 0.3)
    picture = draw_control_point(white, NotFound(Reason.NO_CONTROL_POINT, "none"), (3.0, 3.0))
    assert picture.max() > 100


def test_in_a_crowd_some_labels_are_left_out_and_counted() -> None:
    frame = red_frame((Pad(420, 640, 16.0),), None, Camera(), 3, _crowd)
    seen = find_test_points(frame, NOMINAL_TIP, 60)
    assert len(seen.thrown) + len(seen.undecided) + len(seen.taken) > MOST_LABELS
    panel = pads_panel(frame, seen, NOMINAL_TIP, None, None)
    assert any("small" in fact or "wrong size" in fact or "other size" in fact for fact in panel.facts[1:])


def _lie_on_each_other(one: Box, other: Box) -> bool:
    apart_x = one[0] >= other[0] + other[2] or other[0] >= one[0] + one[2]
    apart_y = one[1] >= other[1] + other[3] or other[1] >= one[1] + one[3]
    return not (apart_x or apart_y)


@given(
    spots=st.lists(st.tuples(st.floats(0, 599), st.floats(0, 599), st.floats(0, 60)), min_size=1, max_size=12),
    crowded=st.booleans(),
)
def test_labels_stay_on_the_sheet_and_off_each_other(spots: list[tuple[float, float, float]], crowded: bool) -> None:
    if crowded:
        spots = [(300.0 + x / 50, 300.0 + y / 50, 5.0) for x, y, _ in spots]
    labels = [Label("text", Spot(*spot), INK, (90, 18)) for spot in spots]
    boxes = [box for box, _ in arrange(labels, np.zeros((600, 600), np.uint8))]
    assert len(boxes) == len(labels)
    for x, y, width, height in boxes:
        assert x >= 0
        assert y >= 0
        assert x + width <= 600
        assert y + height <= 600
    assert not [pair for pair in combinations(boxes, 2) if _lie_on_each_other(*pair)]


def test_a_label_spares_what_is_drawn() -> None:
    busy = np.zeros((300, 300), np.uint8)
    busy[:, 150:] = 255
    ((x, _, width, _), line) = arrange([Label("text", Spot(148.0, 150.0, 2.0), INK, (60, 18))], busy)[0]
    assert x + width <= 150
    assert np.hypot(*(line[1] - line[0])) < 20


def test_a_label_larger_than_its_sheet_is_kept_at_its_corner() -> None:
    ((x, y, _, _), _) = arrange([Label("text", Spot(5.0, 5.0, 0.0), INK, (90, 18))], np.zeros((10, 10), np.uint8))[0]
    assert (x, y) == (2, 2)


def test_numbers_that_are_no_place_are_not_drawn() -> None:
    sheet = Sheet(np.zeros((40, 40, 3), np.uint8), (0, 0, 40, 40), 2)
    sheet.dashes((5.0, 5.0), (np.inf, np.nan), USED)
    sheet.dashes((5.0, 5.0), (np.nan, 3.0), USED)
    assert sheet.pixels.max() == 0
    sheet.cross((1e12, -1e12), 3.0, USED)
    assert sheet.finish().max() == 0


def test_dark_frames_are_brightened_and_bright_ones_left() -> None:
    dark = np.full((20, 20, 3), 20, np.uint8)
    seen, how = brightened(dark)
    assert seen.max() == 160
    assert "8.0 times" in how
    bright = np.full((20, 20, 3), 200, np.uint8)
    same, nothing = brightened(bright)
    assert np.array_equal(same, bright)
    assert nothing == ""


@pytest.mark.parametrize("size", [(3, 3), (119, 119), (300, 350), (701, 20), (2121, 2121)])
def test_a_piece_is_enlarged_to_the_room_or_shrunk_to_it(size: tuple[int, int]) -> None:
    zoom = fitting_zoom(size)
    assert max(size) * zoom <= PANEL_ROOM + 1
    assert zoom == 8 or max(size) * (zoom + 1) > PANEL_ROOM


def test_a_long_verdict_takes_more_lines(model: ProbeModel) -> None:
    panel = tip_panel(white_frame(None), NotFound(Reason.NO_NEEDLE, ""))
    short, long = (page(text, [panel], good=False) for text in ("word", "word " * 60))
    assert long.shape[0] > short.shape[0]
    assert long.shape[1] == short.shape[1]


def test_a_crop_is_magnified_and_black_outside() -> None:
    frame = np.full((50, 60, 3), 9, np.uint8)
    part = crop(frame, (-5, -5, 20, 10), zoom=3)
    assert part.shape == (30, 60, 3)
    assert np.all(part[:15] == 0)
    assert np.all(part[15:, 15:] == 9)
    with pytest.raises(ValueError, match="crop"):
        crop(frame, (0, 0, 0, 5))
