"""A reading is shown as an engineer writes it, and limits that cannot be are told so."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.probe import si


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
