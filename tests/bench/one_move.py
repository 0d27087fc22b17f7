"""Capture the Modbus bytes of one move of one axis on the simulated station, annotated.

python -m tests.bench.one_move > drivers/l4118/ONE_MOVE.md
"""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path
from typing import Literal

from daemon.config.model import load_config
from daemon.platform.logs import set_up
from daemon.tools.demo.processes import Process
from daemon.tools.demo.settings import Places, write_settings
from drivers.bus import ModbusBus, SerialLine
from drivers.deadline import Deadline
from drivers.l4118 import Axis, AxisConfig, HomingConfig
from tests.station.rig import DEMO_BOARD

HEAD = """\
# The bytes of one move

One absolute move of the X axis (slave 1) by +1 mm, as it passes the line of the simulated station; made by
`python -m tests.bench.one_move`, so it can be made again after a change. `>` is the daemon, `<` the drive. The last two
bytes of each frame are the CRC, low byte first.

All that is written goes by FC 43, object by object. The process image is only read, by FC 3 from register 5000 (1388h)
on, as 3602h lays it out since the start: 6041h statusword, padding, 6061h mode, 6064h position, 60FDh inputs. High byte
and high word come first. The drive has no homing bit outside of homing mode: the marker kept in 2400h:20h stands for
one. It was read as the drive was switched on, and a restart ends "operation enabled", so the first look tells state,
place and reference. 1 mm is 655 360 increments; the speed (6081h) is written only when it changes.

Among four drives the same bytes pass, with those of the others between them: the next target of an axis that stands is
written while another travels, and bit 4 falls (000Fh) as soon as the line has nothing more urgent, at the latest before
the next target of that axis.

"""
OBJECTS = {
    0x6040: "controlword", 0x6041: "statusword", 0x6060: "mode", 0x6061: "mode shown", 0x6064: "position",
    0x607A: "target", 0x6081: "speed", 0x603F: "error", 0x2400: "NanoJ input", 0x60FD: "inputs", 0x6083: "acceleration",
    0x6084: "deceleration", 0x607D: "software limit", 0x605A: "quick-stop option", 0x6085: "quick-stop ramp",
}  # fmt: skip
CONTROLWORD = 0x6040
Direction = Literal["sent", "received"]


def meaning(direction: Direction, frame: bytes) -> str:
    """Say what a frame is, by its function code."""
    match frame[1], direction:
        case 0x03, "sent":
            return "read the Tx image"
        case 0x03, _:
            return tx_image(frame[3:-2])
        case 0x2B, _:
            return object_access(direction, frame)
        case function, _:
            return f"function {function}"


def tx_image(data: bytes) -> str:
    """Say what the Tx image holds: 6041h, padding, 6061h, 6064h, 60FDh."""
    status, position = int.from_bytes(data[:2]), int.from_bytes(data[4:8], signed=True)
    return f"statusword {status:04X}h ({flags(status)}), mode {data[3]}, position {position}"


def object_access(direction: Direction, frame: bytes) -> str:
    """Say which object FC 43 reads or writes."""
    index, sub = int.from_bytes(frame[6:8]), frame[8]
    name = OBJECTS.get(index, "object")
    data = frame[13:-2]
    value = f" = {int.from_bytes(data, 'little')}" if data else ""
    if index == CONTROLWORD and data and direction == "sent":
        word = int.from_bytes(data, "little")
        value = f" = {word:04X}h ({commands(word)})"
    if direction == "sent":
        return f"{'write' if frame[3] else 'read'} {index:04X}h:{sub:02X} {name}{value}"
    return f"{index:04X}h:{sub:02X} {name}{value or ' written'}"


def flags(status: int) -> str:
    """Name the bits of 6041h that tell of a move."""
    bits = {0x0400: "target reached", 0x1000: "set-point taken", 0x0800: "limit", 0x0008: "fault"}
    states = {0x27: "operation enabled", 0x23: "switched on", 0x21: "ready", 0x40: "switch-on disabled"}
    state = next((name for code, name in states.items() if status & 0x6F == code), "other state")
    return ", ".join([state, *(name for bit, name in bits.items() if status & bit)])


def commands(word: int) -> str:
    """Name what 6040h commands."""
    base = {0x06: "shutdown", 0x07: "switch on", 0x0F: "enable"}.get(word & 0x0F, "other")
    return ", ".join([base, *(name for bit, name in {0x10: "new set-point", 0x20: "at once"}.items() if word & bit)])


async def capture(line: str, settings: Path) -> list[tuple[Direction, bytes]]:
    """Home the X axis, then move it by 1 mm and keep what passed."""
    frames: list[tuple[Direction, bytes]] = []
    recording = False

    def tap(direction: Direction, data: bytes) -> None:
        if recording:
            frames.append((direction, data))

    section = load_config(settings).axes.x
    homing = HomingConfig(section.homing_method, section.homing_speed, section.homing_speed / 5, section.acceleration)
    config = AxisConfig("x", section.address, section.increments_per_unit, section.minimum, section.maximum,
                        section.speed, section.acceleration, 1.0, homing, poll_s=0.02)  # fmt: skip
    bus = await ModbusBus.open(SerialLine(line, 115200, "N", 1), tap=tap)
    axis = Axis(bus, config)
    deadline = Deadline.after(60.0)
    await axis.start(deadline)
    await axis.home(deadline)
    await axis.move_to(20_000.0, deadline)
    recording = True
    await axis.move_to(21_000.0, deadline)
    recording = False
    await bus.close()
    return frames


def main() -> None:
    """Print the page; logging goes to the other stream."""
    set_up(as_json=False)
    with tempfile.TemporaryDirectory() as folder:
        places = Places(Path(folder), Path(folder))
        settings = write_settings(places)
        arguments = [
            "sim_hw", "--board", str(DEMO_BOARD), "--side", "top", "--seed", "1", "--line", places.line,
            "--camera", places.socket("camera"), "--bench", places.socket("bench"), "--truth", f"{folder}/truth.jsonl",
        ]  # fmt: skip
        sim = Process("simulated station", arguments, places.out / "sim.log", ready_line=True)
        try:
            sim.ready()
            frames = asyncio.run(capture(places.line, settings))
        finally:
            sim.end()
    print(HEAD + "| | bytes | meaning |\n|---|---|---|")
    for direction, frame in frames:
        arrow = "&gt;" if direction == "sent" else "&lt;"
        print(f"| {arrow} | `{frame.hex(' ').upper()}` | {meaning(direction, frame)} |")


if __name__ == "__main__":
    main()
