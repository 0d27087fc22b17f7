"""The drive's numbers without a wire: status, image, units, arrival."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import LimitHit, Stalled
from drivers.l4118 import AxisConfig, AxisStatus, PowerState
from drivers.l4118.arrival import ArrivalWatch, TakenWatch, seen_to_go
from drivers.l4118.image import TX_WANTED, WordOrder, order_shown, parse, tx_serves
from drivers.l4118.objects import decode_state, error_meaning, error_numbers
from drivers.l4118.units import decode_speed_unit
from tests.drivers.peers.drive import DEFAULT_TX


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0200, PowerState.NOT_READY),
        (0x0250, PowerState.SWITCH_ON_DISABLED),
        (0x0231, PowerState.READY),
        (0x0233, PowerState.SWITCHED_ON),
        (0x1637, PowerState.OPERATION_ENABLED),
        (0x0217, PowerState.QUICK_STOP_ACTIVE),
        (0x021F, PowerState.FAULT_REACTION),
        (0x0238, PowerState.FAULT),
        (0x0201, None),
    ],
)
def test_status_words_show_their_state(word: int, state: PowerState | None) -> None:
    """It should decode by the masks of CiA 402, and say when a pattern is none."""
    assert decode_state(word) is state


@given(st.integers(-(2**31), 2**31 - 1), st.sampled_from(["big", "little"]))
def test_a_value_reads_the_same_as_it_was_sent_in_both_word_orders(value: int, order: WordOrder) -> None:
    """It should know which order was meant by the value itself, unless both read the same."""
    layout = parse(TX_WANTED)
    raw = (value % 2**32).to_bytes(4, "big")
    words = [int.from_bytes(raw[:2], "big"), int.from_bytes(raw[2:], "big")]
    registers = [0x0637, 1, *(words if order == "big" else words[::-1]), 0, 0]
    assert layout.value(registers, 0x606400, order, signed=True) == value
    big, little = layout.both_orders(registers, 0x606400, signed=True)
    assert order_shown(big, little, value) == (None if big == little else order)


def test_a_value_that_changes_between_two_readings_shows_no_order_when_both_are_near() -> None:
    """It should wait for a clearer one rather than guess."""
    assert order_shown(0x000A0003, 0x0003000A, 0x000A0103) == "big"
    assert order_shown(0x000A0003, 0x0003000A, 0x00060000) is None


def test_the_mode_lies_in_the_low_byte_behind_its_dummy() -> None:
    """It should follow the packing of the manual's default mapping."""
    layout = parse(DEFAULT_TX)
    assert layout.value([0x1234, 0x00FA, 0, 0, 0, 0, 0], 0x606100, "big", signed=True) == -6
    first = parse((0x60610008, 0x00050008))
    assert first.value([0x0600], 0x606100, "big") == 6


def test_which_mappings_serve() -> None:
    """It should take whole images only, even and aligned."""
    assert tx_serves(parse(TX_WANTED))
    assert not tx_serves(parse(DEFAULT_TX))
    assert not tx_serves(parse(()))
    assert not tx_serves(parse((0x00050008, *TX_WANTED[:1], *TX_WANTED[2:], 0x00050008)))


@pytest.mark.parametrize(
    ("raw", "increments_s"),
    [
        (0x00B44700, 3_276_800 / 60),
        (0xFDB44700, 3_276_800 / 60_000),
        (0x00B50300, 1.0),
        (0x00410300, 3_276_800 / 360),
        (0xFF410300, 3_276_800 / 3600),
    ],
)
def test_speed_units_are_read(raw: int, increments_s: float) -> None:
    """It should know revolutions, increments and angles, per second and minute, with exponent."""
    unit = decode_speed_unit(raw, 3_276_800)
    assert unit is not None
    assert unit.increments_s == pytest.approx(increments_s)
    assert unit.counts(0.0) == 1


