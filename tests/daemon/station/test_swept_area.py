"""The area over which the head passes holds every place where it may be on its way."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.station.swept_area import swept_areas_um
from drivers.gantry import Position
from vision.geometry import rotation
from vision.head.model import CircleHead

HEAD = CircleHead(14_938.0, -3.0)
BOX = ((-20_000.0, -5_000.0), (30_000.0, -5_000.0), (30_000.0, 40_000.0), (-20_000.0, 40_000.0))
places = st.builds(Position, st.floats(0.0, 2e5), st.floats(0.0, 1.5e5), st.just(5200.0), st.floats(-220.0, 100.0))
share = st.floats(0.0, 1.0)


@given(places, places, share, share, share, st.sampled_from(BOX))
def test_a_corner_of_the_head_never_leaves_the_area(
    start: Position, end: Position, x: float, y: float, turn: float, corner: tuple[float, float]
) -> None:
    """It should hold for each axis on its own way: X, Y and theta keep no step with each other."""

    def between(first: float, last: float, gone: float) -> float:
        return first + gone * (last - first)

    theta = between(start.theta_deg, end.theta_deg, turn)
    head = np.array((between(start.x_um, end.x_um, x), between(start.y_um, end.y_um, y)))
    place = head + HEAD.tip_offset_um(theta) + rotation(theta) @ np.array(corner)
    (area,) = swept_areas_um([start, end], HEAD, BOX)
    contour = area.astype(np.float32)
    inside_um = cv2.pointPolygonTest(contour, (float(place[0]), float(place[1])), measureDist=True)
    assert inside_um >= -0.1


def test_the_needle_on_a_straight_way_covers_the_box_of_its_ends_and_each_part_of_a_way_is_told() -> None:
    way = [Position(1e4, 2e4, 0.0, 0.0), Position(9e3, 2e4, 0.0, 0.0), Position(1e4, 3e4, 0.0, 0.0)]
    first, second = swept_areas_um(way, HEAD)
    dx, dy = HEAD.tip_offset_um(0.0)
    assert np.ptp(first, axis=0) == pytest.approx((1000.0, 0.0), abs=0.02)
    assert second.min(axis=0) == pytest.approx((9e3 + dx, 2e4 + dy), abs=0.02)
    assert np.ptp(second, axis=0) == pytest.approx((1000.0, 10_000.0), abs=0.02)
    assert math.isclose(float(cv2.contourArea(second.astype(np.float32))), 1e7, rel_tol=1e-4)


def test_a_head_that_stays_has_the_area_of_its_place() -> None:
    here = Position(1e4, 2e4, 0.0, 0.0)
    (area,) = swept_areas_um([here, here], HEAD)
    assert area == pytest.approx(np.array([np.add((1e4, 2e4), HEAD.tip_offset_um(0.0))]))
