"""The demonstration's first landing is shown where there is one, and never ends it where there is none."""

from __future__ import annotations

from typing import Any, cast

import pytest

from daemon.client import Refused
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.tools.demo.session import Session
from tests.daemon.procedures.fake_station import a_board


class _Station:
    """Stands for a client of a station that refuses each job, or the errors of each job."""

    def __init__(self, trouble: Exception) -> None:
        self.trouble, self.asked = trouble, list[str]()

    def job(self, op: str, **_: Any) -> Any:
        self.asked.append(op)
        raise self.trouble


@pytest.mark.parametrize(("why_not", "asked"), [(None, ["place"]), ("a fiducial", [])])
def test_a_first_landing_that_is_refused_is_left_for_later(why_not: str | None, asked: list[str]) -> None:
    board = a_board(("A", 5_000.0, 4_000.0))
    points = tuple(one.model_copy(update={"why_not": why_not}) for one in board.points)
    station = _Station(Refused(ErrorBody.of(Fault(FaultCode.NOT_THIS_BOARD)).model_dump()))
    said: list[str] = []
    session = Session(
        cast("Any", station), cast("Any", None), board.model_copy(update={"points": points}), 1, said.append
    )
    session.show_the_eye()
    assert station.asked == asked
    assert ("A: not before the board is aligned" in said) == bool(asked)
