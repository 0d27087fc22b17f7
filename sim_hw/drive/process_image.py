"""Process image of a drive: mapped objects packed into Modbus registers (drive manual, "PDO", 3502h and 3602h)."""

from __future__ import annotations

from typing import Literal

from sim_hw.drive.objects import (
    ABORT_MAPPING_TOO_LONG,
    ABORT_NOT_MAPPABLE,
    ABORT_RANGE,
    ABORT_STATE,
    DUMMIES,
    ENTRIES,
    Key,
    ObjectAbort,
    ObjectDictionary,
)

RX_BASE, TX_BASE = 6000, 5000
RX_MAPPING, TX_MAPPING = 0x3502, 0x3602
MAX_ENTRIES = 16
MAX_BYTES = 64


class Image:
    """One direction of the image; values are big-endian, without gaps or alignment."""

    def __init__(self, objects: ObjectDictionary, mapping: int, word_order: Literal["high", "low"]) -> None:
        self._objects = objects
        self._mapping = mapping
        self._word_order = word_order
        self._places: list[tuple[int, int, Key]] | None = None
        self._letter = "R" if mapping == RX_MAPPING else "T"
        objects.setters[mapping, 0] = self._check_count
        for sub in range(1, MAX_ENTRIES + 1):
            objects.setters[mapping, sub] = self._check_entry

    def places(self) -> list[tuple[int, int, Key]]:
        """Return (first byte, length, object) of what is mapped now."""
        if self._places is None:
            self._places = self._placed()
        return self._places

    def _placed(self) -> list[tuple[int, int, Key]]:
        count = self._objects.get(self._mapping)
        offset, found = 0, []
        for sub in range(1, count + 1):
            entry = self._objects.get(self._mapping, sub)
            size = (entry & 0xFF) // 8
            found.append((offset, size, (entry >> 16, entry >> 8 & 0xFF)))
            offset += size
        return found

    def size(self) -> int:
        """Return the image's length in bytes, filled up to whole 4 bytes."""
        return -(-sum(size for _, size, _ in self.places()) // 4) * 4

    def read(self) -> bytes:
        """Return the whole image with the objects' present values."""
        parts = [
            bytes(n) if key[0] in DUMMIES else self._turned(self._objects.read(key)) for _, n, key in self.places()
        ]
        return b"".join(parts).ljust(self.size(), b"\0")

    def write(self, first: int, data: bytes) -> list[tuple[Key, bytes]]:
        """Return the objects touched by bytes written at an offset, with their new little-endian bytes."""
        image = bytearray(self.read())
        image[first : first + len(data)] = data
        return [
            (key, self._turned(bytes(image[offset : offset + size])))
            for offset, size, key in self.places()
            if key[0] not in DUMMIES and offset < first + len(data) and offset + size > first
        ]

    def _turned(self, data: bytes) -> bytes:
        """Turn an object's little-endian bytes into the image's order, or back: it is its own inverse."""
        turned = data[::-1]
        return turned[2:] + turned[:2] if len(data) == 4 and self._word_order == "low" else turned

    def _check_count(self, count: int) -> None:
        self._places = None
        if count > MAX_ENTRIES:
            raise ObjectAbort(ABORT_RANGE)
        entries = [self._objects.get(self._mapping, sub) for sub in range(1, count + 1)]
        for entry in entries:
            self._check_mappable(entry)
        if sum(entry & 0xFF for entry in entries) > 8 * MAX_BYTES:
            raise ObjectAbort(ABORT_MAPPING_TOO_LONG)

    def _check_entry(self, entry: int) -> None:
        self._places = None
        if self._objects.get(self._mapping):
            # An entry may only be changed while the mapping is switched off (subindex 0 is 0).
            raise ObjectAbort(ABORT_STATE)
        if entry:
            self._check_mappable(entry)

    def _check_mappable(self, entry: int) -> None:
        key, bits = (entry >> 16, entry >> 8 & 0xFF), entry & 0xFF
        if key[0] in DUMMIES and key[1] == 0 and DUMMIES[key[0]] == bits:
            return
        known = ENTRIES.get(key)
        if known is None or self._letter not in known.mappable or 8 * known.size != bits:
            raise ObjectAbort(ABORT_NOT_MAPPABLE)
