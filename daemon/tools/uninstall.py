"""Taking away of what `reprobe install` laid out; what a person made stays until the person says otherwise.

Three kinds: the package's own files, which another install brings back; the configuration, with device rules and keys;
and the state, the journal, calibrations and pictures, which nothing brings back but a backup.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from daemon.platform.instance_lock import LOCK, alone
from daemon.tools.install import INSTANCE_UNIT, OURS, OURS_ON_A_BENCH, THEIRS, shipped


@dataclass(frozen=True)
class Installed:
    """What is there of each kind."""

    own: tuple[Path, ...]
    configuration: tuple[Path, ...]
    state: tuple[Path, ...]

    @property
    def is_nothing(self) -> bool:
        """Whether nothing is there at all."""
        return not (self.own or self.configuration or self.state)


def find(root: Path, made: Iterator[str] | tuple[str, ...] = ()) -> Installed:
    """Return what lies below `root`; `made`: places of the files that were made from the commands. OSError."""
    places = [*OURS.values(), *OURS_ON_A_BENCH.values(), INSTANCE_UNIT, *made]
    own = [root / place for place in places]
    own += sorted((root / "etc/credstore").glob("reprobe*.server.key"))
    configuration = [root / "etc/reprobe"]
    for name, place in THEIRS.items():
        # Rules that nobody has edited are the package's own
        (own if _same(root / place, shipped() / name) else configuration).append(root / place)
    configuration += sorted((root / "etc/systemd/system").glob("reprobe*.service.d"))
    state = sorted([*(root / "var/lib").glob("reprobe*"), *(root / "var/cache").glob("reprobe*")])
    return Installed(
        tuple(path for path in own if path.is_symlink() or path.is_file()),
        tuple(path for path in configuration if path.exists()),
        tuple(path for path in state if path.is_dir()),
    )


def take_away(paths: tuple[Path, ...]) -> list[Path]:
    """Remove files and folders; return those that were there. OSError."""
    removed = []
    for path in paths:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.is_symlink() or path.exists():
            path.unlink()
        else:
            continue
        removed.append(path)
        if path.parent.name.endswith(".service.d") and not any(path.parent.iterdir()):
            path.parent.rmdir()
    return removed


def require_stopped(installed: Installed) -> None:
    """Raise `NotAloneError` while a daemon works with any of the state."""
    with ExitStack() as stack:
        for folder in installed.state:
            if (folder / LOCK).exists():
                stack.enter_context(alone(folder))


def _same(path: Path, other: Path) -> bool:
    try:
        return path.read_bytes() == other.read_bytes()
    except FileNotFoundError:
        return False
