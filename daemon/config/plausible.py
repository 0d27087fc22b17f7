"""Plausible ranges of a configuration's numbers: values a thousand times off, millimetres for micrometres.

What no machine of this kind has is refused; what is only odd is told as unlikely and refuses nothing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from daemon.config.doubtful import FARTHEST_LOOK_UM, doubtful
from daemon.config.paths import from_folder
from daemon.config.problems import Problem
from daemon.config.raw_values import RawValues

LINEAR, TURNING = ("x", "y", "z"), "theta"
COARSE = 25.0
"""Increments per um of a lead of 131 mm."""
BAUDRATES = (9600, 19200, 38400, 57600, 115200, 230400, 256000)
"""What such drives and relays offer."""


@dataclass(frozen=True)
class Range:
    """From where to where a number is plausible, in its unit, and what is usual; scaled: it has thousandths of it."""

    low: float
    high: float
    unit: str
    usual: str
    scaled: bool = True


_LINEAR = {
    "speed": Range(500.0, 5e6, "um/s", "100000 um/s are 100 mm/s"),
    "acceleration": Range(5000.0, 1e8, "um/s2", "1000000 um/s2 are 1 m/s2"),
    "homing_speed": Range(100.0, 1e6, "um/s", "20000 um/s are 20 mm/s"),
    "increments_per_unit": Range(5.0, 100_000.0, "increments per um", "655.36 for a lead of 5 mm, not per mm or turn"),
}
_TURNING = {
    "speed": Range(1.0, 5000.0, "degrees/s", "120"),
    "acceleration": Range(5.0, 1e6, "degrees/s2", "1000"),
    "homing_speed": Range(0.5, 2000.0, "degrees/s", "30"),
    "increments_per_unit": Range(100.0, 1e6, "increments per degree", "9102.2222 for 3276800 a turn, not per turn"),
}
_OTHERS = {
    "head.radius_um": Range(200.0, 200_000.0, "um", "14938 um are 14.938 mm"),
    "head.phase_deg": Range(-360.0, 360.0, "degrees", "-3.054"),
    "board.rotation_deg": Range(-360.0, 360.0, "degrees", "0, 90, 180 or 270 and little beside"),
    "camera.pitch_um": Range(0.2, 200.0, "um per pixel", "12"),
}
"""Refused outside."""
_ODD = {
    "camera.exposure_us": Range(50.0, 500_000.0, "us", "20000 us are 20 ms"),
    "camera.timeout_ms": Range(100.0, 60_000.0, "ms", "3000"),
    "lights.settle_ms": Range(1.0, 2000.0, "ms", "40"),
    "gantry.settle_ms": Range(1.0, 2000.0, "ms", "60"),
    "gantry.descent_speed": Range(50.0, 2000.0, "um/s", "2000 um/s are 2 mm/s"),
    "gantry.approach_um": Range(5.0, 5000.0, "um", "200"),
    "gantry.approach_deg": Range(0.05, 5.0, "degrees", "0.5"),
    "gantry.press_um": Range(20.0, 500.0, "um", "200 um are 0.2 mm"),
    "gantry.surface_range_um": Range(20.0, 2000.0, "um", "500 um are 0.5 mm"),
    "gantry.overtravel_um": Range(20.0, 1000.0, "um", "300 um are 0.3 mm"),
    "touch.dwell_ms": Range(1.0, 2000.0, "ms", "30"),
    "pin.preload_n": Range(0.02, 10.0, "N", "0.3"),
    "pin.rate_n_per_mm": Range(0.02, 20.0, "N per mm", "0.6"),
    "station.pictures_quota_mb": Range(20.0, 1e6, "MB", "500"),
    "servo.tolerance_um": Range(2.0, 200.0, "um", "15"),
    "servo.max_placement_um": Range(50.0, 5000.0, "um", "700 um are 0.7 mm"),
    "servo.match_um": Range(10.0, 2000.0, "um", "120"),
    "servo.job_timeout_s": Range(1.0, 3600.0, "s", "60"),
    "servo.calibration_timeout_s": Range(60.0, 86_400.0, "s", "3600"),
    "servo.calibration_days": Range(0.05, 400.0, "days", "30"),
    "api.heartbeat_s": Range(0.05, 60.0, "s", "1"),
    "ladder.proof_max_ohm": Range(0.1, 100.0, "ohm", "10"),
    "ladder.continuity_max_ohm": Range(0.5, 1000.0, "ohm", "10"),
    "ladder.settle_max_ms": Range(50.0, 5000.0, "ms", "500"),
    "ladder.reference_good_s": Range(5.0, 600.0, "s", "60"),
    "reference.max_ohm": Range(0.05, 10.0, "ohm", "1"),
    "servo.scatter_um": Range(2.0, 500.0, "um", "40"),
    "servo.trusted_um": Range(5.0, 2000.0, "um", "120"),
    "servo.first_landing_um": Range(5.0, 2000.0, "um", "80"),
    "servo.landing_um": Range(2.0, 1000.0, "um", "40"),
    "servo.tip_radius_um": Range(1.0, 500.0, "um", "25"),
    "clearance.needle_radius_um": Range(20.0, 5000.0, "um", "500 um are 0.5 mm"),
    "clearance.barrel_radius_um": Range(50.0, 20_000.0, "um", "1500 um are 1.5 mm"),
    "clearance.outline_um": Range(50.0, 50_000.0, "um", "8000, with courtyards 500"),
    "clearance.solder_um": Range(20.0, 5000.0, "um", "500 um are 0.5 mm"),
    "clearance.lead_um": Range(50.0, 20_000.0, "um", "3000 um are 3 mm"),
    "clearance.nest_um": Range(50.0, 100_000.0, "um", "2000 um are 2 mm"),
    "lights.dark_level": Range(2.0, 200.0, "of 255", "60", scaled=False),
    "api.rate_per_s": Range(10.0, 1e6, "requests a second", "2000", scaled=False),
}
"""Told outside; zero switches some of them off and is not told."""


def implausible(raw: RawValues) -> Iterator[Problem]:
    """Yield what no machine of this kind has."""
    for name in (*LINEAR, TURNING):
        for key, plausible in (_TURNING if name == TURNING else _LINEAR).items():
            path = f"axes.{name}.{key}"
            value = raw.number(path)
            if value:
                yield from _outside(path, abs(value), plausible)
    for path, plausible in _OTHERS.items():
        value = raw.number(path)
        if value is not None and (value or path not in {"head.radius_um", "camera.pitch_um"}):
            yield from _outside(path, value, plausible)
    for name in LINEAR:
        yield from _narrow(raw, name)
    yield from _places(raw)
    yield from _heights(raw)


def unlikely(raw: RawValues, folder: Path) -> Iterator[Problem]:
    """Yield what is possible and hardly meant; `folder`: where the file lies."""
    for path, plausible in {**_ODD, **_named(raw)}.items():
        value = raw.number(path)
        if value:
            yield from _outside(path, value, plausible)
    yield from _homing(raw)
    for name in raw.table("bus"):
        rate = raw.number(f"bus.{name}.baudrate")
        if rate is not None and rate not in BAUDRATES:
            near = min(BAUDRATES, key=lambda one: abs(one - rate))
            yield f"bus.{name}.baudrate", f"{rate:.0f} is no usual rate; {near} is the nearest"
    tolerance, placement = raw.number("servo.tolerance_um"), raw.number("servo.max_placement_um")
    if tolerance is not None and placement is not None and tolerance >= placement:
        yield (
            "servo.tolerance_um",
            f"{tolerance:g} um is not below max_placement_um = {placement:g}: nothing is corrected",
        )
    yield from _fine_scale(raw)
    yield from _cycles(raw)
    yield from doubtful(raw)
    yield from _beyond(raw)
    yield from _not_there(raw, folder)
    if raw.number("meter.contact_channel") is not None and not raw.table("reference"):
        yield (
            "meter.contact_channel",
            "without [reference] no open is ever accused, proof or not: nobody knows whether the needle is good",
        )


def _outside(path: str, value: float, plausible: Range) -> Iterator[Problem]:
    if plausible.low <= value <= plausible.high:
        return
    low = value < plausible.low
    if plausible.unit == "degrees" and abs(value) > 360.0:
        yield path, f"{value:g} is more than a turn; is {math.copysign(abs(value) % 360.0, value):g} meant?"
        return
    factors = (1000.0, 1e-3, 1e6, 1e-6) if plausible.scaled else ()
    factor = next((f for f in factors if plausible.low <= value * f <= plausible.high), None)
    meant = f"; is {value * factor:g} meant?" if factor and ((factor > 1) == low) else ""
    word = "small" if low else "large"
    said = (
        f"{value:g} {plausible.unit} is too {word}: {plausible.low:g}..{plausible.high:g} is plausible, usual is "
        f"{plausible.usual}{meant}"
    )
    yield path, said


def _named(raw: RawValues) -> dict[str, Range]:
    """Return the ranges of what stands under names of a station's own: lines, letters of parts."""
    parts = Range(50.0, 50_000.0, "um", "800 um are 0.8 mm")
    named = {f"clearance.heights_um.{letters}": parts for letters in raw.table("clearance.heights_um")}
    return named | {f"bus.{name}.gap_ms": Range(0.5, 100.0, "ms", "3") for name in raw.table("bus")}


