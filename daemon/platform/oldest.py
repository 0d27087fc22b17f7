"""Quota of files in a folder: the oldest go, and only files of the given name."""

from __future__ import annotations

import stat
from pathlib import Path

import structlog

log = structlog.get_logger(__name__)


def drop_oldest(folder: Path, pattern: str, *, keep: int, keep_bytes: int) -> list[Path]:
    """Remove the oldest plain files that match until no more than `keep`, and `keep_bytes`, are left; return them.

    The newest always stays. Links are neither followed nor counted. What cannot be removed is logged.
    """
    files = sorted(_plain(folder, pattern), reverse=True)
    gone, total = [], 0
    for n, (_, size, file) in enumerate(files):
        total += size
        if n and (n >= keep or total > keep_bytes):
            try:
                file.unlink()
                gone.append(file)
            except OSError as exc:
                log.warning("old_file_not_removed", file=str(file), why=str(exc))
    return gone


def _plain(folder: Path, pattern: str) -> list[tuple[float, int, Path]]:
    """Return (time of change, bytes, file) of the plain files that match."""
    found = []
    for file in folder.glob(pattern):
        try:
            seen = file.lstat()
        except OSError:
            continue
        if stat.S_ISREG(seen.st_mode):
            found.append((seen.st_mtime, seen.st_size, file))
    return found
