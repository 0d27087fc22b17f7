"""What a serial line does to a careless master, each over real bytes on a pty."""

import asyncio
import random
import time
from collections.abc import Awaitable, Callable, Sequence

import pytest

from drivers.bus import ModbusBus, OdEntry
from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, LinkError, LinkTimeout, ReplyError
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.peers.line import Answer, PtyLine, Step, framed, one_byte_at_a_time

READ_200 = framed(bytes.fromhex("01 03 02 00 c8"))
READ_100 = framed(bytes.fromhex("01 03 02 00 64"))


def value_of_address(request: bytes) -> list[Step]:
    """A slave whose registers hold their own address."""
    first, count = int.from_bytes(request[2:4], "big"), int.from_bytes(request[4:6], "big")
    data = b"".join((first + n).to_bytes(2, "big") for n in range(count))
    return [framed(request[:2] + bytes([len(data)]) + data)]


class Script:
    """Answers the first requests from a list, the rest as a sound slave."""

    def __init__(self, *first: Sequence[Step]) -> None:
        self.first = list(first)

    def __call__(self, request: bytes) -> Sequence[Step]:
        return self.first.pop(0) if self.first else value_of_address(request)


async def test_a_late_reply_is_never_the_answer_to_the_next_request(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should drop the reply to 100 that comes while 200 would be asked for."""
    bus = await open_bus(make_line(Script([0.6, READ_100])), timeout_s=0.4, late_reply_s=1.0, attempts=1)
    with pytest.raises(LinkTimeout, match="no answer"):
        await bus.read_registers(1, 100, 1, soon)
    assert await bus.read_registers(1, 200, 1, soon) == (200,)


async def test_a_cancelled_request_leaves_nothing_on_the_line(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should finish the request of a cancelled caller before the next one goes out."""
    line = make_line(Script([0.05, READ_100]))
    bus = await open_bus(line, timeout_s=1.0)
    task = asyncio.create_task(bus.read_registers(1, 100, 1, soon))
    await line.request_seen.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert await bus.read_registers(1, 200, 1, soon) == (200,)
    assert len(line.requests) == 2


async def test_a_caller_cancelled_while_waiting_for_the_line_sends_nothing(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should never send a request whose caller has gone before its turn."""
    line = make_line(Script([0.05, READ_100]))
    bus = await open_bus(line, timeout_s=1.0)
    first = asyncio.create_task(bus.read_registers(1, 100, 1, soon))
    await line.request_seen.wait()
    second = asyncio.create_task(bus.write_registers(1, 5, [1], soon))
    await asyncio.sleep(0)
    second.cancel()
    assert await first == (100,)
    with pytest.raises(asyncio.CancelledError):
        await second
    assert await bus.read_registers(1, 7, 1, soon) == (7,)
    assert [request[1] for request in line.requests] == [3, 3]


@pytest.mark.parametrize(
    ("reply", "what"),
    [
        (framed(bytes.fromhex("01 06 00 64 00 01")), "has FC 6"),
        (framed(bytes.fromhex("01 04 02 00 64")), "has FC 4"),
        (READ_100, "4 registers asked, 1 came"),
        (framed(bytes.fromhex("01 03 03 00 64 00")), "4 registers asked"),
        (framed(bytes.fromhex("01 83 02"))[:-1] + b"\0", "no sound frame"),
        (framed(bytes.fromhex("01 90 02")), "has FC 144"),
    ],
    ids=["function 6", "function 4", "short", "odd", "crc", "foreign exception"],
)
async def test_a_reply_that_does_not_fit_is_a_reply_error(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, reply: bytes, what: str
) -> None:
    """It should not believe a frame only because its CRC is right, and it should read well afterwards."""
    bus = await open_bus(make_line(Script([reply])), timeout_s=0.4, attempts=1)
    with pytest.raises(ReplyError, match=what):
        await bus.read_registers(1, 100, 4, soon)
    assert await bus.read_registers(1, 200, 2, soon) == (200, 201)


async def test_a_frame_of_another_slave_is_not_taken(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should skip it and take the right one behind it."""
    foreign = framed(bytes.fromhex("02 03 02 00 63"))
    bus = await open_bus(make_line(Script([foreign + READ_100], [foreign])), timeout_s=0.4, attempts=1)
    assert await bus.read_registers(1, 100, 1, soon) == (100,)
    with pytest.raises(ReplyError, match="no sound frame"):
        await bus.read_registers(1, 100, 1, soon)


@pytest.mark.parametrize("garbage", ["00 ff 13", "01", "01 03", "01 83", "01 03 02 11 22 33 44"])
async def test_noise_before_and_after_the_frame_is_ignored(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, garbage: str
) -> None:
    """It should find the frame without losing a try."""
    noise = bytes.fromhex(garbage)
    line = make_line(Script([noise + READ_100 + noise]))
    bus = await open_bus(line)
    assert await bus.read_registers(1, 100, 1, soon) == (100,)
    assert len(line.requests) == 1


@pytest.mark.parametrize("manner", ["whole", "bytes", "cut", "corrupt", "lossy"])
async def test_the_same_reads_come_right_over_every_line(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, manner: str
) -> None:
    """It should read the same values over a whole, split, cut, corrupt or lossy line, by trying again."""
    rng = random.Random(5)

    def spoil(request: bytes) -> Sequence[Step]:
        steps = value_of_address(request)
        frame = steps[0]
        assert isinstance(frame, bytes)
        if manner == "bytes":
            return one_byte_at_a_time(steps)
        if manner == "whole" or rng.random() > 0.4:
            return steps
        if manner == "cut":
            return [frame[: rng.randrange(1, len(frame))]]
        if manner == "corrupt":
            at = rng.randrange(len(frame))
            return [frame[:at] + bytes([frame[at] ^ 1 << rng.randrange(8)]) + frame[at + 1 :]]
        return []

    wait_s = 1.0 if manner in ("whole", "bytes") else 0.2
    bus = await open_bus(make_line(spoil), timeout_s=wait_s, late_reply_s=wait_s, attempts=8)
    for address in range(10):
        assert await bus.read_registers(1, address, 2, soon) == (address, address + 1)
    if manner in ("whole", "bytes"):
        assert bus.statistics.retries == 0
    else:
        assert bus.statistics.retries > 0


async def test_a_silent_slave_takes_its_tries_and_no_more(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should ask `attempts` times, each with its own time-out, and name slave and port."""
    line = make_line(lambda _: [])
    bus = await open_bus(line, timeout_s=0.03, late_reply_s=0.03, attempts=3)
    bus.label(7, "theta")
    with pytest.raises(LinkTimeout, match=r"theta \(slave 7 on .*no answer within .* \(FC 3\)") as caught:
        await bus.read_registers(7, 0, 1, soon)
    assert isinstance(caught.value, TimeoutError)
    assert "power" in caught.value.advice
    assert len(line.requests) == 3
    assert bus.statistics.timeouts == 3


async def test_a_write_that_must_not_be_repeated_goes_out_once(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should leave the decision to the caller."""
    line = make_line(lambda _: [])
    bus = await open_bus(line, timeout_s=0.03, late_reply_s=0.03)
    with pytest.raises(LinkTimeout):
        await bus.write_registers(1, 5, [1], soon, idempotent=False)
    assert len(line.requests) == 1


async def test_an_exception_reply_is_a_refusal_and_not_tried_again(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should give the code at once."""
    line = make_line(lambda request: [framed(bytes([request[0], request[1] | 0x80, 2]))])
    bus = await open_bus(line)
    with pytest.raises(DeviceRefused, match="illegal address") as caught:
        await bus.read_registers(1, 9999, 1, soon)
    assert caught.value.code == 2
    assert len(line.requests) == 1
    assert bus.statistics.refused == 1


ENTRY = OdEntry(0x6041, 0, 2)


@pytest.mark.parametrize("raw", ["06 02 00 00", "00 00 02 06"])
async def test_an_abort_is_a_refusal_with_its_code(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, raw: str
) -> None:
    """It should not become a time-out, in whichever order the drive sends it."""
    body = bytes.fromhex("01 ab ff 00 06 0d ce") + bytes.fromhex(raw)
    bus = await open_bus(make_line(lambda _: [framed(body)]))
    with pytest.raises(DeviceRefused, match="object does not exist") as caught:
        await bus.od_read(1, ENTRY, soon)
    assert caught.value.code == 0x06020000


@pytest.mark.parametrize(("body", "code"), [("01 ab 01", 1), ("01 ab ff 00 03 0d 01 00", 0xFF), ("01 ab 63", 0x63)])
async def test_other_refusals_of_an_object_access(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, body: str, code: int
) -> None:
    """It should know the plain exception and an extended one without abort code."""
    bus = await open_bus(make_line(one_by_one([framed(bytes.fromhex(body))])))
    with pytest.raises(DeviceRefused) as caught:
        await bus.od_read(1, ENTRY, soon)
    assert caught.value.code == code


def one_by_one(steps: Sequence[Step]) -> Answer:
    return lambda _: one_byte_at_a_time(steps)


@pytest.mark.parametrize("reply", ["01 2b 0e 01", "01 2b 0d 00 00 01 60 64 00 00 00 00 02 11 22"])
async def test_an_object_reply_about_something_else_is_refused(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, reply: str
) -> None:
    """It should not take device identification (MEI 14) or another object for the answer."""
    bus = await open_bus(make_line(lambda _: [framed(bytes.fromhex(reply))]), timeout_s=0.4, attempts=1)
    with pytest.raises(ReplyError):
        await bus.od_read(1, ENTRY, soon)


@pytest.mark.parametrize("tail", ["00 00", "00 02", "00 02 34 12"])
async def test_every_write_reply_is_understood_even_byte_by_byte(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, tail: str
) -> None:
    """It should accept NUM = 0, NUM echoed without data and NUM echoed with data."""
    reply = framed(bytes.fromhex("01 2b 0d 01 00 01 60 41 00 00 00") + bytes.fromhex(tail))
    bus = await open_bus(make_line(lambda _: one_byte_at_a_time([reply])))
    await bus.od_write(1, ENTRY, 0x1234, soon)


async def test_a_write_reply_for_another_object_is_refused(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should not believe that its own write was done."""
    reply = framed(bytes.fromhex("01 2b 0d 01 00 01 60 40 00 00 00 00 00"))
    bus = await open_bus(make_line(lambda _: [reply]), timeout_s=0.4, attempts=1)
    with pytest.raises(ReplyError, match="another object"):
        await bus.od_write(1, ENTRY, 1, soon)


@pytest.mark.parametrize(
    ("echo", "ask"),
    [
        ("01 10 00 05 00 02", "registers"),
        ("01 10 00 06 00 01", "registers"),
        ("01 0f 00 00 00 01", "coils"),
        ("01 0f 00 01 00 02", "coils"),
        ("01 01 02 00 00", "read coils"),
    ],
)
async def test_a_wrong_echo_is_a_reply_error(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, echo: str, ask: str
) -> None:
    """It should compare address and count of what the slave confirms."""
    bus = await open_bus(make_line(lambda _: [framed(bytes.fromhex(echo))]), timeout_s=0.4, attempts=1)
    asked: dict[str, Callable[[], Awaitable[object]]] = {
        "registers": lambda: bus.write_registers(1, 5, [1], soon),
        "coils": lambda: bus.write_coils(1, 0, [True, False], soon),
        "read coils": lambda: bus.read_coils(1, 0, 8, soon),
    }
    with pytest.raises(ReplyError):
        await asked[ask]()


async def test_the_deadline_ends_the_wait_and_leaves_a_clean_line(make_line: MakeLine, open_bus: OpenBus) -> None:
    """It should raise at the deadline though the reply may take longer, and read well afterwards."""
    reply_s = 0.6
    bus = await open_bus(make_line(Script([reply_s, READ_100])), timeout_s=1.0, late_reply_s=1.0)
    began_s = time.monotonic()
    with pytest.raises(LinkTimeout, match="deadline passed"):
        await bus.read_registers(1, 100, 1, Deadline.after(0.03))
    assert time.monotonic() - began_s < reply_s
    assert await bus.read_registers(1, 200, 1, Deadline.after(5)) == (200,)


async def test_an_expired_deadline_sends_nothing(make_line: MakeLine, open_bus: OpenBus) -> None:
    """It should not start what can no longer be waited for."""
    line = make_line(value_of_address)
    bus = await open_bus(line)
    with pytest.raises(LinkTimeout):
        await bus.read_registers(1, 100, 1, Deadline.after(-1))
    await bus.read_registers(1, 1, 1, Deadline.after(5))
    assert len(line.requests) == 1


async def test_requests_keep_the_gap_after_a_reply(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should stay silent for 3 ms after every reply when several slaves share the line."""
    times: list[tuple[str, float]] = []

    def tap(direction: str, _data: bytes) -> None:
        times.append((direction, time.monotonic()))

    bus = await open_bus(make_line(value_of_address), gap_s=0.003, tap=tap)
    await asyncio.gather(*(bus.read_registers(1, n, 1, soon) for n in range(8)))
    sent = [t for direction, t in times if direction == "sent"]
    got = [t for direction, t in times if direction == "received"]
    assert len(sent) == 8
    assert all(nxt - last >= 0.003 for last, nxt in zip(got, sent[1:], strict=False))


async def test_many_callers_each_get_their_own_answer(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should keep requests of concurrent tasks apart."""
    bus = await open_bus(make_line(value_of_address))
    got = await asyncio.gather(*(bus.read_registers(1, n, 1, soon) for n in range(50)))
    assert got == [(n,) for n in range(50)]


async def test_the_tap_sees_every_byte_once(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should record what went over the wire, split bytes and noise included."""
    seen: list[tuple[str, bytes]] = []
    line = make_line(lambda _: one_byte_at_a_time([b"\xff" + READ_100]))
    bus = await open_bus(line, tap=lambda way, data: seen.append((way, data)))
    await bus.read_registers(1, 100, 1, soon)
    await bus.read_registers(1, 100, 1, soon)
    assert b"".join(data for way, data in seen if way == "sent") == b"".join(line.requests)
    assert b"".join(data for way, data in seen if way == "received") == 2 * (b"\xff" + READ_100)


@pytest.mark.parametrize("address", [0, 248, 300])
async def test_addresses_that_are_no_slave_are_refused(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline, address: int
) -> None:
    """It should not broadcast, nor wait for a slave that cannot be."""
    bus = await open_bus(make_line(value_of_address))
    with pytest.raises(ValueError, match="slave address"):
        await bus.read_registers(address, 0, 1, soon)


async def test_a_closed_bus_says_so(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should refuse, and closing twice is harmless."""
    bus: ModbusBus = await open_bus(make_line(value_of_address))
    await bus.close()
    with pytest.raises(LinkError, match="closed"):
        await bus.read_registers(1, 0, 1, soon)


async def test_closing_waits_for_the_request_on_the_wire(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should let it finish."""
    line: PtyLine = make_line(Script([0.05, READ_100]))
    bus: ModbusBus = await open_bus(line, timeout_s=1.0)
    task = asyncio.create_task(bus.read_registers(1, 100, 1, soon))
    await line.request_seen.wait()
    await bus.close()
    assert await task == (100,)
