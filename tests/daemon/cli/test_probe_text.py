"""A reading is shown as an engineer writes it, and limits that cannot be are told so."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.probe import limits_of, si, told
from daemon.domain.point_test import Limits, PointReading, PointRecord, PointVerdict, Rung
from daemon.platform.clock import utc_now


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (0.185, "ohm", "185 mohm"),
        (1834.0, "ohm", "1.83 kohm"),
        (3.3, "V", "3.3 V"),
        (0.0, "ohm", "0 ohm"),
        (1.5, "", "1.5"),
    ],
)
def test_a_value_stands_with_prefix_and_unit_in_one_word(value: float, unit: str, shown: str) -> None:
    assert si(value, unit) == shown


def test_limits_the_wrong_way_round_are_told_in_plain_words() -> None:
    told = CliRunner().invoke(app, ["probe", "TP7", "--low", "9", "--high", "5"])
    assert told.exit_code == 2
    assert "limits: low 9 is above high 5" in told.stderr


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ("5 V", "--high: '5 V' is in V, and ohm is measured here"),
        ("5 ohn", "--high: '5 ohn': 'ohn' is no unit"),
        ("five", "--high: 'five' is no value"),
        ("nan", "limits:"),
    ],
)
def test_a_limit_that_is_no_value_of_the_method_is_told_in_plain_words(limit: str, said: str) -> None:
    told = CliRunner().invoke(app, ["probe", "TP7", "--method", "resistance", "--high", limit])
    assert told.exit_code == 2
    assert said in " ".join(told.stderr.split())


def test_a_method_without_a_value_has_no_limits() -> None:
    told = CliRunner().invoke(app, ["probe", "TP7", "--method", "insert", "--measure", "tester", "--high", "5"])
    assert told.exit_code == 2
    assert "insert measures no value" in told.stderr


@pytest.mark.parametrize(("high", "value"), [("5 ohm", 5.0), ("5", 5.0), ("1.2 kohm", 1200.0), ("1.2kohm", 1200.0)])
def test_a_limit_is_given_with_its_unit_as_in_a_plan_or_as_a_number(high: str, value: float) -> None:
    assert limits_of("resistance", None, high, None) == {"high": pytest.approx(value), "unit": "ohm"}


@pytest.mark.parametrize(
    ("limits", "wanted"),
    [
        (Limits(low=800.0, high=1200.0, unit="ohm"), "(wanted: 800 ohm to 1.2 kohm)"),
        (Limits(high=5.0, unit="ohm"), "(wanted: at most 5 ohm)"),
        (Limits(low=3.2, unit="V"), "(wanted: at least 3.2 V)"),
    ],
)
def test_a_fail_names_the_limits_that_its_reading_did_not_keep(limits: Limits, wanted: str) -> None:
    reading = PointReading(
        rung=Rung.TOUCH, site_um=(0.0, 0.0), proof=True, pressed_um=200.0, force_n=0.48, value=0.184, unit=limits.unit
    )
    record = PointRecord(
        point="J1.1", net="VCC", board_id=None, method="resistance", limits=limits, verdict=PointVerdict.FAIL,
        touches=1, presses=2, looks=1, seconds=1.0, at=utc_now(), readings=(reading,),
    )  # fmt: skip
    first, *rest = told(record)
    assert "1 touch, 2 presses, 1 look" in first
    assert any(wanted in line for line in rest)
    passed = record.model_copy(update={"verdict": PointVerdict.PASS_FIRST})
    assert not any("wanted" in line for line in told(passed))
