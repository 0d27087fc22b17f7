"""The connection: opened, refused, lost and back; and the same bus over TCP."""

import asyncio
import gc
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Literal

import pytest

from drivers.bus import BusTiming, ModbusBus, SerialLine, TcpLine
from drivers.deadline import Deadline
from drivers.errors import LinkError, LinkTimeout
from tests.drivers.bus.test_bus_traps import value_of_address
from tests.drivers.conftest import MakeLine, OpenBus, serial_line
from tests.drivers.peers.line import crc


async def test_a_missing_port_is_named(tmp_path: Path) -> None:
    """It should raise a LinkError with the path and what to do."""
    with pytest.raises(LinkError, match="cannot be opened") as caught:
        await ModbusBus.open(SerialLine(str(tmp_path / "ttyUSB7"), parity="N"))
    assert "ttyUSB7" in str(caught.value)
    assert "Plug in" in caught.value.advice


async def test_a_parity_a_pty_cannot_do_is_named(make_line: MakeLine) -> None:
    """It should turn termios.error, which is no OSError, into a LinkError."""
    line = make_line(value_of_address)
    with pytest.raises(LinkError) as caught:
        await ModbusBus.open(SerialLine(str(line.path), baudrate=115200, parity="E"))
    assert "parity" in caught.value.advice


async def test_a_port_that_could_not_be_set_is_not_held(make_line: MakeLine) -> None:
    """It should leave no lock to garbage: who tries one parity after the other comes to the right one."""
    line = make_line(value_of_address)
    gc.disable()
    try:
        for _ in range(2):  # a pseudo terminal refuses a parity the second time
            with suppress(LinkError):
                await (await ModbusBus.open(SerialLine(str(line.path), baudrate=115200, parity="E"))).close()
        bus = await ModbusBus.open(serial_line(line))
    finally:
        gc.enable()
    await bus.close()


async def test_the_port_is_held_alone(make_line: MakeLine, open_bus: OpenBus) -> None:
    """It should refuse a second daemon on the same port."""
    line = make_line(value_of_address)
    await open_bus(line)
    with pytest.raises(LinkError, match="lock") as caught:
        await ModbusBus.open(serial_line(line))
    assert "Another program" in caught.value.advice


async def test_a_port_that_is_not_there_is_named_once(tmp_path: Path) -> None:
    """It should say what the system says, without the numbers and paths that its errors repeat."""
    with pytest.raises(LinkError, match=r"cannot be opened \(No such file or directory\)$") as caught:
        await ModbusBus.open(SerialLine(str(tmp_path / "absent")))
    assert "Plug in" in caught.value.advice