def _fine_scale(raw: RawValues) -> Iterator[Problem]:
    """Yield an axis that counts hardly more than a lead's number: drives of this kind divide a turn finely."""
    for name in LINEAR:
        scale = raw.number(f"axes.{name}.increments_per_unit")
        if scale is not None and _LINEAR["increments_per_unit"].low <= abs(scale) < COARSE:
            said = f"{scale:g} increments per um are few: is it the lead in mm? A lead of {abs(scale):g} mm has "
            yield f"axes.{name}.increments_per_unit", f"{said}{3276.8 / abs(scale):g} (65536 x 50 increments a turn)"


def _cycles(raw: RawValues) -> Iterator[Problem]:
    for method in raw.table("meter.methods"):
        cycles = raw.number(f"meter.methods.{method}.nplc")
        if cycles:
            usual = Range(0.001, 200.0, "cycles of the mains", "1")
            yield from _outside(f"meter.methods.{method}.nplc", cycles, usual)


def _narrow(raw: RawValues, name: str) -> Iterator[Problem]:
    low, high = raw.number(f"axes.{name}.minimum"), raw.number(f"axes.{name}.maximum")
    if low is not None and high is not None and 0 < high - low < 1000.0:
        said = (
            f"the range {low:g}..{high:g} um is only {(high - low) / 1e3:g} mm; lengths are um: is {high * 1e3:g} "
            "meant?"
        )
        yield f"axes.{name}.maximum", said
    elif low is not None and high is not None and high - low > 5e6:
        yield f"axes.{name}.maximum", f"the range {low:g}..{high:g} um is {(high - low) / 1e6:g} m; lengths are um"


