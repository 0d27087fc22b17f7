"""Object dictionary of a drive: what exists, how wide it is, who may write it.

Names and defaults are those of the drive manual's object pages; entries the manual leaves open are in `knobs.py`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

ABORT_WRITE_ONLY = 0x06010001
"""CANopen abort codes (CiA 301)."""
ABORT_READ_ONLY = 0x06010002
ABORT_NO_OBJECT = 0x06020000
ABORT_NOT_MAPPABLE = 0x06040041
ABORT_MAPPING_TOO_LONG = 0x06040042
ABORT_LENGTH = 0x06070010
ABORT_TOO_LONG = 0x06070012
ABORT_TOO_SHORT = 0x06070013
ABORT_NO_SUBINDEX = 0x06090011
ABORT_RANGE = 0x06090030
ABORT_NOT_STORED = 0x08000020
ABORT_STATE = 0x08000022
ABORT_NO_DATA = 0x08000024


class ObjectAbort(Exception):
    """The access is refused with a CANopen abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"abort {code:08X}h")
        self.code = code


@dataclass(frozen=True)
class Entry:
    """One subindex: struct letter of its type, access, default, and the images it may be mapped to (R, T)."""

    kind: str
    access: str
    default: int
    mappable: str = ""

    @property
    def size(self) -> int:
        """Return the length in bytes."""
        return struct.calcsize("<" + self.kind)


Key = tuple[int, int]
Value = int | bytes

_READ_WRITE, _READ_ONLY = "rw", "ro"


def _table() -> dict[Key, Entry]:
    """Return every fixed-size object; strings are the drive's own."""
    table = {key: Entry("I", _READ_ONLY, value) for key, value in _IDENTITY.items()}
    for line in _ROWS.strip().splitlines():
        where, kind, access, default, *mappable = line.split()
        index, sub = where.split(":")
        table[int(index, 16), int(sub)] = Entry(kind, access, int(default, 0), "".join(mappable))
    for array in (0x2400, 0x2500):
        table[array, 0] = Entry("B", _READ_ONLY, NANOJ_VALUES)
        table |= {(array, place): Entry("i", _READ_WRITE, 0, "RT") for place in range(1, NANOJ_VALUES + 1)}
    for mapping, entries in ((0x3502, RX_DEFAULT), (0x3602, TX_DEFAULT)):
        table[mapping, 0] = Entry("B", _READ_WRITE, len(entries))
        padded = (*entries, *[0] * (16 - len(entries)))
        table |= {(mapping, place): Entry("I", _READ_WRITE, entry) for place, entry in enumerate(padded, start=1)}
    table |= {(0x1010, place): Entry("I", _READ_WRITE, 1) for place in range(1, 0x0E)}
    table |= {(0x1003, place): Entry("I", _READ_ONLY, 0) for place in range(1, 9)}
    return table


NANOJ_VALUES = 32
"""Length of the NanoJ arrays 2400h and 2500h."""

RX_DEFAULT = (0x60400010, 0x00050008, 0x60600008, 0x32020020, 0x607A0020, 0x60810020, 0x60420010, 0x60FE0120)
"""Default mapping, receive (the manual's page was not found; from memory) and transmit (manual, 3602h)."""
TX_DEFAULT = (0x60410010, 0x00050008, 0x60610008, 0x60640020, 0x60440010, 0x60FD0020)

_IDENTITY: dict[Key, int] = {
    (0x1018, 1): 0x0000026C,
    (0x1018, 2): 0x0000003D,
    (0x1018, 3): 0x07F70001,
    (0x1018, 4): 0x00004118,
}
"""1018h: vendor (Nanotec), product, revision, serial number (made up)."""

