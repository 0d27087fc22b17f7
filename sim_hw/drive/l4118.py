"""Nanotec drive with its L4118 motor as a Modbus RTU slave: registers, function code 43, memory, restart."""

from __future__ import annotations

import struct
from collections.abc import Callable

from sim_hw.bus.modbus import (
    DEVICE_FAILURE,
    ENCAPSULATED,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ModbusError,
    fields,
)
from sim_hw.drive import fc43
from sim_hw.drive.drive import Drive
from sim_hw.drive.objects import (
    ABORT_NO_DATA,
    ABORT_NOT_STORED,
    ABORT_RANGE,
    ENTRIES,
    Key,
    ObjectAbort,
    ObjectDictionary,
)
from sim_hw.drive.process_image import RX_BASE, RX_MAPPING, TX_BASE, TX_MAPPING, Image
from sim_hw.plant.axis import AxisSpec
from sim_hw.plant.plant import Plant

SAVE, REBOOT = 0x65766173, 0x746F6F62
SAVE_S = 2.0
"""A save takes seconds; 1010h reads 0 meanwhile."""

NANOJ_OUTPUTS, NANOJ_INPUTS = 2000, 3000
"""NanoJ windows: 2500h from register 2000 (read), 2400h from register 3000."""
_NANOJ = {NANOJ_OUTPUTS: 0x2500, NANOJ_INPUTS: 0x2400}
_NANOJ_REGISTERS = 64

_READ, _READ_INPUT, _WRITE_ONE, _WRITE_MANY, _READ_WRITE = 3, 4, 6, 16, 23
_MAX_READ, _MAX_WRITE = 125, 123

_STRINGS: dict[Key, bytes] = {(0x1008, 0): b"C5-E-1-09", (0x1009, 0): b"W007", (0x100A, 0): b"FIR-v2213-B1048834"}

_NOT_SAVED = {0x1003, 0x1010, 0x2400, 0x2500, 0x2800, 0x6040, 0x6060, 0x607A, 0x60FE}
"""What a save keeps: everything writable but orders, run-time inputs and the error stack."""


