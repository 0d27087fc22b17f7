"""Making of a backup, also while the daemon works: all files as they were at one moment.

The journal is copied by SQLite itself, in one reading transaction. The other files are replaced whole by the daemon, so
each copy is whole; if one of them has changed while the others were copied, all are copied again.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from daemon.config.model import Config, load_config
from daemon.platform.clock import utc_now
from daemon.storage.journal_schema import BUSY_MS
from daemon.tools.backup.archive import (
    BOARD,
    CONFIGURATION,
    DATA,
    JOURNAL,
    KEYS,
    BackupError,
    Manifest,
    entry_of,
    write_archive,
)

TRIES = 5
FOLDERS = ("calibration", "plans")
"""Of the data folder. Pictures are left out: they are many, and say nothing that a station needs to go on."""
_KINDS = (
    ("configuration", CONFIGURATION),
    ("board file", f"{BOARD}/"),
    ("calibrations, with their history and pages", f"{DATA}/calibration/"),
    ("plans", f"{DATA}/plans/"),
    ("journal", JOURNAL),
    ("private keys", f"{KEYS}/"),
)
_Stamp = tuple[int, int, int]


def make_backup(config_file: Path, output: Path, *, with_keys: bool = False) -> Manifest:
    """Write a backup; return what is in it. Raises `ConfigError`, `BackupError`, OSError."""
    config = load_config(config_file)
    if output.exists():
        raise BackupError(f"{output} is there already", "choose another name: an older backup is never overwritten")
    with tempfile.TemporaryDirectory(dir=output.absolute().parent, prefix=".backup-") as name:
        folder = Path(name)
        _copy_all(_sources(config_file, config, with_keys=with_keys), folder)
        journal_version = _copy_journal(config.station.data_dir / "journal.sqlite", folder / JOURNAL)
        names = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
        manifest = Manifest(
            station=config.station.name, made_at=utc_now(), program=_program(), journal_version=journal_version,
            files={one: entry_of(folder / one) for one in names},
        )  # fmt: skip
        write_archive(output, manifest, folder)
    return manifest


def _sources(config_file: Path, config: Config, *, with_keys: bool) -> dict[str, Path]:
    """Return name in the archive -> file, for all but the journal."""
    board = config.board.file
    sources = {CONFIGURATION: config_file} | ({f"{BOARD}/{board.name}": board} if board.is_file() else {})
    for folder in FOLDERS:
        sources |= _below(config.station.data_dir / folder, f"{DATA}/{folder}")
    if with_keys:
        sources |= _below(config.api.keys_dir, KEYS)
    return sources


def _below(folder: Path, name: str) -> dict[str, Path]:
    if not folder.is_dir():
        return {}
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    # What is being written has a name that begins with a dot.
    return {f"{name}/{path.relative_to(folder).as_posix()}": path for path in files if not path.name.startswith(".")}


def _copy_all(sources: dict[str, Path], folder: Path) -> None:
    for _ in range(TRIES):
        before = {name: _stamp(path) for name, path in sources.items()}
        for name, path in sources.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if before[name] is not None:
                shutil.copyfile(path, target)
        if all(_stamp(path) == before[name] is not None for name, path in sources.items()):
            return
    raise BackupError("files are being changed again and again", "try again when no calibration runs")


def _stamp(path: Path) -> _Stamp | None:
    """Return what tells a file from one that took its place; None if it is gone."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _copy_journal(source: Path, target: Path) -> int | None:
    """Copy the journal as of one moment, looked through; return its version, None if there is no journal."""
    if not source.is_file():
        return None
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        with closing(_reader(source)) as live, closing(sqlite3.connect(target, isolation_level=None)) as copy:
            live.backup(copy)
            copy.execute("PRAGMA journal_mode=DELETE")
            found = str(copy.execute("PRAGMA integrity_check(1)").fetchone()[0])
            if found != "ok":
                raise sqlite3.DatabaseError(found)
            return int(copy.execute("PRAGMA user_version").fetchone()[0])
    except sqlite3.Error as exc:
        raise BackupError(
            f"the journal {source} cannot be copied: {exc}",
            "`reprobe doctor` says what is wrong with it; `reprobe reset` moves a damaged one aside",
        ) from exc


def _reader(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=BUSY_MS / 1e3)


def _program() -> str:
    try:
        return version("reprobe")
    except PackageNotFoundError:
        return "unknown"


def contents(manifest: Manifest) -> Iterator[str]:
    """Say what is in a backup, a line for each kind."""
    for what, begin in _KINDS:
        sizes = [entry.bytes for name, entry in manifest.files.items() if name.startswith(begin)]
        if sizes:
            yield f"{what}: {len(sizes)} file{'s' if len(sizes) > 1 else ''}, {sum(sizes) / 1e3:.0f} kB"
        else:
            yield f"{what}: none"
