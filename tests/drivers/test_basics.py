"""Deadlines, errors, and finishing what must not be left half done."""

import asyncio

import pytest

from drivers.deadline import Deadline
from drivers.errors import CameraTimeout, DeviceError, DriveFault, LinkTimeout
from drivers.shielded import finish


def test_a_deadline_only_gets_shorter() -> None:
    """It should never give time back when passed down."""
    deadline = Deadline.after(10.0)
    assert deadline.within(100.0) == deadline
    assert deadline.within(1.0).at_s < deadline.at_s
    assert Deadline.after(-1.0).expired
    assert Deadline.after(-1.0).remaining_s == 0.0


@pytest.mark.parametrize("kind", [LinkTimeout, CameraTimeout])
def test_time_outs_are_time_out_errors_with_advice(kind: type[DeviceError]) -> None:
    """It should be caught as TimeoutError, keep its fields and print its device."""
    error = kind("nothing came", device="X")
    assert isinstance(error, TimeoutError)
    assert str(error) == "X: nothing came"
    assert error.advice == kind.default_advice
    assert DriveFault("stop", device="X", code=5, advice="wait").advice == "wait"


async def test_finish_finishes_and_then_passes_the_cancellation_on() -> None:
    """It should not lose the cancellation, nor the work."""
    go, done = asyncio.Event(), []

    async def work() -> None:
        await go.wait()
        done.append(True)

    task = asyncio.create_task(finish(work()))
    await asyncio.sleep(0)
    task.cancel()
    await asyncio.sleep(0)
    assert not task.done()
    go.set()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert done == [True]


async def test_finish_gives_the_result_or_the_error() -> None:
    """It should be transparent otherwise."""

    async def value() -> int:
        return 7

    async def error() -> int:
        raise DeviceError("no", device="X")

    assert await finish(value()) == 7
    with pytest.raises(DeviceError, match="no"):
        await finish(error())
