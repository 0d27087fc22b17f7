"""Doubtful values of a configuration: possible, each alone plausible, and hardly meant together.

Told as unlikely; they refuse no file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations, pairwise

from daemon.config.problems import Problem
from daemon.config.raw_values import RawValues

LEAST_HOVER_UM = 50.0
"""Between the needle and a board that lies as it should, at every look."""
FARTHEST_LOOK_UM = 3000.0
"""Above the board: from higher the needle's end hangs out of focus, and beside its place in the picture."""
LEAST_TURN_DEG = 10.0
RADIANS = {math.pi / 2: 90, math.pi: 180, 3 * math.pi / 2: 270, 2 * math.pi: 360}
TO_NEGATIVE, TO_POSITIVE = frozenset({1, 17}), frozenset({2, 18})
"""Homing methods that end at a limit switch, by the end at which it is in the motor's sense (CiA 402-2, 6098h)."""
GONE_AFTER_A_START = ("/tmp/", "/run/", "/dev/", "/proc/", "/sys/")  # noqa: S108  # they are named, not used
NOT_USED_BY_A_KIND = (
    ("lights", "modbus", ("port",), "serial"),
    ("lights", "serial", ("bus", "address"), "modbus"),
    ("camera", "v4l2", ("endpoint",), "stream"),
    ("camera", "stream", ("device",), "v4l2"),
)
"""Table, its kind, keys that this kind does not read, the kind that does."""
USUAL = {"station.data_dir": "/var/lib/reprobe", "board.file": "board.json", "api.keys_dir": "keys"}
LEAST_HEAD_UM = 1000.0
"""No head with its camera and lamps is narrower."""
APART_UM = 1000.0
"""Between the middles of what the needle is lowered onto beside the board."""
SWITCH_OF_INPUT = {1: "negative limit", 2: "positive limit", 3: "home"}
"""What the drive's first inputs are wired to, as it leaves the maker."""


def doubtful(raw: RawValues) -> Iterator[Problem]:
    """Yield what a person should look at again."""
    for check in (
        _hover,
        _turns,
        _homing,
        _sense,
        _channels,
        _ports,
        _name,
        _folders,
        _unused,
        _on_end,
        _frozen,
        _never_pressed,
        _queue,
        _head_in_mm,
        _on_each_other,
    ):
        yield from check(raw)


def _hover(raw: RawValues) -> Iterator[Problem]:
    work, touch = raw.number("gantry.work_z_um"), raw.number("gantry.touch_z_um")
    if work is not None and touch is not None and 0.0 <= work - touch < LEAST_HOVER_UM:
        said = (
            f"only {work - touch:g} um above touch_z_um = {touch:g}: the needle would touch the board at every look; "
            f"usual is {touch + 200.0:g}"
        )
        yield "gantry.work_z_um", said
    elif work is not None and touch is not None and work - touch > FARTHEST_LOOK_UM:
        said = f"the needle would hang {work - touch:g} um over the board at every look; usual is {touch + 200.0:g}"
        yield "gantry.work_z_um", said


def _turns(raw: RawValues) -> Iterator[Problem]:
    low, high = raw.number("axes.theta.minimum"), raw.number("axes.theta.maximum")
    if low is not None and high is not None and 0.0 < high - low < LEAST_TURN_DEG:
        said = f"the head could turn by {high - low:g} degrees only, from {low:g} to {high:g}; angles are degrees"
        yield "axes.theta.maximum", f"{said}: are -220 and 100 meant?"
    turned = raw.number("board.rotation_deg")
    for radians, degrees in RADIANS.items():
        if turned is not None and math.isclose(abs(turned), radians, abs_tol=0.01):
            meant = math.copysign(degrees, turned)
            yield "board.rotation_deg", f"{turned:g} looks like radians; angles are degrees: is {meant:g} meant?"


def _homing(raw: RawValues) -> Iterator[Problem]:
    for name in ("x", "y", "z", "theta"):
        path = f"axes.{name}"
        speed, homing = raw.number(f"{path}.speed"), raw.number(f"{path}.homing_speed")
        if speed is not None and homing is not None and homing > speed > 0.0:
            yield f"{path}.homing_speed", f"{homing:g} is faster than any move (speed = {speed:g}); homing is slower"
        yield from _wrong_end(raw, path)


def _wrong_end(raw: RawValues, path: str) -> Iterator[Problem]:
    """Yield a homing position at the end of the range that the homing method does not go to."""
    method, scale = raw.number(f"{path}.homing_method"), raw.number(f"{path}.increments_per_unit")
    low, high = raw.number(f"{path}.minimum"), raw.number(f"{path}.maximum")
    place = raw.number(f"{path}.homing_position")
    if method is None or not scale or low is None or high is None or place is None or low >= high:
        return
    if method not in TO_NEGATIVE | TO_POSITIVE:
        return
    goes_low = (method in TO_NEGATIVE) == (scale > 0.0)
    is_low = place < (low + high) / 2.0
    if goes_low != is_low:
        end, other = ("lower", "upper") if goes_low else ("upper", "lower")
        twin = {1: 2, 2: 1, 17: 18, 18: 17}[int(method)]
        danger = ": it would press the needle down" if path == "axes.z" and goes_low else ""
        said = (
            f"{method:.0f} homes to the {end} end{danger}, but homing_position = {place:g} is at the {other} end of "
            f"{low:g}..{high:g}; is {twin} meant, or another homing_position?"
        )
        yield f"{path}.homing_method", said