def _heights(raw: RawValues) -> Iterator[Problem]:
    for path, meant in heights_meant(raw).items():
        yield path, f"{meant / 1e3:g} um is {meant / 1e6:g} mm; is {meant:g} meant?"


def heights_meant(raw: RawValues) -> dict[str, float]:
    """Return the heights that stand there in millimetres, in um: one beside others that are in um, or all three."""
    touch, work, safe = (raw.number(f"gantry.{name}_z_um") for name in ("touch", "work", "safe"))
    top = raw.number("axes.z.maximum")
    if touch is None or work is None or safe is None or top is None:
        return {}
    found: dict[str, float] = {}
    all_in_mm = 0.0 < safe < 100.0
    for name, height, odd in (("touch", touch, work - touch > FARTHEST_LOOK_UM), ("work", work, work < touch),
                              ("safe", safe, safe <= work)):  # fmt: skip
        if 0.0 < height < 100.0 and height * 1e3 <= top and (odd or all_in_mm):
            found[f"gantry.{name}_z_um"] = height * 1e3
    return found


def _places(raw: RawValues) -> Iterator[Problem]:
    """Places on the table: within the axes, and not in millimetres."""
    for table, what in (("board.origin_{}_um", "the board's corner"), ("control_point.{}_um", "the printed cross"),
                        ("reference.{}_um", "the reference pad"), ("brush.{}_um", "the brush")):  # fmt: skip
        for name in ("x", "y"):
            path = table.format(name)
            value = raw.number(path)
            low, high = raw.number(f"axes.{name}.minimum"), raw.number(f"axes.{name}.maximum")
            if value is None or low is None or high is None or high - low < 1000.0:
                continue
            if 0 < abs(value) < 1000.0 and low <= value * 1e3 <= high:
                said = (
                    f"{value:g} um would put {what} {abs(value) / 1e3:g} mm from the robot's zero; lengths are um: is "
                    f"{value * 1e3:g} meant? (for a place so near to zero write 0 or 1000)"
                )
                yield path, said


