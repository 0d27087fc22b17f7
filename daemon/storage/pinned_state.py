"""Pinned state: a few facts in a file that is overwritten in place, so that a full disk does not keep them out.

Its room is taken when it is made. Two slots are written in turn, each with a checksum: a write that is cut off leaves
the one before. What it holds must not be lost when the journal cannot be written: the event numbers given out, and
the axes in doubt.
"""

from __future__ import annotations

import json
import os
import zlib
from pathlib import Path
from typing import Any

from daemon.platform.atomic_file import FOR_THE_GROUP, replace_whole
from daemon.platform.plain_file import read_small

SLOT = 4096
_TURN = "turn"


class PinnedState:
    """One such file. Every method does I/O, and raises OSError if that fails."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._turn = 0
        self._facts: dict[str, Any] = {}

    def load(self) -> None:
        """Read the newer of the two slots; a file that is not there, or that nobody can read, holds nothing."""
        try:
            raw = read_small(self._path)
        except FileNotFoundError:
            raw = b""
        slots = [facts for at in (0, SLOT) if (facts := _read(raw[at : at + SLOT])) is not None]
        self._facts = max(slots, key=lambda facts: int(facts[_TURN]), default={})
        self._turn = int(self._facts.get(_TURN, 0))

    def get(self, key: str) -> Any:
        """Return one fact as it was last read or written; None if there is none."""
        return self._facts.get(key)

    def store(self, key: str, value: Any) -> None:
        """Write one fact down, flushed to disk, beside the others; ValueError if they no longer fit."""
        turn = self._turn + 1
        facts = {**self._facts, key: value, _TURN: turn}
        slot = _written(facts)
        if not self._path.exists():
            replace_whole(self._path, lambda path: path.write_bytes(bytes(2 * SLOT)), FOR_THE_GROUP)
        handle = os.open(self._path, os.O_WRONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        try:
            os.pwrite(handle, slot, (turn % 2) * SLOT)
            os.fsync(handle)
        finally:
            os.close(handle)
        self._turn, self._facts = turn, facts


def _written(facts: dict[str, Any]) -> bytes:
    body = json.dumps(facts).encode()
    slot = b"%08x %s\n" % (zlib.crc32(body), body)
    if len(slot) > SLOT:
        raise ValueError(f"{len(slot)} bytes do not fit")
    return slot.ljust(SLOT, b" ")


def _read(slot: bytes) -> dict[str, Any] | None:
    try:
        checksum, body = slot.rstrip(b" \n").split(b" ", 1)
        if zlib.crc32(body) != int(checksum, 16):
            return None
        facts = json.loads(body)
        return facts if isinstance(facts.get(_TURN), int) else None
    except (ValueError, AttributeError):
        return None
