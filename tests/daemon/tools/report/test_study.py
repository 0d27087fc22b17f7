"""A type-1 study says what the textbook says, and its page is drawn again from its numbers."""

from __future__ import annotations

import json
import math
import random
import statistics
from pathlib import Path
from typing import Any, Self

import pytest
from typer.testing import CliRunner

from daemon.cli import study as command
from daemon.cli.app import app
from daemon.client import NoAnswer, Refused
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody, JobResult
from daemon.tools.report.study import WANTED, Study, capability, study_page, write_study

pytestmark = pytest.mark.usefixtures("logging_as_before")
# Ten values of a mean of 2 and a standard deviation of 1.5, by construction
TEN = [2.0 + 1.5 * z * math.sqrt(9 / 10) for z in (1, -1, 1, -1, 1, -1, 1, -1, 1, -1)]


def _study(spread_um: float, bias_um: float = 0.0, tolerance_um: float = 100.0) -> Study:
    chance = random.Random(7)
    dx, dy = ([bias_um + chance.gauss(0, spread_um) for _ in range(50)] for _ in range(2))
    return Study(station="s", made_at="2026-01-31T12:00:00+00:00", test_point="TP7", tolerance_um=tolerance_um,
                 dx_um=dx, dy_um=dy)  # fmt: skip


def test_cg_and_cgk_are_those_of_the_textbook() -> None:
    assert statistics.stdev(TEN) == pytest.approx(1.5)
    found = capability(TEN, 60.0)
    assert found.cg == pytest.approx(0.2 * 60 / (6 * 1.5))
    assert found.cgk == pytest.approx((0.1 * 60 - 2.0) / (3 * 1.5))
    assert capability([0.0] * 10, 60.0).cg == math.inf
    assert capability([7.0] * 10, 60.0).cgk == -math.inf
    with pytest.raises(ValueError, match="10 or more"):
        capability(TEN[:9], 60.0)


@pytest.mark.parametrize(("spread", "bias", "good"), [(1.0, 0.0, True), (10.0, 0.0, False), (1.0, 8.0, False)])
def test_the_verdict_heeds_spread_and_bias(spread: float, bias: float, good: bool) -> None:
    page = study_page(_study(spread, bias))
    assert page.verdict.good is good
    assert any(number.bad for number in page.numbers) is not good
    assert all(number.limit for number in page.numbers if number.bad), "what is bad has its limit beside it"


def test_the_page_is_drawn_again_from_its_numbers(tmp_path: Path) -> None:
    write_study(_study(2.0), tmp_path / "study.html")
    again = CliRunner().invoke(
        app, ["study", "--redraw", str(tmp_path / "study.json"), "-o", str(tmp_path / "again.html")]
    )
    assert again.exit_code == 0, again.output
    assert "Cgk" in again.output
    assert (tmp_path / "again.html").read_text() == (tmp_path / "study.html").read_text()
    wrong = CliRunner().invoke(app, ["study", "--redraw", str(tmp_path / "study.html")])
    assert wrong.exit_code == 2
    assert CliRunner().invoke(app, ["study"]).exit_code == 2


@pytest.mark.parametrize(("spread", "bias"), [(10.0, 0.0), (1.0, 8.0)])
def test_the_smallest_tolerance_that_is_good_enough_is_said(spread: float, bias: float) -> None:
    """Nobody can act on a bare verdict."""
    page = study_page(_study(spread, bias))
    rows = {number.label: number for number in page.numbers}
    least = max(float(str(rows[f"{axis}: smallest T for which both are {WANTED}"].value)) for axis in "XY")
    assert study_page(_study(spread, bias, tolerance_um=least * 1.001)).verdict.good
    assert not study_page(_study(spread, bias, tolerance_um=least * 0.999)).verdict.good
    assert f"from {math.ceil(least)} um on" in page.verdict.because


class _Station:
    """Answers as a station does at which the looks from one of them on fail."""

    fails_from = 12

    def __init__(self, _endpoint: str) -> None:
        self.looks = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def request(self, _op: str) -> dict[str, Any]:
        return {"station": "s", "board": {"test_points": [{"name": "TP7", "x_um": 0.0, "y_um": 0.0}]}}

    def job(self, op: str, **_: Any) -> JobResult:
        self.looks += op == "look"
        error = ErrorBody.of(Fault(FaultCode.TIP_NOT_FOUND)) if self.looks >= self.fails_from else None
        return JobResult(
            id="j", op=op, ok=error is None, seq=1, station="s", finished_at="t", outcome="seen", error=error,
            detail={"dx_um": 1.0 + self.looks % 2, "dy_um": -1.0},
        )  # fmt: skip


def test_landings_are_not_thrown_away_for_one_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "Client", _Station)
    made = CliRunner().invoke(app, ["study", "TP7", "--times", "20", "-o", str(tmp_path / "study.html")])
    assert made.exit_code == 1
    assert "only 11 of 20 landings are in it" in made.output
    assert "tip" in made.output
    kept = Study.model_validate_json((tmp_path / "study.json").read_text())
    assert len(kept.dx_um) == 11
    monkeypatch.setattr(_Station, "fails_from", 9)
    few = CliRunner().invoke(app, ["study", "TP7", "--times", "20", "-o", str(tmp_path / "few.html")])
    assert few.exit_code == 1
    assert not (tmp_path / "few.html").exists()


