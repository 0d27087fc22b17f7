"""The demonstration of the fleet gives the answers that were planted, and says so where one is another."""

from __future__ import annotations

from html import escape
from pathlib import Path

import pytest

from tests.fleet.dashboards import dashboards
from tests.fleet.demo.__main__ import LEAST_BOARDS, main
from tests.fleet.demo.answers import QUESTIONS, Question
from tests.fleet.demo.planted import BAD_POINT, DRIFTS


@pytest.mark.timeout(400)
def test_ten_stations_records_answer_what_was_planted_and_dashboards_show_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ["--boards", str(LEAST_BOARDS), "--seconds", "0", "--draw", str(tmp_path)]
    assert main(arguments) == 0, capsys.readouterr().out
    said = capsys.readouterr().out
    assert f"{len(QUESTIONS)} of {len(QUESTIONS)} answers are what was planted in 10 stations" in said
    assert "NOT WHAT WAS PLANTED" not in said
    drawn = {file.stem: file.read_text() for file in tmp_path.glob("*.html")}
    assert drawn.keys() == {board["uid"] for board in dashboards()}
    for board in dashboards():
        assert all(escape(panel["title"]) in drawn[board["uid"]] for panel in board["panels"])
        assert ",nan" not in drawn[board["uid"]], "a browser draws nothing of a line with such a place"
    assert DRIFTS in drawn["reprobe-fleet"]
    assert BAD_POINT in drawn["reprobe-board-design"]


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.words)
def test_an_answer_that_names_another_one_is_not_what_was_planted(question: Question) -> None:
    assert not question.holds([("another", "another", 1.0, 2, 3)] * 2)


def test_what_is_not_installed_is_told_with_what_brings_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "")
    assert main([]) == 2
    assert "apt-get install -y" in capsys.readouterr().err


def test_fewer_boards_than_can_be_judged_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--boards", "3"])
    assert ended.value.code == 2
    assert str(LEAST_BOARDS) in capsys.readouterr().err
