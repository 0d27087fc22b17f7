"""Examination of bus and drives: line, identity, self-test. Moves nothing."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping

from daemon.tools.doctor.findings import CheckResults
from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from drivers.l4118 import Axis

START_WITHIN_S, ASK_WITHIN_S = 15.0, 5.0
SWITCHES = {0b001: "negative limit", 0b010: "positive limit", 0b100: "home"}
ALL_SWITCHES = 7
SWITCH_INPUTS, POLE_PAIRS = "3240h:01", "2030h:00"
INCREMENTS_PER_PAIR = 65536
ROUND_TRIPS, SLOW_MS = 15, 10.0
SLOW_ADVICE = (
    "the adapter waits before it hands over what came: set its latency timer to 1 ms "
    "(/sys/bus/usb-serial/devices/ttyUSB*/latency_timer), or use another"
)


async def examine_axis(findings: CheckResults, axis: Axis, bus: ModbusBus) -> None:
    """Identify one drive, let the driver settle and test its mapping, and read how it is."""
    about = f"axis {axis.config.name}"
    garbled = bus.statistics.garbled
    try:
        started = await axis.start(Deadline.after(START_WITHIN_S))
        identity = await axis.identity(Deadline.after(ASK_WITHIN_S))
        health = await axis.health(Deadline.after(ASK_WITHIN_S))
        settings = await axis.settings(Deadline.after(ASK_WITHIN_S))
    except DeviceError as exc:
        findings.fail(about, str(exc), exc.advice)
        return
    finally:
        _judge_address(findings, axis, bus.statistics.garbled - garbled)
    findings.ok(
        about,
        f"slave {axis.config.address}, vendor {identity.vendor_id:08X}h, product {identity.product_code:08X}h, "
        f"firmware {identity.revision:08X}h, serial {identity.serial_number:08X}h",
    )
    order = f"objects asked {started.addressing.index_order} endian, node {started.addressing.node}"
    words = {"big": "high word first", "little": "low word first", None: "word order not shown by the position yet"}
    findings.ok(f"{about} mapping", f"reads back as written; {words[started.word_order]}; {order}")
    _judge_switches(findings, axis, settings[SWITCH_INPUTS])
    _judge_settings(findings, axis, settings)
    if health.error_code:
        found = f"{health.error_meaning or 'fault'} ({health.error_code:04X}h)"
        findings.fail(f"{about} state", found, "remove the cause the drive names, then reset")
    elif health.homed and (health.negative_limit or health.positive_limit):
        findings.fail(f"{about} state", "stands on a limit switch", "free the axis, then home")
    else:
        homed = "homed" if health.homed else "not homed (home it when the daemon runs)"
        findings.ok(f"{about} state", f"{health.state}, {homed}")


def _judge_address(findings: CheckResults, axis: Axis, garbled: int) -> None:
    """Say what garbled answers of one address, and of no other, come from."""
    if garbled:
        found = f"{garbled} answers of slave {axis.config.address} were garbled"
        advice = f"perhaps two slaves have address {axis.config.address}: unplug all but one, and scan (--scan)"
        findings.warn(f"axis {axis.config.name} address", found, advice)


def _judge_switches(findings: CheckResults, axis: Axis, inputs: int | None) -> None:
    """Judge which inputs the drive takes for switches."""
    about = f"axis {axis.config.name} switches"
    advice = f"set switch_inputs = {ALL_SWITCHES} under axes.{axis.config.name}, or 3240h:01 in the drive"
    if inputs is None:
        findings.warn(about, "the drive has no 3240h:01", "see by hand that it stops at its limit switches")
        return
    ignored = [name for bit, name in SWITCHES.items() if not inputs & bit]
    found = f"3240h:01 = {inputs:X}h" + (f"; ignored: {', '.join(ignored)}" if ignored else "")
    if axis.config.homing_switch & ~inputs:
        findings.fail(about, f"{found}; homing method {axis.config.homing.method} would run past its switch", advice)
    else:
        both_limits = all(inputs & bit for bit, name in SWITCHES.items() if "limit" in name)
        findings.judge(about, found, good=both_limits, otherwise="warn", advice=advice)


def _judge_settings(findings: CheckResults, axis: Axis, settings: Mapping[str, int | None]) -> None:
    """Show the settings that make a motor run and stop, as they are; judge the one that is known beforehand."""
    shown = ", ".join(f"{place} = {'none' if value is None else value}" for place, value in settings.items())
    pairs, wanted = settings[POLE_PAIRS], axis.config.increments_per_rev / INCREMENTS_PER_PAIR
    findings.judge(f"axis {axis.config.name} settings", shown, good=pairs is None or pairs == wanted, otherwise="warn",
                   advice=f"2030h (pole pairs) is {pairs}, {wanted:.0f} are reckoned with: see the motor")  # fmt: skip


async def examine_round_trip(findings: CheckResults, axis: Axis, bus: ModbusBus) -> None:
    """Time the shortest question; what is left beside the line's own speed is the adapter's, and the drive's."""
    took_s: list[float] = []
    try:
        for _ in range(ROUND_TRIPS):
            began_s = time.monotonic()
            await axis.statusword(Deadline.after(ASK_WITHIN_S))
            took_s.append(time.monotonic() - began_s)
    except DeviceError as exc:
        findings.fail("round trip", str(exc), exc.advice)
        return
    took_ms = statistics.median(took_s) * 1e3
    found = f"{took_ms:.1f} ms for one question, {bus.request_s * 1e3:.1f} by the speed of the line"
    findings.judge(f"round trip of axis {axis.config.name}", found, good=took_ms - bus.request_s * 1e3 <= SLOW_MS,
                   otherwise="warn", advice=SLOW_ADVICE)  # fmt: skip


def examine_line(findings: CheckResults, buses: Mapping[str, ModbusBus]) -> None:
    """Judge each line by how it did during the examination."""
    for name, bus in buses.items():
        seen = bus.statistics
        bad = seen.timeouts + seen.garbled
        found = f"{seen.requests} requests, {seen.timeouts} without an answer, {seen.garbled} garbled"
        findings.judge(f"bus {name} quality", found, good=bad == 0, otherwise="warn",
                       advice="check termination, shield, and that no two slaves share an address")  # fmt: skip