# index:subindex  type  access  default  mappable (R receive, T transmit)
_ROWS = """
1000:0 I ro 0x00040192
1001:0 B ro 0 T
1003:0 B rw 0
1010:0 B ro 13
1018:0 B ro 4
2028:0 I rw 5
202A:0 I rw 115200
202D:0 I rw 0
2030:0 I rw 50
2031:0 I rw 1800
2800:0 B ro 1
2800:1 I rw 0
3202:0 I rw 0 R
3240:0 B ro 5
3240:1 I rw 0
3240:2 I rw 0
3240:3 I rw 0
3240:4 I rw 0
3240:5 I ro 0 T
3701:0 h rw 2
603F:0 H ro 0 T
6040:0 H rw 0 R
6041:0 H ro 0 T
6042:0 h rw 200 R
6044:0 h ro 0 T
605A:0 h rw 2
605B:0 h rw 1
605C:0 h rw 1
605D:0 h rw 1
605E:0 h rw 2
6060:0 b rw 0 R
6061:0 b ro 0 T
6062:0 i ro 0 T
6064:0 i ro 0 T
6065:0 I rw 256
6066:0 H rw 100
6067:0 I rw 10
6068:0 H rw 0
606C:0 i ro 0 T
607A:0 i rw 4000 R
607C:0 i rw 0
607D:0 B ro 2
607D:1 i rw 0 R
607D:2 i rw 0 R
6081:0 I rw 500 R
6082:0 I rw 0 R
6083:0 I rw 500 R
6084:0 I rw 500 R
6085:0 I rw 5000 R
6086:0 h rw 0 R
6098:0 b rw 35
6099:0 B ro 2
6099:1 I rw 50
6099:2 I rw 10
609A:0 I rw 500
60A8:0 I rw 0
60A9:0 I rw 0
60C5:0 I rw 5000
60C6:0 I rw 5000
60F2:0 H rw 1
60F4:0 i ro 0 T
60FD:0 I ro 0 T
60FE:0 B ro 1
60FE:1 I rw 0 R
6502:0 I ro 0x21
"""

ENTRIES = _table()

DUMMIES = {0x0002: 8, 0x0003: 16, 0x0004: 32, 0x0005: 8, 0x0006: 16, 0x0007: 32}
"""Index 0002h..0007h fill gaps in a mapping: object -> bits."""


class ObjectDictionary:
    """Hold the values; the drive hangs its behaviour on `getters` and `setters`.

    A setter runs before the value is stored and may refuse it (ObjectAbort).
    """

    def __init__(self, stored: dict[Key, int], strings: dict[Key, bytes]) -> None:
        self._strings = strings
        self.values: dict[Key, int] = {key: stored.get(key, entry.default) for key, entry in ENTRIES.items()}
        self.getters: dict[Key, Callable[[], int]] = {}
        self.setters: dict[Key, Callable[[int], None]] = {}

    def get(self, index: int, sub: int = 0) -> int:
        """Return a stored value, for the drive itself."""
        return self.values[index, sub]

    def entry(self, key: Key) -> Entry:
        """Return what exists at a place.

        Raises:
            ObjectAbort: no such object or subindex.

        """
        if key in ENTRIES:
            return ENTRIES[key]
        known = any(index == key[0] for index, _ in (*ENTRIES, *self._strings))
        raise ObjectAbort(ABORT_NO_SUBINDEX if known else ABORT_NO_OBJECT)

    def read(self, key: Key) -> bytes:
        """Return an object's bytes, little-endian.

        Raises:
            ObjectAbort: it cannot be read.

        """
        if key in self._strings:
            return self._strings[key]
        entry = self.entry(key)
        getter = self.getters.get(key)
        value = self.values[key] if getter is None else getter()
        return struct.pack("<" + entry.kind, _fitted(value, entry))

    def write(self, key: Key, data: bytes) -> None:
        """Store an object's bytes, little-endian.

        Raises:
            ObjectAbort: it cannot be written so.

        """
        if key in self._strings:
            raise ObjectAbort(ABORT_READ_ONLY)
        entry = self.entry(key)
        if entry.access == _READ_ONLY:
            raise ObjectAbort(ABORT_READ_ONLY)
        if len(data) != entry.size:
            raise ObjectAbort(ABORT_TOO_LONG if len(data) > entry.size else ABORT_TOO_SHORT)
        value = struct.unpack("<" + entry.kind, data)[0]
        setter = self.setters.get(key)
        if setter is not None:
            setter(value)
        self.values[key] = value


def _fitted(value: int, entry: Entry) -> int:
    """Wrap a computed value into the object's width, as a register does."""
    bits = 8 * entry.size
    value &= (1 << bits) - 1
    return value - (1 << bits) if entry.kind.islower() and value >> (bits - 1) else value
