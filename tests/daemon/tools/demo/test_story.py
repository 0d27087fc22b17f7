"""A demonstration's figures are the truth's: what was said is held against what the needle really met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.domain.point_test import Cause, PointReading, PointRecord, PointVerdict, Rung
from daemon.domain.results import JobResult
from daemon.tools.demo.story import Story, judge
from daemon.tools.demo.truth_log import COIN, Stretch, Stroke
from tests.daemon.domain.test_board_run import a_record

NAMES = ("A", "B", "C", "D")
OVER = Stroke(0.0, first=True, material="metal", nets=("NA",), joined=("NA",))
COIN_TOUCH = Stroke(0.0, first=True, material="metal", nets=(COIN,))


class _Fixture:
    """Every point's net is its name with an N before; some are broken."""

    def __init__(self, broken: Sequence[str] = ()) -> None:
        self._broken = broken

    def net_of(self, point: Any) -> str:
        return f"N{point.name}"

    def is_sound(self, point: Any, _happened: Stretch) -> bool:
        return point.name not in self._broken


def _on(name: str, *, first: bool = True, **facts: Any) -> Stroke:
    return replace(OVER, first=first, nets=(f"N{name}",), **facts)


def _beside() -> Stroke:
    return replace(OVER, material="mask", nets=(), error_um=287.0)


def _record(name: str, verdict: PointVerdict, presses: int = 1, **facts: Any) -> PointRecord:
    return a_record(name, verdict, facts.pop("touches", presses), **facts).model_copy(update={"presses": presses})


def _reading(*, proof: bool) -> PointReading:
    return PointReading(
        rung=Rung.LOOK, site_um=(0.0, 0.0), pressed_um=300.0, force_n=0.5, proof=proof, seen=True, value=None,
        overload=True, unit="ohm",
    )  # fmt: skip


def _judged(
    records: Sequence[PointRecord], strokes: Sequence[Stroke], broken: Sequence[str] = (), outcome: str = "run_done",
    **log: Any,
) -> Story:  # fmt: skip
    board: Any = SimpleNamespace(points=[SimpleNamespace(name=name) for name in NAMES])
    result = JobResult(id="r", op="run", ok=True, outcome=outcome, seq=1, station="s", finished_at="")
    happened = Stretch(strokes=list(strokes), **log)
    fixture: Any = _Fixture(broken)
    return judge(board, records, result, len(records), fixture, happened)


def _whole() -> tuple[list[PointRecord], list[Stroke]]:
    records = [
        _record("A", PointVerdict.PASS_FIRST),
        _record("B", PointVerdict.PASS_RECOVERED, 2, recovered_by=Rung.LOOK, cause=Cause.MISPLACED),
        _record("C", PointVerdict.PASS_RECOVERED, 3, touches=1, recovered_by=Rung.PUMP),
        _record("D", PointVerdict.OPEN_CONFIRMED, 2),
    ]
    strokes = [
        COIN_TOUCH, _on("A"), _beside(), _on("B"), _on("C", soil_ohm=50.0), _on("C", first=False),
        _on("C", first=False), _on("D"), COIN_TOUCH, _on("D"),
    ]  # fmt: skip
    return records, strokes


def test_a_film_that_broke_at_the_second_press_was_not_recovered_by_eye() -> None:
    record = _record("A", PointVerdict.PASS_RECOVERED, 2, recovered_by=Rung.LOOK, cause=Cause.FILM)
    story = _judged([record], [COIN_TOUCH, _on("A", soil_ohm=50.0), _on("A")])
    assert "1 recovered (1 by a second press)" in story.sentence(1.0)


