"""Function code 43, MEI type 13: single objects of the dictionary (CiA 309-2; drive manual, "Encapsulated Interface").

request   2B 0D CTRL 00 NODE INDEX(2) SUB START(2) NUM(2) [data when writing]
reply     the same twelve bytes, then the data when reading
refusal   AB FF 00 06 0D CE abort(4)
Lengths are big-endian, data little-endian; what the manual leaves open is a knob.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from sim_hw.bus.modbus import ENCAPSULATED, ILLEGAL_FUNCTION, ILLEGAL_VALUE, MEI_CANOPEN, ModbusError
from sim_hw.drive.objects import ABORT_LENGTH, ABORT_TOO_LONG, ABORT_TOO_SHORT, ENTRIES, Key, ObjectAbort
from sim_hw.plant.knobs import Knobs

_HEAD = 12
_EXTENDED = 0xFF
_CANOPEN_ERROR, _CONTROL_ERROR = 0xCE, 0xCF
_ABORT_NO_NODE = 0x05040000
"""Abort code "SDO protocol timed out": no such node behind this gateway."""


class Objects(Protocol):
    """What is served."""

    def read_object(self, key: Key) -> bytes:
        """Return an object's bytes or raise ObjectAbort."""

    def write_object(self, key: Key, data: bytes) -> None:
        """Store an object's bytes or raise ObjectAbort."""


@dataclass(frozen=True)
class _Request:
    control: int
    node: int
    key: Key
    start: int
    count: int
    data: bytes


def respond(pdu: bytes, address: int, objects: Objects, knobs: Knobs) -> bytes:
    """Serve one request to the slave at `address`; refusals are extended exception replies.

    Raises:
        ModbusError: another MEI type, or a request cut short.

    """
    if len(pdu) < 2 or pdu[1] != MEI_CANOPEN:
        raise ModbusError(ILLEGAL_FUNCTION)
    if len(pdu) < _HEAD:
        raise ModbusError(ILLEGAL_VALUE)
    request = _parsed(pdu, knobs.fc43_index_order)
    if request.control not in (0x00, knobs.fc43_write_flag):
        return _refusal(_CONTROL_ERROR, bytes([knobs.fc43_write_flag]))
    try:
        if not _node_fits(request.node, address, knobs):
            raise ObjectAbort(_ABORT_NO_NODE)
        if request.control == knobs.fc43_write_flag:
            return _write(pdu, request, objects, knobs)
        return _read(pdu, request, objects)
    except ObjectAbort as abort:
        return _refusal(_CANOPEN_ERROR, abort.code.to_bytes(4, knobs.fc43_abort_order))


def _parsed(pdu: bytes, index_order: Literal["big", "little"]) -> _Request:
    return _Request(
        control=pdu[2],
        node=pdu[4],
        key=(int.from_bytes(pdu[5:7], index_order), pdu[7]),
        start=int.from_bytes(pdu[8:10], "big"),
        count=int.from_bytes(pdu[10:12], "big"),
        data=pdu[_HEAD:],
    )


def _node_fits(node: int, address: int, knobs: Knobs) -> bool:
    return node in (1, address) if knobs.fc43_node < 0 else node == knobs.fc43_node


def _read(pdu: bytes, request: _Request, objects: Objects) -> bytes:
    """Read; a number needs its exact length, a string gives at most what is asked for, and 0 asks for all."""
    if request.data:
        raise ModbusError(ILLEGAL_VALUE)
    value = objects.read_object(request.key)
    if request.key in ENTRIES and (request.start or request.count not in (0, len(value))):
        raise ObjectAbort(ABORT_TOO_LONG if request.count > len(value) else ABORT_TOO_SHORT)
    end = request.start + request.count if request.count else len(value)
    part = value[request.start : end]
    return pdu[:10] + len(part).to_bytes(2, "big") + part


def _write(pdu: bytes, request: _Request, objects: Objects, knobs: Knobs) -> bytes:
    if len(request.data) != request.count:
        raise ModbusError(ILLEGAL_VALUE)
    if request.start:
        raise ObjectAbort(ABORT_LENGTH)
    objects.write_object(request.key, request.data)
    return pdu[:10] + (pdu[10:12] if knobs.fc43_write_num == "echo" else b"\0\0")


def _refusal(kind: int, detail: bytes) -> bytes:
    length = 2 + len(detail)
    return bytes([ENCAPSULATED | 0x80, _EXTENDED]) + length.to_bytes(2, "big") + bytes([MEI_CANOPEN, kind]) + detail
