"""The examination says who the measuring instrument is, and which method it does not understand."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

import pytest

from daemon.config.sections.meter import MeterSection
from daemon.tools.doctor.findings import CheckResults
from daemon.tools.doctor.meter import examine_meter
from tests.drivers.peers.instrument import Instrument, Script, TcpPeer


@pytest.fixture
def script() -> Script:
    return Script()


@pytest.fixture
async def address(script: Script) -> AsyncIterator[str]:
    peer = TcpPeer(Instrument(script))
    yield str(await peer.open())
    await peer.close()


async def _examined(address: str, **settings: Any) -> list[tuple[str, str, str]]:
    findings = CheckResults()
    section = MeterSection.model_validate({"kind": "scpi", "address": address, "answer_ms": 5000, **settings})
    await examine_meter(findings, section)
    return [(check.about, check.verdict, check.found) for check in findings.checks]


async def test_a_good_one_is_named_with_what_it_reads(address: str, script: Script) -> None:
    who = ("meter", "ok", "ACME DMM-7, serial number SN123")
    assert await _examined(address) == [who, ("meter resistance", "ok", "understood; it reads 15 ohm")]
    script.reading = (b"+9.9E37\n",)
    checks = await _examined(address, methods={"contact": {}, "voltage": {}})
    assert checks[1:] == [
        ("meter contact", "ok", "understood; it reads overload"),
        ("meter voltage", "ok", "understood; it reads overload"),
    ]


async def test_a_method_it_does_not_know_is_named_and_the_others_go_on(address: str, script: Script) -> None:
    script.knows = lambda command: not command.startswith(b"CONF:CAP")
    checks = await _examined(address, methods={"capacitance": {}, "fres": {}})
    assert [check[:2] for check in checks] == [("meter", "ok"), ("meter capacitance", "fail"), ("meter fres", "ok")]
    assert "does not know the commands" in checks[1][2]


async def test_one_that_is_not_there_is_a_failure_with_its_cause(address: str, script: Script) -> None:
    ((about, verdict, found),) = await _examined(address, model="34461A")
    assert (about, verdict) == ("meter", "fail")
    assert "not the 34461A" in found
