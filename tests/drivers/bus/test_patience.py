"""Slaves that are busy, lack a function code or confirm more than was written, and requests nobody waits for."""

import asyncio
import gc
from typing import Any

import pytest

from drivers.bus import ModbusBus, OdEntry, SerialLine
from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, LinkTimeout, ReplyError
from tests.drivers.bus.test_bus_traps import READ_100, Script
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.peers.line import PtyLine, Step, framed


def refusal(request: bytes, code: int) -> list[Step]:
    return [framed(bytes([request[0], request[1] | 0x80, code]))]


def busy(code: int, function: int = 3) -> list[Step]:
    return [framed(bytes([1, function | 0x80, code]))]


# ---------------------------------------------------------------- busy
@pytest.mark.parametrize("code", [5, 6])
async def test_a_busy_slave_is_asked_again(make_line: MakeLine, open_bus: OpenBus, soon: Deadline, code: int) -> None:
    """It should have patience for more answers than it has tries, and count none of them as refused."""
    line = make_line(Script(*[busy(code)] * 5))
    bus = await open_bus(line, attempts=1)
    assert await bus.read_registers(1, 100, 1, soon) == (100,)
    assert len(line.requests) == 6
    assert (bus.statistics.busy, bus.statistics.refused) == (5, 0)


async def test_a_slave_that_stays_busy_is_a_refusal_at_the_deadline(make_line: MakeLine, open_bus: OpenBus) -> None:
    """It should say what it said last, with its code."""
    line = make_line(lambda request: refusal(request, 6))
    bus = await open_bus(line)
    with pytest.raises(DeviceRefused, match="busy") as caught:
        await bus.read_registers(1, 100, 1, Deadline.after(1.0))
    assert caught.value.code == 6
    assert len(line.requests) > 2


async def test_what_is_asked_once_only_is_asked_again_when_it_was_not_taken(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should repeat after "busy" (06), and not after "acknowledge" (05): that one is being worked on."""
    done = framed(bytes.fromhex("01 10 00 05 00 01"))
    line = make_line(Script(busy(6, 16), [done], busy(5, 16)))
    bus = await open_bus(line)
    await bus.write_registers(1, 5, [1], soon, idempotent=False)
    with pytest.raises(DeviceRefused, match="acknowledge"):
        await bus.write_registers(1, 5, [1], soon, idempotent=False)
    assert len(line.requests) == 3


# ---------------------------------------------------------------- function codes
async def test_registers_are_read_by_function_4_where_3_is_missing(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should find that out once."""

    def answer(request: bytes) -> list[Step]:
        return [framed(bytes([1, 4, 2, 0, 100]))] if request[1] == 4 else refusal(request, 1)

    line = make_line(answer)
    bus = await open_bus(line)
    for _ in range(2):
        assert await bus.read_registers(1, 100, 1, soon) == (100,)
    assert [request[1] for request in line.requests] == [3, 4, 4]


async def test_coils_are_written_one_by_one_where_function_15_is_missing(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should put the one out before the other goes on."""
    line = make_line(lambda request: refusal(request, 1) if request[1] == 15 else [request])
    bus = await open_bus(line)
    await bus.write_coils(5, 0, [True, False], soon)
    await bus.write_coils(5, 0, [False, True], soon)
    writes = [(request[1], request[3], request[4]) for request in line.requests]
    assert writes == [(15, 0, 0), (5, 1, 0), (5, 0, 0xFF), (5, 0, 0), (5, 1, 0xFF)]


@pytest.mark.parametrize(
    ("ask", "names"),
    [
        (lambda bus, soon: bus.read_registers(1, 5000, 2, soon), "read registers"),
        (lambda bus, soon: bus.write_coils(1, 0, [True, False], soon), "write several coils"),
        (lambda bus, soon: bus.read_coils(1, 0, 2, soon), "read coils"),
        (lambda bus, soon: bus.od_read(1, OdEntry(0x6041, 0, 2), soon), "object dictionary"),
    ],
)
async def test_a_missing_function_code_is_named(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, ask: Any, names: str
) -> None:
    """It should say which one the device lacks, and what it is for."""
    bus = await open_bus(make_line(lambda request: refusal(request, 1)))
    with pytest.raises(DeviceRefused, match="illegal function") as caught:
        await ask(bus, soon)
    assert names in caught.value.advice


@pytest.mark.parametrize("echo", ["05 0f 00 00 00 08", "05 0f 00 03 00 02"])
async def test_a_board_may_confirm_all_its_coils(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, echo: str
) -> None:
    """It should take the echo of eight for the echo of the two that are among them."""
    bus = await open_bus(make_line(lambda _: [framed(bytes.fromhex(echo))]), attempts=1)
    await bus.write_coils(5, 3, [True, False], soon)


# ---------------------------------------------------------------- echo
@pytest.mark.parametrize("answers", [True, False])
async def test_an_adapter_that_hears_itself_is_named(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, answers: bool
) -> None:
    """It should not take the echo of a request for its reply, nor find the reply behind it and go on."""
    line = make_line(lambda request: [request, READ_100] if answers else [request])
    bus = await open_bus(line, timeout_s=0.1, late_reply_s=0.1, attempts=1)
    with pytest.raises(ReplyError, match="hears itself") as caught:
        await bus.read_registers(1, 100, 1, soon)
    assert "local_echo" in caught.value.advice


async def test_a_reply_that_begins_like_its_request_by_chance_is_no_echo(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should believe the count 5 of 3602h on slave 4, whose request has a CRC that begins with 05."""
    bus = await open_bus(make_line(lambda request: [framed(request[:-2] + b"\5")]))
    assert await bus.od_read(4, OdEntry(0x3602, 0, 1), soon) == 5


async def test_an_echo_that_is_configured_is_taken_off(make_line: MakeLine, soon: Deadline) -> None:
    """It should read what stands behind it."""
    line = make_line(lambda request: [request, READ_100])
    bus = await ModbusBus.open(SerialLine(str(line.path), 115200, "N", 1, local_echo=True), gap_s=0.0, timeout_s=1.0)
    assert await bus.read_registers(1, 100, 1, soon) == (100,)
    await bus.close()


# ---------------------------------------------------------------- nobody waits
async def test_a_request_whose_caller_has_gone_leaves_no_unheard_error(make_line: MakeLine, open_bus: OpenBus) -> None:
    """It should not end in "Task exception was never retrieved", for a deadline or a cancelled caller."""
    heard: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _loop, context: heard.append(context))
    line = make_line(lambda _: [])
    bus = await open_bus(line, timeout_s=0.05, late_reply_s=0.05)
    with pytest.raises(LinkTimeout):
        await bus.read_registers(1, 100, 1, Deadline.after(0.02))
    task = asyncio.create_task(bus.read_registers(1, 100, 1, Deadline.after(5.0)))
    line.request_seen.clear()
    await line.request_seen.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await bus.close()
    gc.collect()
    await asyncio.sleep(0)
    assert heard == []


async def test_the_time_of_a_request_follows_the_speed_of_the_line(make_line: MakeLine, open_bus: OpenBus) -> None:
    """It should be some 80 ms at 4800 baud and less than 20 at 115200."""
    line: PtyLine = make_line(lambda _: [READ_100])
    fast = await open_bus(line, gap_s=0.003)
    assert fast.request_s < 0.02
    await fast.close()
    slow = await ModbusBus.open(SerialLine(str(line.path), 4800, "N", 1), gap_s=0.003)
    assert 0.07 < slow.request_s < 0.12
    await slow.close()
