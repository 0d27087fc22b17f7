"""Object dictionary access by Modbus FC 43 / MEI 13 (CiA 309-2): bytes <-> dataclasses, pure.

    request : ID 2B 0D CTRL 00 NODE IDX IDX SUB START START NUM NUM [data if write] CRC CRC
    response: the same header echoed, then data if read

Everything is big-endian except the data. The byte order of the index, NODE and the write flag in CTRL are not
settled by the manuals, so they are settings (`OdAddressing`) which the axis probes at start.
"""

import struct
from dataclasses import dataclass
from typing import Literal

FUNCTION_CODE = 0x2B
# MEI type: CANopen general reference
MEI_TYPE = 0x0D
# Length of the PDU without data: FC + MEI type + 10 header bytes
HEADER_BYTES = 12
# Mark of a CANopen abort in an extended exception
ABORT_MARK = 0xCE
# Exception code "extended exception": two length bytes follow
EXTENDED_EXCEPTION = 0xFF

ABORT_MEANING = {
    0x05030000: "toggle bit not alternated",
    0x05040000: "protocol timed out",
    0x06010000: "unsupported access",
    0x06010001: "object is write-only",
    0x06010002: "object is read-only",
    0x06020000: "object does not exist",
    0x06040041: "object cannot be mapped",
    0x06040042: "mapping exceeds the image",
    0x06070010: "length does not match",
    0x06090011: "subindex does not exist",
    0x06090030: "value out of range",
    0x06090031: "value too high",
    0x06090032: "value too low",
    0x08000000: "general error",
    0x08000020: "cannot be stored",
    0x08000021: "cannot be stored: local control",
    0x08000022: "cannot be stored in the present state",
    0x08000024: "no data available",
}


@dataclass(frozen=True, slots=True)
class OdEntry:
    """One object: where it is, how long it is (bytes), whether its value has a sign."""

    index: int
    subindex: int = 0
    size_bytes: int = 4
    signed: bool = False

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.subindex:02X}h"

    @property
    def place(self) -> str:
        """Give index and subindex as errors name them in their field `object`, such as 6041h:00."""
        return f"{self.index:04X}h:{self.subindex:02X}"


@dataclass(frozen=True, slots=True)
class OdAddressing:
    """The points of the telegram that the manuals leave open."""

    index_order: Literal["big", "little"] = "big"
    node: int = 1
    write_flag: int = 0x01
    """Bit of CTRL that makes the access a write."""


# What a drive most probably wants
USUAL = OdAddressing()


@dataclass(frozen=True, slots=True)
class OdTelegram:
    """A request or a reply without slave address, function code and CRC."""

    control: int
    node: int
    index_bytes: bytes
    subindex: int
    start: int
    count: int
    data: bytes = b""

    def encode(self) -> bytes:
        """Give the bytes after the function code."""
        head = struct.pack(">BBBB", MEI_TYPE, self.control, 0, self.node)
        return head + self.index_bytes + struct.pack(">BHH", self.subindex, self.start, self.count) + self.data

    @classmethod
    def decode(cls, body: bytes) -> "OdTelegram":
        """Read the bytes after the function code; raise ValueError for anything that is no such telegram."""
        if len(body) < HEADER_BYTES - 1 or body[0] != MEI_TYPE:
            raise ValueError(f"no object dictionary telegram: {body.hex(' ')}")
        _, control, _, node = body[:4]
        subindex, start, count = struct.unpack(">BHH", body[6:11])
        return cls(control, node, body[4:6], subindex, start, count, body[11:])


def read_request(entry: OdEntry, addressing: OdAddressing) -> OdTelegram:
    """Build the telegram that asks for `entry`."""
    index = entry.index.to_bytes(2, addressing.index_order)
    return OdTelegram(0x00, addressing.node, index, entry.subindex, 0, entry.size_bytes)


def write_request(entry: OdEntry, value: int, addressing: OdAddressing) -> OdTelegram:
    """Build the telegram that sets `entry`; raise OverflowError when the value does not fit."""
    index = entry.index.to_bytes(2, addressing.index_order)
    data = value.to_bytes(entry.size_bytes, "little", signed=entry.signed)
    return OdTelegram(addressing.write_flag, addressing.node, index, entry.subindex, 0, entry.size_bytes, data)


def read_value(request: OdTelegram, reply: OdTelegram, *, signed: bool) -> int:
    """Take the value out of a read reply; raise ValueError when it answers another question."""
    _same_header(request, reply)
    if reply.count != request.count or len(reply.data) != request.count:
        raise ValueError(f"{request.count} bytes asked, {reply.count} announced, {len(reply.data)} came")
    return int.from_bytes(reply.data, "little", signed=signed)


def check_write_reply(request: OdTelegram, reply: OdTelegram) -> None:
    """Accept both possible write replies (NUM = 0, or NUM echoed); raise ValueError for any other."""
    _same_header(request, reply)
    if reply.count not in (0, request.count):
        raise ValueError(f"{request.count} bytes written, reply says {reply.count}")
    if reply.data not in (b"", request.data):
        raise ValueError(f"reply to a write carries foreign data {reply.data.hex(' ')}")


def _same_header(request: OdTelegram, reply: OdTelegram) -> None:
    asked = (request.control, request.node, request.index_bytes, request.subindex, request.start)
    got = (reply.control, reply.node, reply.index_bytes, reply.subindex, reply.start)
    if asked != got:
        raise ValueError(f"reply is for another object: asked {asked}, got {got}")


def abort_code(body: bytes) -> int | None:
    """Find the CANopen abort code in an extended exception, or None when it carries none.

    `body` starts after AB FF: two length bytes, MEI type, CEh, four code bytes. Their order is not settled;
    an abort code starts with 05, 06 or 08, which decides it.
    """
    if len(body) < 8 or body[2] != MEI_TYPE or body[3] != ABORT_MARK:
        return None
    raw = body[4:8]
    order: Literal["big", "little"] = "big" if raw[0] in (5, 6, 8) or raw[3] not in (5, 6, 8) else "little"
    return int.from_bytes(raw, order)
