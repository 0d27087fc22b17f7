"""The tester measures, and its word is taken for the press it was said of."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointVerdict, Rung
from daemon.jobs.context import Touching
from daemon.procedures.registry import PROCEDURES
from tests.daemon.procedures.fake_probing import (
    INF,
    Line,
)
from tests.daemon.procedures.fake_station import run


async def _measured(line: Line, *words: dict[str, Any]) -> Any:
    """Probe with a tester that says these words, press after press."""
    ran = line.begin("A", measure="tester", lease_ms=20_000.0)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    for said in words:
        await line.stands.wait()
        line.stands.clear()
        assert line.is_down
        assert line.held is not None
        line.held.lift("", said)
    await job
    line.see_rules_kept()
    return line.told[-1]


async def test_a_tester_that_measures_is_asked_again_after_each_rung(line: Line) -> None:
    line.films["A"] = (99, INF)
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"}, {"verdict": "pass"})
    assert (record.verdict, record.recovered_by) == (PointVerdict.PASS_RECOVERED, Rung.PUMP)
    assert [reading.said for reading in record.readings] == ["open", "open", "pass"]


async def test_the_stations_second_wire_proves_what_the_tester_calls_open(line: Line) -> None:
    line.open_nets.add("NA")
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.OPEN_CONFIRMED, 1)


async def test_in_a_testers_press_the_stations_instrument_is_connected_to_nothing(line: Line) -> None:
    line.open_nets.add("NA")
    connected, made = [], line.touching

    def touching(key: str = "") -> Touching:
        told = made(key)

        def stands(contact: ContactFacts) -> None:
            connected.append(line.meter.channels)
            told.made(contact)

        return replace(told, made=stands)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(line, "touching", touching)
        await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert connected == [(), ()]


async def test_what_the_tester_calls_open_and_the_stations_instrument_reads_well_is_the_testers_wiring(
    line: Line,
) -> None:
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 2)
    assert "0.18 ohm in the same press" in record.reason


async def test_a_relay_that_sticks_is_no_witness_against_the_testers_wiring(line: Line) -> None:
    line.meter.stuck_channels = (101,)
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.presses) == (PointVerdict.CONTACT_NOT_MADE, 2)
    assert "a relay of the scanner sticks" in record.reason
    assert "tester's wiring" not in record.reason


async def test_a_broken_harness_accuses_no_net_by_the_testers_word_either(line: Line) -> None:
    """The station's channel is broken, too, so that nothing contradicts the tester."""
    line.harness_open.add(101)
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.CONTACT_NOT_MADE, 1)
    assert "net or harness, nobody knows" in record.reason


async def test_a_tester_that_calls_a_net_a_fail_has_measured_something_else(line: Line) -> None:
    record = await _measured(line, {"verdict": "fail"}, {"verdict": "fail"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.FAIL, 0)


async def test_a_net_that_has_to_be_open_is_not_passed_on_another_pad(line: Line) -> None:
    """Any pad would: so it is seen before it is touched."""
    line.first_press_lands_on_b()
    record = await line.probe("A", method="resistance", limits={"low": 1e6, "unit": "ohm"})
    assert record.verdict is not PointVerdict.PASS_FIRST
    assert line.descents_onto("B") == 0


async def test_where_the_stations_harness_does_not_reach_the_net_the_testers_word_counts(line: Line) -> None:
    line.without(meter=line.world.context.config.meter.model_copy(update={"channels": {"NB": 102}}))
    record = await _measured(line, {"verdict": "open"}, {"verdict": "open"})
    assert (record.verdict, record.elsewhere) == (PointVerdict.OPEN_CONFIRMED, 0)


async def test_without_a_meter_the_tester_alone_accuses_nobody(line: Line) -> None:
    line.without(meter=None, reference=None, brush=None)
    record = await _measured(line, *[{"verdict": "open"}] * 8)
    assert record.verdict is PointVerdict.CONTACT_NOT_MADE


async def test_a_word_that_comes_after_the_next_press_has_begun_is_not_taken_for_it(line: Line) -> None:
    ran = line.begin("A", measure="tester", lease_ms=20_000.0)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    held = line.held
    assert held is not None
    told = []
    for said in ("open", "pass"):
        await line.stands.wait()
        line.stands.clear()
        told.append(line.stood[-1].press)
        if said == "pass":
            with pytest.raises(Fault) as late:
                held.lift("", {"verdict": "fail"}, told[0])
            assert late.value.kind is FaultCode.ANOTHER_PRESS
        held.lift("", {"verdict": said}, told[-1])
    await job
    assert told == [1, 2]
    assert [reading.said for reading in line.told[-1].readings] == ["open", "pass"]
    assert ran.got.detail["press"] == 2


async def test_a_testers_value_is_judged_by_the_limits(line: Line) -> None:
    ran = line.begin("A", measure="tester", method="resistance", limits={"low": 90.0, "high": 110.0, "unit": "ohm"})
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    assert line.held is not None
    line.held.lift("", {"value": 100.0, "unit": "ohm"})
    await job
    assert line.told[-1].verdict is PointVerdict.PASS_FIRST
    assert line.contacts == ["made", "lifted"]


async def test_a_fault_is_inserted_while_the_needle_stands(line: Line) -> None:
    ran = line.begin("A", measure="tester", method="insert")
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    assert line.held is not None
    line.held.lift("", {})
    await job
    assert line.told[-1].verdict is PointVerdict.PASS_FIRST


async def test_a_tester_whose_lease_runs_out_ends_the_job(line: Line) -> None:
    with pytest.raises(Fault) as caught:
        await run(line.world, PROCEDURES["probe"], {}, line.begin("A", measure="tester", lease_ms=200.0))
    assert caught.value.kind is FaultCode.LEASE_EXPIRED


async def test_a_tester_that_says_nothing_to_the_end_has_not_tested(line: Line) -> None:
    ran = line.begin("A", measure="tester", hold_ms=200.0)
    await run(line.world, PROCEDURES["probe"], {}, ran)
    line.see_rules_kept()
    assert line.told[-1].verdict is PointVerdict.NOT_TESTED


async def test_a_lift_without_a_word_is_no_pass(line: Line) -> None:
    """A lift without a word, for any reason, has measured nothing."""
    record = await _measured(line, {})
    assert record.verdict is PointVerdict.NOT_TESTED


async def test_a_value_within_limits_that_the_tester_calls_a_fail_is_no_pass(line: Line) -> None:
    limits = {"low": 90.0, "high": 110.0, "unit": "ohm"}
    ran = line.begin("A", measure="tester", method="resistance", limits=limits, touches=1)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    assert line.held is not None
    line.held.lift("", {"verdict": "fail", "value": 100.0, "unit": "ohm"})
    await job
    assert line.told[-1].verdict is PointVerdict.CONTACT_NOT_MADE


async def test_what_is_said_again_of_the_press_before_is_not_taken_for_the_next(line: Line) -> None:
    ran = line.begin("A", measure="tester", lease_ms=20_000.0)
    job = asyncio.create_task(run(line.world, PROCEDURES["probe"], {}, ran))
    await line.stands.wait()
    line.stands.clear()
    assert line.held is not None
    line.held.lift("", {"verdict": "open"})
    while line.is_down:  # noqa: ASYNC110  # each turn lets the job go on
        await asyncio.sleep(0)
    line.held.lift("", {"verdict": "open"})  # its answer was lost, and it was sent again
    await line.stands.wait()
    await asyncio.sleep(0)
    line.held.lift("", {"verdict": "pass"})
    await job
    assert [reading.said for reading in line.told[-1].readings] == ["open", "pass"]
