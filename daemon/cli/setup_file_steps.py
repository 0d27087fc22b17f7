"""Steps of the guided set-up that write the configuration: what is plugged in, the mechanics, the board. None moves."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from daemon.cli.setup_dialogue import Dialogue, StepFailed, number, text, whole
from daemon.config.cross_checks import is_endpoint
from daemon.config.model import Config, ConfigError, load_config, unlikely
from daemon.config.problems import told
from daemon.config.reading import toml_text
from daemon.config.sections.devices import BusSection
from daemon.domain.board import Board
from daemon.platform.atomic_file import rewrite
from daemon.tools.board_import import Options, import_board
from daemon.tools.setup import (
    Answering,
    cameras,
    increments_per_unit,
    read_value,
    serial_ports,
    who_answers,
    with_values,
)
from daemon.tools.setup.edit import Value, example
from drivers.errors import DeviceError
from drivers.meter import parse_address

T = TypeVar("T")
AXES = ("x", "y", "z", "theta")
NEW_FILE = 0o644
"""Mode of a new file: it has no secret, and the daemon is another user."""
HOMING = "17: negative limit, 18: positive limit, 19: home switch, positive side, 21: home switch, negative side"


@dataclass
class Setup:
    """A set-up under way: the file it writes, and the dialogue."""

    file: Path
    dialogue: Dialogue

    def text(self) -> str:
        """Return the configuration as it is so far; a new one begins as the example. `StepFailed` for a damaged one."""
        if not self.file.exists():
            return example()
        try:
            return toml_text(self.file)
        except ConfigError as exc:
            why = "; ".join(what for _, what in exc.problems)
            raise StepFailed(
                f"{self.file} cannot be read: {why}", "mend it, or move it away to begin a new one; then try again"
            ) from exc

    def number_at(self, path: str, otherwise: float) -> float:
        """Return a number of the file as it is so far; `otherwise` where there is none."""
        now = read_value(self.text(), path)
        try:
            value = math.nan if isinstance(now, bool) or not isinstance(now, int | float) else float(now)
        except OverflowError:
            value = math.nan
        return value if math.isfinite(value) else otherwise

    def write(self, values: dict[str, Value]) -> None:
        """Put values into the file; everything else in it stays."""
        try:
            content = with_values(self.text(), values)
        except ValueError as exc:
            raise StepFailed(str(exc), f"edit {self.file}, then try again") from exc
        rewrite(self.file, content.encode(), NEW_FILE)

    def ask_number(self, path: str, question: str, unit: str, low: float, high: float, scale: float = 1.0) -> float:
        """Ask for a value of the file in a unit that people use; return it in the file's, which is `scale` times it."""
        now = f"{self.number_at(path, 0.0) / scale:g}"
        return self.ask(path, f"{question}, {unit}", now, number(low, high, unit)) * scale

    def choose(self, path: str, question: str, offered: list[str], now: str) -> str:
        """Let a device be chosen; what the file says, `now`, is offered first while it can be found."""
        place = self.file.parent / now
        there = now if _is_endpoint(now) else str(place) if now and _exists(place) else ""
        return self.dialogue.choose(f"{path} where it was {now}", question, offered, there)

    def ask(self, path: str, question: str, now: str, check: Callable[[str], T]) -> T:
        """Ask for a value of the file, which is `now` as people write it.

        What was answered the last time is offered only while the file is as it was then: what it says since is newer,
        a scale that was measured for example.
        """
        return self.dialogue.ask(f"{path} where it was {now}", question, now, check)

    def said_of(self, path: str, otherwise: str) -> str:
        """Return what the file, if there is one yet, says at a path."""
        now = read_value(self.text(), path) if self.file.exists() else None
        return otherwise if now is None else str(now)


def name_it(setup: Setup) -> None:
    """Ask for name and data folder."""
    name = setup.ask("station.name", "Name of this station", setup.said_of("station.name", "station-1"), text)
    where = "/var/lib/reprobe" if setup.file.is_absolute() and setup.file.is_relative_to("/etc") else "station"
    where = setup.said_of("station.data_dir", where)
    folder = setup.ask("station.data_dir", "Folder of journal, calibrations and pictures", where, text)
    setup.write({"station.name": name, "station.data_dir": folder})