class L4118:
    """Answer for one axis; `power_cycle` forgets what was not saved."""

    def __init__(self, spec: AxisSpec, plant: Plant, t_s: float = 0.0) -> None:
        self.spec = spec
        self._plant = plant
        knobs = plant.knobs
        self._memory: dict[Key, int] = {
            (0x2028, 0): spec.address,
            (0x3240, 1): knobs.special_function_enable,
            (0x3701, 0): knobs.limit_reaction,
            (0x605A, 0): knobs.quick_stop_option,
            (0x60A8, 0): knobs.position_unit,
            (0x60A9, 0): knobs.speed_unit,
        }
        self._power_up(t_s, boot_s=0.0)

    def power_cycle(self, t_s: float) -> None:
        """Cut and restore the power: homing, mapping and 2400h are forgotten, the axis slips if it moved."""
        self.drive.update(t_s)
        self.drive.motor.cut(t_s)
        self._power_up(t_s, boot_s=self._plant.knobs.drive_boot_s)

    def respond(self, pdu: bytes, t_s: float) -> bytes | None:
        """Return the reply to one request; nothing while the drive starts."""
        if t_s < self._ready_s:
            return None
        handlers: dict[int, Callable[[bytes], bytes]] = {
            _READ: self._serve_read,
            _READ_INPUT: self._serve_read,
            _WRITE_ONE: self._serve_write_one,
            _WRITE_MANY: self._serve_write_many,
            _READ_WRITE: self._serve_read_write,
            ENCAPSULATED: self._serve_object,
        }
        if pdu[0] not in handlers:
            raise ModbusError(ILLEGAL_FUNCTION)
        self.drive.update(t_s)
        return handlers[pdu[0]](pdu)

    # --- single objects, for function code 43

    def read_object(self, key: Key) -> bytes:
        """Return an object's bytes, little-endian, or raise ObjectAbort."""
        return self._objects.read(key)

    def write_object(self, key: Key, data: bytes) -> None:
        """Store an object's bytes, little-endian, or raise ObjectAbort."""
        self._objects.write(key, data)

    def _power_up(self, t_s: float, boot_s: float) -> None:
        self._ready_s = t_s + boot_s
        self._saved_s = t_s
        self._objects = ObjectDictionary(self._memory, _STRINGS)
        self.drive = Drive(self.spec, self._plant, self._objects, t_s)
        self._rx = Image(self._objects, RX_MAPPING, self._plant.knobs.word_order)
        self._tx = Image(self._objects, TX_MAPPING, self._plant.knobs.word_order)
        getters, setters = self._objects.getters, self._objects.setters
        getters[0x1003, 0] = lambda: len(self.drive.errors)
        setters[0x1003, 0] = self._clear_errors
        for sub in range(1, 9):
            getters[0x1003, sub] = self._error_reader(sub)
        for sub in range(1, 0x0E):
            getters[0x1010, sub] = lambda: int(self.drive.now_s >= self._saved_s)
            setters[0x1010, sub] = self._save
        setters[0x2800, 1] = self._reboot

    def _error_reader(self, sub: int) -> Callable[[], int]:
        def read() -> int:
            if sub > len(self.drive.errors):
                raise ObjectAbort(ABORT_NO_DATA)
            return self.drive.errors[sub - 1].entry

        return read

    def _clear_errors(self, count: int) -> None:
        if count:
            raise ObjectAbort(ABORT_RANGE)
        self.drive.errors = []

    def _save(self, key: int) -> None:
        if key != SAVE:
            raise ObjectAbort(ABORT_NOT_STORED)
        writable = (place for place, entry in ENTRIES.items() if entry.access == "rw")
        self._memory = {place: self._objects.values[place] for place in writable if place[0] not in _NOT_SAVED}
        self._saved_s = self.drive.now_s + SAVE_S

    def _reboot(self, key: int) -> None:
        if key != REBOOT:
            raise ObjectAbort(ABORT_RANGE)
        self.power_cycle(self.drive.now_s)

    def _serve_object(self, pdu: bytes) -> bytes:
        return fc43.respond(pdu, self.spec.address, self, self._plant.knobs)

    # --- registers

    def _serve_read(self, pdu: bytes) -> bytes:
        function, start, count = fields(">BHH", pdu)
        if not 1 <= count <= _MAX_READ or len(pdu) != 5:
            raise ModbusError(ILLEGAL_VALUE)
        data = self._registers(start, count)
        return struct.pack("BB", function, len(data)) + data

    def _serve_write_one(self, pdu: bytes) -> bytes:
        _, start, _ = fields(">BHH", pdu)
        # A single 16-bit write may address any register of the image.
        self._store(start, pdu[3:5], aligned=False)
        return pdu[:5]

    def _serve_write_many(self, pdu: bytes) -> bytes:
        _, start, count, size = fields(">BHHB", pdu)
        if not 1 <= count <= _MAX_WRITE or size != 2 * count or len(pdu) != 6 + size:
            raise ModbusError(ILLEGAL_VALUE)
        self._store(start, pdu[6:])
        return pdu[:5]

    def _serve_read_write(self, pdu: bytes) -> bytes:
        _, from_, count, start, written, size = fields(">BHHHHB", pdu)
        if not (1 <= count <= _MAX_READ and 1 <= written <= _MAX_WRITE and size == 2 * written):
            raise ModbusError(ILLEGAL_VALUE)
        if len(pdu) != 10 + size:
            raise ModbusError(ILLEGAL_VALUE)
        self._store(start, pdu[10:])
        self.drive.update(self.drive.now_s)
        data = self._registers(from_, count)
        return struct.pack("BB", _READ_WRITE, len(data)) + data

    def _registers(self, start: int, count: int) -> bytes:
        """Return register contents; access to the image begins on a 4-byte border (drive manual, FC 3 and 4)."""
        for base, index in _NANOJ.items():
            if base <= start and start + count <= base + _NANOJ_REGISTERS:
                whole = b"".join(self._objects.read((index, sub))[::-1] for sub in range(1, 33))
                return whole[2 * (start - base) : 2 * (start - base + count)]
        for base, image in ((TX_BASE, self._tx), (RX_BASE, self._rx)):
            if base <= start and 2 * (start - base + count) <= image.size():
                _check_border(start - base)
                return image.read()[2 * (start - base) : 2 * (start - base + count)]
        raise ModbusError(ILLEGAL_ADDRESS)

    def _store(self, start: int, data: bytes, *, aligned: bool = True) -> None:
        registers = len(data) // 2
        if start >= NANOJ_INPUTS and start + registers <= NANOJ_INPUTS + _NANOJ_REGISTERS:
            self._store_inputs(start - NANOJ_INPUTS, data)
            return
        if start < RX_BASE or 2 * (start - RX_BASE) + len(data) > self._rx.size():
            raise ModbusError(ILLEGAL_ADDRESS)
        if aligned:
            _check_border(start - RX_BASE)
        self._take(self._rx.write(2 * (start - RX_BASE), data))

    def _store_inputs(self, first: int, data: bytes) -> None:
        """Write 2400h through its registers, whole 32-bit values only."""
        _check_border(first)
        if len(data) % 4:
            raise ModbusError(ILLEGAL_VALUE)
        for place in range(0, len(data), 4):
            self._objects.write((0x2400, (first + place // 2) // 2 + 1), data[place : place + 4][::-1])

    def _take(self, written: list[tuple[Key, bytes]]) -> None:
        """Store mapped objects; the controlword counts last, so it finds the values that came with it."""
        try:
            for key, data in sorted(written, key=lambda item: item[0] == (0x6040, 0)):
                self._objects.write(key, data)
        except ObjectAbort as abort:
            raise ModbusError(DEVICE_FAILURE) from abort


def _check_border(registers: int) -> None:
    if registers % 2:
        raise ModbusError(ILLEGAL_ADDRESS)
