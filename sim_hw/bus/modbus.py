"""Modbus RTU as a slave sees it: CRC, how long a request is, exceptions.

Read from the Modbus application protocol (function codes 1, 3..6, 15, 16, 23, 43) and the drive manual.
"""

from __future__ import annotations

import struct
from typing import Protocol

ILLEGAL_FUNCTION = 0x01
ILLEGAL_ADDRESS = 0x02
ILLEGAL_VALUE = 0x03
DEVICE_FAILURE = 0x04

ENCAPSULATED = 0x2B
"""Function code 43 with MEI type 13: CANopen objects over Modbus (CiA 309-2)."""
MEI_CANOPEN = 0x0D

MAX_FRAME = 256


class ModbusError(Exception):
    """The request is answered by an exception reply."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code:02X}h")
        self.code = code


class Slave(Protocol):
    """Answer protocol data units."""

    def respond(self, pdu: bytes, t_s: float) -> bytes | None:
        """Return the reply's PDU, or None to stay silent. Raises ModbusError for an exception reply."""


def _crc_of(byte: int) -> int:
    """Return what one byte adds to the CRC, bit by bit (Modbus over serial line, 6.2.2)."""
    crc = byte
    for _ in range(8):
        crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


_CRC_OF = tuple(_crc_of(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """Return the Modbus CRC (sent low byte first)."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _CRC_OF[(crc ^ byte) & 0xFF]
    return crc


def seal(body: bytes) -> bytes:
    """Append the CRC to address and PDU."""
    return body + struct.pack("<H", crc16(body))


def intact(frame: bytes) -> bool:
    """Tell whether a frame's CRC is right."""
    return 4 <= len(frame) <= MAX_FRAME and crc16(frame) == 0


def request_length(head: bytes) -> int | None:
    """Return how long the request that begins so is, CRC included; None while that cannot be known."""
    if len(head) < 2:
        return None
    function = head[1]
    if function in (1, 2, 3, 4, 5, 6):
        return 8
    if function in (15, 16):
        return 9 + head[6] if len(head) > 6 else None
    if function == 23:
        return 13 + head[10] if len(head) > 10 else None
    if function == ENCAPSULATED and len(head) > 12 and head[2] == MEI_CANOPEN:
        return 15 + (int.from_bytes(head[11:13], "big") if head[3] & 0x01 else 0)
    return None


def answer(slave: Slave, frame: bytes, t_s: float) -> bytes | None:
    """Return a slave's whole reply frame to a whole request frame, or None; exceptions become exception replies."""
    address, pdu = frame[0], frame[1:-2]
    try:
        reply = slave.respond(pdu, t_s)
    except ModbusError as error:
        reply = bytes([pdu[0] | 0x80, error.code])
    return None if reply is None or address == 0 else seal(bytes([address]) + reply)


def fields(layout: str, data: bytes) -> tuple[int, ...]:
    """Unpack the fixed head of a PDU.

    Raises:
        ModbusError: the request is too short.

    """
    size = struct.calcsize(layout)
    if len(data) < size:
        raise ModbusError(ILLEGAL_VALUE)
    return struct.unpack(layout, data[:size])