def _sense(raw: RawValues) -> Iterator[Problem]:
    number = raw.number("sense.input")
    if raw.given("sense.input") and number in SWITCH_OF_INPUT:
        which = SWITCH_OF_INPUT[int(number)]
        yield "sense.input", f"input {number:.0f} is where drives have their {which} switch; is another one meant?"


def _channels(raw: RawValues) -> Iterator[Problem]:
    channels = sorted((str(one), net) for net, one in raw.table("meter.channels").items())
    for (one, net), (other, again) in pairwise(channels):
        if one == other:
            said = f"nets {net!r} and {again!r} have the same channel {one}; each pin of the harness has its own"
            yield f"meter.channels.{again}", said


def _ports(raw: RawValues) -> Iterator[Problem]:
    port = raw.number("metrics.port")
    if port is not None and 0 < port < 1024:  # the system's own
        yield "metrics.port", f"{port:.0f} is below 1024, where only root may listen; 9464 is usual"


def _name(raw: RawValues) -> Iterator[Problem]:
    name = raw.text("station.name")
    if name is not None and ("/" in name or not name.isprintable() or name != name.strip()):
        yield "station.name", f"{name!r} stands in names of files: leave out slashes and what is not seen"


def _folders(raw: RawValues) -> Iterator[Problem]:
    """Yield folders and files that are written as no Linux path is, or would not outlive a start of the computer."""
    for path in ("station.data_dir", "board.file", "api.keys_dir"):
        given = raw.text(path)
        if given is None:
            continue
        if not given:
            yield path, f"is empty, which is the folder of this file; write the path, such as {USUAL[path]}"
        elif "\\" in given or not given.isprintable():
            yield path, f"{given!r} looks like a path of Windows; write one with /, such as /var/lib/reprobe"
        elif given.startswith("~") or "$" in given:
            yield path, f"{given!r}: ~ and $ are not replaced here; write the path whole, such as /var/lib/reprobe"
    if (given := raw.text("station.data_dir")) is not None and given.startswith(GONE_AFTER_A_START):
        said = f"what lies in {given} is gone after the next start of the computer: journal and calibrations too"
        yield "station.data_dir", f"{said}; /var/lib/reprobe is usual"


def _unused(raw: RawValues) -> Iterator[Problem]:
    """Yield keys that belong to another kind of the same device."""
    for name in raw.table("bus"):
        for key in ("tcp_port", "framing"):
            if raw.given(f"bus.{name}.port") and raw.given(f"bus.{name}.{key}"):
                said = "is not used on a serial port: leave it out; or is host meant, instead of port = {!r}?"
                yield f"bus.{name}.{key}", said.format(raw.at(f"bus.{name}.port"))
    for table, kind, keys, other in NOT_USED_BY_A_KIND:
        if raw.text(f"{table}.kind") != kind:
            continue
        for key in keys:
            if raw.given(f"{table}.{key}"):
                yield f"{table}.{key}", f"is not used by kind = {kind!r}: leave it out; or is kind = {other!r} meant?"


def _on_end(raw: RawValues) -> Iterator[Problem]:
    width, height = raw.number("camera.width"), raw.number("camera.height")
    if width is not None and height is not None and width < height:
        said = f"{width:.0f} x {height:.0f} is a picture on end, and cameras give wide ones"
        yield "camera.width", f"{said}: are width = {height:.0f}, height = {width:.0f} meant?"


def _frozen(raw: RawValues) -> Iterator[Problem]:
    exposure, frozen = raw.number("camera.exposure_us"), raw.number("camera.frozen_ms")
    if exposure is not None and frozen is not None and frozen < 2.0 * exposure / 1e3:
        said = (
            f"{frozen:g} ms are less than two exposures of {exposure / 1e3:g} ms: a good camera would be opened again"
        )
        yield "camera.frozen_ms", f"{said} and again; usual is 1000"


def _never_pressed(raw: RawValues) -> Iterator[Problem]:
    if raw.number("gantry.overtravel_um") == 0:
        said = "0 lets no touch push the pin in: it makes no sure contact"
        yield "gantry.overtravel_um", f"{said}; usual is 300, no more than two thirds of pin.travel_um"


def _queue(raw: RawValues) -> Iterator[Problem]:
    length, own = raw.number("api.queue_length"), raw.number("api.queue_per_client")
    if length is not None and own is not None and raw.given("api.queue_per_client") and own > length:
        said = f"{own:.0f} are never reached, for queue_length = {length:.0f} is all that may wait"
        yield "api.queue_per_client", f"{said}; write no more than that"


def _head_in_mm(raw: RawValues) -> Iterator[Problem]:
    box = raw.at("clearance.head_box_um")
    if not isinstance(box, list) or not all(isinstance(v, int | float) for v in box) or not any(box):
        return
    if max(map(abs, box)) < LEAST_HEAD_UM:
        meant = ", ".join(f"{v * 1e3:g}" for v in box)
        said = f"no head is within {max(map(abs, box)):g} um of its needle; lengths are um: is [{meant}] meant?"
        yield "clearance.head_box_um", said


def _on_each_other(raw: RawValues) -> Iterator[Problem]:
    """Yield places beside the board that are one and the same: the needle would brush what it is judged by."""
    tables = ("control_point", "reference", "brush")
    places = {table: (raw.number(f"{table}.x_um"), raw.number(f"{table}.y_um")) for table in tables}
    for (one, (x, y)), (other, (u, v)) in combinations(places.items(), 2):
        if x is None or y is None or u is None or v is None:
            continue
        if (apart := math.hypot(x - u, y - v)) < APART_UM:
            said = f"[{other}] lies {apart:g} um from [{one}], on the same place"
            yield f"{other}.x_um", f"{said}: put in the coordinates of its own middle"