def test_the_line_tells_false_opens_what_cured_them_and_true_ones() -> None:
    story = _judged(*_whole(), broken="D")
    assert story.good
    assert story.sentence(1.0).startswith(
        "4 nets: 2 false opens at first touch, 2 recovered (1 by eye, 1 by pumping), 1 true open confirmed, 0 wrong, "
        "0 scratches, "
    )
    assert [one.truth for one in story.points] == [
        "net whole, first touch on the pad", "net whole, first touch on mask, 287 um from the nearest pad's middle",
        "net whole, first touch on the pad, through a film", "net broken, first touch on the pad",
    ]  # fmt: skip


def test_a_broken_net_whose_harness_nobody_can_vouch_for_is_told_as_such() -> None:
    proofs = tuple(_reading(proof=True) for _ in range(2))
    record = _record("A", PointVerdict.CONTACT_NOT_MADE, 2, readings=proofs, elsewhere=1)
    touches = [_on("A"), COIN_TOUCH, _on("A"), _on("B"), _on("B")]
    passed = _record("B", PointVerdict.PASS_FIRST)
    story = _judged([record, passed], touches, broken="A")
    assert story.good
    assert "1 open in net or harness" in story.sentence(1.0)
    assert not _judged([record, passed], touches).good, "of a net that is whole it is no answer"


@pytest.mark.parametrize(
    ("name", "verdict", "broken", "strokes", "wrong"),
    [
        ("A", PointVerdict.PASS_FIRST, "", [_on("B")], "pass through NB"),
        ("A", PointVerdict.PASS_FIRST, "A", [_on("A")], "pass on a broken net"),
        ("A", PointVerdict.OPEN_CONFIRMED, "", [_on("A")], "open_confirmed on a sound net"),
        ("A", PointVerdict.FAIL, "", [_on("A")], "fail on a sound net"),
        ("A", PointVerdict.OPEN_CONFIRMED, "A", [_on("A")], None),
    ],
)
def test_a_verdict_that_the_truth_contradicts_is_wrong(
    name: str, verdict: PointVerdict, broken: str, strokes: list[Stroke], wrong: str | None
) -> None:
    story = _judged([_record(name, verdict)], strokes, broken=broken)
    assert story.points[0].wrong == wrong
    assert story.good is (wrong is None)
    assert f"{int(wrong is not None)} wrong" in story.sentence(1.0)


@pytest.mark.parametrize("verdict", [PointVerdict.NOT_TESTED, PointVerdict.CONTACT_NOT_MADE])
def test_a_net_without_an_answer_is_told_and_is_no_success(verdict: PointVerdict) -> None:
    story = _judged([_record("A", verdict, 0)], [])
    assert not story.good
    assert "1 without an answer" in story.sentence(1.0)


@pytest.mark.parametrize("spoiled", [{"scratches": 1}, {"dents": 1}])
def test_a_scratch_or_a_dent_is_no_success(spoiled: dict[str, int]) -> None:
    assert not _judged(*_whole(), broken="D", **spoiled).good


def test_a_run_that_stopped_is_no_success() -> None:
    assert not _judged(*_whole(), broken="D", outcome="run_stopped").good


@pytest.mark.parametrize("missing", [0, 1])
def test_touches_that_nobody_recorded_or_the_log_has_not_are_odd(missing: int) -> None:
    records, strokes = _whole()
    story = _judged(records, strokes[:-1] if missing else [*strokes, _on("D")], broken="D")
    assert story.odd
    assert not story.good


def test_the_time_a_point_is_the_stations() -> None:
    record = _record("A", PointVerdict.PASS_FIRST).model_copy(update={"seconds": 0.5})
    assert _judged([record], [_on("A")]).sentence(2.0).endswith("1.0 s a point by the station's clock")
    assert _judged([record], [_on("A")]).sentence(1.0).endswith("0.5 s a point")


def test_a_reading_is_no_stroke_of_another_point() -> None:
    """Each record takes its own touches off the log, however many strokes they have."""
    records, strokes = _whole()
    assert [len(one.strokes) for one in _judged(records, strokes, broken="D").points] == [1, 2, 3, 2]
