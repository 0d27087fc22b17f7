"""A small disk of its own, in memory, that a test may fill."""

from __future__ import annotations

import errno
import io
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

SIZE_MB = 6
FILLER = "filler"


@contextmanager
def mounted(folder: Path, size_mb: int) -> Iterator[bool]:
    """Mount one as a new folder; tell whether that is allowed here. Where it is not, the folder is a plain one."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size_mb}m", "tmpfs", str(folder)]
    is_small = subprocess.run(mount, check=False, capture_output=True).returncode == 0
    try:
        yield is_small
    finally:
        if is_small:
            subprocess.run(["umount", "-l", str(folder)], check=True)  # noqa: S607


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """Mount it; a test is skipped where that is not allowed."""
    with mounted(folder, SIZE_MB) as is_small:
        if not is_small:
            pytest.skip("no small disk can be mounted here")
        yield folder


def fill(disk: Path) -> None:
    """Leave no byte."""
    with (disk / FILLER).open("ab", buffering=0) as file:
        for size in (65536, 4096, 1):
            with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
                _write_without_end(file, b"x" * size)
    assert os.statvfs(disk).f_bavail == 0


def _write_without_end(file: io.FileIO, block: bytes) -> None:
    while True:
        file.write(block)


def make_room(disk: Path) -> None:
    """Give the room back."""
    (disk / FILLER).unlink()