def find_drives(setup: Setup) -> None:
    """Find port, speed, parity and addresses of drives and relay board by asking; nothing is set."""
    dialogue = setup.dialogue
    port = setup.choose("bus.main.port", "Port of the drives (a number, or a path)", serial_ports(), _line_now(setup))
    gateway = _is_gateway(port)
    port = port if gateway else _device(port)
    host, _, tcp_port = port.partition(":")
    section = _gateway(host, tcp_port) if gateway else BusSection(port=port)

    def ask_all() -> Answering | None:
        dialogue.say("Asking every address at every speed and parity; that takes up to a minute, and only reads ...")
        return asyncio.run(who_answers(section))

    try:
        found = dialogue.once(port, ask_all)
    except DeviceError as failure:
        raise StepFailed(str(failure), failure.advice) from failure
    if found is None:
        raise StepFailed("nobody answers there", "check power, the two wires (try them swapped) and termination")
    drives, others = ", ".join(map(str, found.drives)) or "none", ", ".join(map(str, found.others)) or "none"
    dialogue.say(f"At {found.baudrate} baud, parity {found.parity}: drives {drives}; others, such as relays: {others}")
    if len(found.drives) < len(AXES):
        raise StepFailed(
            f"{len(found.drives)} drives answer, and a station has {len(AXES)}",
            "give each drive an address of its own (object 2028h), and see that all have power",
        )
    values: dict[str, Value] = {"bus.main.baudrate": found.baudrate, "bus.main.parity": found.parity}
    if gateway:
        values = {"bus.main.host": host, "bus.main.tcp_port": int(tcp_port), "bus.main.port": None}
    else:
        values |= {"bus.main.port": port, "bus.main.host": None}
    setup.write(values | _addresses(setup, found))


def _addresses(setup: Setup, found: Answering) -> dict[str, Value]:
    """Ask who is who of those that answer; offer the file's order while it is of them."""
    values: dict[str, Value] = {}
    for axis, address in zip(AXES, _in_order(setup, found.drives), strict=False):
        path = f"axes.{axis}.address"
        values[path] = setup.ask(path, f"Address of the drive of {axis}", str(address), _one_of(found.drives))
    relay = int(setup.number_at("lights.address", 5.0))
    relay = found.others[0] if found.others and relay not in found.others else relay
    values["lights.address"] = setup.ask(
        "lights.address", "Address of the lamps' relay board", str(relay), whole(1, 255, "an address")
    )
    return values


def _line_now(setup: Setup) -> str:
    """Return the line that the file names, as it is answered: a port, or a gateway's host and port."""
    host = setup.said_of("bus.main.host", "")
    return f"{host}:{setup.said_of('bus.main.tcp_port', '502')}" if host else setup.said_of("bus.main.port", "")


def _in_order(setup: Setup, drives: tuple[int, ...]) -> tuple[int, ...]:
    """Return the drives that answer in the order of the axes: the file's, if it is of these drives."""
    said = tuple(int(setup.number_at(f"axes.{axis}.address", 0.0)) for axis in AXES)
    return said if len(set(said)) == len(AXES) and set(said) <= set(drives) else drives


def _is_gateway(said: str) -> bool:
    return said.count(":") == 1 and not said.startswith("/")


def _is_endpoint(said: str) -> bool:
    return said.startswith(("ipc://", "tcp://")) or _is_gateway(said)


def _gateway(host: str, tcp_port: str) -> BusSection:
    """Return a line behind a gateway; raise `StepFailed` if that is none."""
    try:
        return BusSection(host=text(host), tcp_port=int(tcp_port))
    except ValueError as exc:
        raise StepFailed(f"'{host}:{tcp_port}' is no host:port", "write it as 192.168.0.7:502") from exc


def _device(given: str) -> str:
    """Return a device's path as it is from anywhere; raise `StepFailed` if there is none."""
    if not given or not _exists(Path(given)):
        raise StepFailed(f"there is no device {given!r}", "plug it in, or see `ls /dev/serial/by-id /dev/video*`")
    if Path(given).is_socket():
        raise StepFailed(
            f"{given!r} is a socket, and no device", f"a frame server is written as ipc://{Path(given).absolute()}"
        )
    return str(Path(given).absolute())


