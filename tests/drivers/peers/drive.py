"""A CiA 402 drive behind Modbus, as small as the drivers' tests need it.

Time is the number of looks: every status read moves the motor one step. NOT modelled: ramps, units other than
increments, saving, bulk reads.
"""

from dataclasses import dataclass, field
from typing import Literal

from tests.drivers.peers.line import Step, framed

DEFAULT_TX = (0x60410010, 0x00050008, 0x60610008, 0x60640020, 0x60440010, 0x60FD0020)
DEFAULT_RX = (
    0x60400010, 0x00050008, 0x60600008, 0x32020020, 0x607A0020, 0x60810020, 0x60420010, 0x60FE0120,
)  # fmt: skip
VENDOR = 0x26C


@dataclass
class Variant:
    """What the manuals leave open."""

    index_order: Literal["big", "little"] = "big"
    word_order: Literal["big", "little"] = "big"
    node: int | None = None
    write_reply: Literal["zero", "echo"] = "zero"
    abort_order: Literal["big", "little"] = "big"
    speed_unit: int = 0x00B44700
    position_unit: int = 0xFF410000


@dataclass
class DriveModel:
    """One slave; `answer(request)` gives what it sends back."""

    address: int
    variant: Variant = field(default_factory=Variant)
    step: int = 2_000_000
    homing_looks: int = 3

    def __post_init__(self) -> None:
        # What can be broken from outside
        self.silent = False
        self.stuck = False
        self.no_acknowledge = False
        self.homing_fails = False
        self.motor_voltage = True
        self.cause_remains = False
        self.inputs = 0
        self.jam_at: int | None = None
        self.heeds_halt = self.heeds_shutdown = True
        self.switch_inputs = 7
        self.homing_step = 0
        self.log: list[str] = []
        self.power_cycle()

    def power_cycle(self) -> None:
        """Lose everything volatile."""
        self.state = 0x40
        self.control = 0
        self.mode = 0
        self.position = 0
        self.goal = 0
        self.acknowledge = self.target_reached = self.following_error = False
        self.homing_left = 0
        self.referenced = False
        self.errors: list[int] = []
        v = self.variant
        self.od: dict[tuple[int, int], list[int]] = {
            (0x1018, 1): [4, VENDOR],
            (0x603F, 0): [2, 0],
            (0x6060, 0): [1, 0],
            (0x607A, 0): [4, 0],
            (0x607C, 0): [4, 0],
            (0x607D, 1): [4, 0],
            (0x607D, 2): [4, 0],
            (0x6081, 0): [4, 0],
            (0x6083, 0): [4, 0],
            (0x6084, 0): [4, 0],
            (0x6085, 0): [4, 0],
            (0x6098, 0): [1, 0],
            (0x6099, 1): [4, 0],
            (0x6099, 2): [4, 0],
            (0x609A, 0): [4, 0],
            (0x60A8, 0): [4, v.position_unit],
            (0x60A9, 0): [4, v.speed_unit],
            (0x60F4, 0): [4, 0],
            (0x6044, 0): [2, 0],
            (0x6042, 0): [2, 0],
            (0x3202, 0): [4, 0x9],
            (0x3240, 1): [4, self.switch_inputs],
            (0x60FE, 1): [4, 0],
        }
        self.od |= {(0x2400, sub): [4, 0] for sub in range(1, 33)}
        for array, mapping in ((0x3502, DEFAULT_RX), (0x3602, DEFAULT_TX)):
            self.od[array, 0] = [1, len(mapping)]
            for number in range(1, 17):
                self.od[array, number] = [4, mapping[number - 1] if number <= len(mapping) else 0]

    # ------------------------------------------------------------ the machine
    def statusword(self) -> int:
        word = self.state | 0x200 | (0x10 if self.motor_voltage else 0)
        bits = ((self.target_reached, 0x400), (self.acknowledge, 0x1000), (self.following_error, 0x2000))
        return word | sum(bit for on, bit in bits if on)

    def fail(self, code: int, entry: int) -> None:
        self.state, self.errors = 0x08, [entry, *self.errors]
        self.od[0x603F, 0][1] = code

    def write_control(self, word: int) -> None:
        rising = word & ~self.control
        self.control = word
        if self.state == 0x08:
            if rising & 0x80 and not self.cause_remains:
                self.state, self.errors = 0x40, []
                self.od[0x603F, 0][1] = 0
            return
        before = self.state
        self._power(word)
        if before != self.state:
            self.log.append(f"{before:02X}->{self.state:02X}")
        if self.state != 0x27:
            self.goal, self.homing_left = self.position, 0
            return
        if rising & 0x10:
            self._start()
        elif not word & 0x10 and self.mode == 1:
            self.acknowledge = False

    def _power(self, word: int) -> None:
        if not word & 0x02 or not self.motor_voltage:
            self.state = 0x40
        elif not word & 0x04:
            self.state = 0x07 if self.state in (0x27, 0x07) else 0x40
        elif word & 0x0F == 0x06 and self.state in (0x40, 0x21, 0x23, 0x27):
            self.state = 0x21 if self.heeds_shutdown or self.state != 0x27 else 0x27
        elif word & 0x0F == 0x07 and self.state in (0x21, 0x23, 0x27):
            self.state = 0x23
        elif word & 0x0F == 0x0F and self.state in (0x23, 0x27, 0x07):
            self.state = 0x27

    def _start(self) -> None:
        if self.mode == 6:
            self.acknowledge = self.target_reached = self.following_error = False
            self.homing_left = self.homing_looks
            self.log.append("homing")
        elif self.mode == 1 and not self.no_acknowledge:
            self.goal = self.od[0x607A, 0][1]
            self.goal -= (self.goal & 0x80000000) << 1
            self.acknowledge, self.target_reached = True, False
            self.log.append(f"move {self.goal}")

    def look(self) -> None:
        """Let one bit of time pass."""
        if self.state != 0x27:
            return
        if self.control & 0x100 and self.heeds_halt:
            self.target_reached, self.goal = True, self.position
        elif self.homing_left and self.mode == 6:
            self._home_on()
        elif self.mode == 1 and not self.stuck:
            gap = self.goal - self.position
            move = max(-self.step, min(self.step, gap))
            if self.jam_at is None or (self.position - self.jam_at) * (self.position + move - self.jam_at) > 0:
                self.position += move
            self.target_reached = self.position == self.goal

    def _home_on(self) -> None:
        self.homing_left -= 1
        self.position += self.homing_step
        if self.homing_left:
            return
        if self.homing_fails:
            self.following_error = True
        else:
            self.position = self.goal = 0
            self.acknowledge = self.target_reached = self.referenced = True

    # ------------------------------------------------------------ object dictionary and image
    def get(self, index: int, sub: int) -> tuple[int, int]:
        live = {
            (0x6040, 0): (2, self.control),
            (0x6041, 0): (2, self.statusword()),
            (0x6061, 0): (1, self.mode),
            (0x6064, 0): (4, self.position),
            (0x60FD, 0): (4, self.inputs),
            (0x1001, 0): (1, bool(self.errors)),
        }
        if (index, sub) == (0x1003, 1):
            if not self.errors:
                raise Abort(0x08000024)
            return 4, self.errors[0]
        if (index, sub) in live:
            return live[index, sub]
        if (index, sub) not in self.od:
            raise Abort(0x06020000)
        size, value = self.od[index, sub]
        return size, value

    def put(self, index: int, sub: int, value: int) -> None:
        if (index, sub) == (0x6040, 0):
            self.write_control(value)
        elif (index, sub) not in self.od:
            raise Abort(0x06020000)
        else:
            self.od[index, sub][1] = value
            if index == 0x6060:
                self.mode = value

    def _mapping(self, array: int) -> list[tuple[int, int, int]]:
        entries = [self.od[array, number + 1][1] for number in range(min(16, self.od[array, 0][1]))]
        return [(entry >> 16, entry >> 8 & 0xFF, (entry & 0xFF) // 8) for entry in entries]

    def tx_image(self) -> bytes:
        out = b""
        for index, sub, size in self._mapping(0x3602):
            value = self.get(index, sub)[1] if index >= 0x1000 else 0
            out += self._words((value % (1 << 8 * size)).to_bytes(size, "big"))
        return out

    def write_rx_image(self, data: bytes) -> None:
        at, control = 0, None
        for index, sub, size in self._mapping(0x3502):
            part = self._words(data[at : at + size])
            at += size
            if index < 0x1000 or len(part) < size:
                continue
            if index == 0x6040:
                control = int.from_bytes(part, "big")
            else:
                self.put(index, sub, int.from_bytes(part, "big"))
        if control is not None:
            self.write_control(control)

    def _words(self, raw: bytes) -> bytes:
        return raw[2:] + raw[:2] if self.variant.word_order == "little" and len(raw) == 4 else raw

    # ------------------------------------------------------------ the wire
    def answer(self, request: bytes) -> list[Step]:
        if self.silent:
            return []
        pdu = request[1:-2]
        reply = {3: self._read, 16: self._write, 23: self._readwrite, 43: self._object}.get(pdu[0])
        body = reply(pdu) if reply else bytes([pdu[0] | 0x80, 1])
        return [framed(bytes([self.address]) + body)]

    def _read(self, pdu: bytes) -> bytes:
        start, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        self.look()
        image = self.tx_image()[2 * (start - 5000) :][: 2 * count]
        if len(image) < 2 * count:
            return bytes([pdu[0] | 0x80, 2])
        return bytes([3, 2 * count]) + image

    def _write(self, pdu: bytes) -> bytes:
        self.write_rx_image(pdu[6:])
        return pdu[:5]

    def _readwrite(self, pdu: bytes) -> bytes:
        count = int.from_bytes(pdu[3:5], "big")
        self.write_rx_image(pdu[10:])
        return bytes([23, 2 * count]) + self.tx_image()[: 2 * count]

    def _object(self, pdu: bytes) -> bytes:
        control, node = pdu[2], pdu[4]
        index = int.from_bytes(pdu[5:7], self.variant.index_order)
        sub, count = pdu[7], int.from_bytes(pdu[10:12], "big")
        try:
            if self.variant.node is not None and node != self.variant.node:
                raise Abort(0x08000000)
            if index == 0x6041:
                self.look()
            size, value = self.get(index, sub)
            if size != count:
                raise Abort(0x06070010)
            if control & 1:
                self.put(index, sub, int.from_bytes(pdu[12:], "little"))
                return pdu[:12] if self.variant.write_reply == "echo" else pdu[:10] + bytes(2)
            return pdu[:12] + (value % (1 << 8 * size)).to_bytes(size, "little")
        except Abort as exc:
            code = exc.code.to_bytes(4, self.variant.abort_order)
            return bytes([0xAB, 0xFF, 0, 6, 0x0D, 0xCE]) + code


class Abort(Exception):
    """The drive refuses an object access."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:08X}")
        self.code = code


def several(*drives: DriveModel):  # noqa: ANN201 - a closure of the line's answer type
    """Let drives share one line."""
    by_address = {drive.address: drive for drive in drives}

    def answer(request: bytes) -> list[Step]:
        drive = by_address.get(request[0])
        return drive.answer(request) if drive else []

    return answer
