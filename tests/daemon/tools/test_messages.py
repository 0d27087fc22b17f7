"""The page of messages is what the code says, and each message can be acted on."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from daemon.domain.errors import FaultCode
from daemon.maintenance.catalogue import all_specs
from daemon.tools.messages import page

COMMITTED = Path(__file__).parents[3] / "doc" / "messages.md"
NOBODY_CAN_ACT_ON_IT = ("see detail", "give the operation more time", "find the cause", "find what is slow")
INSIDES = re.compile(r"\b(?:None|null|traceback|exception|0x[0-9a-f]+|[0-9A-F]{4}h|\w+Error)\b|\w\(\)")
"""Python's words, registers and functions: no business of an operator's, unless asked for (`detail`)."""


def test_the_committed_page_is_what_the_code_makes() -> None:
    """After a change: `python -m daemon.cli schema --out doc`."""
    assert COMMITTED.read_text(encoding="utf-8") == page()


def test_every_kind_of_fault_and_every_alert_is_on_the_page_with_its_cure() -> None:
    text = page()
    for kind in FaultCode:
        assert f"### {kind.wire_name} ({kind.code})" in text
        assert kind.value.advice in text
    for spec in all_specs(["main"]):
        assert f"| `{spec.name}` |" in text


@pytest.mark.parametrize("kind", FaultCode, ids=lambda kind: kind.wire_name)
def test_cause_and_cure_are_for_the_person_who_reads_them_at_night(kind: FaultCode) -> None:
    for words in (kind.value.cause, kind.value.advice):
        assert len(words.split()) >= 2
        assert not INSIDES.search(words), words
        assert not any(empty in words.lower() for empty in NOBODY_CAN_ACT_ON_IT), words


def test_no_cure_on_the_page_is_one_that_nobody_can_act_on() -> None:
    text = page().lower()
    assert not [empty for empty in NOBODY_CAN_ACT_ON_IT if empty in text]


def test_no_message_of_a_job_names_a_register_or_a_function() -> None:
    """Nor does it quote bytes; `detail.technical` does, for who mends the drive or the line."""
    jobs = page().partition("## What a job")[2].partition("## Alerts")[0]
    said = [line.removeprefix("- ").partition(" -> ")[0] for line in jobs.splitlines() if line.startswith("- ")]
    assert len(said) > 200
    inside = r"\bFC\b|&lt;\w+>h\b|\bcoils?\b|set-point|(?:control|status) ?word|no sound frame"
    assert not [text for text in said if re.search(rf"{INSIDES.pattern}|{inside}", text)]


def test_an_instruments_message_stands_with_the_cure_of_its_own_trouble() -> None:
    section = page().partition("### meter_failed")[2].partition("### ")[0]
    assert "is not connected -> Check the instrument's power and cable" in section
    assert "See the log" not in section


def test_messages_of_drivers_stand_under_the_fault_that_they_become() -> None:
    _, _, after = page().partition("### light_failed")
    section = after.partition("### ")[0]
    assert "both lamps are switched off, but the picture is lit" in section
    assert "its relay contact sticks" in section
