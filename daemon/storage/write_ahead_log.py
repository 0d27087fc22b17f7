"""Write-ahead log of SQLite, seen from outside: whether the bytes that were written stay as they were.

SQLite looks at the sums of a log's frames only where it takes over one that was left behind (file format, section 4):
what is spoilt while the database is open goes into the file unseen, and what is spoilt afterwards ends the log there.
No lock of SQLite's is on the log, so that it may be opened and closed beside it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

HEAD_BYTES, FRAME_HEAD_BYTES = 32, 24
_PAGE_SIZE, _SALTS = slice(8, 12), slice(16, 24)
_IN_FRAME, _COMMIT = slice(8, 16), slice(4, 8)
"""A frame repeats the salts of the log it belongs to; the last of a transaction says how large the file is then."""


def commits(log: Path) -> list[int]:
    """Return the numbers, from 1, of the frames that end a transaction of this log, whatever their sums say."""
    try:
        with log.open("rb") as file:
            head = file.read(HEAD_BYTES)
            return [number for number, frame in enumerate(_frames(file, head), start=1) if any(frame[_COMMIT])]
    except OSError:
        return []


class LogSum:
    """Sum over a log's whole transactions: they stay until SQLite writes it again from its head; others may not."""

    def __init__(self, log: Path) -> None:
        self._log = log
        self.forget()

    def forget(self) -> None:
        """Know of nothing: a failed write may have left what the next one writes over."""
        self._head, self._end, self._sum = b"", 0, 0

    def follow(self) -> None:
        """Take in what was added by own work."""
        try:
            with self._log.open("rb") as file:
                self._take(file)
        except OSError:
            self.forget()

    def _take(self, file: BinaryIO) -> None:
        head = file.read(HEAD_BYTES)
        if head != self._head:
            self._head, self._end, self._sum = head, len(head), zlib.crc32(head)
        file.seek(self._end)
        end, total = self._end, self._sum
        for frame in _frames(file, head):
            end, total = end + len(frame), zlib.crc32(frame, total)
            if any(frame[_COMMIT]):
                self._end, self._sum = end, total

    def is_kept(self) -> bool:
        """Tell whether the log still holds what it held; reads all of it."""
        try:
            with self._log.open("rb") as file:
                return zlib.crc32(file.read(self._end)) == self._sum
        except OSError:
            return not self._end


def _frames(file: BinaryIO, head: bytes) -> Iterator[bytes]:
    """Yield the frames from here on that belong to the log of this head; those behind are of one before it."""
    if len(head) < HEAD_BYTES:
        return
    size = FRAME_HEAD_BYTES + int.from_bytes(head[_PAGE_SIZE], "big")
    while len(frame := file.read(size)) == size and frame[_IN_FRAME] == head[_SALTS]:
        yield frame
