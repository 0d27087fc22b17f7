"""Names are unique, and a test point is one by an exact name or by what the files say of it."""

import pytest

from daemon.tools.board_import.names import PinRoles, is_connector, name_pins, net_of, unique
from daemon.tools.cad.model import Pin

BOTH = frozenset({"top", "bottom"})


def _pin(part: str, pin: str = "1", feature: str | None = None, net: str = "A") -> Pin:
    return Pin(part, pin, net, 0.0, 0.0, not part, None, BOTH, frozenset(), feature=feature)  # type: ignore[arg-type]


def _names(*pins: Pin) -> list[str]:
    return name_pins(pins, PinRoles(pins))


def test_names_that_were_cut_to_the_same_are_told_apart() -> None:
    assert _names(_pin("TP_VIN"), _pin("TP_VIN"), _pin("TP3")) == ["TP_VIN", "TP_VIN/2", "TP3"]


def test_a_name_that_is_taken_is_not_given_again() -> None:
    assert unique(["A", "A", "A/2", "A"]) == ["A", "A/3", "A/2", "A/4"]


def test_a_part_whose_name_begins_like_a_test_points_is_a_part() -> None:
    pins = [_pin("TPS1", f"{n}") for n in range(1, 5)]
    roles = PinRoles(pins)
    assert _names(*pins) == ["TPS1.1", "TPS1.2", "TPS1.3", "TPS1.4"]
    assert not any(roles.is_test_point(p) for p in pins)


@pytest.mark.parametrize("part", ["TP7", "TP_VIN", "tp12"])
def test_one_pin_under_a_test_points_name_is_a_test_point(part: str) -> None:
    pin = _pin(part)
    assert PinRoles([pin]).is_test_point(pin)
    assert not PinRoles([pin, _pin(part, "2")]).is_test_point(pin), "with two pins it is a part"


@pytest.mark.parametrize("part", ["TPS1", "TPA", "ATP1", "TP", "T1"])
def test_other_names_are_parts(part: str) -> None:
    assert not PinRoles([_pin(part)]).is_test_point(_pin(part))


def test_what_the_files_say_of_a_pad_counts_whatever_it_is_called() -> None:
    pin = _pin("E5", feature="test_point")
    assert PinRoles([pin, _pin("E5", "2")]).is_test_point(pin)
    assert PinRoles([]).is_fiducial(_pin("MK1", feature="fiducial"))


def test_vias_are_counted_and_pins_without_a_number_too() -> None:
    assert _names(_pin(""), _pin("R1", ""), _pin(""), _pin("R1", "")) == ["VIA1", "R1.1", "VIA2", "R1.2"]


def test_what_stands_for_no_net_is_none() -> None:
    assert net_of(_pin("R1", net="N/C")) is None
    assert net_of(_pin("R1", net="GND")) == "GND"


def test_connectors_are_known_by_their_names() -> None:
    assert all(is_connector(p) for p in ("J1", "P12", "USB1", "CN3"))
    assert not any(is_connector(p) for p in ("U1", "PS1", "JTAG", "R7"))
