"""The line on a real pty: framing, pacing, silence, and everything that can be broken on it."""

import asyncio
import os
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_hw.bus.line import CHARACTER_S, T35_S, Line
from sim_hw.bus.modbus import crc16, seal
from sim_hw.bus.relay import Relay
from sim_hw.drive.l4118 import L4118
from sim_hw.plant.axis import SPECS
from sim_hw.plant.clock import SimClock
from tests.sim_hw.rig import make_plant

POLL_X = seal(bytes.fromhex("0103138800 02".replace(" ", "")))
POLL_Y = seal(bytes.fromhex("020313880002"))
COILS = seal(bytes.fromhex("050100000008"))
SILENT_S = 0.15


class Bus:
    """A line with all its slaves, and a client on its other end."""

    def __init__(self, folder: Path, *, paced: bool, **knobs: object) -> None:
        self.plant = make_plant(**knobs)
        self.faults = self.plant.faults
        slaves = {spec.address: L4118(spec, self.plant) for spec in SPECS}
        self.relay = Relay(self.plant)
        self.drives = slaves
        # Started a second ago: the drives are up.
        clock = SimClock(start_wall_s=time.monotonic() - 1.0)
        slaves_all = {**slaves, 5: self.relay}
        self.line = Line(slaves_all, clock, self.faults, lambda: self.plant.knobs, seed=1, paced=paced)
        self.path = folder / "line"
        self.line.open(self.path)
        self.client = -1
        self.connect()

    def connect(self) -> None:
        self.client = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.arrived: asyncio.Queue[bytes] = asyncio.Queue()
        asyncio.get_running_loop().add_reader(self.client, lambda: self.arrived.put_nowait(os.read(self.client, 4096)))

    def disconnect(self) -> None:
        asyncio.get_running_loop().remove_reader(self.client)
        os.close(self.client)

    def send(self, data: bytes) -> None:
        os.write(self.client, data)

    async def receive(self, within_s: float = 2.0) -> bytes | None:
        """Return the next whole reply, or None if the line stays silent."""
        data = b""
        try:
            async with asyncio.timeout(within_s):
                while len(data) < 5 or crc16(data):
                    data += await self.arrived.get()
        except TimeoutError:
            return data or None
        return data

    async def ask(self, data: bytes, within_s: float = 2.0) -> bytes | None:
        self.send(data)
        return await self.receive(within_s)


@pytest.fixture
async def bus(tmp_path: Path) -> Iterator[Bus]:
    made = Bus(tmp_path, paced=False)
    yield made
    made.disconnect()
    made.line.close()


@pytest.fixture
async def paced(tmp_path: Path) -> Iterator[Bus]:
    made = Bus(tmp_path, paced=True)
    yield made
    made.disconnect()
    made.line.close()


async def test_every_slave_answers_on_the_one_line(bus: Bus) -> None:
    for address in (1, 2, 3, 4):
        reply = await bus.ask(seal(bytes([address]) + bytes.fromhex("0313880002")))
        assert reply is not None
        assert reply[:3] == bytes([address, 3, 4])
    assert await bus.ask(COILS) == seal(bytes.fromhex("05010100"))


async def test_the_line_is_raw_in_both_directions(bus: Bus) -> None:
    awkward = bytes([0x0A, 0x0D, 0x03, 0x11])  # what a cooked terminal would eat or turn
    value = awkward.hex()
    assert await bus.ask(seal(bytes.fromhex("012b0d0100012400010000" + "0004" + value))) is not None
    reply = await bus.ask(seal(bytes.fromhex("012b0d0000012400010000" + "0004")))
    assert reply is not None
    assert reply[13:17] == awkward


async def test_a_request_may_arrive_byte_by_byte(bus: Bus) -> None:
    for byte in POLL_X:
        bus.send(bytes([byte]))
    assert (await bus.receive()) is not None


async def test_nobody_answers_for_an_absent_address_or_a_broken_frame(bus: Bus) -> None:
    assert await bus.ask(seal(bytes.fromhex("090313880002")), SILENT_S) is None
    assert await bus.ask(POLL_X[:-1] + b"\0", SILENT_S) is None
    assert bus.line.statistics.garbled == 1
    assert await bus.ask(POLL_X) is not None, "a bad frame does not poison the next"


