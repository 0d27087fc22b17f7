"""What the leads add is taken off a value only while it is known to be so."""

from __future__ import annotations

import pytest

from daemon.procedures.tare import tare_of
from tests.daemon.clock import Clock
from tests.daemon.procedures.fake_probing import (
    CONTACT_OHM,
    LEAD_OHM,
    FakeMeter,
    Line,
)


async def test_the_values_are_less_what_the_leads_add_once_the_reference_pad_was_read(line: Line) -> None:
    line.open_nets.add("NA")
    await line.probe("A", job_id="one")
    record = await line.probe("B", job_id="two")
    assert record.readings[-1].value == pytest.approx(0.0, abs=1e-6)


TARED, UNTARED = pytest.approx(0.0, abs=1e-6), pytest.approx(LEAD_OHM + CONTACT_OHM)


async def _tared(line: Line) -> Clock:
    """Have the reference pad read; return the clock by which that ages."""
    line.world.station.needle.health.now_s = clock = Clock()
    line.debris_ohm = 5_000.0
    await line.probe("C", job_id="one")
    return clock


async def test_the_record_says_which_tare_was_taken_off_and_how_old_it_is(line: Line) -> None:
    clock = await _tared(line)
    clock.now_s += 100.0
    reading = (await line.probe("B", job_id="two")).readings[-1]
    assert (reading.value, reading.tare_ohm, reading.tare_age_s) == (TARED, UNTARED, 100.0)


async def test_a_tare_that_has_aged_is_taken_off_no_more(line: Line) -> None:
    clock = await _tared(line)
    clock.now_s += line.world.context.config.reference.tare_s + 1.0
    reading = (await line.probe("B", job_id="two")).readings[-1]
    assert (reading.value, reading.tare_ohm, reading.tare_age_s) == (UNTARED, None, None)


@pytest.mark.parametrize("changed", ["reference", "meter section", "meter", "needle"])
async def test_a_tare_of_another_needle_meter_or_pad_is_taken_off_no_value(line: Line, changed: str) -> None:
    await _tared(line)
    config = line.world.context.config
    if changed == "reference":
        line.without(reference=config.reference.model_copy(update={"max_ohm": 2.0}))
    elif changed == "meter section":
        line.without(meter=config.meter.model_copy(update={"channels": {**config.meter.channels, "NX": 199}}))
    elif changed == "meter":
        line.world.station.fit(FakeMeter(line))
    else:
        line.world.teach(tip_px=(500.0, 500.0))
    assert tare_of(line.world.context, line.world.station.needle.health) is None
    line.open_nets.clear()
    if changed != "needle":  # after another needle is taught the map is calibrated, too
        reading = (await line.probe("B", job_id="two")).readings[-1]
        assert (reading.value, reading.tare_ohm) == (UNTARED, None)
