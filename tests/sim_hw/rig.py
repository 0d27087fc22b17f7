"""A drive on the bench: its own tiny master for function code 43 and registers, and a hand on the clock."""

from __future__ import annotations

import struct

from sim_hw.bus.modbus import answer, crc16, seal
from sim_hw.drive.l4118 import L4118
from sim_hw.plant.axis import SPECS
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.plant import Placement, Plant

BY_NAME = {spec.name: spec for spec in SPECS}


class Refused(Exception):
    """The drive answered with an abort (its code) or an exception (1..4)."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}")
        self.code = code


def make_plant(seed: int = 1, **knobs: object) -> Plant:
    values = Knobs()
    for name, value in knobs.items():
        values = values.with_value(name, value)
    return Plant(values, Placement(0.0, 0.0, 80.0, 50.0), Faults(), seed)


class Rig:
    """One axis of a plant with its drive; `t_s` is the present."""

    def __init__(self, axis: str = "x", seed: int = 1, **knobs: object) -> None:
        self.plant = make_plant(seed, **knobs)
        self.faults = self.plant.faults
        self.spec = BY_NAME[axis]
        self.drive = L4118(self.spec, self.plant)
        self.t_s = 1.0

    def exchange(self, pdu: bytes) -> bytes | None:
        """Send one frame and return the reply's PDU."""
        reply = answer(self.drive, seal(bytes([self.spec.address]) + pdu), self.t_s)
        if reply is None:
            return None
        assert crc16(reply) == 0
        assert reply[0] == self.spec.address
        return reply[1:-2]

    def ask(self, pdu: bytes) -> bytes:
        reply = self.exchange(pdu)
        assert reply is not None
        if reply[0] == 0xAB and reply[1] == 0xFF:
            raise Refused(int.from_bytes(reply[6:10], "little"))
        if reply[0] & 0x80:
            raise Refused(reply[1])
        return reply

    def read(self, index: int, sub: int = 0, kind: str = "i") -> int:
        size = struct.calcsize("<" + kind)
        reply = self.ask(struct.pack(">BBBBBHBHH", 0x2B, 0x0D, 0, 0, 1, index, sub, 0, size))
        return int(struct.unpack("<" + kind, reply[12:])[0])

    def write(self, index: int, value: int, sub: int = 0, kind: str = "I") -> None:
        data = struct.pack("<" + kind, value)
        self.ask(struct.pack(">BBBBBHBHH", 0x2B, 0x0D, 1, 0, 1, index, sub, 0, len(data)) + data)

    def registers(self, start: int, count: int) -> list[int]:
        reply = self.ask(struct.pack(">BHH", 3, start, count))
        return list(struct.unpack(f">{count}H", reply[2:]))

    def control(self, word: int, after_s: float = 0.003) -> int:
        """Write the controlword and return the statusword some cycles later."""
        self.write(0x6040, word, kind="H")
        self.t_s += after_s
        return self.status()

    def status(self) -> int:
        return self.read(0x6041, kind="H")

    def enable(self, mode: int) -> None:
        self.write(0x6060, mode, kind="b")
        self.t_s += 0.003
        for word in (0x06, 0x07, 0x0F):
            self.control(word)
        assert self.status() & 0x6F == 0x27

    def ramps(self, rpm: int = 600, rpm_s: int = 6000) -> None:
        self.write(0x6081, rpm)
        for index in (0x6083, 0x6084, 0x6085):
            self.write(index, rpm_s)

    def units(self, place: float) -> int:
        """Return a place (um, deg) in increments."""
        return round(place * self.spec.increments_per_unit)

    def order(self, place: float, word: int = 0x1F) -> int:
        """Give a set-point (the edge of bit 4) and return the statusword after it was taken."""
        self.write(0x607A, self.units(place), kind="i")
        self.control(word & ~0x10)
        return self.control(word)

    def run_until(self, mask: int, limit_s: float = 60.0, step_s: float = 0.01) -> int:
        """Advance until a statusword bit is up."""
        end_s = self.t_s + limit_s
        while not self.status() & mask:
            self.t_s += step_s
            assert self.t_s < end_s, f"statusword {self.status():04X}"
        return self.status()

    def home(self, method: int, offset: int = 0) -> int:
        """Home; return the final statusword."""
        self.write(0x6098, method, kind="b")
        self.write(0x607C, offset, kind="i")
        self.write(0x6099, 600, sub=1)
        self.write(0x6099, 30, sub=2)
        self.write(0x609A, 6000)
        self.enable(6)
        self.control(0x1F)
        return self.run_until(0x3000)

    def true_place(self) -> float:
        return self.plant.axes[self.spec.name].position(self.t_s)
