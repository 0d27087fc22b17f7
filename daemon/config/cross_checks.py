"""Checks of a configuration that need more than one value: heights, addresses, names of lines, ports and sockets.

They read the file's own values, so that one wrong field hides none of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from daemon.config.clearance_checks import clearance_checks
from daemon.config.paths import is_below_the_file
from daemon.config.problems import Problem, nearest
from daemon.config.raw_values import RawValues
from daemon.config.watch_names import GROUPS, is_known, watch_names
from drivers.gantry import THETA_FIRST_DEG, THETA_LAST_DEG

AXES = ("x", "y", "z", "theta")
CLEAR_UM = 100.0
"""Between the needle and the highest possible surface."""
HOMING_METHODS = frozenset({*range(1, 15), *range(17, 31), 33, 34, 35, 37})
"""CiA 402-2, 6098h; below zero they are the maker's own."""
HOMING_SWITCH = {17: 1, 18: 2, **dict.fromkeys(range(19, 23), 4)}
"""Bit of 3240h:01 that has the drive heed the switch, by homing method."""
_ENDPOINT = re.compile(r"tcp://(?P<host>\[[0-9A-Fa-f:]+\]|[^:/\s]+):(?P<port>\d{1,5}|\*)|ipc://.+|inproc://.+")


def cross_checks(raw: RawValues) -> Iterator[Problem]:
    """Yield every problem."""
    for check in (
        _lines,
        _addresses,
        _shared_ports,
        _axes,
        _heights,
        clearance_checks,
        _presses,
        _lights,
        _camera,
        _sockets,
        _watches,
        _probing,
    ):
        yield from check(raw)


def _lines(raw: RawValues) -> Iterator[Problem]:
    known = sorted(raw.table("bus"))
    for name, line in raw.table("bus").items():
        if isinstance(line, dict):
            yield from _line(raw, f"bus.{name}", line)
    users = [f"axes.{name}.bus" for name in AXES]
    if raw.text("lights.kind") == "modbus":
        users.append("lights.bus")
    for path in users:
        bus = raw.text(path)
        if bus is not None and bus not in known:
            listed = ", ".join(f"[bus.{name}]" for name in known) or "none"
            meant = nearest(bus, known)
            yield path, f"{path} names {bus!r}, which is not under [bus]; there is {listed}{meant}"


def _line(raw: RawValues, path: str, line: dict[str, object]) -> Iterator[Problem]:
    if ("port" in line) == ("host" in line):
        what = "it has both" if "port" in line else "it has neither"
        yield path, f"give either port or host: {what}"
    yield from _device_path(raw, f"{path}.port")
    yield from _host(path, raw.text(f"{path}.host"))


def _host(path: str, given: str | None) -> Iterator[Problem]:
    """Yield a host with what does not belong to its name: a scheme, a port, blanks."""
    if given is None or not (found := re.fullmatch(r"\s*(?:[a-z]+://)?([^\s/:]*)(?::(\d+))?[\s/]*", given)):
        return
    host, number = found.groups()
    if number is not None:
        yield f"{path}.host", f"the port stands in a key of its own: host = {host!r}, tcp_port = {number}"
    elif host != given:
        yield f"{path}.host", f"{given!r} is no name or number of a computer; is host = {host!r} meant?"


def _device_path(raw: RawValues, path: str) -> Iterator[Problem]:
    port = raw.text(path)
    if port is not None and not port.startswith("/") and not is_below_the_file(port):
        name, why = port.removeprefix("dev/"), "is no path of a device"
        if re.fullmatch(r"(?i)com\d+:?", port):
            name, why = "ttyUSB0", "is a name of Windows"
        yield path, f"{port!r} {why}; write it whole, such as '/dev/{name}' (`ls /dev/serial/by-id`)"


