"""The pad that is meant is chosen by its neighbourhood, or none is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision.geometry.constellation import ConstellationMatch, NoMatch, match_near, match_target

LIMITS = {"max_shift_um": 700.0, "tolerance_um": 100.0, "reach_um": 700.0}


def test_the_nearest_is_not_taken_when_it_is_the_neighbour() -> None:
    """A placement error of 300 um over two tangent sites 450 um apart: the wrong one is nearer."""
    cad = [(0.0, 0.0), (450.0, 0.0)]
    seen = [(-300.0, 0.0), (150.0, 0.0)]
    match = match_target(seen, cad, **LIMITS)
    assert isinstance(match, ConstellationMatch)
    assert match.index == 0
    assert match.shift_um == pytest.approx((-300.0, 0.0))
    assert match.agreeing == 2


def test_a_neighbour_alone_is_refused_when_the_target_should_be_seen() -> None:
    answer = match_target([(150.0, 0.0)], [(0.0, 0.0), (-450.0, 0.0)], **LIMITS)
    assert isinstance(answer, NoMatch)
    assert answer.reason == "contradicted"
    assert not answer


def test_a_neighbour_behind_the_needle_does_not_count_as_missing() -> None:
    cad = [(0.0, 0.0), (-450.0, 0.0)]
    match = match_target([(150.0, 0.0)], cad, **LIMITS, hidden=lambda places: [p[0] < -200 for p in places])
    assert isinstance(match, ConstellationMatch)


def test_two_shifts_that_explain_everything_are_ambiguous() -> None:
    """Two pads of which CAD knows only one: nothing tells which."""
    cad = [(0.0, 0.0), (1400.0, 0.0)]
    seen = [(-690.0, 0.0)]
    assert isinstance(match_target(seen, cad, **LIMITS), ConstellationMatch)
    row = [(0.0, 0.0), (500.0, 0.0), (1000.0, 0.0), (-500.0, 0.0), (-1000.0, 0.0)]
    answer = match_target([(-250.0, 0.0), (250.0, 0.0)], row, **LIMITS)
    assert isinstance(answer, NoMatch)
    assert answer.reason == "ambiguous"
    assert set(answer.candidates) == {0, 1}


def test_nothing_seen_and_nothing_near() -> None:
    assert match_target([], [(0.0, 0.0)], **LIMITS) == NoMatch("none_near", ())
    assert match_target([(900.0, 0.0)], [(0.0, 0.0)], **LIMITS) == NoMatch("none_near", (0,))


def test_a_stray_object_is_outweighed_by_two_that_agree_and_not_by_one() -> None:
    cad = [(0.0, 0.0), (450.0, 0.0)]
    stray = (300.0, 500.0)
    match = match_target([(50.0, 0.0), (500.0, 0.0), stray], cad, **LIMITS)
    assert isinstance(match, ConstellationMatch)
    assert match.index == 0
    assert isinstance(match_target([(50.0, 0.0), stray], [(0.0, 0.0)], **LIMITS), NoMatch)


def test_a_doubtful_object_is_dismissed_when_the_pads_seen_speak_against_it() -> None:
    """With the one pad of the neighbourhood seen, something else near the tip cannot be it too."""
    match = match_target([(300.0, 0.0)], [(0.0, 0.0)], **LIMITS, doubtful_um=[(-100.0, 50.0)])
    assert isinstance(match, ConstellationMatch)
    assert match.index == 0


def test_a_doubtful_object_that_may_be_the_target_is_never_taken() -> None:
    answer = match_target([], [(0.0, 0.0)], **LIMITS, doubtful_um=[(-100.0, 50.0)])
    assert answer == NoMatch("undecided", (0,))
    pair = [(0.0, 0.0), (450.0, 0.0)]
    answer = match_target([(500.0, 0.0)], pair, **LIMITS, doubtful_um=[(50.0, 0.0)])
    assert answer == NoMatch("ambiguous", (0, 1)), "the pad seen may be the neighbour, and its partner the one in doubt"


def test_where_the_place_is_known_strays_farther_off_do_not_matter() -> None:
    """A stroke of silkscreen taken for a via contradicts the neighbourhood, but not a place known beforehand."""
    objects = [(1900.0, 300.0), (25.0, -10.0)]
    assert match_target(objects, [(0.0, 0.0)], **{**LIMITS, "max_shift_um": 2500.0}).__class__ is NoMatch
    assert match_near(objects, [(0.0, 0.0)], shift_um=(0.0, 0.0), trust_um=120.0) == 1
    assert match_near(objects, [(0.0, 0.0)], shift_um=(1900.0, 250.0), trust_um=120.0) == 0


@pytest.mark.parametrize(
    ("objects", "cad"),
    [
        ([], [(0.0, 0.0)]),
        ([(130.0, 0.0)], [(0.0, 0.0)]),
        ([(30.0, 0.0), (-60.0, 20.0)], [(0.0, 0.0)]),
        ([(30.0, 0.0)], [(0.0, 0.0), (200.0, 100.0)]),
    ],
    ids=["nothing", "too far off", "two of them", "CAD has a neighbour as near"],
)
def test_a_known_place_decides_nothing_unless_one_thing_alone_is_there(
    objects: list[tuple[float, float]], cad: list[tuple[float, float]]
) -> None:
    assert match_near(objects, cad, shift_um=(0.0, 0.0), trust_um=120.0) is None


place = st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000))


@given(st.lists(place, min_size=1, max_size=6), st.tuples(st.floats(-400, 400), st.floats(-400, 400)), st.randoms())
def test_never_the_wrong_pad(others: list[tuple[float, float]], shift: tuple[float, float], rnd: object) -> None:
    """Whatever the neighbourhood, with every pad of the window seen, the answer is the target or none."""
    cad = np.array([(0.0, 0.0), *others])
    moved = cad + shift
    visible = np.linalg.norm(moved, axis=1) <= LIMITS["reach_um"]
    index = np.flatnonzero(visible)
    answer = match_target(moved[index], cad, **LIMITS)
    if isinstance(answer, ConstellationMatch):
        chosen = moved[index[answer.index]]
        assert np.linalg.norm(chosen - moved[0]) <= 2 * LIMITS["tolerance_um"]
