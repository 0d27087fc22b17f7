"""What is plugged in: serial ports, cameras, and who answers on a line. Reads only; nothing moves, nothing is set."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from daemon.config.sections.devices import BusSection
from daemon.tools.doctor.findings import CheckResults
from daemon.tools.doctor.scan import ADDRESSES, THOUGHT_S, scan_line, settings_of
from drivers.bus import Line, ModbusBus, SerialLine
from drivers.deadline import Deadline
from drivers.errors import DeviceRefused

STATUS_WORD_OF_DRIVE, REPLY_S, WITHIN_S = 5000, 1.0, 5.0
PATIENT_S, MOST_PATIENT_S = 0.3, 1.0
LIKELY_BAUDS, LIKELY_ADDRESSES = (115200, 19200), 8
"""What drives are set to, new or on a line; they are given the first addresses."""
_PORTS = ("dev/reprobe-bus", "dev/serial/by-id/*", "dev/ttyUSB*", "dev/ttyACM*", "dev/ttyAMA*")
_CAMERAS = ("dev/reprobe-camera", "dev/v4l/by-id/*", "dev/video*")


@dataclass(frozen=True)
class Answering:
    """Who answers on a line that was found, at which setting."""

    baudrate: int
    parity: str
    drives: tuple[int, ...]
    others: tuple[int, ...]
    """Addresses of what is no drive: a relay board."""


def serial_ports(root: Path = Path("/")) -> list[str]:
    """Return ports that may be the station's, the stable names first; one that goes by two names once."""
    return _once(root, _PORTS)


def cameras(root: Path = Path("/")) -> list[str]:
    """Return cameras in the same way."""
    return _once(root, _CAMERAS)


def _once(root: Path, patterns: Iterable[str]) -> list[str]:
    found: dict[Path, str] = {}
    for pattern in patterns:
        for path in sorted(root.glob(pattern)):
            found.setdefault(path.resolve(), str(path))
    return list(found.values())


async def who_answers(section: BusSection, addresses: Iterable[int] = ADDRESSES) -> Answering | None:
    """Try the line at one setting after the other until somebody answers; None where nobody does."""
    asked = list(addresses)
    likely: list[Line] = []
    rest: list[Line] = []
    for line in settings_of(section):
        (likely if not isinstance(line, SerialLine) or line.baudrate in LIKELY_BAUDS else rest).append(line)
    # A slave, or a computer, that is busy answers late: the likely settings are tried with patience, before the others
    for lines, whom, thought_s in ((likely, asked[:LIKELY_ADDRESSES], PATIENT_S), ([*likely, *rest], asked, THOUGHT_S)):
        for line in lines:
            if await scan_line(CheckResults(), "line", line, whom, thought_s):
                return await _told_apart(line, await _all_there(line, asked))
    return None


async def _all_there(line: Line, asked: list[int]) -> list[int]:
    """Return who answers on a line where somebody does; of the likely ones who is silent is asked again, for longer."""
    there = await scan_line(CheckResults(), "line", line, asked, PATIENT_S)
    silent = [address for address in asked[:LIKELY_ADDRESSES] if address not in there]
    return sorted([*there, *await scan_line(CheckResults(), "line", line, silent, MOST_PATIENT_S)])


async def _told_apart(line: Line, there: list[int]) -> Answering:
    """Tell drives from relay boards: a drive has a status word to read, a relay board refuses.

    Raises `DeviceError` where one that answered before says nothing now: nobody knows what it is.
    """
    bus = await ModbusBus.open(line, timeout_s=REPLY_S)
    try:
        drives = [address for address in there if await _is_drive(bus, address)]
    finally:
        await bus.close()
    baudrate, parity = (line.baudrate, line.parity) if isinstance(line, SerialLine) else (0, "")
    return Answering(baudrate, parity, tuple(drives), tuple(one for one in there if one not in drives))


async def _is_drive(bus: ModbusBus, address: int) -> bool:
    try:
        await bus.read_registers(address, STATUS_WORD_OF_DRIVE, 2, Deadline.after(WITHIN_S))
    except DeviceRefused:
        return False
    return True
