"""Backup archive: a tar file with a manifest first, and the length and SHA-256 of every file that follows.

What is read from an archive is believed only when it is what the manifest says: no other file, no link, no path that
leads out of the folder it is unpacked into.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import re
import tarfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from daemon.platform.atomic_file import flush_folder, written_beside

MANIFEST = "manifest.json"
CONFIGURATION = "station.toml"
BOARD = "board"
"""Folder of the board file."""
DATA = "data"
"""Folder of what lay in `station.data_dir`."""
KEYS = "keys"
JOURNAL = f"{DATA}/journal.sqlite"
MANIFEST_BYTES = 20_000_000
CHUNK = 1 << 20
_PART = r"[^/\0]*[^/\0.][^/\0]*"
_NAMES = re.compile(
    rf"{re.escape(CONFIGURATION)}|{re.escape(JOURNAL)}|{BOARD}/{_PART}|(?:{DATA}/(?:calibration|plans)|{KEYS})(?:/{_PART})+"
)
"""What may be in an archive; a part of a path is never made of dots alone."""


class BackupError(ValueError):
    """Something keeps a backup from being made or put back; `advice` says what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


class Entry(BaseModel):
    """One file of the archive."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class Manifest(BaseModel):
    """What an archive holds, and of which station."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal[1] = 1
    station: str
    made_at: str
    program: str
    journal_version: int | None = None
    """None: there was no journal."""
    files: dict[str, Entry]

    @property
    def has_keys(self) -> bool:
        """Whether private keys are in it."""
        return any(name.startswith(f"{KEYS}/") for name in self.files)


def entry_of(path: Path) -> Entry:
    """Return length and checksum of a file; OSError."""
    with path.open("rb") as file:
        checksum = hashlib.file_digest(file, "sha256").hexdigest()
    return Entry(bytes=path.stat().st_size, sha256=checksum)


def write_archive(output: Path, manifest: Manifest, folder: Path) -> None:
    """Write the files of a folder; whole or not at all, for its owner alone. FileExistsError, OSError."""

    def write(path: Path) -> None:
        with tarfile.open(path, "w:gz") as archive:
            body = manifest.model_dump_json(indent=1).encode()
            archive.addfile(_member(MANIFEST, len(body)), io.BytesIO(body))
            for name, entry in manifest.files.items():
                with (folder / name).open("rb") as file:
                    archive.addfile(_member(name, entry.bytes), file)

    with written_beside(output, write) as beside:
        output.hardlink_to(beside)  # unlike a rename, it never takes the place of an older backup
    flush_folder(output.absolute().parent)


def _member(name: str, length: int) -> tarfile.TarInfo:
    member = tarfile.TarInfo(name)
    member.size, member.mode = length, 0o600
    return member


def read_manifest(path: Path) -> Manifest:
    """Return what an archive says it holds; `BackupError` if it is no backup."""
    with _opened(path) as archive:
        return _manifest(path, archive)


def unpack(path: Path, folder: Path) -> Manifest:
    """Unpack an archive into a folder, each file as its manifest says; `BackupError` if one is not, or OSError."""
    with _opened(path) as archive:
        manifest = _manifest(path, archive)
        missing = set(manifest.files)
        for member in archive:
            if member.name == MANIFEST:
                continue
            if not member.isfile() or member.name not in missing:
                raise _damaged(path, f"{member.name!r} does not belong into it")
            _unpack_one(path, archive, member, manifest.files[member.name], folder)
            missing.remove(member.name)
    if missing:
        raise _damaged(path, f"{min(missing)} is not in it")
    return manifest


def _unpack_one(path: Path, archive: tarfile.TarFile, member: tarfile.TarInfo, entry: Entry, folder: Path) -> None:
    target = folder / member.name
    target.parent.mkdir(parents=True, exist_ok=True)
    source = archive.extractfile(member)
    if source is None or member.size != entry.bytes:
        raise _damaged(path, f"{member.name} has another length than its manifest says")
    if _copied(source, target) != entry.sha256:
        raise _damaged(path, f"{member.name} is not what was put into it (its SHA-256 differs)")


def _copied(source: IO[bytes], target: Path) -> str:
    """Copy; return the SHA-256 of what was copied."""
    checksum = hashlib.sha256()
    with target.open("wb") as file:
        while chunk := source.read(CHUNK):
            checksum.update(chunk)
            file.write(chunk)
    return checksum.hexdigest()


@contextmanager
def _opened(path: Path) -> Iterator[tarfile.TarFile]:
    try:
        if not path.is_file():
            raise BackupError(f"{path} is no file", "name the archive that `reprobe backup` wrote")
        with tarfile.open(path, "r:gz") as archive:
            yield archive
    except (tarfile.TarError, gzip.BadGzipFile, zlib.error, EOFError) as exc:
        raise _damaged(path, str(exc) or "it ends too early") from exc


def _manifest(path: Path, archive: tarfile.TarFile) -> Manifest:
    first = archive.next()
    file = archive.extractfile(first) if first is not None and first.name == MANIFEST and first.isfile() else None
    if file is None:
        raise BackupError(f"{path} is no backup of a station", "name the archive that `reprobe backup` wrote")
    try:
        manifest = Manifest.model_validate_json(file.read(MANIFEST_BYTES))
    except ValidationError as exc:
        raise BackupError(
            f"{path} is no backup that this program reads: {exc.errors()[0]['msg']}",
            "put it back with the program that made it, or a newer one",
        ) from exc
    if wrong := [name for name in manifest.files if _NAMES.fullmatch(name) is None]:
        raise _damaged(path, f"{wrong[0]!r} does not belong into it")
    if CONFIGURATION not in manifest.files:
        raise _damaged(path, f"{CONFIGURATION} is not in it")
    return manifest


def _damaged(path: Path, why: str) -> BackupError:
    return BackupError(f"{path} is damaged: {why}", "nothing was changed; take another backup")