@pytest.mark.parametrize("raw", [0x00010300, 0x00B40000])
def test_other_speed_units_are_not_guessed(raw: int) -> None:
    """It should give None for metres, and for a time it does not know."""
    assert decode_speed_unit(raw, 3_276_800) is None


def test_error_entries_read_as_words() -> None:
    """It should split number, class and code."""
    assert error_meaning(0) == ""
    assert error_meaning(0x0A04FF01) == "negative limit switch and tolerance zone exceeded"
    assert error_numbers(0x0A04FF01) == ", class 04h, code FF01h"
    assert error_numbers(0) == ""
    assert "99" in error_meaning(0x63000000)


CONFIG = AxisConfig("X", 1, 655.36, 0.0, 1000.0, 100.0, 100.0, 1.0, stall_s=1.0)


def look(position: float, word: int = 0x0237, inputs: int = 0) -> AxisStatus:
    return AxisStatus(word, 1, position, inputs)


@pytest.mark.parametrize(
    ("old_stands", "before", "now", "taken"),
    [
        (False, look(5.0, 0x0637), look(5.0, 0x1637), True),
        (False, look(5.0, 0x0637), look(9.0, 0x0237), False),
        (True, look(5.0, 0x1637), look(5.0, 0x1637), False),
        (True, look(5.0, 0x1637), look(5.0, 0x1237), True),
        (True, look(5.0, 0x1237), look(5.0, 0x1237), False),
        (True, look(5.0, 0x1637), look(6.0, 0x1637), False),
        (True, look(5.0, 0x1637), look(6.1, 0x1637), True),
        (True, look(5.0, 0x1637), look(3.9, 0x1637), True),
        (True, look(5.0, 0x1637), look(9.0, 0x0637), False),
    ],
)
def test_a_set_point_is_taken_by_a_bit_12_of_its_own(
    old_stands: bool, before: AxisStatus, now: AxisStatus, taken: bool
) -> None:
    """It should believe one that may be old by the bit 10 that fell since, or by a place left farther than a window."""
    assert TakenWatch(CONFIG, before, old_stands=old_stands).taken(now) == taken


@pytest.mark.parametrize(("target", "goes"), [(7.0, False), (7.1, True), (3.0, False), (2.9, True)])
def test_a_way_shows_that_it_is_gone_where_it_is_longer_than_both_windows(target: float, goes: bool) -> None:
    assert seen_to_go(CONFIG, look(5.0), target) == goes


def test_arrival_needs_the_bit_and_the_place() -> None:
    """It should believe neither alone."""
    watch = ArrivalWatch(CONFIG, 0.0, 100.0, 0.0)
    assert not watch.arrived(look(99.5), 0.1)
    assert not watch.arrived(look(50.0, 0x0637), 0.2)
    assert watch.arrived(look(100.0, 0x0637), 0.3)


def test_a_move_that_will_never_arrive_is_told() -> None:
    """It should tell following error, standstill and internal limit apart."""
    with pytest.raises(Stalled, match="following error"):
        ArrivalWatch(CONFIG, 0.0, 100.0, 0.0).arrived(look(5.0, 0x2237), 0.1)
    with pytest.raises(Stalled, match="short of"):
        ArrivalWatch(CONFIG, 0.0, 100.0, 0.0).arrived(look(0.1), 1.1)
    with pytest.raises(LimitHit, match="internal limit"):
        ArrivalWatch(CONFIG, 0.0, 100.0, 0.0).arrived(look(0.1, 0x0A37), 1.1)
    watch = ArrivalWatch(CONFIG, 0.0, 100.0, 0.0)
    assert not watch.arrived(look(10.0), 0.9)
    assert not watch.arrived(look(10.2), 1.8)


def test_the_status_names_its_bits() -> None:
    """It should show interlock and voltage."""
    status = look(0.0, 0x0010, 0x8)
    assert status.interlock
    assert status.voltage
    assert not status.negative_limit
