"""After a calibration that failed the command says which one holds."""

from typing import Any

import pytest

from daemon.cli.progress import figure_words, in_force_words, undone_words


@pytest.mark.parametrize(
    ("detail", "words"),
    [
        ({"what": "map", "in_force": "old", "made_at": "2026-03-04T05:06:07"}, "old map, made 2026-03-04T05:06:07"),
        ({"what": "map", "in_force": "new", "made_at": "2026-05-04T07:00:00"}, "new map, made 2026-05-04T07:00:00"),
        ({"what": "surface", "in_force": "none", "made_at": None}, "no surface"),
        ({"what": "tip", "in_force": "old", "probe": "0123abcd"}, "old tip"),
    ],
)
def test_which_calibration_is_in_force_is_said_with_its_time(detail: dict[str, Any], words: str) -> None:
    assert in_force_words(detail) == words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"verified": True, "places": 4, "agreement": 0.953}, "verified yes, places 4, agreement 0.953"),
        ([36.8, 55.8], "36.8, 55.8"), ([], ""), (True, "yes"), (None, "none"), ("map", "map"), (14937.7, "14937.7"),
    ],
)  # fmt: skip
def test_a_results_figures_are_no_python(value: object, words: str) -> None:
    assert figure_words(value) == words


def test_what_a_new_tip_undoes_is_said_with_what_can_be_typed() -> None:
    void, following = undone_words({"void": ["map", "surface"], "next": ["calibrate map", "align"]})
    assert void.endswith(": map, surface")
    assert following == "next: `reprobe calibrate map`, then `reprobe align`"
    assert undone_words({"void": [], "next": []}) == undone_words({}) == []