def _addresses(raw: RawValues) -> Iterator[Problem]:
    users: dict[tuple[str, float], list[str]] = {}
    tables = [f"axes.{name}" for name in AXES] + (["lights"] if raw.text("lights.kind") == "modbus" else [])
    for table in tables:
        bus, address = raw.text(f"{table}.bus"), raw.number(f"{table}.address")
        if bus is not None and address is not None:
            users.setdefault((bus, address), []).append(table)
    for (bus, address), sharing in users.items():
        if len(sharing) > 1:
            who = " and ".join(sharing)
            advice = "each needs its own: set it at the device and here"
            yield f"{sharing[-1]}.address", f"{who} have the same address {address:.0f} on bus {bus!r}; {advice}"


def _shared_ports(raw: RawValues) -> Iterator[Problem]:
    """Yield who shares a port with another: two masters on one line do harm."""
    owners: dict[str, str] = {}
    gateways: dict[tuple[str, float | None], str] = {}
    for name in raw.table("bus"):
        host, port = raw.text(f"bus.{name}.host"), raw.number(f"bus.{name}.tcp_port")
        if host is None:
            continue
        if (first := gateways.setdefault((host, port), name)) != name:
            said = f"{host} with tcp_port {port:.0f} is also [bus.{first}]; one line is one [bus.NAME]"
            yield f"bus.{name}.host", f"{said}: leave one out, or give the other port of the gateway"
    paths = [f"bus.{name}.port" for name in raw.table("bus")] + ["lights.port", "camera.device", "meter.address"]
    for path in paths:
        device = raw.text(path)
        if device is None or not device.startswith("/"):
            continue
        if device in owners:
            said = f"{device} is also {owners[device]}; each device has a port of its own, one line is one [bus.NAME]"
            yield path, said
        owners.setdefault(device, path)


def _axes(raw: RawValues) -> Iterator[Problem]:
    for name in AXES:
        path = f"axes.{name}"
        low, high = raw.number(f"{path}.minimum"), raw.number(f"{path}.maximum")
        if low is not None and high is not None and low >= high:
            yield path, f"minimum {low} is not below maximum {high}; are they exchanged?"
        elif low is not None and high is not None and name == "theta":
            yield from _band(low, high)
        if raw.number(f"{path}.increments_per_unit") == 0:
            unit = "degree" if name == "theta" else "um"
            yield f"{path}.increments_per_unit", f"is zero; it is the drive's increments per {unit}"
        method = raw.number(f"{path}.homing_method")
        if method is not None and method >= 0 and method not in HOMING_METHODS:
            common = "17, 18: negative, positive limit switch; 19..22: home switch; 35, 37: where it stands"
            yield f"{path}.homing_method", f"{method:g} is no method of CiA 402 (1..14, 17..30, 33..35, 37): {common}"
        if method is not None:
            yield from _switch(raw, path, method)


def _switch(raw: RawValues, path: str, method: float) -> Iterator[Problem]:
    """Yield inputs without the switch that the homing method looks for: the axis would run past it."""
    heeds, needs = raw.number(f"{path}.switch_inputs"), HOMING_SWITCH.get(int(method), 0)
    if heeds is not None and needs and not int(heeds) & needs:
        said = f"{heeds:.0f} has the drive heed no such switch as homing_method = {method:.0f} looks for"
        yield f"{path}.switch_inputs", f"{said}; 7 is all three: both limits and home"


def _band(low: float, high: float) -> Iterator[Problem]:
    """Yield a range that reaches into the band of the wiring, at any turn."""
    for turn in (-720.0, -360.0, 0.0, 360.0):
        first, last = THETA_LAST_DEG + turn, THETA_FIRST_DEG + turn
        if low < last and high > first:
            said = (
                f"the range {low:g}..{high:g} reaches into {first:g}..{last:g}, where the head's wiring must never be: "
                f"set minimum = {THETA_FIRST_DEG - 360:g}, maximum = {THETA_LAST_DEG:g} (head angles 140..360 are "
                "-220..0 here)"
            )
            yield "axes.theta", said
            return


