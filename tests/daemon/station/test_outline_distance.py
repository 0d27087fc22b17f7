"""Whether an area comes as near to an outline as asked, against a plain count of places."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.station.outline_distance import Outlines, near
from vision.geometry import Array

L_SHAPE = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0)])


def along(outline: Array, step: float = 0.05) -> Array:
    """Return places all along an outline's line."""
    ends = np.roll(outline, -1, axis=0)
    shares = np.arange(0.0, 1.0, step / 20.0)[:, None, None]
    places: Array = (outline + shares * (ends - outline)).reshape(-1, 2)
    return places


@given(st.lists(st.tuples(st.floats(-5.0, 15.0), st.floats(-5.0, 15.0)), min_size=3, max_size=8), st.floats(0.0, 4.0))
def test_an_area_is_near_an_outline_if_any_of_its_places_is(corners: list[tuple[float, float]], reach: float) -> None:
    """It should agree with the nearest of many places, but for the step between them."""
    hull = cv2.convexHull(np.array(corners, dtype=np.float32))
    area = np.array(corners[:1] if hull is None else hull, dtype=float).reshape(-1, 2)
    lines, others = along(area), along(L_SHAPE)
    apart = float(np.hypot(*np.moveaxis(lines[:, None] - others[None], 2, 0)).min())
    inside = any(cv2.pointPolygonTest(L_SHAPE.astype(np.float32), (float(x), float(y)), False) >= 0 for x, y in lines)
    if inside or apart <= reach - 0.1:
        assert near(area, L_SHAPE, reach + 1e-3)
    elif apart > reach + 0.1 and not Outlines([area]).hold((1.0, 1.0)):
        assert not near(area, L_SHAPE, reach)


@pytest.mark.parametrize(
    ("area", "reach", "filled", "is_near"),
    [
        ([(6.0, 6.0), (8.0, 8.0)], 1.9, True, False),  # in the notch of the L, a way and no area
        ([(6.0, 6.0), (8.0, 8.0)], 2.1, True, True),
        ([(1.0, 1.0), (2.0, 1.0), (2.0, 2.0)], 0.5, True, True),  # within it
        ([(1.0, 1.0), (2.0, 1.0), (2.0, 2.0)], 0.5, False, False),  # within its line, and away from that
        ([(-5.0, 3.0), (15.0, 3.0), (15.0, 3.5)], 0.0, False, True),  # through it, no corner near
        ([(-5.0, -5.0), (15.0, -5.0), (15.0, 15.0), (-5.0, 15.0)], 0.5, False, True),  # all about it
    ],
)
def test_near_by_hand(area: list[tuple[float, float]], reach: float, filled: bool, is_near: bool) -> None:
    assert near(np.array(area), L_SHAPE, reach, filled=filled) == is_near


def test_a_place_is_held_by_any_of_several_outlines_and_by_their_lines() -> None:
    both = Outlines([L_SHAPE, L_SHAPE + 20.0])
    assert both.hold((1.0, 1.0))
    assert both.hold((24.0, 29.0))
    assert not both.hold((8.0, 8.0))
    assert not Outlines([]).hold((1.0, 1.0))
