"""The timeline of a correction, read from what a bench has kept."""

import json
from pathlib import Path

import cv2
import pytest

from tests.bench.cycle.draw import draw, median
from tests.bench.cycle.legs import Leg, Way
from tests.bench.cycle.line import Exchange
from tests.bench.cycle.timeline import Span, Timeline, corrections

CORRECTION = [
    ("triggered", 10.0),
    ("triggered", 10.1),
    ("look", 10.2),
    ("move", 10.6),
    ("verify", 10.9),
    ("verify", 11.3),
]
PLACE = [(name, when_s - 5.0) for name, when_s in CORRECTION]
LEG = Leg(10.65, {"x": Way(0.0, 35.0, 1000.0, 14_000.0), "y": Way(0.0, 14.0, 1000.0, 14_000.0)})


def marks(*jobs: list[tuple[str, float]], frames: tuple[float, ...] = ()) -> list[str]:
    states = [json.dumps([when_s, "state", name]) for job in jobs for name, when_s in job]
    return states + [json.dumps([when_s, "frame", when_s - 0.08, 0.02]) for when_s in frames]


def switched(*told: tuple[float, int]) -> list[Exchange]:
    return [Exchange(at_s, at_s + 0.01, bytes([5, 0x0F, 0, 0, 0, 2, 1, state, 0, 0]), bytes(8)) for at_s, state in told]


LAMPS = switched((10.15, 1), (10.3, 2), (10.45, 1), (11.0, 2), (11.2, 0))


def test_a_correction_is_told_with_states_light_frames_moves_and_line() -> None:
    """It should count from when the correction began, and keep what does not belong to it out."""
    before = switched((5.15, 1), (5.3, 0))
    (one,) = corrections(marks(PLACE, CORRECTION, frames=(5.3, 10.3, 10.5)), [*before, *LAMPS], [LEG])
    assert one.seconds == pytest.approx(1.2)
    assert [(span.name, round(span.begun_s, 3), round(span.over_s, 3)) for span in one.states] == [
        ("triggered", 0.0, 0.1), ("look", 0.1, 0.5), ("move", 0.5, 0.8), ("verify", 0.8, 1.2)
    ]  # fmt: skip
    assert [span.name for span in one.lamps] == ["white", "red", "white", "red", "dark"]
    assert one.lamps[0] == Span("white", pytest.approx(0.06), pytest.approx(0.21))
    assert one.exposures[0] == Span("", pytest.approx(0.12), pytest.approx(0.14))
    assert one.frames[0] == Span("", pytest.approx(0.12), pytest.approx(0.2))
    assert len(one.frames) == 2
    assert one.moves == (
        Span("x", pytest.approx(0.55), pytest.approx(0.65)),
        Span("y", pytest.approx(0.55), pytest.approx(0.55 + 2.0 * (14.0 / 14_000.0) ** 0.5)),
    )
    assert len(one.line) == len(LAMPS)


def test_a_job_without_two_looks_or_that_was_cut_off_is_no_correction() -> None:
    assert corrections(marks(PLACE), switched((5.15, 1), (5.3, 0)), []) == []
    assert corrections(marks(CORRECTION[:4]), LAMPS, []) == []
    again = [*CORRECTION[:5], ("move", 11.0), ("verify", 11.1), ("verify", 11.3)]
    assert corrections(marks(again), LAMPS, []) == []


def test_the_drawing_shows_the_correction_of_median_length(tmp_path: Path) -> None:
    found = corrections(marks(CORRECTION), LAMPS, [LEG])
    longer = [Timeline(seconds, *[()] * 6) for seconds in (0.9, 1.5)]
    assert median([*longer, *found]) is found[0]
    draw(found[0], tmp_path / "one.png")
    picture = cv2.imread(str(tmp_path / "one.png"))
    assert picture is not None
    assert (picture == (108, 117, 217)).all(axis=2).sum() > 1000, "the red lamp"
    assert (picture == (84, 111, 31)).all(axis=2).sum() > 500, "the moves"
