"""The simulated meter's wires, by raw bytes: a TCP port on loopback and a pseudo terminal."""

import asyncio
import os
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from sim_hw.electric.meter_wires import LONGEST, MeterWires
from sim_hw.plant.faults import Faults


@pytest.fixture
def faults() -> Faults:
    return Faults()


@pytest.fixture
async def wires(faults: Faults) -> AsyncIterator[MeterWires]:
    async def answer(message: str) -> str | None:
        return message.removesuffix("?").upper() if message.endswith("?") else None

    made = MeterWires(answer, faults, seed=1)
    await made.open()
    serving = asyncio.create_task(made.serve())
    yield made
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
    await made.close()


class Client:
    """One side of either wire."""

    def __init__(self, wires: MeterWires, kind: str) -> None:
        self._socket: socket.socket | None = None
        if kind == "tcp":
            host, _, port = wires.address.rpartition(":")
            self._socket = socket.create_connection((host, int(port)))
            self._fd = self._socket.fileno()
        else:
            self._fd = os.open(wires.pty, os.O_RDWR | os.O_NOCTTY)

    def send(self, data: bytes) -> None:
        os.write(self._fd, data)

    async def line(self) -> bytes:
        got = b""
        while not got.endswith(b"\n"):
            got += await asyncio.wait_for(asyncio.to_thread(os.read, self._fd, 1), 10.0)
        return got

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        else:
            os.close(self._fd)


@pytest.fixture(params=["tcp", "pty"])
def client(request: pytest.FixtureRequest, wires: MeterWires) -> Client:
    return Client(wires, request.param)


async def test_messages_end_with_a_line_feed_and_are_answered_in_turn(client: Client) -> None:
    client.send(b"one?\r\ntwo")
    assert await client.line() == b"ONE\n"
    client.send(b"?\nquiet\n\nthree?\n")
    assert [await client.line(), await client.line()] == [b"TWO\n", b"THREE\n"]
    client.close()


async def test_a_silent_meter_takes_the_question_and_says_nothing(client: Client, faults: Faults) -> None:
    faults.switch("meter_silent", on=True, count=1)
    client.send(b"one?\ntwo?\n")
    assert await client.line() == b"TWO\n"
    client.close()


async def test_garbage_is_one_line_that_is_no_answer(client: Client, faults: Faults) -> None:
    faults.switch("meter_garbage", on=True, count=1)
    client.send(b"one?\ntwo?\n")
    assert b"ONE" not in await client.line()
    assert await client.line() == b"TWO\n"
    client.close()


async def test_a_message_without_end_is_thrown_away_and_the_next_is_answered(wires: MeterWires) -> None:
    client = Client(wires, "tcp")
    client.send(b"x" * (3 * LONGEST))
    client.send(b"?\none?\n")
    lines = [await client.line()]
    while lines[-1] != b"ONE\n":
        lines.append(await client.line())
    assert max(map(len, lines)) <= 2 * LONGEST
    client.close()


async def test_one_who_hangs_up_in_the_middle_hurts_nobody(wires: MeterWires) -> None:
    first, second = Client(wires, "tcp"), Client(wires, "tcp")
    first.send(b"one?\ntw")
    first.close()
    second.send(b"two?\n")
    assert await second.line() == b"TWO\n"
    second.close()


async def test_a_port_that_is_taken_is_an_os_error(wires: MeterWires, faults: Faults) -> None:
    async def answer(_message: str) -> str | None:
        return None

    other = MeterWires(answer, faults, seed=1)
    with pytest.raises(OSError, match="address already in use"):
        await other.open(int(wires.address.rpartition(":")[2]))
    await other.close()


async def test_the_link_leads_to_the_pseudo_terminal_and_goes_with_it(tmp_path: Path, faults: Faults) -> None:
    async def answer(_message: str) -> str | None:
        return None

    link = tmp_path / "meter"
    made = MeterWires(answer, faults, seed=1)
    await made.open(link=link)
    assert str(link.readlink()) == made.pty
    await made.close()
    assert list(tmp_path.iterdir()) == []
    link.write_text("a file of somebody's")
    with pytest.raises(FileExistsError, match="choose another path"):
        await MeterWires(answer, faults, seed=1).open(link=link)
    assert link.read_text() == "a file of somebody's"
