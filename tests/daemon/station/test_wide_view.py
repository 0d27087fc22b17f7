"""What is known of a map's far parts holds at the height at which it was learned, and for that map alone."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.station.wide_view import HEIGHTS_KEPT, Bend, WideView
from tests.daemon.procedures.fake_station import pose_map
from vision.geometry import PoseMap

TRUE_MAP = pose_map()


@pytest.fixture
def known() -> WideView:
    view = WideView()
    for height_um in (-400.0, 0.0):
        view.learned(TRUE_MAP, Bend(np.eye(3) + height_um, height_um))
    return view


@pytest.mark.parametrize(("height_um", "learned_at_um", "holds"), [
    (0.0, 0.0, True), (49.0, 0.0, True), (51.0, 0.0, False), (-180.0, 0.0, False), (-250.0, -400.0, False),
    (-420.0, -400.0, True), (-900.0, -400.0, False),
])  # fmt: skip
def test_the_nearest_height_is_offered_and_says_whether_it_holds(
    known: WideView, height_um: float, learned_at_um: float, holds: bool
) -> None:
    bend = known.of(TRUE_MAP, height_um)
    assert bend is not None
    assert (bend.height_um, bend.holds_at(height_um)) == (learned_at_um, holds)


def test_what_is_learned_anew_at_a_height_takes_the_place_of_what_was(known: WideView) -> None:
    known.learned(TRUE_MAP, Bend(np.full((3, 3), 7.0), 20.0))
    there, above = known.of(TRUE_MAP, 0.0), known.of(TRUE_MAP, -400.0)
    assert there is not None
    assert above is not None
    assert (there.height_um, above.height_um) == (20.0, -400.0)


def test_another_map_knows_nothing_and_forgets_the_first(known: WideView) -> None:
    other = PoseMap.from_json(TRUE_MAP.to_json())
    assert known.of(other, 0.0) is None
    known.learned(other, Bend(np.eye(3), 0.0))
    assert known.of(TRUE_MAP, 0.0) is None


def test_no_more_heights_are_kept_than_some(known: WideView) -> None:
    for k in range(1, 2 * HEIGHTS_KEPT):
        known.learned(TRUE_MAP, Bend(np.eye(3), 1000.0 * k))
    oldest = known.of(TRUE_MAP, 0.0)
    assert oldest is not None
    assert oldest.height_um == 1000.0 * HEIGHTS_KEPT