@pytest.mark.parametrize(
    "trouble", [Refused(ErrorBody.of(Fault(FaultCode.BUSY, "a job runs")).model_dump()), NoAnswer("no answer in time")]
)
def test_landings_are_not_thrown_away_for_a_station_that_takes_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: Exception
) -> None:
    """Somebody else's job began, or the daemon went away: nothing is wrong with what was measured."""

    class Leaves(_Station):
        def job(self, op: str, **fields: Any) -> JobResult:
            if self.looks == self.fails_from - 1:
                raise trouble
            return super().job(op, **fields)

    monkeypatch.setattr(command, "Client", Leaves)
    made = CliRunner().invoke(app, ["study", "TP7", "--times", "20", "-o", str(tmp_path / "study.html")])
    assert made.exit_code == 1
    assert "only 11 of 20 landings are in it" in made.output
    assert ("a job runs" in made.output) or ("no answer in time" in made.output)
    assert len(Study.model_validate_json((tmp_path / "study.json").read_text()).dx_um) == 11
    monkeypatch.setattr(_Station, "fails_from", 9)
    few = CliRunner().invoke(app, ["study", "TP7", "--times", "20", "-o", str(tmp_path / "few.html")])
    assert few.exit_code == 1
    assert "landing 9: " in few.output
    assert not (tmp_path / "few.html").exists()


def test_landings_are_not_thrown_away_for_ctrl_c_and_the_head_stops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []
    cancelled: list[str] = []

    class Interrupted(_Station):
        def job(self, op: str, **fields: Any) -> JobResult:
            begun.append(fields["job_id"])
            if self.looks == self.fails_from - 1:
                raise KeyboardInterrupt
            return super().job(op, **fields)

        def request(self, op: str, **fields: Any) -> dict[str, Any]:
            if op == "cancel":
                cancelled.append(fields["id"])
            return super().request(op)

    monkeypatch.setattr(command, "Client", Interrupted)
    made = CliRunner().invoke(app, ["study", "TP7", "--times", "20", "-o", str(tmp_path / "study.html")])
    assert made.exit_code == 1
    assert "only 11 of 20 landings are in it; the next one: it was interrupted" in made.output
    assert len(Study.model_validate_json((tmp_path / "study.json").read_text()).dx_um) == 11
    assert cancelled == begun[-1:]
    monkeypatch.setattr(_Station, "fails_from", 9)
    few = CliRunner().invoke(app, ["study", "TP7", "--times", "20", "-o", str(tmp_path / "few.html")])
    assert (few.exit_code, "interrupted" in few.output) == (1, True)
    assert not (tmp_path / "few.html").exists()


@pytest.mark.parametrize("what", ["a folder", "below a file", "numbers", "another's numbers", "nothing"])
def test_a_page_that_cannot_be_written_or_would_replace_another_file_is_refused_before_the_first_landing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "board.json").write_text('{"name": "b"}')
    page = {"a folder": "folder.html", "below a file": "board.json/x.html", "numbers": "board.json",
            "another's numbers": "board.html", "nothing": ""}[what]  # fmt: skip
    monkeypatch.setattr(command, "Client", None)
    refused = CliRunner().invoke(app, ["study", "TP7", "-o", str(tmp_path / page) if page else ""])
    assert refused.exit_code == 2, refused.output
    assert "-o" in refused.output
    assert (tmp_path / "board.json").read_text() == '{"name": "b"}'
    assert sorted(one.name for one in tmp_path.iterdir()) == ["board.json", "folder.html"]


def test_a_study_that_comes_to_nothing_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(_endpoint: str) -> None:
        raise NoAnswer("nobody is there")

    monkeypatch.setattr(command, "Client", nobody)
    failed = CliRunner().invoke(app, ["study", "TP7", "-o", str(tmp_path / "missing" / "x" / "a.html")])
    assert failed.exit_code == 1, failed.output
    assert list(tmp_path.iterdir()) == []


def test_what_has_no_end_is_null_for_machines(tmp_path: Path) -> None:
    still = _study(1.0).model_copy(update={"dx_um": (1.0,) * 10, "dy_um": (1.0,) * 10})
    write_study(still, tmp_path / "study.html")
    drawn = CliRunner().invoke(
        app, ["study", "--redraw", str(tmp_path / "study.json"), "-o", str(tmp_path / "study.html"), "--json"]
    )

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    assert json.loads(drawn.stdout, parse_constant=refuse)["x"]["cg"] is None


def test_numbers_in_which_a_landing_lacks_its_y_are_refused_in_words(tmp_path: Path) -> None:
    whole = _study(1.0, 0.0).model_dump(mode="json")
    (tmp_path / "s.json").write_text(json.dumps(whole | {"dx_um": [*whole["dx_um"], 1.0]}))
    wrong = CliRunner().invoke(app, ["study", "--redraw", str(tmp_path / "s.json"), "-o", str(tmp_path / "p.html")])
    assert wrong.exit_code == 2
    assert "a y" in wrong.output
