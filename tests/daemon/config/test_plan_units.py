"""Values of a plan are read with their unit, and refused without one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.config.plan_units import parse_value, with_unit
from daemon.domain.point_test import PointUnit


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("2 ohm", "ohm", 2.0),
        ("4.7kohm", "ohm", 4700.0),
        ("20 mohm", "ohm", 0.02),
        ("1 Mohm", "ohm", 1e6),
        ("5 Ω", "ohm", 5.0),
        ("2 Ohm", "ohm", 2.0),
        ("1e3 ohm", "ohm", 1e3),
        ("3.3 V", "V", 3.3),
        ("-500 mV", "V", -0.5),
        ("10 nF", "F", 1e-8),
        ("4.7 µF", "F", 4.7e-6),
        ("4.7 uF", "F", 4.7e-6),
        ("22 pF", "F", 22e-12),
    ],
)
def test_a_value_is_read_in_the_unit_itself(text: str, unit: PointUnit, value: float) -> None:
    assert parse_value(text, unit) == value


@pytest.mark.parametrize(
    ("given_", "unit", "says"),
    [
        (2, "ohm", "2 has no unit"),
        ("2", "ohm", "'2' has no unit"),
        (3.3, "V", "such as '3.3 V'"),
        (True, "V", "no unit"),
        ("2 V", "ohm", "is in V, and ohm is measured here"),
        ("2 mF", "V", "is in F, and V is measured here"),
        ("two ohm", "ohm", "is no value"),
        ("2 hm", "ohm", "is no unit"),
        ("1e400 ohm", "ohm", "no finite value"),
    ],
)
def test_a_value_without_its_unit_is_refused_with_what_to_write(given_: object, unit: PointUnit, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        parse_value(given_, unit)


@given(st.floats(1e-12, 1e9), st.sampled_from(["ohm", "V", "F"]))
def test_what_is_written_with_a_unit_is_read_again_to_four_digits(value: float, unit: PointUnit) -> None:
    assert parse_value(with_unit(value, unit), unit) == pytest.approx(value, rel=1e-3)


def test_no_value_is_no_text() -> None:
    assert with_unit(None, "ohm") == ""
    assert with_unit(0.0, "V") == "0 V"
