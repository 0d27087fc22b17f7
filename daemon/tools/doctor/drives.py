"""Examination of bus and drives: line, identity, self-test. Moves nothing."""

from __future__ import annotations

from collections.abc import Mapping

from daemon.tools.doctor.findings import CheckResults
from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from drivers.l4118 import Axis

START_WITHIN_S, ASK_WITHIN_S = 15.0, 5.0


async def examine_axis(findings: CheckResults, axis: Axis) -> None:
    """Identify one drive, let the driver settle and test its mapping, and read how it is."""
    about = f"axis {axis.config.name}"
    try:
        started = await axis.start(Deadline.after(START_WITHIN_S))
        identity = await axis.identity(Deadline.after(ASK_WITHIN_S))
        health = await axis.health(Deadline.after(ASK_WITHIN_S))
    except DeviceError as exc:
        findings.fail(about, str(exc), exc.advice)
        return
    findings.ok(
        about,
        f"slave {axis.config.address}, vendor {identity.vendor_id:08X}h, product {identity.product_code:08X}h, "
        f"firmware {identity.revision:08X}h, serial {identity.serial_number:08X}h",
    )
    order = f"objects asked {started.addressing.index_order} endian, node {started.addressing.node}"
    findings.ok(f"{about} mapping", f"reads back as written; words {started.word_order} first; {order}")
    if health.error_code:
        found = f"{health.error_meaning or 'fault'} ({health.error_code:04X}h)"
        findings.fail(f"{about} state", found, "remove the cause the drive names, then reset")
    elif health.homed and (health.negative_limit or health.positive_limit):
        findings.fail(f"{about} state", "stands on a limit switch", "free the axis, then home")
    else:
        homed = "homed" if health.homed else "not homed (home it when the daemon runs)"
        findings.ok(f"{about} state", f"{health.state}, {homed}")


def examine_line(findings: CheckResults, buses: Mapping[str, ModbusBus]) -> None:
    """Judge each line by how it did during the examination."""
    for name, bus in buses.items():
        seen = bus.statistics
        bad = seen.timeouts + seen.garbled
        found = f"{seen.requests} requests, {seen.timeouts} without an answer, {seen.garbled} garbled"
        findings.judge(f"bus {name} quality", found, good=bad == 0, otherwise="warn",
                       advice="check termination, shield, and that no two slaves share an address")  # fmt: skip
