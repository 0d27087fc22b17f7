"""Atomic files: either whole or not there."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_BESIDE = ".new-"


FOR_THE_GROUP = 0o640
"""Mode of what the station keeps: people of the daemon's group read it."""


def replace_whole(path: Path, write: Callable[[Path], object], mode: int | None = None) -> None:
    """Let `write` fill a new file, then put it in the place of `path`, flushed to disk.

    Without a mode it is its owner's alone, unless `write` says otherwise. Missing folders are made. Raises what
    `write` raises and OSError; `path` is then as it was, unless the folder alone could not be flushed.
    """
    with written_beside(path, write, mode) as beside:
        beside.replace(path)
        flush_folder(path.parent)


def rewrite(path: Path, content: bytes, mode_of_new: int) -> None:
    """Give a file that is a person's own another content, whole or not at all.

    What that person arranged stays: a link still leads to the file, which keeps its mode, and its owner and group as
    far as this process may give a file away. Raises OSError; the file is then as it was.
    """
    # Not `resolve`, which raises another error where links lead round in a circle.
    target = Path(os.path.realpath(path))
    before = target.stat() if target.exists() else None

    def put(beside: Path) -> None:
        beside.write_bytes(content)
        if before is not None:
            _give(beside, before)
        beside.chmod(mode_of_new if before is None else stat.S_IMODE(before.st_mode))  # giving a file takes bits away

    replace_whole(target, put)


def _give(path: Path, like: os.stat_result) -> None:
    """Give a file the owner and the group of another, each as far as that is allowed."""
    for user, group in ((-1, like.st_gid), (like.st_uid, -1)):
        with suppress(PermissionError):
            os.chown(path, user, group)


@contextmanager
def written_beside(path: Path, write: Callable[[Path], object], mode: int | None = None) -> Iterator[Path]:
    """Give a new file in the folder of `path`, filled by `write` and flushed to disk, for the block to move.

    What the block has not moved is removed at its end.
    """
    make_folder(path.parent)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=_BESIDE, suffix=path.suffix)
    beside = Path(name)
    try:
        os.close(handle)
        write(beside)
        if mode is not None:
            beside.chmod(mode)
        with beside.open("rb") as file:
            os.fsync(file.fileno())
        yield beside
    finally:
        # A leftover takes a little room; that it stays must not hide how the writing ended.
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def remove_leftovers(folder: Path) -> None:
    """Remove what a process that was killed had begun to write in a folder and those below, by nobody else's hand.

    Only for a folder in which no other process writes. What cannot be removed stays: it is only in the way.
    """
    for leftover in folder.rglob(f"{_BESIDE}*"):
        if leftover.is_file() or leftover.is_symlink():
            with suppress(OSError):
                leftover.unlink()


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, each one's name flushed to disk; one that is there is left as it is."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    flush_folder(folder.parent)


def flush_folder(folder: Path) -> None:
    """Flush a folder's names to disk: a file that was put there is found there after a power cut, too."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
