"""Instance lock: one daemon to a station, by a lock on its data folder that the system releases if it dies.

Without it a second daemon would take over local sockets without a word, and call the first one's job interrupted.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOCK = "daemon.lock"


class NotAloneError(Exception):
    """Another daemon works with this folder; `advice` says what to do."""

    advice = "stop it first, or give this one another station.data_dir"


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Hold the folder, making it if need be; raise `NotAloneError` with the other's process number."""
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            other = os.read(handle, 20).decode(errors="replace").strip() or "unknown"
            raise NotAloneError(f"another daemon (process {other}) works with {folder}") from None
        _sign(handle)
        yield
    finally:
        # The file stays: to remove it would let two hold two files of the same name.
        os.close(handle)


def _sign(handle: int) -> None:
    """Write the own process number, for who finds the folder taken; a full disk must not keep the daemon out."""
    with suppress(OSError):
        os.ftruncate(handle, os.pwrite(handle, f"{os.getpid()}\n".encode(), 0))
