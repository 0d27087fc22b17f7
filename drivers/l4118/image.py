"""The process image: which object lies where in the registers from 5000 on (Tx, what the drive tells). Pure.

Data are packed without gaps in the order of the mapping (3602h), big-endian (drive manual, "PDO").
The order of the two words of a 32 bit value is not settled there: it is an argument.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

TX_ADDRESS = 5000

WordOrder = Literal["big", "little"]

# Objects below this index are dummies that only fill space
_FIRST_REAL_INDEX = 0x1000

# 6041h, dummy u8, 6061h, 6064h, 60FDh: even number of registers, long values on even registers
TX_WANTED = (0x60410010, 0x00050008, 0x60610008, 0x60640020, 0x60FD0020)


@dataclass(frozen=True, slots=True)
class Slot:
    """Where one object lies: byte offset and length in the image."""

    offset: int
    size: int


@dataclass(frozen=True, slots=True)
class Layout:
    """A mapping, decoded. Keys are index << 8 | subindex."""

    entries: tuple[int, ...]
    slots: Mapping[int, Slot]
    register_count: int

    def value(self, registers: Sequence[int], key: int, order: WordOrder, *, signed: bool = False) -> int:
        """Take one object out of the registers of the image."""
        slot = self.slots[key]
        if slot.size == 1:
            word = registers[slot.offset // 2]
            raw = bytes([word >> 8 if slot.offset % 2 == 0 else word & 0xFF])
        else:
            first = slot.offset // 2
            words = list(registers[first : first + slot.size // 2])
            if order == "little":
                words.reverse()
            raw = b"".join(word.to_bytes(2, "big") for word in words)
        return int.from_bytes(raw, "big", signed=signed)

    def both_orders(self, registers: Sequence[int], key: int, *, signed: bool = False) -> tuple[int, int]:
        """Take one object out of the registers as it reads with the high, and with the low word first."""
        return self.value(registers, key, "big", signed=signed), self.value(registers, key, "little", signed=signed)


def parse(entries: Sequence[int]) -> Layout:
    """Lay out a mapping; each entry is index << 16 | subindex << 8 | bits."""
    slots: dict[int, Slot] = {}
    offset = 0
    for entry in entries:
        size = (entry & 0xFF) // 8
        if entry >> 16 >= _FIRST_REAL_INDEX:
            slots[entry >> 8] = Slot(offset, size)
        offset += size
    return Layout(tuple(entries), slots, (offset + 1) // 2)


def tx_serves(layout: Layout) -> bool:
    """Tell whether a Tx mapping has all we poll, each long value on whole registers, in an even count."""
    return _has_all(layout, TX_WANTED) and layout.register_count % 2 == 0


def order_shown(big: int, little: int, exact: int) -> WordOrder | None:
    """Tell which of two readings of one value is meant, by what the value is a moment later; None: it is not clear."""
    near, far = sorted((abs(big - exact), abs(little - exact)))
    if 8 * near >= far:
        return None
    return "big" if abs(big - exact) == near else "little"


def _has_all(layout: Layout, wanted: Sequence[int]) -> bool:
    for entry in wanted:
        if entry >> 16 < _FIRST_REAL_INDEX:
            continue
        slot = layout.slots.get(entry >> 8)
        if slot is None or slot.size * 8 != entry & 0xFF or (slot.size > 1 and slot.offset % 2):
            return False
    return True
