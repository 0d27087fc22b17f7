"""Putting back of a backup, while the daemon is stopped, so that a kill at any point loses nothing.

All is unpacked and proved first, on the disk it is for. Then a note is written that a restore has begun, with which the
daemon does not start; what is there is moved aside, the new takes its place, the note is removed. Nothing is deleted.
What a backup cannot know of the present is not taken from it: an alignment is void, and event numbers go on rising.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
import time
import tomllib
from contextlib import ExitStack, closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from daemon.config.model import Config, ConfigError, load_config
from daemon.platform.atomic_file import flush_folder, make_folder, replace_whole
from daemon.platform.instance_lock import alone
from daemon.storage import alignment_void, unfinished_restore
from daemon.storage.journal_schema import SCHEMA_VERSION, salvaged_seq
from daemon.storage.journal_writer import NEXT_SEQ
from daemon.storage.pinned_state import PinnedState
from daemon.tools.backup.archive import (
    BOARD,
    CONFIGURATION,
    DATA,
    JOURNAL,
    KEYS,
    BackupError,
    Manifest,
    read_manifest,
    unpack,
)

MOVED = ("calibration", "plans", "journal.sqlite", "journal.sqlite-wal", "journal.sqlite-shm")
"""Of the data folder: what a backup takes the place of."""


@dataclass(frozen=True)
class Restored:
    """What was put back, and where the things it took the place of are."""

    manifest: Manifest
    data_dir: Path
    aside: tuple[Path, ...]


def restore(archive: Path, config_file: Path, *, other_station: bool = False, with_keys: bool = False) -> Restored:
    """Put a backup back; raises `BackupError`, `NotAloneError` while a daemon works there, OSError.

    `other_station`: also one of a station of another name. `with_keys`: its keys too, if it has some.
    """
    manifest = read_manifest(archive)
    _require_same_station(manifest, config_file, other_station=other_station)
    if (manifest.journal_version or 0) > SCHEMA_VERSION:
        raise BackupError(
            f"its journal is of version {manifest.journal_version}, this program knows {SCHEMA_VERSION}",
            f"install the program of the backup ({manifest.program}) or a newer one first",
        )
    if with_keys and not manifest.has_keys:
        raise BackupError(f"{archive} has no keys", "make it by `reprobe backup --with-keys`, or leave --with-keys out")
    make_folder(config_file.absolute().parent)
    with ExitStack() as stack:
        fresh = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=config_file.parent, prefix=".restore-")))
        unpack(archive, fresh)
        config = _as_it_will_be(fresh / CONFIGURATION, config_file, manifest)
        folders = {config.station.data_dir, *_present_data_dir(config_file)}
        for folder in sorted(folders):
            stack.enter_context(alone(folder))
        staged = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=config.station.data_dir, prefix=".restore-")))
        shutil.copytree(fresh, staged, dirs_exist_ok=True)
        for path in staged.rglob("*"):
            _flushed(path)
        aside = _put_in_place(staged, config_file, config, archive, with_keys=with_keys)
    return Restored(manifest, config.station.data_dir, aside)


# --- may it be ------------------------------------------------------------------------------------------------


def _require_same_station(manifest: Manifest, config_file: Path, *, other_station: bool) -> None:
    if other_station or not config_file.exists():
        return
    name = _name_of(config_file)
    if name is None:
        raise BackupError(
            f"which station {config_file} is of cannot be read, and the backup is of {manifest.station!r}",
            "if it is for this station, say --other-station",
        )
    if name != manifest.station:
        raise BackupError(
            f"the backup is of station {manifest.station!r}, and {config_file} is of {name!r}",
            "its calibrations are not true here; if you mean it all the same, say --other-station",
        )


def _name_of(config_file: Path) -> str | None:
    """Return the station's name, also of a configuration that has other mistakes."""
    try:
        return str(tomllib.loads(config_file.read_text(encoding="utf-8-sig"))["station"]["name"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _present_data_dir(config_file: Path) -> set[Path]:
    try:
        return {load_config(config_file).station.data_dir}
    except (ConfigError, OSError):
        return set()


def _as_it_will_be(unpacked: Path, config_file: Path, manifest: Manifest) -> Config:
    """Return the configuration as it is read in its place, where its relative paths begin."""
    handle, name = tempfile.mkstemp(dir=config_file.parent, prefix=".restore-", suffix=".toml")
    os.close(handle)
    try:
        shutil.copyfile(unpacked, name)
        return load_config(Path(name))
    except ConfigError as exc:
        first = f"{exc.problems[0][0]}: {exc.problems[0][1]}"
        raise BackupError(
            f"this program does not take the configuration in the backup ({len(exc.problems)} problems; {first})",
            f"unpack it (tar xf) and correct it by `reprobe check-config`, or use the program of the backup "
            f"({manifest.program})",
        ) from exc
    finally:
        Path(name).unlink()


# --- doing it -------------------------------------------------------------------------------------------------


def _put_in_place(
    staged: Path, config_file: Path, config: Config, archive: Path, *, with_keys: bool
) -> tuple[Path, ...]:
    data_dir = config.station.data_dir
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    aside = data_dir / f"before-restore-{stamp}"
    next_seq = max(salvaged_seq(data_dir / "journal.sqlite"), salvaged_seq(staged / JOURNAL), int(time.time()))
    make_folder(aside)
    unfinished_restore.begin(data_dir, archive)
    _place_configuration(staged, config_file, config, aside)
    for name in MOVED:
        if (data_dir / name).exists():
            (data_dir / name).replace(aside / name)
        if (staged / DATA / name).exists():
            (staged / DATA / name).replace(data_dir / name)
    kept = [aside]
    if with_keys:
        kept += _place_keys(staged / KEYS, config.api.keys_dir, stamp)
    _suit_to_the_present(data_dir, next_seq)
    _owned_as(data_dir)
    flush_folder(aside)
    flush_folder(data_dir)
    unfinished_restore.end(data_dir)
    return tuple(kept)


def _place_configuration(staged: Path, config_file: Path, config: Config, aside: Path) -> None:
    boards = [(board, config.board.file) for board in (staged / BOARD).glob("*")]
    for source, target in (*boards, (staged / CONFIGURATION, config_file)):
        if target.is_file():
            shutil.copy2(target, aside / target.name)
            _flushed(aside / target.name)
        replace_whole(target, lambda path, source=source: _copied(source, path))  # type: ignore[misc]


def _copied(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)
    target.chmod(0o644)


def _place_keys(staged: Path, keys_dir: Path, stamp: str) -> list[Path]:
    """Put the keys in their place; the old ones stay beside, for their owner alone."""
    new = keys_dir.with_name(f".{keys_dir.name}-{stamp}")
    shutil.copytree(staged, new)
    for path in (new, *new.rglob("*")):
        path.chmod(0o700 if path.is_dir() else 0o600)
        _flushed(path)
    kept: list[Path] = []
    if keys_dir.exists():
        old = keys_dir.with_name(f"{keys_dir.name}-before-restore-{stamp}")
        keys_dir.replace(old)
        kept.append(old)
    new.replace(keys_dir)
    flush_folder(keys_dir.parent)
    return kept


def _suit_to_the_present(data_dir: Path, next_seq: int) -> None:
    """Make void what a backup cannot know: where the board lies now, and which event numbers were given since."""
    folder = data_dir / "calibration"
    if alignment_void.made_at(folder):
        why = "it was put back from a backup; align the board that lies there now"
        alignment_void.write_void(folder, alignment_void.Void(why))
    pinned = PinnedState(data_dir / "journal.pinned")
    pinned.load()
    next_seq = max(next_seq, int(pinned.get(NEXT_SEQ) or 0))
    pinned.store(NEXT_SEQ, next_seq)
    journal = data_dir / "journal.sqlite"
    if journal.exists():
        with closing(sqlite3.connect(journal, isolation_level=None)) as db:
            db.execute("UPDATE meta SET value=? WHERE key=?", (next_seq, NEXT_SEQ))


def _owned_as(data_dir: Path) -> None:
    """Give what root has put there to the folder's owner, the daemon's user, and its group the right to read."""
    owner = data_dir.stat()
    for name in (*MOVED, "journal.pinned", "daemon.lock"):
        top = data_dir / name
        for path in (top, *top.rglob("*")) if top.is_dir() else (top,):
            if not path.exists():
                continue
            if os.geteuid() == 0:
                os.chown(path, owner.st_uid, owner.st_gid)
            path.chmod(0o750 if path.is_dir() else 0o640)


def _flushed(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
