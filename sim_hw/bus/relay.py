"""Light relay: a Waveshare-type eight-channel Modbus RTU board; coil 0 white ring, coil 1 red ring."""

from __future__ import annotations

import struct

from sim_hw.bus.modbus import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, ModbusError, fields
from sim_hw.plant.plant import Plant

COILS = 8
ALL_COILS = 0x00FF
LAMPS = ("white", "red")

_ON, _OFF, _TOGGLE = 0xFF00, 0x0000, 0x5500
"""Function code 5 values."""

_READ_COILS, _WRITE_COIL, _WRITE_COILS = 1, 5, 15


class Relay:
    """Answer function codes 1, 5 and 15; a stuck contact is not seen in the coils read back."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.coils = [False] * COILS

    def respond(self, pdu: bytes, t_s: float) -> bytes | None:
        """Return the reply to one request."""
        handlers = {_READ_COILS: self._read, _WRITE_COIL: self._write_one, _WRITE_COILS: self._write_many}
        if pdu[0] not in handlers:
            raise ModbusError(ILLEGAL_FUNCTION)
        return handlers[pdu[0]](pdu, t_s)

    def _read(self, pdu: bytes, t_s: float) -> bytes:
        _, start, count = fields(">BHH", pdu)
        _check_range(start, count)
        del t_s
        return struct.pack("BB", _READ_COILS, 1) + _packed(self.coils[start : start + count])

    def _write_one(self, pdu: bytes, t_s: float) -> bytes:
        _, coil, value = fields(">BHH", pdu)
        if value not in (_ON, _OFF, _TOGGLE):
            raise ModbusError(ILLEGAL_VALUE)
        if coil != ALL_COILS and coil >= COILS:
            raise ModbusError(ILLEGAL_ADDRESS)
        places = range(COILS) if coil == ALL_COILS else (coil,)
        for place in places:
            self._set(place, t_s, on=not self.coils[place] if value == _TOGGLE else value == _ON)
        return pdu[:5]

    def _write_many(self, pdu: bytes, t_s: float) -> bytes:
        _, start, count, size = fields(">BHHB", pdu)
        _check_range(start, count)
        if size != 1 or len(pdu) != 7:
            raise ModbusError(ILLEGAL_VALUE)
        for place in range(count):
            self._set(start + place, t_s, on=bool(pdu[6] >> place & 1))
        return pdu[:5]

    def _set(self, coil: int, t_s: float, *, on: bool) -> None:
        if coil >= COILS:
            raise ModbusError(DEVICE_FAILURE)
        self.coils[coil] = on
        if coil < len(LAMPS) and not self._plant.faults.on("relay_stuck"):
            self._plant.switch_lamp(LAMPS[coil], t_s, on=on)


def _check_range(start: int, count: int) -> None:
    if not 1 <= count <= COILS:
        raise ModbusError(ILLEGAL_VALUE)
    if start + count > COILS:
        raise ModbusError(ILLEGAL_ADDRESS)


def _packed(bits: list[bool]) -> bytes:
    return bytes([sum(bit << place for place, bit in enumerate(bits))])
