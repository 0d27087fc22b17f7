"""Examination of a station in its order. A running daemon is asked instead: two masters on one line do harm."""

from __future__ import annotations

import asyncio
import stat
from contextlib import AsyncExitStack
from pathlib import Path

from daemon.client import Client, NoAnswer, NotLetIn, Refused, from_here
from daemon.config.model import Config, ConfigError, load_config
from daemon.domain.board import Board
from daemon.station.devices import make_axes, make_camera, open_buses, open_lights
from daemon.tools.doctor.computer import devices_of, examine_computer, in_use
from daemon.tools.doctor.drives import examine_axis, examine_line, examine_round_trip
from daemon.tools.doctor.findings import CheckResults
from daemon.tools.doctor.meter import examine_meter
from daemon.tools.doctor.scan import scan_lines
from daemon.tools.doctor.seeing import examine_lights, examine_rate, examine_settings
from daemon.wire.curve_keys import KeyTrouble
from drivers.bus import ModbusBus
from drivers.camera import Camera
from drivers.deadline import Deadline
from drivers.errors import DeviceError

ASK_WITHIN_S, OPEN_WITHIN_S = 1.5, 12.0


def examine(config_file: Path, *, scan: bool = False) -> CheckResults:
    """Examine a station, or with `scan` only look who is on its lines; whatever is wrong becomes a finding."""
    findings = CheckResults()
    try:
        config = load_config(config_file)
    except ConfigError as exc:
        for where, what in exc.placed():
            findings.fail(f"configuration {where}", what, "correct it, then run this again")
        return findings
    open_to_all = bool(config_file.stat().st_mode & stat.S_IWOTH)
    findings.judge("configuration", f"{config_file}: good", good=not open_to_all, otherwise="warn",
                   advice=f"anybody may change what moves the head: chmod o-w {config_file}")  # fmt: skip
    try:
        board = Board.load(config.board.file)
        findings.ok("board", f"{board.name} ({board.side}), {len(board.test_points())} test points")
    except ValueError as exc:
        findings.fail("board", str(exc), "make it by `reprobe board CAD_FOLDER -o board.json`")
    if _ask_daemon(findings, config):
        return findings
    examine_computer(findings, config)
    if any(in_use(Path(device)) for _, device, _ in devices_of(config)):
        findings.warn("devices", "not examined: another program uses them", "stop it, then run this again")
    elif scan:
        asyncio.run(scan_lines(findings, config))
    else:
        asyncio.run(_examine_devices(findings, config))
    return findings


def _ask_daemon(findings: CheckResults, config: Config) -> bool:
    """If a daemon runs on this station, note what it says of itself; tell whether one does."""
    about = "running daemon"
    try:
        with Client(from_here(config.api.control), timeout_s=ASK_WITHIN_S) as client:
            says, health = client.request("snapshot"), client.request("alerts", limit=1)
    except (NotLetIn, Refused, KeyTrouble) as exc:
        advice = "name a key it takes in REPROBE_KEY, or stop it (systemctl stop reprobe) to examine the devices"
        findings.fail(about, str(exc), advice)
        return True
    except NoAnswer:
        return False
    fault = says["fault"]
    found = f"{says['station']} is in state {says['state']}"
    if fault:
        findings.fail(about, f"{found}: {fault['message']}", fault["advice"])
    else:
        findings.ok(about, found)
    for name, bus in says.get("links", {}).get("buses", {}).items():
        found = f"{bus['requests']} requests, {bus['timeouts']} without an answer, {bus['garbled']} garbled"
        findings.judge(f"bus {name} as it says", found, good=bool(bus["connected"]), advice="check the adapter")
    for alert in health["standing"]:
        findings.warn(f"alert {alert['name']}", "; ".join([alert["what"], *alert["evidence"]]), alert["advice"])
    not_used = says["calibration"]["not_used"]
    for what, why in not_used.items():
        findings.warn(f"calibration {what}", why, f"reprobe calibrate {what}")
    advice = "for the whole examination stop it first: `systemctl stop reprobe`, or Ctrl-C where it was started by hand"
    findings.warn("devices", "not touched: the daemon has them", advice)
    return True


async def _examine_devices(findings: CheckResults, config: Config) -> None:
    async with AsyncExitStack() as stack:
        buses = await _open_buses(findings, config, stack)
        if buses is not None:
            axes = make_axes(config, buses)
            for name, axis in axes.items():
                await examine_axis(findings, axis, buses[getattr(config.axes, name).bus])
            timed = {getattr(config.axes, name).bus: axis for name, axis in axes.items()}
            for name, axis in timed.items():
                await examine_round_trip(findings, axis, buses[name])
        camera = await _open_camera(findings, config, stack)
        await _examine_seeing(findings, config, camera, buses, stack)
        if buses is not None:
            examine_line(findings, buses)
    if config.meter is not None:
        await examine_meter(findings, config.meter)


async def _open_buses(findings: CheckResults, config: Config, stack: AsyncExitStack) -> dict[str, ModbusBus] | None:
    try:
        buses = await open_buses(config, stack)
    except DeviceError as exc:
        findings.fail("bus", str(exc), exc.advice)
        return None
    for name in buses:
        findings.ok(f"bus {name}", "opens")
    return buses


async def _open_camera(findings: CheckResults, config: Config, stack: AsyncExitStack) -> Camera | None:
    camera = make_camera(config.camera)
    try:
        await camera.open(Deadline.after(OPEN_WITHIN_S))
    except DeviceError as exc:
        findings.fail("camera", str(exc), exc.advice)
        return None
    stack.push_async_callback(camera.close)
    examine_settings(findings, camera, config.camera)
    try:
        await examine_rate(findings, camera)
    except DeviceError as exc:
        findings.fail("camera frame rate", str(exc), exc.advice)
        return None
    return camera


async def _examine_seeing(
    findings: CheckResults,
    config: Config,
    camera: Camera | None,
    buses: dict[str, ModbusBus] | None,
    stack: AsyncExitStack,
) -> None:
    if config.lights.kind == "modbus" and buses is None:
        findings.warn("lights", "not examined: their bus is not open", "see the bus above")
        return
    try:
        lights = await open_lights(config.lights, buses or {}, Deadline.after(OPEN_WITHIN_S))
    except DeviceError as exc:
        findings.fail("lights", str(exc), exc.advice)
        return
    stack.push_async_callback(lights.close)
    if camera is None:
        findings.warn("lights", "the relay answers; the lamps are not seen without a camera", "see the camera above")
    else:
        await examine_lights(findings, camera, lights)
