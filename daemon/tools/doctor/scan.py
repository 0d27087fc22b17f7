"""Scan of a line: which addresses answer, at which speed and parity. Reads only; nothing moves, nothing is set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

from daemon.config.model import Config
from daemon.config.sections.devices import BusSection
from daemon.station.devices import bus_line
from daemon.tools.doctor.findings import CheckResults
from drivers.bus import Line, ModbusBus, SerialLine
from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, LinkError, LinkTimeout, ReplyError

BAUDS = (115200, 19200, 9600, 38400, 57600, 7200, 14400, 56000, 128000, 256000)
"""Speeds of the drives and of relay boards, the likely ones first."""
PARITIES: tuple[Literal["E", "N", "O"], ...] = ("E", "N", "O")
ADDRESSES = (*range(1, 33), 255)
"""Drives and relays are given low addresses; some relay boards ship with 255."""
PLACE = 5000
"""Register that is asked for: the status of a drive. A slave without it refuses, which is an answer too."""
THOUGHT_S, EXCHANGE_BYTES = 0.03, 17


async def scan_lines(findings: CheckResults, config: Config) -> None:
    """Look on every line of the configuration at its own setting first, then at all others."""
    for name, section in config.bus.items():
        nobody = True
        for line in settings_of(section):
            nobody &= not await scan_line(findings, f"bus {name}", line, ADDRESSES)
        if nobody:
            findings.fail(f"bus {name}", f"nobody answers at any of {len(ADDRESSES)} addresses, speeds and parities",
                          "check power, the two wires (try them swapped), and termination")  # fmt: skip


def settings_of(section: BusSection) -> Iterator[Line]:
    """Yield the line as configured, then in all other ways a slave may be set."""
    configured = bus_line(section)
    yield configured
    if not isinstance(configured, SerialLine):
        return  # the speed behind a gateway is the gateway's
    for baud in BAUDS:
        for parity in PARITIES:
            line = SerialLine(configured.port, baud, parity, 1, configured.local_echo)
            if (line.baudrate, line.parity) != (configured.baudrate, configured.parity):
                yield line


async def scan_line(
    findings: CheckResults, about: str, line: Line, addresses: Iterable[int], thought_s: float = THOUGHT_S
) -> list[int]:
    """Ask every address once; note and return those that answer within the time a slave is given to think."""
    wait_s = thought_s + line.seconds(EXCHANGE_BYTES)
    try:
        bus = await ModbusBus.open(line, timeout_s=wait_s, late_reply_s=wait_s, attempts=1)
    except LinkError as exc:
        findings.warn(about, f"{line} cannot be tried: {exc.message}", exc.advice)
        return []
    try:
        said = {address: await _ask(bus, address) for address in addresses}
    except LinkError as exc:
        findings.fail(about, str(exc), exc.advice)
        return []
    finally:
        await bus.close()
    there = [address for address, what in said.items() if what == "answers"]
    for address in there:
        findings.ok(about, f"{line}: address {address} answers")
    garbled = [address for address, what in said.items() if what == "garbled"]
    if garbled and len(garbled) < len(said) // 2:
        shown = ", ".join(map(str, garbled))
        findings.warn(about, f"{line}: garbled answers at address {shown}", "perhaps two slaves have the same address")
    elif garbled:
        findings.warn(about, f"{line}: noise at {len(garbled)} addresses", "an echo, or slaves that are set otherwise")
    return there


async def _ask(bus: ModbusBus, address: int) -> str:
    """Ask one address for a status."""
    try:
        await bus.read_registers(address, PLACE, 2, Deadline.after(5.0))
    except DeviceRefused:
        return "answers"
    except ReplyError:
        return "garbled"
    except LinkTimeout:
        return "silent"
    return "answers"
