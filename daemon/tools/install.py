"""Installation for the service manager: units, user, folders, device rules. Twice is the same as once.

Files that are the package's own are brought up to date; what a person edits (`station.toml`, the device rules) is
written once and never touched again.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from daemon.config.bench_template import BenchPlaces, BenchWaits, bench_toml
from daemon.platform.atomic_file import replace_whole
from daemon.tools.board_import import Options, import_board

PREFIX = Path("/opt/reprobe")
"""Where the units expect the program's virtual environment."""
OURS = {
    "reprobe.service": "usr/local/lib/systemd/system/reprobe.service",
    "reprobe-page.service": "usr/local/lib/systemd/system/reprobe-page.service",
    "reprobe-uplink.service": "usr/local/lib/systemd/system/reprobe-uplink.service",
    "reprobe-collect.service": "usr/local/lib/systemd/system/reprobe-collect.service",
    "reprobe.sysusers.conf": "usr/local/lib/sysusers.d/reprobe.conf",
    "reprobe.tmpfiles.conf": "usr/local/lib/tmpfiles.d/reprobe.conf",
    "71-reprobe-modemmanager.rules": "etc/udev/rules.d/71-reprobe-modemmanager.rules",
    "station.example.toml": "etc/reprobe/station.example.toml",
}
"""Brought up to date each time."""
OURS_ON_A_BENCH = {
    "reprobe-sim.service": "usr/local/lib/systemd/system/reprobe-sim.service",
    "bench.conf": "etc/systemd/system/reprobe.service.d/bench.conf",
}
THEIRS = {"70-reprobe.rules": "etc/udev/rules.d/70-reprobe.rules"}
"""Written once."""
FOLDERS = {
    "etc/reprobe": 0o755,
    "etc/reprobe/keys": 0o700,
    "etc/reprobe/keys/clients": 0o700,
    "etc/reprobe/page": 0o700,
    "etc/reprobe/fleet": 0o700,
    "etc/credstore": 0o700,
}
INSTANCE_UNIT = "usr/local/lib/systemd/system/reprobe@.service"
INSTANCE_NAME = re.compile(r"[a-z0-9][a-z0-9_]{0,30}")
KEY_LINK, KEY = "etc/credstore/reprobe.server.key", "/etc/reprobe/keys/server.key"
STATION = "etc/reprobe/station.toml"
BENCH_BOARD = "etc/reprobe/bench-board"
FILE_MODE = 0o644


class InstallError(Exception):
    """Something could not be laid out; the message says what and why, `advice` what to do where that is not all."""

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class Placed:
    """One file and what became of it."""

    path: Path
    how: Literal["written", "brought up to date", "as it was", "yours, left alone"]


def shipped() -> Path:
    """Return the folder of the files to lay out: in an installed package beside this module, else in the checkout."""
    here = Path(__file__).parents[1]
    for folder in (here / "units", here.parent / "systemd"):
        if (folder / "reprobe.service").is_file():
            return folder
    raise InstallError("this package was installed without its units; install it from a wheel or a checkout")


def lay_out(
    root: Path,
    prefix: Path = PREFIX,
    *,
    bench: bool = False,
    instance: str | None = None,
    made: Mapping[str, str] = MappingProxyType({}),
) -> list[Placed]:
    """Lay everything out below `root`; `prefix` is where the program is on the finished system.

    `bench`: with the simulated station and a configuration for it. `instance`: with the folders of one of several
    stations on this computer. `made`: place -> text of more files of the package's own. Raises `InstallError`.
    """
    if not prefix.is_absolute():
        raise InstallError(f"the prefix {prefix} is not an absolute path")
    if instance is not None and INSTANCE_NAME.fullmatch(instance) is None:
        raise InstallError(f"{instance!r} is no name of a station: write small letters, digits and _, as in left")
    try:
        placed = list(_lay_out(root, prefix, bench=bench))
        placed += [_ours(root / where, text) for where, text in made.items()]
        if instance is not None:
            placed += _instance(root, instance)
        return placed
    except OSError as exc:
        advice = "as root for --root /; else choose a folder you may write to"
        raise InstallError(f"{exc.filename or root}: {exc.strerror}", advice) from exc


def _lay_out(root: Path, prefix: Path, *, bench: bool) -> Iterator[Placed]:
    source = shipped()
    for folder, mode in FOLDERS.items():
        _folder(root / folder, mode)
    for name, where in (OURS | OURS_ON_A_BENCH if bench else OURS).items():
        text = (source / name).read_text(encoding="utf-8")
        yield _ours(root / where, text.replace(f"{PREFIX}/", f"{prefix}/"))
    for name, where in THEIRS.items():
        yield _theirs(root / where, (source / name).read_text(encoding="utf-8"))
    unit = instance_unit((source / "reprobe.service").read_text(encoding="utf-8"))
    yield _ours(root / INSTANCE_UNIT, unit.replace(f"{PREFIX}/", f"{prefix}/"))
    yield _link(root / KEY_LINK, KEY)
    if bench:
        yield from _bench(root)


