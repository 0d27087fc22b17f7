"""Faults and knobs take what fits and name what does not."""

import pytest

from sim_hw.plant.faults import DEFAULTS, Faults
from sim_hw.plant.knobs import Knobs


def test_a_fault_has_defaults_takes_parameters_and_goes_off() -> None:
    faults = Faults()
    assert not faults.on("late_replies")
    assert faults.get("late_replies")["delay_s"] == 0.5
    faults.switch("late_replies", on=True, delay_s=1)
    assert faults.on("late_replies")
    assert faults.get("late_replies")["delay_s"] == 1.0
    faults.switch("late_replies", on=False)
    assert faults.get("late_replies")["delay_s"] == 0.5


@pytest.mark.parametrize(
    ("name", "parameters", "says"),
    [
        ("nonsense", {}, "unknown fault"),
        ("stall", {"axis": "w"}, "must be one of x, y, z, theta, all"),
        ("stall", {"axles": "x"}, "no parameter 'axles'"),
        ("stall", {"detected": 1}, "of type bool"),
        ("late_replies", {"delay_s": "long"}, "of type float"),
        ("absent_slave", {"address": 1.5}, "of type int"),
        ("frozen", {"count": 0}, "above zero"),
        ("slip", {"axis": "z"}, "must be one of x, y, not 'z'"),
        ("slip", {"um": "far"}, "of type float"),
    ],
)
def test_a_fault_that_does_not_fit_is_refused(name: str, parameters: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Faults().switch(name, on=True, **parameters)


def test_a_counted_fault_clears_itself_and_tells() -> None:
    faults, told = Faults(), []
    faults.listen(lambda name, on, _parameters: told.append((name, on)))
    faults.switch("torn", on=True, count=2)
    assert [faults.use("torn") for _ in range(3)] == [True, True, False]
    assert told == [("torn", True), ("torn", False)]


def test_it_is_counted_how_often_a_fault_was_switched_on() -> None:
    faults = Faults()
    for on in (True, True, False, True):
        faults.switch("slip", on=on)
    assert faults.times("slip") == 3
    assert faults.times("stall") == 0


def test_a_fault_hits_one_axis_or_all() -> None:
    faults = Faults()
    faults.switch("stall", on=True, axis="y")
    assert faults.hits("stall", "axis", "y")
    assert not faults.hits("stall", "axis", "x")
    faults.switch("stall", on=True, axis="all")
    assert faults.hits("stall", "axis", "x")


def test_the_listing_names_every_fault() -> None:
    faults = Faults()
    faults.switch("bent", on=True, px=4)
    listing = faults.listing()
    assert set(listing) == set(DEFAULTS)
    assert listing["bent"] == {"on": True, "px": 4.0}


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("board_dx_um", "-12.5", -12.5),
        ("board_dx_um", "none", None),
        ("position_unit", "0xFF410000", 0xFF410000),
        ("fc43_node", -1, -1),
        ("fc43_index_order", "little", "little"),
        ("repeatability_um", 0, 0.0),
    ],
)
def test_a_knob_takes_text_and_numbers(name: str, text: object, value: object) -> None:
    assert getattr(Knobs().with_value(name, text), name) == value


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("backlash", 1, "unknown knob"),
        ("repeatability_um", "much", "must be a number"),
        ("repeatability_um", True, "must be a number"),
        ("repeatability_um", "nan", "must be a number"),
        ("repeatability_um", None, "must be a number"),
        ("fc43_node", 1.5, "whole number"),
        ("word_order", "middle", "must be one of high, low"),
    ],
)
def test_a_knob_that_does_not_fit_is_refused(name: str, value: object, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Knobs().with_value(name, value)
