"""The process image: which object lies where in the registers from 5000 (Tx) and 6000 (Rx). Pure.

Data are packed without gaps in the order of the mapping (3602h, 3502h), big-endian (drive manual, "PDO").
The order of the two words of a 32 bit value is not settled there: it is an argument.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

TX_ADDRESS = 5000
RX_ADDRESS = 6000

WordOrder = Literal["big", "little"]

# Objects below this index are dummies that only fill space
_FIRST_REAL_INDEX = 0x1000

# 6041h, dummy u8, 6061h, 6064h, 60FDh: even number of registers, long values on even registers
TX_WANTED = (0x60410010, 0x00050008, 0x60610008, 0x60640020, 0x60FD0020)
# 6040h, dummy u16, 607Ah, 6081h. The mode (6060h) goes by FC 43, so no 8 bit value is ever written here
RX_WANTED = (0x60400010, 0x00060010, 0x607A0020, 0x60810020)


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

    def registers(self, values: Mapping[int, int], order: WordOrder) -> list[int]:
        """Build the registers of the whole image; objects not in `values` become zero."""
        image = bytearray(2 * self.register_count)
        for key, value in values.items():
            slot = self.slots[key]
            raw = (value % (1 << 8 * slot.size)).to_bytes(slot.size, "big")
            if order == "little" and slot.size == 4:
                raw = raw[2:] + raw[:2]
            image[slot.offset : slot.offset + slot.size] = raw
        return [int.from_bytes(image[at : at + 2], "big") for at in range(0, len(image), 2)]


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


def rx_serves(layout: Layout) -> bool:
    """Tell whether an Rx mapping has what we write and nothing else: the image is written as a whole."""
    return _has_all(layout, RX_WANTED) and len(layout.slots) == 3 and layout.register_count % 2 == 0


def _has_all(layout: Layout, wanted: Sequence[int]) -> bool:
    for entry in wanted:
        if entry >> 16 < _FIRST_REAL_INDEX:
            continue
        slot = layout.slots.get(entry >> 8)
        if slot is None or slot.size * 8 != entry & 0xFF or (slot.size > 1 and slot.offset % 2):
            return False
    return True
