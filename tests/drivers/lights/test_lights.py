"""Both relays: never two rings, dark at both ends, and what the hardware may do to it."""

import asyncio
import os
import select
import threading
import time
import tty
from pathlib import Path

import pytest

from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import DeadlinePassed, LightError
from drivers.lights import Light, ModbusRelayLights, SerialRelayLights, modbus_relay
from drivers.lights.serial_relay import command
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.peers.line import framed


class Relay:
    """An eight channel board at slave 5 that remembers every state it ever showed."""

    def __init__(self) -> None:
        self.coils = 0b11
        self.history: list[int] = []
        self.silent = False
        self.refuses = 0
        self.dead_coils = 0

    def answer(self, request: bytes) -> list:
        if self.silent or request[0] != 5:
            return []
        if self.refuses:
            return [framed(bytes([5, request[1] | 0x80, self.refuses]))]
        first, count = int.from_bytes(request[2:4], "big"), int.from_bytes(request[4:6], "big")
        mask = (1 << count) - 1 << first
        if request[1] == 15:
            self.coils = (self.coils & ~mask | (request[7] << first) & mask) & ~self.dead_coils
            self.history.append(self.coils)
            return [framed(request[:6])]
        assert request[1] == 1
        return [framed(request[:2] + bytes([1, self.coils >> first & (1 << count) - 1]))]


@pytest.fixture
async def board(make_line: MakeLine, open_bus: OpenBus) -> tuple[Relay, ModbusBus]:
    relay = Relay()
    return relay, await open_bus(make_line(relay.answer), timeout_s=0.2, late_reply_s=0.2)


async def test_opening_and_closing_leave_it_dark(board: tuple[Relay, ModbusBus], soon: Deadline) -> None:
    """It should not trust the state it finds."""
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    assert relay.coils == 0
    await lights.set(Light.RED, soon)
    assert relay.coils == 0b10
    await lights.close()
    assert relay.coils == 0
    assert lights.settle_s == 0.05


@pytest.mark.parametrize(("white", "red", "bits"), [(0, 1, (1, 2)), (4, 3, (16, 8))])
async def test_the_rings_never_overlap(
    board: tuple[Relay, ModbusBus], soon: Deadline, white: int, red: int, bits: tuple[int, int]
) -> None:
    """It should go from white to red in one write, on whichever coils they are."""
    relay, bus = board
    relay.coils = 0
    lights = await ModbusRelayLights.open(bus, 5, white, red, deadline=soon)
    for light in (Light.WHITE, Light.RED, Light.WHITE, Light.OFF):
        await lights.set(light, soon)
    assert relay.history == [0, bits[0], bits[1], bits[0], 0]


async def test_a_refusal_is_a_light_error_with_its_exception_code(
    board: tuple[Relay, ModbusBus], soon: Deadline
) -> None:
    """It should keep the board's own number."""
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    relay.refuses = 2
    with pytest.raises(LightError, match="illegal address") as caught:
        await lights.set(Light.WHITE, soon)
    assert caught.value.fields() == {"exception": 2}


async def test_a_coil_that_does_not_follow_is_a_light_error(board: tuple[Relay, ModbusBus], soon: Deadline) -> None:
    """It should believe the read-back, not the echo."""
    relay, bus = board
    relay.dead_coils = 0b01
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    with pytest.raises(LightError, match="read"):
        await lights.set(Light.WHITE, soon)


async def test_coils_that_change_by_themselves_are_a_light_error(
    board: tuple[Relay, ModbusBus], soon: Deadline
) -> None:
    """It should see at rest what another master, or the board itself, has switched."""
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    await lights.check(soon)
    relay.coils = 0b01
    with pytest.raises(LightError, match="was told off, but by now"):
        await lights.check(soon)
    await lights.set(Light.OFF, soon)
    await lights.check(soon)
    relay.silent = True
    with pytest.raises(LightError, match="does not tell its state"):
        await lights.check(soon)


