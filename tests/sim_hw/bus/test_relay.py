"""The relay board and the lamps behind it."""

import random
from itertools import pairwise

import pytest

from sim_hw.bus.modbus import answer, seal
from sim_hw.bus.relay import Relay
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.lamp import Lamp
from sim_hw.plant.plant import Plant
from tests.sim_hw.rig import make_plant


def ask(relay: Relay, body: str, t_s: float = 1.0) -> str:
    reply = answer(relay, seal(bytes.fromhex(body)), t_s)
    assert reply is not None
    return reply[:-2].hex()


@pytest.fixture
def plant() -> Plant:
    return make_plant()


@pytest.fixture
def relay(plant: Plant) -> Relay:
    return Relay(plant)


def test_one_coil_is_echoed_and_read_back(relay: Relay) -> None:
    assert ask(relay, "05050001ff00") == "05050001ff00"
    assert ask(relay, "050100000008") == "05010102"
    assert ask(relay, "050500010000") == "050500010000"
    assert ask(relay, "050100000008") == "05010100"


def test_both_rings_change_in_one_write(relay: Relay, plant: Plant) -> None:
    ask(relay, "05050000ff00", t_s=1.0)
    assert ask(relay, "050f000000020102", t_s=2.0) == "050f00000002"
    state = plant.state_at(3.0)
    assert state.white < 0.01
    assert state.red > 0.99


def test_coil_ffh_is_all_and_5500h_toggles(relay: Relay) -> None:
    ask(relay, "050500ffff00")
    assert ask(relay, "050100000008") == "050101ff"
    ask(relay, "050500035500")
    assert ask(relay, "050100000008") == "050101f7"
    ask(relay, "050500ff0000")
    assert ask(relay, "050100000008") == "05010100"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("05050008ff00", "02"),
        ("050500000100", "03"),
        ("050100040008", "02"),
        ("050100000000", "03"),
        ("0506000000ff", "01"),
    ],
)
def test_what_it_cannot_do_is_an_exception(relay: Relay, body: str, code: str) -> None:
    assert ask(relay, body) == f"05{int(body[2:4], 16) | 0x80:02x}{code}"


def test_a_lamp_follows_after_delay_and_rise() -> None:
    lamp, knobs = Lamp(random.Random(1)), Knobs(relay_bounce_s=0.0)
    lamp.switch(1.0, knobs, on=True)
    assert lamp.level(1.006) == 0.0
    times = [1.0 + 0.0001 * step for step in range(1000)]
    levels = [lamp.level(t_s) for t_s in times]
    assert levels == sorted(levels)
    at_10 = next(t_s for t_s, level in zip(times, levels, strict=True) if level >= 0.1)
    at_90 = next(t_s for t_s, level in zip(times, levels, strict=True) if level >= 0.9)
    assert at_90 - at_10 == pytest.approx(0.015, abs=0.0003)
    assert lamp.level(1.1) > 0.999


def test_a_closing_contact_bounces() -> None:
    lamp = Lamp(random.Random(2))
    lamp.switch(1.0, Knobs(relay_bounce_s=0.005), on=True)
    levels = [lamp.level(1.0 + 0.0001 * step) for step in range(400)]
    assert any(later < earlier for earlier, later in pairwise(levels))
    assert lamp.level(1.2) > 0.999


def test_a_dead_lamp_stays_dark_and_its_coil_reads_on(relay: Relay, plant: Plant) -> None:
    plant.faults.switch("dead_lamp", on=True, lamp="red")
    ask(relay, "050f000000020103")
    assert ask(relay, "050100000008") == "05010103"
    assert plant.state_at(2.0).red == 0.0
    assert plant.state_at(2.0).white > 0.99


def test_a_stuck_relay_answers_and_does_nothing(relay: Relay, plant: Plant) -> None:
    ask(relay, "05050000ff00")
    plant.faults.switch("relay_stuck", on=True)
    ask(relay, "050500000000", t_s=2.0)
    assert ask(relay, "050100000008") == "05010100"
    assert plant.state_at(3.0).white > 0.99


def test_the_emergency_stop_leaves_the_lights(relay: Relay, plant: Plant) -> None:
    ask(relay, "05050000ff00")
    plant.faults.switch("estop", on=True)
    assert plant.state_at(2.0).white > 0.99
