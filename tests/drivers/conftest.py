"""A line with a scripted far end, and a check that nothing is left running."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from drivers.bus import ModbusBus, SerialLine
from drivers.deadline import Deadline
from tests.drivers.peers.line import Answer, PtyLine

MakeLine = Callable[[Answer], PtyLine]
OpenBus = Callable[..., Awaitable[ModbusBus]]


@pytest.fixture(autouse=True)
async def no_task_left() -> AsyncIterator[None]:
    """Fail a test that leaves a task behind."""
    before = asyncio.all_tasks()
    yield
    left = [t for t in asyncio.all_tasks() - before - {asyncio.current_task()} if not t.done()]
    for task in left:
        task.cancel()
    assert not left, f"tasks left running: {left}"


@pytest.fixture
async def make_line(tmp_path: Path) -> AsyncIterator[MakeLine]:
    lines: list[PtyLine] = []

    def make(answer: Answer) -> PtyLine:
        lines.append(PtyLine(tmp_path / f"line{len(lines)}", answer))
        return lines[-1]

    yield make
    for line in lines:
        line.close()


def serial_line(line: PtyLine) -> SerialLine:
    return SerialLine(str(line.path), baudrate=115200, parity="N")


@pytest.fixture
def soon() -> Deadline:
    """A deadline no healthy test comes near."""
    return Deadline.after(30.0)


@pytest.fixture
async def open_bus() -> AsyncIterator[OpenBus]:
    buses: list[ModbusBus] = []

    async def open_(line: PtyLine, **options: object) -> ModbusBus:
        settings: dict[str, object] = {"gap_s": 0.0, "timeout_s": 1.0, **options}
        buses.append(await ModbusBus.open(serial_line(line), **settings))  # type: ignore[arg-type]
        return buses[-1]

    yield open_
    for bus in buses:
        await bus.close()