async def test_a_pulled_cable_is_a_link_error_and_comes_back(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should fail at once while the cable is out, and work again when it is in."""
    line = make_line(value_of_address)
    bus = await open_bus(line, timeout_s=0.1, reconnect_max_s=0.05)
    assert await bus.read_registers(1, 1, 1, soon) == (1,)
    line.unplug()
    with pytest.raises(LinkError):
        await bus.read_registers(1, 2, 1, soon)
    with pytest.raises(LinkError) as caught:
        await bus.read_registers(1, 2, 1, soon)
    assert not isinstance(caught.value, LinkTimeout)
    assert not bus.connected
    line.plug()
    while True:
        try:
            assert await bus.read_registers(1, 3, 1, soon) == (3,)
            break
        except LinkError:
            assert not soon.expired
            await asyncio.sleep(0.01)
    assert bus.connected
    assert bus.reconnects == 1


async def test_a_cable_pulled_while_waiting_is_a_link_error(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should not be reported as a silent slave."""
    line = make_line(lambda _: [])
    bus = await open_bus(line, timeout_s=0.1, attempts=1)
    task = asyncio.create_task(bus.read_registers(1, 2, 1, soon))
    await line.request_seen.wait()
    line.unplug()
    with pytest.raises(LinkError, match="connection lost"):
        await task


async def test_a_lost_line_is_not_hammered(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should say when it will try again instead of trying on every call."""
    line = make_line(value_of_address)
    bus = await open_bus(line, timeout_s=0.1)
    line.unplug()
    texts = []
    for _ in range(3):
        with pytest.raises(LinkError) as caught:
            await bus.read_registers(1, 2, 1, soon)
        texts.append(str(caught.value))
    assert any("next try in" in text for text in texts)


def test_impossible_timing_is_refused() -> None:
    """It should not accept a late reply time shorter than the reply time, or no try at all."""
    with pytest.raises(ValueError, match="late_reply_s"):
        BusTiming(timeout_s=0.2, late_reply_s=0.1)
    with pytest.raises(ValueError, match="attempts"):
        BusTiming(attempts=0)


class _Slave(asyncio.Protocol):
    def __init__(self, wrap: Callable[[bytes], bytes]) -> None:
        self.wrap = wrap

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.transport.write(self.wrap(data))


@asynccontextmanager
async def tcp_slave(wrap: Callable[[bytes], bytes]) -> AsyncIterator[int]:
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: _Slave(wrap), "127.0.0.1", 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


def rtu(data: bytes) -> bytes:
    reply = value_of_address(data)[0]
    assert isinstance(reply, bytes)
    return reply


def mbap(data: bytes) -> bytes:
    reply = rtu(data[6:] + b"\0\0")[:-2]
    return data[:4] + len(reply).to_bytes(2, "big") + reply


@pytest.mark.parametrize(("framing", "wrap"), [("rtu", rtu), ("tcp", mbap)])
async def test_the_bus_speaks_rtu_and_modbus_tcp_over_a_socket(
    framing: Literal["rtu", "tcp"], wrap: Callable[[bytes], bytes], soon: Deadline
) -> None:
    """It should read registers over both."""
    async with tcp_slave(wrap) as port:
        bus = await ModbusBus.open(TcpLine("127.0.0.1", port, framing), timeout_s=1.0)
        assert await bus.read_registers(1, 40, 3, soon) == (40, 41, 42)
        await bus.close()


async def test_an_abort_passes_modbus_tcp_too(soon: Deadline) -> None:
    """It should decode AB FF without the RTU framer."""
    body = bytes.fromhex("01 ab ff 00 06 0d ce 06 02 00 00")

    def abort(data: bytes) -> bytes:
        return data[:4] + len(body).to_bytes(2, "big") + body

    from drivers.bus import OdEntry
    from drivers.errors import DeviceRefused

    async with tcp_slave(abort) as port:
        bus = await ModbusBus.open(TcpLine("127.0.0.1", port), timeout_s=1.0)
        with pytest.raises(DeviceRefused, match="06020000h"):
            await bus.od_read(1, OdEntry(0x1234), soon)
        await bus.close()


async def test_a_silent_tcp_slave_is_a_time_out_every_time() -> None:
    """It should stay a time-out: the library would close the connection after three."""
    async with tcp_slave(lambda _: b"") as port:
        bus = await ModbusBus.open(TcpLine("127.0.0.1", port), timeout_s=0.02, attempts=5)
        with pytest.raises(LinkTimeout, match="no answer"):
            await bus.read_registers(1, 1, 1, Deadline.after(5))
        assert bus.connected
        await bus.close()


async def test_nobody_listening_is_a_link_error() -> None:
    """It should name host and port."""
    async with tcp_slave(rtu) as port:
        pass
    with pytest.raises(LinkError, match=f"127.0.0.1:{port}"):
        await ModbusBus.open(TcpLine("127.0.0.1", port))


def test_the_peers_crc_is_the_textbooks() -> None:
    """It should give the frame of the relay board's manual."""
    assert crc(bytes.fromhex("01 01 00 00 00 08")) == bytes.fromhex("3d cc")