def _heights(raw: RawValues) -> Iterator[Problem]:
    names = ("touch_z_um", "work_z_um", "safe_z_um", "surface_range_um", "press_um")
    touch, work, safe, surface, press = (raw.number(f"gantry.{name}") for name in names)
    if touch is not None and work is not None and touch > work:
        yield "gantry", f"heights must be touch_z_um <= work_z_um < safe_z_um, but touch {touch:g} > work {work:g} um"
    if work is not None and safe is not None and work >= safe:
        yield "gantry", f"heights must be touch_z_um <= work_z_um < safe_z_um, but work {work:g} >= safe {safe:g} um"
    if touch is not None and safe is not None and surface is not None and touch + surface + CLEAR_UM >= safe:
        least = touch + surface + CLEAR_UM
        said = (
            f"safe_z_um must be above touch_z_um + surface_range_um + {CLEAR_UM:.0f} = {least:g} um, or a board there "
            f"is hit; it is {safe:g}"
        )
        yield "gantry.safe_z_um", said
    low, high = raw.number("axes.z.minimum"), raw.number("axes.z.maximum")
    if low is None or high is None or low >= high:
        return
    heights = {"safe_z_um": safe, "work_z_um": work, "touch_z_um": touch}
    for name, height in heights.items():
        if height is not None and not low <= height <= high:
            yield f"gantry.{name}", f"{height:g} um lies outside axes.z {low:g}..{high:g} um"
    if touch is not None and press is not None and low <= touch <= high and touch - press < low:
        yield (
            "gantry.press_um",
            f"touch_z_um - press_um = {touch - press:g} lies outside axes.z {low:g}..{high:g} um",
        )


def _presses(raw: RawValues) -> Iterator[Problem]:
    """Yield every press that the pin is not made for: two thirds of its travel are the recommended stroke."""
    travel, most = raw.number("pin.travel_um"), raw.number("gantry.overtravel_um")
    for path in ("gantry.overtravel_um", "gantry.press_um"):
        press = raw.number(path)
        if press is not None and travel is not None and press > travel * 2 / 3:
            yield (
                path,
                (
                    f"{path} = {press:g} is more than two thirds of pin.travel_um ({travel * 2 / 3:.0f}): "
                    "the pin or the board would be damaged"
                ),
            )
    touch = raw.number("touch.overtravel_um")
    if touch is not None and most is not None and touch > most:
        yield (
            "touch.overtravel_um",
            (
                f"touch.overtravel_um = {touch:g} is more than gantry.overtravel_um ({most:g}), "
                "the most that the pin may ever be pushed in"
            ),
        )


def _probing(raw: RawValues) -> Iterator[Problem]:
    """Yield what a probe could not do: reach its pads, ask its channels, or stay within its budgets."""
    for table in ("reference", "brush"):
        z_um, touch = raw.number(f"{table}.z_um"), raw.number("gantry.touch_z_um")
        within = raw.number("gantry.surface_range_um")
        if z_um is not None and touch is not None and within is not None and abs(z_um - touch) > within:
            said = f"{z_um:g} um is farther than gantry.surface_range_um ({within:g}) from touch_z_um = {touch:g}"
            yield f"{table}.z_um", f"{said}: the needle would be sent below its floor, or hit it on the way"
    if raw.table("brush") and not raw.table("reference"):
        yield "brush", "a brush needs [reference]: only there a needle is found to be bad, or clean again"
    if raw.table("reference") and not raw.table("meter"):
        yield "reference", "a reference pad needs [meter]: nothing else can tell whether the needle is good there"
    channels, contact = raw.table("meter.channels"), raw.number("meter.contact_channel")
    shared = next((net for net, channel in channels.items() if channel == contact), None)
    if contact is not None and shared is not None:
        yield (
            "meter.contact_channel",
            f"{contact:.0f} is also the channel of net {shared!r}: contact would be proved by the net that is tested",
        )
    ground = raw.text("meter.ground_net")
    if ground is not None and ground not in channels:
        yield "meter.ground_net", f"{ground!r} has no channel under meter.channels{nearest(ground, sorted(channels))}"
    visit, life = raw.number("ladder.touches_per_visit"), raw.number("touch.touches_per_pad")
    if visit is not None and visit > (life or 8):
        yield "ladder.touches_per_visit", f"{visit:.0f} in one visit are more than in a pad's life ({life or 8:.0f})"