def _beyond(raw: RawValues) -> Iterator[Problem]:
    """Yield places that lie outside the axes; the tip is beside the head's centre, so some such are within reach."""
    tables = ("board.origin", "control_point", "reference", "brush")
    for path in (f"{table}{'_' if '.' in table else '.'}{axis}_um" for table in tables for axis in ("x", "y")):
        axis = "x" if "x_um" in path else "y"
        value = raw.number(path)
        low, high = raw.number(f"axes.{axis}.minimum"), raw.number(f"axes.{axis}.maximum")
        if value is not None and low is not None and high is not None and not low <= value <= high:
            yield path, f"{value:g} um lies outside axes.{axis} {low:g}..{high:g} um"


def _homing(raw: RawValues) -> Iterator[Problem]:
    for name in (*LINEAR, TURNING):
        low, high = raw.number(f"axes.{name}.minimum"), raw.number(f"axes.{name}.maximum")
        place = raw.number(f"axes.{name}.homing_position")
        if low is None or high is None or place is None or low >= high:
            continue
        margin = 0.1 * (high - low)
        path = f"axes.{name}.homing_position"
        if not low - margin <= place <= high + margin:
            yield path, f"{place:g} lies far outside the range {low:g}..{high:g}; it is the homing switch's coordinate"
        elif name == "z" and place < (low + high) / 2:
            said = (
                f"Z is homed at {place:g} um, the lower end of {low:g}..{high:g}: homing would press the needle down; "
                f"home at the upper end (homing_method 18, homing_position = {high:g})"
            )
            yield path, said


def _not_there(raw: RawValues, folder: Path) -> Iterator[Problem]:
    """Devices that this computer does not have now; the file may be written on another one."""
    paths = [f"bus.{name}.port" for name in raw.table("bus")] + ["lights.port", "camera.device", "meter.address"]
    for path in paths:
        port = raw.text(path)
        if port is None:
            continue
        port = from_folder(port, folder)
        if port.startswith("/") and not Path(port).exists():
            yield path, f"{port} is not there on this computer{_there()}"


def _there() -> str:
    """Return which serial and video devices there are."""
    found = [str(one) for kind in ("ttyUSB*", "ttyACM*", "reprobe-*", "video*") for one in Path("/dev").glob(kind)]
    found = sorted(found, key=lambda name: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)])
    return f"; there is {', '.join(found[:6])}" if found else "; plug it in, or see `ls /dev/serial/by-id /dev/video*`"