def _exists(path: Path) -> bool:
    """Tell whether a file is there; a name that no file can have is of none."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _one_of(addresses: tuple[int, ...]) -> Callable[[str], int]:
    def check(said: str) -> int:
        if not (said.isdecimal() and int(said) in addresses):
            raise ValueError(f"choose one of {', '.join(map(str, addresses))}")
        return int(said)

    return check


def mechanics(setup: Setup) -> None:
    """Ask for travel, lead and switches of each axis, and for heights."""
    values: dict[str, Value] = {}
    for axis in AXES:
        unit, scale, most = ("degrees", 1.0, 1000.0) if axis == "theta" else ("mm", 1000.0, 5000.0)
        setup.dialogue.say(f"Axis {axis}:")
        per_unit = setup.number_at(f"axes.{axis}.increments_per_unit", 0.0) or increments_per_unit(scale)
        now = increments_per_unit(1.0) / abs(per_unit) / scale
        turn = setup.ask(
            f"axes.{axis}.turn", f"  travel with one turn of the motor, {unit}", f"{now:.6g}", number(0.01, 1000, unit)
        )
        # A negative scale, which a trial move has found, turns the axis round: that stays
        values[f"axes.{axis}.increments_per_unit"] = math.copysign(increments_per_unit(turn * scale), per_unit)
        for key, what in (("minimum", "lowest coordinate"), ("maximum", "highest coordinate"),
                          ("homing_position", "coordinate of the homing switch")):  # fmt: skip
            values[f"axes.{axis}.{key}"] = setup.ask_number(f"axes.{axis}.{key}", f"  {what}", unit, -most, most, scale)
        path = f"axes.{axis}.homing_method"
        method = f"{setup.number_at(path, 0):g}"
        values[path] = setup.ask(path, f"  homing method ({HOMING})", method, whole(-128, 127, "a homing method"))
    setup.dialogue.say("Heights of the needle's end, and the head:")
    for path, what in (("gantry.safe_z_um", "free of every part"), ("gantry.work_z_um", "where it looks from"),
                       ("gantry.touch_z_um", "where it just touches the bare board")):  # fmt: skip
        values[path] = setup.ask_number(path, f"  height {what}", "mm", -100, 1000, 1000.0)
    values["head.radius_um"] = setup.ask_number(
        "head.radius_um", "  distance of the needle from the head's axis of rotation", "mm", 0.001, 500, 1000.0
    )
    values["head.phase_deg"] = setup.ask_number(
        "head.phase_deg", "  its direction at head angle 0", "degrees", -360, 360
    )
    for axis in ("x", "y"):
        path = f"control_point.{axis}_um"
        values[path] = setup.ask_number(path, f"  {axis.upper()} of the printed cross", "mm", -5000, 5000, 1000.0)
    setup.write(values)


def camera(setup: Setup) -> None:
    """Choose the camera: a device, or a ZeroMQ frame server."""
    stream = setup.said_of("camera.kind", "v4l2") == "stream"
    now = setup.said_of("camera.endpoint" if stream else "camera.device", "")
    chosen = setup.choose("camera", "Camera (a number, a path, or the endpoint of a frame server)", cameras(), now)
    if chosen.startswith(("ipc://", "tcp://")):
        setup.write({"camera.kind": "stream", "camera.endpoint": chosen, "camera.device": None})
    else:
        setup.write({"camera.kind": "v4l2", "camera.device": _device(chosen), "camera.endpoint": None})


def board(setup: Setup) -> None:
    """Take a board file, or make one of CAD; ask where the board lies."""
    now = setup.said_of("board.file", "board.json")
    said = setup.ask("board.file", "Board file, or folder of its CAD", now, text)
    source = setup.file.parent / said
    if not _exists(source) and _exists(Path(said)):  # as it is seen from where the command was typed
        source = Path(said).absolute()
        said = str(source)
    try:
        if source.is_dir() or source.suffix == ".zip":
            target = setup.file.parent / "board.json"
            side = setup.dialogue.ask(f"board.side of {said}", "Side that is probed (top or bottom)", "top", _side)
            bare = setup.dialogue.yes("Is the board bare, without parts?", key=f"board.bare of {said}", default=False)
            import_board(source, side, Options(bare=bare)).save(target)  # type: ignore[arg-type]
            said = target.name
        loaded = Board.load(setup.file.parent / said)
    except (ValueError, OSError) as exc:
        raise StepFailed(str(exc), "see `reprobe board --help` for what a board is made of") from exc
    setup.dialogue.say(f"Board {loaded.name}, {loaded.side}: {len(loaded.test_points())} test points")
    values: dict[str, Value] = {"board.file": said}
    for axis in ("x", "y"):
        path = f"board.origin_{axis}_um"
        question = f"{axis.upper()} of the board's lower left corner"
        values[path] = setup.ask_number(path, question, "mm", -5000, 5000, 1000.0)
    setup.write(values)


def _side(said: str) -> str:
    if said not in ("top", "bottom"):
        raise ValueError("answer top or bottom")
    return said


def meter(setup: Setup) -> None:
    """Ask for the instrument that measures through the needle; a station may have none."""
    say, there = setup.dialogue.say, read_value(setup.text(), "meter")
    now: dict[str, Any] = there if isinstance(there, dict) else {}
    say("An instrument between needle and harness measures what the needle stands on. A station may be without one.")
    if not setup.dialogue.yes("Is there one?", default=there is not None):
        say("So your own tester measures: by `reprobe touch` or `reprobe probe --measure tester`, or over the wire.")
        say("Without that option `reprobe probe` and `reprobe run` need one;")
        say(f"`reprobe setup -c {setup.file} --only meter` adds it.")
        if there is not None:
            say(f"{setup.file} still has one: delete its table [meter] there by hand.")
        return
    address = setup.ask(
        "meter.address", "Its address, host:port or a serial port", str(now.get("address", "")), _meter_address
    )
    values: dict[str, Value] = {"meter.kind": "scpi", "meter.address": address}
    say("If the needle has a second wire that only metal joins to the first, contact can be proved.")
    proof = setup.ask(
        "meter.contact_channel", "Scanner channel of that wire, or none",
        str(now.get("contact_channel", "none")), _channel,
    )  # fmt: skip
    if proof is not None or "contact_channel" in now:
        values["meter.contact_channel"] = proof
    setup.write(values)
    if not now.get("channels"):
        say(f"Write into [meter] of {setup.file} the scanner channel of each net: channels = {{ CLK = 101 }}")
    if not now.get("ground_net"):
        say('For voltage, diode and capacitance write there the net they are measured against: ground_net = "GND"')
    say(f"`reprobe doctor -c {setup.file}` asks whether it answers. A daemon that runs has to be restarted for it.")


def _meter_address(said: str) -> str:
    parse_address(said)
    return said


def _channel(said: str) -> int | None:
    return None if said.lower() in ("none", "no", "-") else whole(0, 10**6, "a channel, or none")(said)


def sockets(setup: Setup) -> None:
    """Ask where testers reach the daemon."""
    values: dict[str, Value] = {}
    for key, default in (("control", "tcp://127.0.0.1:5555"), ("events", "tcp://127.0.0.1:5556")):
        now = read_value(setup.text(), f"api.{key}") or default
        values[f"api.{key}"] = setup.ask(f"api.{key}", f"Socket of {key}", str(now), _socket)
    setup.write(values)


def _socket(said: str) -> str:
    if not is_endpoint(said):
        raise ValueError(f"{said!r} is no socket; write it as tcp://127.0.0.1:5555 or ipc:///run/reprobe/control")
    return said


def check(setup: Setup) -> None:
    """Check the whole file, as `reprobe check-config` does; of what is unlikely it is said how to mend it in time."""
    whole_file(setup)
    odd = unlikely(setup.file)
    notes = told(odd.notes, odd.lines)
    for note in notes:
        setup.dialogue.say(f"  warning: {note}")
    if notes:
        again = f"`reprobe setup -c {setup.file} --only NAME`, such as mechanics"
        setup.dialogue.say(
            f"If that is not as it is meant, end with Ctrl-C before anything moves, and mend it: {again}."
        )
    setup.dialogue.say(f"{setup.file}: good")


def whole_file(setup: Setup) -> Config:
    """Return the configuration that the file is; raise `StepFailed` with all its mistakes if it is none."""
    try:
        return load_config(setup.file)
    except ConfigError as exc:
        listed = "\n".join(f"  {problem}" for problem in told(exc.problems, exc.lines))
        raise StepFailed(
            f"{setup.file} has mistakes:\n{listed}", f"correct them in {setup.file}, then try again"
        ) from exc
