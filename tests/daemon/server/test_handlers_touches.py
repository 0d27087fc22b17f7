"""A touch that is held: who may hold or lift it, and which word counts for which press."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from daemon.domain.contact import ContactFacts
from daemon.domain.errors import FaultCode
from daemon.domain.results import JobResult
from daemon.domain.roles import Caller
from daemon.jobs.held_touch import HeldTouch
from daemon.server.handlers import Handlers
from daemon.storage.journal import Journal
from daemon.wire.example_parts import CONTACT
from daemon.wire.operations.jobs import JobReply
from daemon.wire.operations.table import OPERATIONS
from tests.daemon.server.fake_daemon import (
    DONE,
    Daemon,
    ask,
    refusal,
    standing,
)


async def test_a_touch_is_answered_when_the_needle_stands(handlers: Handlers, station: Daemon) -> None:
    station.jobs.touches["t"] = held = HeldTouch("t", "")
    answer = asyncio.create_task(ask(handlers, "touch", id="t", test_point="TP1", hold_ms=5000, wait="contact"))
    await station.jobs.taken.get()
    assert not answer.done()
    contact = ContactFacts(**CONTACT | {"id": "t"})
    held.stands(contact, 2000.0, 5000.0)
    assert await answer == JobReply(id="t", contact=contact)


async def test_a_touch_that_is_sent_again_while_the_needle_rises_is_answered_with_its_result(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = standing("t")
    held.let_go()
    answer = asyncio.create_task(ask(handlers, "touch", id="t", test_point="TP1", hold_ms=5000, wait="contact"))
    await station.jobs.taken.get()
    for _ in range(5):  # turns of the loop, in each of which it could have answered
        await asyncio.sleep(0)
    assert not answer.done()
    station.jobs.done.set_result(DONE)
    assert await answer == JobReply(id="t", result=DONE)


async def test_a_touch_that_fails_before_the_needle_stands_is_answered_with_its_result(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = HeldTouch("t", "")
    station.jobs.done.set_result(DONE)
    assert await ask(handlers, "touch", id="t", test_point="TP1", wait="contact") == JobReply(id="t", result=DONE)


async def test_lift_ends_the_touch_of_its_id_and_answers_its_result(handlers: Handlers, station: Daemon) -> None:
    station.jobs.touches["t"] = held = standing("t")
    answer = asyncio.create_task(ask(handlers, "lift", id="t", verdict="pass", value=0.4, unit="ohm"))
    assert await held.wait(60.0) == "lift"
    assert held.measured == {"verdict": "pass", "value": 0.4, "unit": "ohm"}
    result = _touched(measured=held.measured)
    station.jobs.done.set_result(result)
    assert await answer == JobReply(id="t", result=result)
    assert station.jobs.taken.empty(), "it is no job of its own"


async def test_lift_of_a_probe_answers_that_the_needle_stands_again_and_at_last_the_result(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = standing("t", judged=True)
    answer = asyncio.create_task(ask(handlers, "lift", id="t", verdict="open"))
    assert await held.wait(60.0) == "lift"
    assert held.close() == {"verdict": "open"}
    held.again()
    again = ContactFacts(**CONTACT | {"id": "t", "pressed_um": 450.0})
    held.stands(again, lease_ms=20_000.0, hold_ms=60_000.0)
    assert await answer == JobReply(id="t", contact=again)
    assert await held.wait(0.0) is None, "what was said of the press before lifts this one not"
    answer = asyncio.create_task(ask(handlers, "lift", id="t", verdict="pass"))
    assert await held.wait(60.0) == "lift"
    result = _touched(measured=held.close(), op="probe")
    station.jobs.done.set_result(result)
    assert await answer == JobReply(id="t", result=result)


async def test_a_word_that_is_no_verdict_of_a_probe_is_refused_and_the_needle_stays(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = standing("t", judged=True)
    refused = await refusal(handlers, "lift", id="t", verdict="so-so")
    assert refused.kind is FaultCode.INVALID_REQUEST
    assert "fail, open, pass" in refused.message
    assert await held.wait(0.0) is None


@pytest.mark.parametrize(
    ("unit", "taken"), [("kohm", False), ("mOhm", False), ("V", False), ("Ohm", True), ("Ω", True)]
)
async def test_a_value_in_another_unit_than_its_limits_is_refused_and_the_needle_stays(
    handlers: Handlers, station: Daemon, unit: str, taken: bool
) -> None:
    station.jobs.touches["t"] = held = standing("t", judged=True, unit="ohm")
    station.jobs.done.set_result(_touched(measured={"value": 1.0, "unit": unit}, op="probe"))
    if taken:
        await ask(handlers, "lift", id="t", value=1.0, unit=unit)
        assert held.measured["value"] == 1.0
        return
    refused = await refusal(handlers, "lift", id="t", value=1.0, unit=unit)
    assert refused.kind is FaultCode.INVALID_REQUEST
    assert "ohm" in refused.message
    assert await held.wait(0.0) is None


async def test_a_word_of_the_press_before_is_refused_by_name_and_the_needle_stays(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = standing("t", judged=True)
    held.again()
    held.stands(ContactFacts(**CONTACT | {"id": "t", "press": 2}), lease_ms=20_000.0, hold_ms=60_000.0)
    refused = await refusal(handlers, "lift", id="t", verdict="pass", press=1)
    assert refused.kind is FaultCode.ANOTHER_PRESS
    assert await held.wait(0.0) is None
    station.jobs.done.set_result(_touched(measured={"verdict": "pass"}, op="probe"))
    await ask(handlers, "lift", id="t", verdict="pass", press=2)
    assert await held.wait(60.0) == "lift"


async def test_a_word_of_another_press_than_the_last_is_refused_after_the_end(
    handlers: Handlers, journal: Journal
) -> None:
    said = {"verdict": "open"}
    result = await _touched_before(journal, said, op="probe", detail={"measured": said, "press": 2})
    assert (await refusal(handlers, "lift", id="t", press=1, **said)).kind is FaultCode.ANOTHER_PRESS
    assert await ask(handlers, "lift", id="t", press=2, **said) == JobReply(id="t", result=result)


async def test_a_press_of_a_touch_that_nobody_knows_is_refused_and_no_lift(handlers: Handlers, station: Daemon) -> None:
    assert (await refusal(handlers, "lift", id="mistyped", press=2)).kind is FaultCode.UNKNOWN_JOB
    assert station.jobs.taken.empty()


def _touched(measured: dict[str, Any] | None, **changes: Any) -> JobResult:
    return DONE.model_copy(update={"id": "t", "op": "touch", "detail": {"measured": measured}, **changes})


async def _touched_before(journal: Journal, measured: dict[str, Any] | None, **changes: Any) -> JobResult:
    await journal.add_job("t", "touch", "{}")
    result = _touched(measured, **{"seq": journal.take_seq(), **changes})
    await journal.finish_job(result)
    return result


async def test_lift_of_a_touch_that_is_over_answers_what_came_of_it(handlers: Handlers, journal: Journal) -> None:
    result = await _touched_before(journal, {"verdict": "pass", "value": 0.4})
    for said in ({"verdict": "pass", "value": 0.4}, {}):
        assert await ask(handlers, "lift", id="t", **said) == JobReply(id="t", result=result)


@pytest.mark.parametrize("kept", [{"verdict": "open"}, {"verdict": "pass", "value": 0.4}, None])
async def test_a_verdict_that_is_not_the_one_that_was_kept_is_refused(
    handlers: Handlers, journal: Journal, kept: dict[str, Any] | None
) -> None:
    await _touched_before(journal, kept)
    refused = await refusal(handlers, "lift", id="t", verdict="pass")
    assert refused.kind is FaultCode.VERDICT_NOT_KEPT
    assert refused.detail["kept"] == kept


async def test_a_verdict_that_comes_while_the_result_is_being_written_is_refused(
    handlers: Handlers, station: Daemon
) -> None:
    station.jobs.touches["t"] = held = standing("t")
    assert held.close() == {}
    answer = asyncio.create_task(refusal(handlers, "lift", id="t", verdict="pass"))
    await asyncio.sleep(0)
    station.jobs.done.set_result(_touched(measured=None))
    assert (await answer).kind is FaultCode.VERDICT_NOT_KEPT


async def test_lift_of_a_touch_that_failed_answers_how_it_failed_whatever_was_measured(
    handlers: Handlers, journal: Journal
) -> None:
    result = await _touched_before(journal, None, ok=False)
    assert await ask(handlers, "lift", id="t", verdict="pass") == JobReply(id="t", result=result)


async def test_what_was_measured_in_a_touch_that_nobody_knows_is_refused_and_no_lift(
    handlers: Handlers, station: Daemon
) -> None:
    assert (await refusal(handlers, "lift", id="mistyped", verdict="pass")).kind is FaultCode.UNKNOWN_JOB
    assert station.jobs.taken.empty()


@pytest.mark.parametrize("op", ["hold", "lift"])
async def test_only_the_client_that_touched_may_hold_or_lift(handlers: Handlers, station: Daemon, op: str) -> None:
    station.jobs.touches["t"] = held = standing("t", key="tester-2")
    assert (await refusal(handlers, op, id="t")).kind is FaultCode.NOT_THE_HOLDER
    request = OPERATIONS.parse({"op": "hold", "id": "t", "lease_ms": 500})
    reply: Any = handlers.at_once(request, Caller("tester-2", "operate", "tester-2"))
    assert (reply.id, reply.until_ms) == ("t", 500.0)
    assert await held.wait(0.0) is None


async def test_a_late_joiner_is_told_of_the_needle_that_is_held_down(handlers: Handlers, station: Daemon) -> None:
    assert (await ask(handlers, "snapshot")).contact is None
    station.jobs.contact = ContactFacts(**CONTACT)
    assert (await ask(handlers, "snapshot")).contact == station.jobs.contact