def instance_unit(unit: str) -> str:
    """Return the unit of one of several stations: its own configuration, folders, devices and keys."""
    return (
        unit.replace("Description=reprobe station daemon", "Description=reprobe station daemon of %i")
        .replace("/etc/reprobe/", "/etc/reprobe/%i/")
        .replace("Directory=reprobe\n", "Directory=reprobe-%i\n")
        .replace("/var/cache/reprobe\n", "/var/cache/reprobe-%i\n")
        .replace(":reprobe.server.key", ":reprobe-%i.server.key")
        .replace("/dev/reprobe-", "/dev/reprobe-%i-")
        .replace("edit reprobe`", "edit reprobe@NAME`")
        .replace("reset-failed reprobe`", "reset-failed reprobe@NAME`")
    )


def instance_example(example: str, name: str) -> str:
    """Return the example configuration of one of several stations."""
    own = (
        example.replace("/etc/reprobe/", f"/etc/reprobe/{name}/")
        .replace('name = "station-1"', f'name = "{name}"')
        .replace('"/var/lib/reprobe"', f'"/var/lib/reprobe-{name}"')
        .replace("/dev/reprobe-", f"/dev/reprobe-{name}-")
    )
    return f"""{own}
[api]                             # of this station alone; its testers say --endpoint ipc:///run/reprobe-{name}/control
control = "ipc:///run/reprobe-{name}/control"
events = "ipc:///run/reprobe-{name}/events"
"""


def _instance(root: Path, name: str) -> Iterator[Placed]:
    """Lay out the folders of one of several stations, and an example of its configuration."""
    for folder, mode in ((name, 0o755), (f"{name}/keys", 0o700), (f"{name}/keys/clients", 0o700)):
        _folder(root / "etc/reprobe" / folder, mode)
    example = (shipped() / "station.example.toml").read_text(encoding="utf-8")
    yield _ours(root / f"etc/reprobe/{name}/station.example.toml", instance_example(example, name))
    yield _link(root / f"etc/credstore/reprobe-{name}.server.key", f"/etc/reprobe/{name}/keys/server.key")


def _bench(root: Path) -> Iterator[Placed]:
    """Lay out the simulated station's board and a configuration that reaches it."""
    # With the extra `sim` only; found, never imported: it is reached by its wires.
    spec = importlib.util.find_spec("sim_hw")
    if spec is None or spec.origin is None or importlib.util.find_spec("gerbonara") is None:
        raise InstallError("the simulated station is not installed; pip install 'reprobe[sim]'")
    cad = Path(spec.origin).parent / "demo_board"
    for file in sorted(cad.iterdir()):
        yield _ours(root / BENCH_BOARD / file.name, file.read_text(encoding="utf-8"))
    # No parts lie on the board that the simulated station comes up with.
    board = import_board(cad, "top", Options(bare=True)).content(packed=False).decode()
    yield _theirs(root / "etc/reprobe/board.json", board)
    yield _theirs(root / STATION, _bench_station())


def _bench_station() -> str:
    """Return the configuration of a bench with a service's places; its sockets are those of `reprobe-sim.service`."""
    bench = BenchPlaces(
        by="reprobe install --bench",
        name="bench",
        data_dir="/var/lib/reprobe",
        line="/run/reprobe-sim/bus",
        camera="ipc:///run/reprobe-sim/camera",
        control="tcp://127.0.0.1:5555",
        events="tcp://127.0.0.1:5556",
    )
    return bench_toml(bench, BenchWaits(), "all")


def _folder(path: Path, mode: int) -> None:
    """Make a folder of that mode; one that is there keeps the mode it has."""
    if not path.is_dir():
        path.mkdir(parents=True)
        path.chmod(mode)


def _ours(path: Path, text: str) -> Placed:
    before = path.read_text(encoding="utf-8") if path.is_file() else None
    if before == text:
        return Placed(path, "as it was")
    _write(path, text)
    return Placed(path, "written" if before is None else "brought up to date")


def _link(link: Path, target: str) -> Placed:
    if link.is_symlink() or link.exists():
        return Placed(link, "as it was")
    link.symlink_to(target)
    return Placed(link, "written")


def _theirs(path: Path, text: str) -> Placed:
    if path.exists():
        return Placed(path, "yours, left alone")
    _write(path, text)
    return Placed(path, "written")


def _write(path: Path, text: str) -> None:
    def write(beside: Path) -> None:
        beside.write_text(text, encoding="utf-8")
        beside.chmod(FILE_MODE)

    replace_whole(path, write)
