"""What a test program gets of a point's test."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.adapters.prober import NotMeasured, Probed, Prober, StationTrouble
from daemon.client import Client, Refused
from daemon.domain.point_test import Limits, PointRecord, PointTest
from tests.daemon.adapters.station import Listed, listed_station, reading, record

ERROR = {"code": 6106, "name": "meter_failed", "message": "is silent", "advice": "see its cable", "detail": {}}


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Listed]:
    with listed_station(f"ipc://{tmp_path}/control", {"TP1": record("TP1"), "TP2": {"error": ERROR}}) as listed:
        yield listed


@pytest.fixture
def prober(station: Listed) -> Iterator[Prober]:
    with Client(station.endpoint, timeout_s=10.0) as client:
        yield Prober(client, "board-7")


def probed(verdict: str, **facts: Any) -> Probed:
    return Probed(PointRecord.model_validate(record("TP1", verdict, **facts)))


def test_a_point_is_asked_for_by_its_name_on_the_board_that_was_named(prober: Prober, station: Listed) -> None:
    assert prober("TP1").ohms == 0.4
    assert prober("TP1", board_id="other", method="contact")
    first, second = station.asked
    assert (first["op"], first["test_point"], first["board_id"], first["wait"]) == ("probe", "TP1", "board-7", True)
    assert (second["board_id"], second["method"]) == ("other", "contact")
    assert first["id"] != second["id"]


def test_a_line_of_a_plan_is_asked_as_it_says(prober: Prober, station: Listed) -> None:
    limits = Limits(high=5.0, unit="ohm")
    prober(PointTest(point="TP1", net="CLK", limits=limits, theta_deg=90.0, look="first", touches=2))
    asked = station.asked[0]
    assert (asked["method"], asked["limits"]["high"], asked["theta_deg"]) == ("continuity", 5.0, 90.0)
    assert (asked["look"], asked["touches"], "net" in asked) == ("first", 2, False)


def test_a_station_that_cannot_is_told_from_a_board_that_fails(prober: Prober) -> None:
    with pytest.raises(StationTrouble, match=r"TP2: is silent \(meter_failed\); see its cable"):
        prober("TP2")
    with pytest.raises(Refused, match="unknown_test_point"):
        prober("TP3")


@pytest.mark.parametrize(
    ("verdict", "passed"),
    [("pass_first", True), ("pass_recovered", True), ("fail", False), ("open_confirmed", False),
     ("contact_not_made", False), ("not_tested", False)],
)  # fmt: skip
def test_only_a_pass_is_true(verdict: str, passed: bool) -> None:
    assert (bool(probed(verdict)), probed(verdict).passed) == (passed, passed)
    assert verdict in repr(probed(verdict))


def test_a_confirmed_open_is_infinite_and_nothing_is_read_where_nobody_knows() -> None:
    assert math.isinf(probed("open_confirmed", readings=[reading(None)]).ohms)
    for verdict in ("contact_not_made", "not_tested"):
        with pytest.raises(NotMeasured, match=f"{verdict}. the pad is gone"):
            _ = probed(verdict, readings=[reading(None)], reason="the pad is gone").ohms


def test_a_value_is_read_in_its_own_unit_only() -> None:
    diode = probed("pass_first", method="diode", readings=[reading(9.0), reading(0.61, "V")])
    assert diode.volts == 0.61
    with pytest.raises(NotMeasured, match="reads V and not ohm"):
        _ = diode.ohms
    with pytest.raises(NotMeasured, match="reads nothing and not F"):
        _ = probed("pass_first", readings=[]).farads
