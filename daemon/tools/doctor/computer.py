"""Computer of a station: ports, cameras, permissions, disk, time. Reads only."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import grp
import os
import shutil
import stat
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from serial.tools import list_ports

from daemon.config.model import Config
from daemon.storage.calibration_conditions import AHEAD
from daemon.storage.calibration_store import Calibrations
from daemon.tools.doctor.findings import CheckResults

LEAST_FREE_MB, ADVISED_FREE_MB = 200.0, 1000.0
EARLIEST = datetime(2024, 1, 1, tzinfo=UTC)
CLOCK_UNSYNCHRONIZED = 5
"""What adjtimex(2) returns then (TIME_ERROR)."""


def examine_computer(findings: CheckResults, config: Config) -> None:
    """Check all that can be checked without opening a device."""
    list_serial_ports(findings)
    list_cameras(findings)
    for about, device, group in devices_of(config):
        examine_device(findings, about, Path(device), group)
    examine_data_dir(findings, config)
    examine_time(findings, config)


def devices_of(config: Config) -> Iterator[tuple[str, str, str]]:
    """Yield (what, device file, group that may use it) for all the configuration names."""
    for name, section in config.bus.items():
        if section.port is not None:
            yield f"port of bus {name}", section.port, "dialout"
    if config.lights.port is not None:
        yield "port of the lights", config.lights.port, "dialout"
    if config.meter is not None and config.meter.address.startswith("/"):
        yield "port of the meter", config.meter.address, "dialout"
    if config.camera.device is not None:
        yield "camera device", config.camera.device, "video"


def list_serial_ports(findings: CheckResults) -> None:
    """Say which serial ports there are, with the names that stay the same."""
    by_id = _stable_names(Path("/dev/serial/by-id"))
    ports = sorted(list_ports.comports(), key=lambda port: port.device)
    shown = [f"{by_id.get(port.device, port.device)} ({port.description})" for port in ports if port.hwid != "n/a"]
    findings.ok("serial ports", "; ".join(shown) or "none with hardware behind it")


def list_cameras(findings: CheckResults) -> None:
    """Say which cameras there are."""
    by_id = _stable_names(Path("/dev/v4l/by-id"))
    shown = []
    for folder in sorted(Path("/sys/class/video4linux").glob("video*")):
        device = f"/dev/{folder.name}"
        shown.append(f"{by_id.get(device, device)} ({_text(folder / 'name')})")
    findings.ok("cameras", "; ".join(shown) or "none on this computer")


def _stable_names(folder: Path) -> dict[str, str]:
    return {str(link.resolve()): str(link) for link in sorted(folder.glob("*"))} if folder.is_dir() else {}


def _text(file: Path) -> str:
    try:
        return file.read_text(errors="replace").strip()
    except OSError:
        return "unnamed"


def examine_device(findings: CheckResults, about: str, device: Path, group: str) -> None:
    """Check that a device is there, may be used, and that nobody else has it."""
    if not device.exists():
        findings.fail(about, f"{device} is not there", "plug it in, or correct its name in the configuration")
        return
    if not stat.S_ISCHR(device.stat().st_mode):
        findings.fail(about, f"{device} is no device", "correct its name in the configuration")
        return
    if not os.access(device, os.R_OK | os.W_OK):
        advice = f"add the service's user to the group {_group_of(device) or group}, then log in again"
        findings.fail(about, f"{device} may not be used by this user", advice)
        return
    if in_use(device):
        who = ", ".join(f"{name} (process {pid})" for pid, name in who_has_open(device)) or "another program"
        findings.fail(about, f"{device} is in use by {who}", "stop that program first")
    else:
        real = device.resolve()
        findings.ok(about, f"{device}{f' -> {real}' if real != device else ''}, free")


def _group_of(device: Path) -> str | None:
    try:
        return grp.getgrgid(device.stat().st_gid).gr_name
    except (KeyError, OSError):
        return None


def in_use(device: Path) -> bool:
    """Tell whether another program has a device: a serial port is locked by who uses it, a camera only held open."""
    try:
        handle = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as exc:
        return exc.errno == errno.EBUSY
    try:
        if not os.isatty(handle):
            return bool(who_has_open(device))
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def who_has_open(device: Path) -> list[tuple[int, str]]:
    """Return (process number, name) of others that have a device open, as far as this user may see."""
    real = device.resolve()
    others = [process for process in Path("/proc").glob("[0-9]*") if int(process.name) != os.getpid()]
    return [(int(process.name), _text(process / "comm")) for process in others if _has_open(process, real)]


def _has_open(process: Path, device: Path) -> bool:
    try:
        return any(_leads_to(handle, device) for handle in (process / "fd").iterdir())
    except OSError:
        return False  # it ended meanwhile, or is somebody else's


def _leads_to(handle: Path, device: Path) -> bool:
    try:
        return handle.readlink() == device
    except OSError:
        return False


def examine_data_dir(findings: CheckResults, config: Config) -> None:
    """Check that journal and pictures can be kept, by whom they can be read, and for how long."""
    folder = config.station.data_dir
    there = next(place for place in (folder, *folder.parents) if place.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        findings.fail("data folder", f"{there} may not be written", f"give it to the service's user: chown ... {there}")
        return
    open_to_all = folder.exists() and bool(folder.stat().st_mode & stat.S_IWOTH)
    findings.judge("data folder", f"{folder}{'' if folder.exists() else ' (will be made)'}", good=not open_to_all,
                   otherwise="warn", advice=f"anybody may change it: chmod o-w {folder}")  # fmt: skip
    free_mb = shutil.disk_usage(there).free / 1e6
    wanted_mb = max(ADVISED_FREE_MB, 2 * config.station.pictures_quota_mb)
    advice = f"free some, or lower station.pictures_quota_mb; {wanted_mb:.0f} MB are advised"
    verdict = "fail" if free_mb < LEAST_FREE_MB else "warn"
    findings.judge(
        "disk", f"{free_mb:.0f} MB free", good=free_mb >= wanted_mb, advice=advice,
        otherwise="fail" if verdict == "fail" else "warn",
    )  # fmt: skip


def examine_time(findings: CheckResults, config: Config) -> None:
    """Check the clocks: steady, set by the network, and not before what was calibrated."""
    first, second = time.monotonic(), time.monotonic()
    resolution_ms = time.get_clock_info("monotonic").resolution * 1e3
    steady = second >= first and resolution_ms <= 1.0
    findings.judge("monotonic clock", f"resolution {resolution_ms:.6f} ms", good=steady,
                   advice="this computer's clock cannot time a frame; use another")  # fmt: skip
    now = datetime.now(UTC)
    calibrations = Calibrations(config.station.data_dir / "calibration", config.station.name)
    calibrations.load()
    latest = max(map(datetime.fromisoformat, calibrations.made_at().values()), default=EARLIEST)
    ahead = [f"{what}: {why}" for what, why in calibrations.problems.items() if AHEAD in why]
    behind = ahead[0] if ahead else f"a calibration was made at {latest:%Y-%m-%d %H:%M}"
    findings.judge("date and time", f"{now:%Y-%m-%d %H:%M} UTC", good=not ahead and now >= max(latest, EARLIEST),
                   advice=f"set the clock: {behind}")  # fmt: skip
    synchronized = clock_synchronized()
    if synchronized is not None:
        findings.judge("time from the network", "synchronized" if synchronized else "not synchronized",
                       good=synchronized, otherwise="warn",
                       advice="timedatectl set-ntp true; results carry the time of this clock")  # fmt: skip


def clock_synchronized() -> bool | None:
    """Ask the kernel whether something keeps the clock set; None where it does not say."""
    adjtimex = getattr(ctypes.CDLL(None), "adjtimex", None)
    if adjtimex is None:
        return None
    state = adjtimex(ctypes.create_string_buffer(512))  # struct timex, all zero: only ask
    return None if state < 0 else state != CLOCK_UNSYNCHRONIZED