async def test_a_check_without_time_left_says_nothing_about_the_lamps(
    board: tuple[Relay, ModbusBus], soon: Deadline
) -> None:
    """It should leave to the caller what a late answer means: on a busy computer the lamps are not broken."""
    lights = await ModbusRelayLights.open(board[1], 5, deadline=soon)
    with pytest.raises(DeadlinePassed):
        await lights.check(Deadline.after(0.0))


async def test_a_silent_board_is_a_light_error(board: tuple[Relay, ModbusBus], soon: Deadline) -> None:
    """It should say what to check, with the link's own words."""
    relay, bus = board
    relay.silent = True
    with pytest.raises(LightError, match=r"no answer within 200 ms \(FC 15\)"):
        await ModbusRelayLights.open(bus, 5, deadline=soon)


async def test_a_cancelled_close_is_dark_all_the_same(board: tuple[Relay, ModbusBus], soon: Deadline) -> None:
    """It should finish going dark."""
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    await lights.set(Light.WHITE, soon)
    task = asyncio.create_task(lights.close())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert relay.coils == 0


async def test_rings_far_apart_are_refused(board: tuple[Relay, ModbusBus]) -> None:
    """It should want neighbouring coils, for one request must switch both."""
    with pytest.raises(ValueError, match="neighbouring"):
        ModbusRelayLights(board[1], 5, 0, 2)


# ---------------------------------------------------------------- USB relay without replies
def test_commands_have_the_makers_sum() -> None:
    """It should give the bytes of the maker's page."""
    assert command(1, on=True) == bytes.fromhex("a0 01 01 a2")
    assert command(1, on=False) == bytes.fromhex("a0 01 00 a1")
    assert command(2, on=True) == bytes.fromhex("a0 02 01 a3")


async def test_the_serial_relay_switches_off_before_on(soon: Deadline) -> None:
    """It should send off for the other ring first, over a real port, and be dark at both ends."""
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        lights = await SerialRelayLights.open(os.ttyname(slave), deadline=soon)
        await lights.set(Light.WHITE, soon)
        await lights.set(Light.RED, soon)
        await lights.close()
        # What was written arrives at the other end a moment later, and not in one piece.
        sent = b""
        while len(sent) < 8 * len(command(1, on=True)) and select.select([master], [], [], soon.remaining_s)[0]:
            sent += os.read(master, 200)
    finally:
        os.close(master)
        os.close(slave)
    off1, on1, off2, on2 = (command(c, on=on) for c in (1, 2) for on in (False, True))
    assert sent == off1 + off2 + off2 + on1 + off1 + on2 + off1 + off2


