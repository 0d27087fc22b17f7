"""Examination of the measuring instrument: it answers, who it is, and that it understands the methods configured."""

from __future__ import annotations

from daemon.config.sections.meter import MeterSection
from daemon.station.devices import open_meter
from daemon.tools.doctor.findings import CheckResults
from drivers.deadline import Deadline
from drivers.errors import MeterError
from drivers.meter import Meter, Method

WITHIN_S = 12.0


async def examine_meter(findings: CheckResults, section: MeterSection) -> None:
    """Open it and set it up for each method; it is left at the last one."""
    try:
        meter = await open_meter(section, Deadline.after(WITHIN_S))
    except MeterError as exc:
        findings.fail("meter", str(exc), exc.advice)
        return
    try:
        findings.ok("meter", f"{meter.identity}, serial number {meter.identity.serial or 'not told'}")
        for method in section.methods or (Method.RESISTANCE,):
            await _examine_method(findings, meter, method)
    finally:
        await meter.close()


async def _examine_method(findings: CheckResults, meter: Meter, method: Method) -> None:
    """Read once: the needle is up, so that an overload is as good an answer as a number."""
    try:
        reading = await meter.measure(method, Deadline.after(WITHIN_S))
    except MeterError as exc:
        findings.fail(f"meter {method.value}", str(exc), exc.advice)
        return
    said = "overload" if reading.overload else f"{reading.value:.6g} {reading.unit}"
    findings.ok(f"meter {method.value}", f"understood; it reads {said}")