async def test_a_broadcast_reaches_all_and_gets_no_answer(bus: Bus) -> None:
    everyone = seal(bytes.fromhex("00" + "2b0d010001608100000000" + "04" + "39300000"))
    assert await bus.ask(everyone, SILENT_S) is None
    for drive in bus.drives.values():
        assert drive.read_object((0x6081, 0)) == bytes.fromhex("39300000")


async def test_the_client_may_close_and_open_again(bus: Bus) -> None:
    for _ in range(3):
        assert await bus.ask(POLL_X) is not None
        bus.disconnect()
        bus.connect()
    tty.setraw(bus.client)
    assert await bus.ask(POLL_X) is not None


async def test_the_symlink_is_removed_only_while_it_is_ours(tmp_path: Path) -> None:
    first, second = Bus(tmp_path, paced=False), Bus(tmp_path, paced=False)
    first.disconnect()
    first.line.close()
    assert second.path.is_symlink(), "the second station has taken the path over"
    second.disconnect()
    second.line.close()
    assert not second.path.is_symlink()


async def test_a_file_in_the_way_is_not_replaced(bus: Bus, tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("data")
    with pytest.raises(FileExistsError, match="choose another path"):
        bus.line.open(tmp_path / "precious")


async def test_a_paced_exchange_takes_its_time_on_the_wire(paced: Bus) -> None:
    start_s = time.monotonic()
    reply = await paced.ask(POLL_X)
    took_s = time.monotonic() - start_s
    assert reply is not None
    wire_s = (len(POLL_X) + len(reply)) * CHARACTER_S + T35_S
    assert took_s >= wire_s + 0.001 - 1e-4, "with at least 1 ms of thinking"


async def test_a_paced_line_loses_a_request_that_comes_too_soon(paced: Bus) -> None:
    assert await paced.ask(POLL_X) is not None
    paced.plant.set_knob("bus_gap_ms", 60_000.0)  # whatever the computer does between the two
    assert await paced.ask(POLL_X, SILENT_S) is None
    assert paced.line.statistics.early == 1
    paced.plant.set_knob("bus_gap_ms", 0.0)
    assert await paced.ask(POLL_X) is not None


async def test_a_paced_line_ends_a_frame_by_silence(paced: Bus) -> None:
    paced.send(POLL_X[:4])
    await asyncio.sleep(0.02)
    paced.send(POLL_X[4:])
    assert await paced.receive(SILENT_S) is None
    assert paced.line.statistics.garbled == 2


async def test_cable_out_is_silence_and_passes(bus: Bus) -> None:
    bus.faults.switch("cable_out", on=True)
    assert await bus.ask(COILS, SILENT_S) is None
    assert await bus.ask(POLL_X, SILENT_S) is None
    bus.faults.switch("cable_out", on=False)
    assert await bus.ask(POLL_X) is not None


async def test_one_absent_slave_leaves_the_others(bus: Bus) -> None:
    bus.faults.switch("absent_slave", on=True, address=1)
    assert await bus.ask(POLL_X, SILENT_S) is None
    assert await bus.ask(POLL_Y) is not None


async def test_exceptions_answer_instead_of_the_slave(bus: Bus) -> None:
    bus.faults.switch("exceptions", on=True, code=4, address=2, count=1)
    assert await bus.ask(POLL_X) is not None
    assert await bus.ask(POLL_Y) == seal(bytes.fromhex("028304"))
    reply = await bus.ask(POLL_Y)
    assert reply is not None
    assert reply[1] == 3, "counted out"


async def test_a_late_reply_comes_as_the_answer_to_the_next_request(bus: Bus) -> None:
    bus.faults.switch("late_replies", on=True, delay_s=0.2, count=1)
    assert await bus.ask(POLL_X, 0.05) is None
    assert await bus.ask(POLL_Y) is not None
    late = await bus.receive()
    assert late is not None
    assert late[0] == 1


async def test_crc_noise_flips_one_bit_of_the_reply(bus: Bus) -> None:
    good = await bus.ask(COILS)
    bus.faults.switch("crc_noise", on=True, count=1)
    bad = await bus.ask(COILS, SILENT_S)
    assert good is not None
    assert bad is not None
    flipped = int.from_bytes(good, "big") ^ int.from_bytes(bad, "big")
    assert flipped.bit_count() == 1
    assert await bus.ask(COILS) == good