class BrokenPort:
    def __init__(self) -> None:
        self.closed = False

    def write(self, _data: bytes, /) -> int:
        raise OSError("gone")

    def flush(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        self.closed = True


async def test_a_lost_serial_relay_is_a_light_error(soon: Deadline) -> None:
    """It should translate the port's error, and still close the port at the end."""
    port = BrokenPort()
    lights = SerialRelayLights(port)
    with pytest.raises(LightError, match="gone"):
        await lights.set(Light.WHITE, soon)
    with pytest.raises(LightError):
        await lights.close()
    assert port.closed
    with pytest.raises(LightError, match="shutdown"):
        await lights.set(Light.OFF, soon)


async def test_a_missing_serial_relay_is_a_light_error(tmp_path: Path, soon: Deadline) -> None:
    """It should name the port."""
    with pytest.raises(LightError, match="nowhere"):
        await SerialRelayLights.open(str(tmp_path / "nowhere"), deadline=soon)


async def test_a_serial_relay_out_of_time_says_so() -> None:
    """It should end at the deadline."""
    release = threading.Event()

    class SlowPort(BrokenPort):
        def write(self, data: bytes, /) -> int:
            release.wait(10)
            return len(data)

    lights = SerialRelayLights(SlowPort())
    with pytest.raises(LightError, match="too long"):
        await lights.set(Light.WHITE, Deadline.after(0.02))
    release.set()
    await lights.close()


def test_one_channel_for_two_rings_is_refused() -> None:
    """It should want two."""
    with pytest.raises(ValueError, match="channel each"):
        SerialRelayLights(BrokenPort(), 1, 1)


async def test_a_light_that_is_on_already_is_only_read_back(
    board: tuple[Relay, ModbusBus], soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should write nothing where the board shows what it was told, and switch it where it shows something else."""
    monkeypatch.setattr(modbus_relay, "FRESH_S", 0.0)
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    await lights.set(Light.WHITE, soon)
    written = len(relay.history)
    await lights.set(Light.WHITE, soon)
    assert len(relay.history) == written
    relay.coils = 0b10
    await lights.set(Light.WHITE, soon)
    assert relay.coils == 0b01


async def test_a_light_tells_when_it_was_switched_and_the_same_while_it_shines(
    board: tuple[Relay, ModbusBus], soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should be when the board had been told, before it was read back, and anew where it had to be switched."""
    relay, bus = board
    read_at: list[float] = []
    read_coils = bus.read_coils
    monkeypatch.setattr(modbus_relay, "FRESH_S", 0.0)

    async def read(address: int, first: int, count: int, deadline: Deadline) -> tuple[bool, ...]:
        read_at.append(time.monotonic())
        return await read_coils(address, first, count, deadline)

    monkeypatch.setattr(bus, "read_coils", read)
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    before_s = time.monotonic()
    switched_s = await lights.set(Light.WHITE, soon)
    assert before_s <= switched_s <= read_at[-1]
    assert await lights.set(Light.WHITE, soon) == switched_s
    relay.coils = 0b10
    assert await lights.set(Light.WHITE, soon) > read_at[-2]


async def test_what_was_confirmed_a_moment_ago_is_not_asked_again_and_darkness_that_is_older_is_told_again(
    board: tuple[Relay, ModbusBus], soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modbus_relay, "FRESH_S", 3_600.0)
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    await lights.set(Light.WHITE, soon)
    asked = bus.statistics.requests
    await lights.set(Light.WHITE, soon)
    assert bus.statistics.requests == asked
    for light in (Light.RED, Light.OFF, Light.OFF):
        await lights.set(light, soon)
    assert bus.statistics.requests == asked + 2 * 2
    monkeypatch.setattr(modbus_relay, "FRESH_S", 0.0)
    await lights.set(Light.OFF, soon)
    assert bus.statistics.requests == asked + 3 * 2
    assert relay.history[-2:] == [0, 0], "it was written, not only read back"


@pytest.mark.parametrize("trouble", ["switched by others", "silent"])
async def test_a_light_that_a_check_found_in_trouble_is_asked_again_however_short_ago_it_was_confirmed(
    board: tuple[Relay, ModbusBus], soon: Deadline, monkeypatch: pytest.MonkeyPatch, trouble: str
) -> None:
    """It should shine once it is wanted again, and until then each check should find the trouble."""
    monkeypatch.setattr(modbus_relay, "FRESH_S", 3_600.0)
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    switched_s = await lights.set(Light.WHITE, soon)
    relay.coils, relay.silent = 0, trouble == "silent"
    for _ in range(2):
        with pytest.raises(LightError):
            await lights.check(soon)
    relay.silent = False
    assert await lights.set(Light.WHITE, soon) > switched_s
    assert relay.coils == 0b01


async def test_a_light_is_asked_again_where_any_other_answer_of_its_board_did_not_come(
    board: tuple[Relay, ModbusBus], soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It should trust no former confirmation once switching has failed: the board may have been reset since."""
    monkeypatch.setattr(modbus_relay, "FRESH_S", 3_600.0)
    relay, bus = board
    lights = await ModbusRelayLights.open(bus, 5, deadline=soon)
    await lights.set(Light.WHITE, soon)
    relay.silent = True
    with pytest.raises(LightError):
        await lights.set(Light.OFF, soon)
    relay.coils, relay.silent = 0, False
    await lights.set(Light.WHITE, soon)
    assert relay.coils == 0b01