def _lights(raw: RawValues) -> Iterator[Problem]:
    kind = raw.text("lights.kind")
    if kind == "modbus" and raw.at("lights.bus") is None:
        yield "lights", "kind modbus needs bus, the name of its line under [bus]"
    if kind == "serial" and raw.at("lights.port") is None:
        yield "lights", "kind serial needs port, such as /dev/reprobe-relay"
    yield from _device_path(raw, "lights.port")
    white, red = raw.number("lights.white"), raw.number("lights.red")
    if white is not None and white == red:
        yield "lights", f"white and red are the same switch, {white:.0f}; each ring has its own"
    if kind == "serial" and 0 in (white, red):
        which = "white" if white == 0 else "red"
        yield f"lights.{which}", "channels of a serial relay count from 1 (coils of a modbus relay from 0)"


def _camera(raw: RawValues) -> Iterator[Problem]:
    kind, device = raw.text("camera.kind"), raw.text("camera.device")
    if kind == "v4l2" and raw.at("camera.device") is None:
        yield "camera", "kind v4l2 needs device, such as /dev/reprobe-camera"
    if kind == "stream" and raw.at("camera.endpoint") is None:
        yield "camera", "kind stream needs endpoint, such as ipc:///run/reprobe-sim/camera"
    if device is not None and not device.startswith("/") and not is_below_the_file(device):
        yield "camera.device", f"{device!r} is no path of a device; write it whole, such as '/dev/video0'"
    endpoint = raw.text("camera.endpoint")
    if endpoint is not None and not is_endpoint(endpoint):
        yield "camera.endpoint", f"{endpoint!r} is no ZeroMQ endpoint: tcp://host:port or ipc:///path"
    exposure, timeout = raw.number("camera.exposure_us"), raw.number("camera.timeout_ms")
    if exposure is not None and timeout is not None and exposure / 1e3 > timeout:
        yield "camera.timeout_ms", f"{timeout:g} ms is shorter than one exposure of {exposure / 1e3:g} ms"


def _sockets(raw: RawValues) -> Iterator[Problem]:
    control, events, live = raw.text("api.control"), raw.text("api.events"), raw.text("api.live")
    for name, endpoint in (("control", control), ("events", events), ("live", live or None)):
        if endpoint is not None and not is_endpoint(endpoint):
            yield f"api.{name}", f"{endpoint!r} is no ZeroMQ endpoint: tcp://127.0.0.1:5555 or ipc:///path"
    if control is not None and events is not None and _place(control) == _place(events):
        yield "api.events", f"control and events are both on {events}; each needs a port of its own, such as 5555, 5556"
    if live and _place(live) in [_place(endpoint) for endpoint in (control, events) if endpoint is not None]:
        yield "api.live", f"{live} is taken by control or events; live pictures need a port of their own, such as 5557"
    port = raw.number("metrics.port")
    for name, endpoint in (("control", control), ("events", events), ("live", live or None)):
        if port and endpoint is not None and _place(endpoint) == f"{port:.0f}":
            yield "metrics.port", f"{port:.0f} is also the port of api.{name}; take another, or 0 for no metrics"


def is_endpoint(endpoint: str) -> bool:
    """Tell whether a text is an endpoint of ZeroMQ."""
    found = _ENDPOINT.fullmatch(endpoint)
    return found is not None and (found["port"] in (None, "*") or 0 < int(found["port"]) <= 65535)


def _place(endpoint: str) -> str:
    """Return what two sockets cannot share: the port, or the file."""
    found = _ENDPOINT.fullmatch(endpoint)
    port = found["port"] if found else None
    return endpoint if port in (None, "*", "0") else str(int(port))


def _watches(raw: RawValues) -> Iterator[Problem]:
    off, buses = raw.at("maintenance.off"), sorted(raw.table("bus"))
    for watch in off if isinstance(off, list | tuple) else ():
        if isinstance(watch, str) and not is_known(watch, buses):
            meant = nearest(watch, [*GROUPS, *watch_names(buses)])
            yield "maintenance.off", f"{watch!r} is no watch{meant or '; `reprobe health` lists them'}"
