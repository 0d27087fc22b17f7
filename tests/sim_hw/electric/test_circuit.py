"""Nets, harness, breaks, shorts and parts, on a netlist of a few pads."""

import math
from dataclasses import dataclass

import pytest

from sim_hw.electric.circuit import COIN, FIRST_PIN, TEST_A, Circuit, Defects, Place


@dataclass(frozen=True)
class Pad:
    net: str
    reference: str
    x_mm: float
    y_mm: float = 0.0


PADS = [
    Pad("A", "J1", 0.0), Pad("A", "TP1", 10.0), Pad("A", "TP2", 20.0), Pad("A", "R1", 5.0),
    Pad("B", "TP3", 10.5, 0.5), Pad("B", "R1", 6.0), Pad("B", "C1", 7.0), Pad("B", "U1", 9.0),
    Pad("GND", "J1", 0.0, 30.0), Pad("GND", "C1", 8.0),
    Pad("N10", "", 50.0, 50.0), Pad("N9", "", 60.0, 50.0), Pad("", "FID1", 1.0),
]  # fmt: skip
A, B, GND, N9, N10 = FIRST_PIN, FIRST_PIN + 1, FIRST_PIN + 2, FIRST_PIN + 3, FIRST_PIN + 4
NONE = Defects()


@pytest.fixture
def circuit() -> Circuit:
    return Circuit(PADS, seed=1)


def test_pins_are_numbered_in_the_order_of_their_names(circuit: Circuit) -> None:
    assert dict(circuit.pins) == {A: "A", B: "B", GND: "GND", N9: "N9", N10: "N10"}


def test_a_sound_net_is_its_trace_and_the_harness_and_others_are_open(circuit: Circuit) -> None:
    place = Place("A", 20.0, 0.0)
    assert circuit.ohms([place], [A], NONE) == pytest.approx(0.01, abs=1e-3)
    assert circuit.ohms([place], [A], Defects(harness_ohm=2.0)) == pytest.approx(2.01, abs=1e-3)
    for channels in ([], [B], [B, GND, N9]):
        assert math.isinf(circuit.ohms([place], channels, NONE))
    assert math.isinf(circuit.ohms([Place(None)], [A], NONE))


def test_a_needle_on_two_nets_joins_them(circuit: Circuit) -> None:
    assert circuit.ohms([Place("A", 10.0), Place("B", 10.5, 0.5)], [B], NONE) < 0.1


def test_a_broken_trace_cuts_off_what_is_beyond_and_only_that() -> None:
    seen: set[tuple[bool, ...]] = set()
    for seed in range(60):
        circuit, all_broken = Circuit(PADS, seed), Defects(opens=1.0)
        assert circuit.broken(all_broken) == tuple(dict.fromkeys(pad.net for pad in PADS if pad.net))
        sound = tuple(not math.isinf(circuit.ohms([Place("A", x)], [A], all_broken)) for x in (0.0, 10.0, 20.0))
        assert sound == tuple(sorted(sound, reverse=True)), "whole up to the break, open beyond"
        assert not sound[-1]
        seen.add(sound)
    assert seen == {(False, False, False), (True, False, False), (True, True, False)}


def test_opens_come_at_their_share_and_none_where_there_is_none() -> None:
    pads = [Pad(f"N{number}", "TP", float(number)) for number in range(3000)]
    circuit = Circuit(pads, seed=2)
    assert circuit.broken(NONE) == ()
    assert len(circuit.broken(Defects(opens=0.01))) == pytest.approx(30, abs=20)
    assert set(circuit.broken(Defects(opens=0.01))) < set(circuit.broken(Defects(opens=0.05)))


def test_a_short_is_to_the_neighbour_whose_pad_is_nearest(circuit: Circuit) -> None:
    assert ("A", "B") in circuit.shorted(Defects(shorts=1.0))
    assert 0.0 < circuit.ohms([Place("A", 0.0)], [B], Defects(shorts=1.0)) < 0.2
    assert circuit.shorted(NONE) == ()


def test_parts_lie_between_nets_only_where_they_are_assembled() -> None:
    bare, assembled = Circuit(PADS, seed=1), Circuit(PADS, seed=1, assembled=True)
    assert math.isinf(bare.ohms([Place("A", 0.0)], [B], NONE))
    assert 100.0 <= assembled.ohms([Place("A", 0.0)], [B], NONE) <= 1e5
    assert assembled.farads([Place("B", 10.5)], [GND], NONE) > bare.farads([Place("B", 10.5)], [GND], NONE) + 9e-11


def test_two_ways_are_in_parallel() -> None:
    pads = [Pad("A", "TP1", 0.0), Pad("A", "R1", 0.0), Pad("A", "R2", 0.0), Pad("B", "R1", 1.0), Pad("B", "R2", 1.0)]
    one = Circuit([pad for pad in pads if pad.reference != "R2"], seed=4, assembled=True)
    two = Circuit([pad for pad in pads if pad.reference != "R1"], seed=4, assembled=True)
    both = Circuit(pads, seed=4, assembled=True)
    r1, r2, r12 = (c.ohms([Place("A")], [FIRST_PIN + 1], NONE) for c in (one, two, both))
    assert r12 == pytest.approx(r1 * r2 / (r1 + r2), rel=1e-6)


def test_copper_has_a_capacitance_to_ground_that_is_smaller_beyond_a_break() -> None:
    """A break at the harness' own joint leaves all of the net's copper on the needle."""
    smaller = 0
    for seed in range(20):
        circuit = Circuit(PADS, seed)
        whole = circuit.farads([Place("A", 20.0)], [GND], NONE)
        cut = circuit.farads([Place("A", 20.0)], [GND], Defects(opens=1.0))
        assert 10e-12 < whole < 40e-12
        assert circuit.farads([], [GND], NONE) < cut <= whole
        smaller += cut < whole
    assert smaller > 8


def test_a_chips_clamp_shows_as_a_diode_and_a_wire_as_none() -> None:
    circuit = Circuit(PADS, seed=1, assembled=True)
    assert 0.5 < circuit.diode_v([Place("B", 10.5)], [GND], NONE) < 0.75
    assert math.isinf(circuit.diode_v([Place("N9", 60.0)], [GND], NONE))
    assert circuit.diode_v([Place("A", 20.0)], [A], NONE) == pytest.approx(0.01 * TEST_A, abs=1e-6)


def test_the_coin_is_on_the_return_whatever_is_closed(circuit: Circuit) -> None:
    assert circuit.ohms([Place(COIN)], [], Defects(harness_ohm=5.0)) < 0.01


def test_the_pads_that_are_listed_as_cut_off_are_those_that_read_open() -> None:
    for seed in range(40):
        circuit, some = Circuit(PADS, seed), Defects(opens=0.5)
        listed = {(pad["net"], pad["x_mm"], pad["y_mm"]) for pad in circuit.cut_off(some)}
        pins = {net: pin for pin, net in circuit.pins.items()}
        read_open = {
            (pad.net, pad.x_mm, pad.y_mm)
            for pad in PADS
            if pad.net and math.isinf(circuit.ohms([Place(pad.net, pad.x_mm, pad.y_mm)], [pins[pad.net]], some))
        }
        assert listed == read_open
        assert {net for net, _, _ in listed} == set(circuit.broken(some))
