"""Run in the emulated machine: put the installed V4L2 driver through what a camera can do to it, on a vivid device.

    trials.py DEVICE ANSWER

The answer is one JSON object: for each trial what happened, or the exception that ended it, and of what outages the
driver spoke. What of it is right is judged by the tests on the host.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
import traceback
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from structlog.testing import capture_logs

from drivers.camera import CameraConfig, Frame, V4L2Camera
from drivers.deadline import Deadline
from drivers.errors import CameraError

DEVICE, ANSWER = sys.argv[1:]
DRIVER, INSTANCE = "/sys/bus/platform/drivers/vivid", "vivid.0"
PATIENCE_S = 90.0
"""For what has to work; an emulated processor is slow."""
SHORT_S = 10.0
"""For what has to fail: the error has to come by then."""
# vivid has raw formats only; its picture stands still, bit by bit.
CONFIG = CameraConfig(
    device=DEVICE, encoding="bgr8", exposure_us=None, white_balance_k=None,
    frame_timeout_s=3.0, backoff_max_s=1.0, refuse_identical=False,
)  # fmt: skip
Facts = dict[str, Any]


def run(*command: str) -> str:
    """Run a command of the machine and return what it printed."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def press(control: str, value: int = 1) -> None:
    """Set a control of the device, behind the driver's back."""
    run("v4l2-ctl", "-d", DEVICE, "-c", f"{control}={value}")


def value_of(control: str) -> int:
    """Read a control of the device."""
    return int(run("v4l2-ctl", "-d", DEVICE, "-C", control).rpartition(":")[2])


@asynccontextmanager
async def opened(config: CameraConfig = CONFIG) -> AsyncIterator[V4L2Camera]:
    """Open the camera and close it afterwards."""
    camera = V4L2Camera(config)
    await camera.open(Deadline.after(PATIENCE_S))
    try:
        yield camera
    finally:
        await camera.close()


async def fresh(camera: V4L2Camera, within_s: float = PATIENCE_S) -> Frame:
    """Return a picture that is exposed after now."""
    return await camera.frame_after(time.monotonic(), Deadline.after(within_s))


async def refusal(attempt: Awaitable[Any]) -> Facts:
    """Return the driver's error and how long it took to come."""
    began_s = time.monotonic()
    try:
        await attempt
    except CameraError as exc:
        facts = {"kind": type(exc).__name__, "says": str(exc), "took_s": time.monotonic() - began_s}
        return {**facts, "cause": repr(exc.__cause__), "allowed_s": SHORT_S}
    return {"kind": None, "says": "nothing", "took_s": time.monotonic() - began_s, "allowed_s": SHORT_S}


async def opening(config: CameraConfig) -> Facts:
    """Return how an attempt to open went, and what was read back if it succeeded."""
    camera = V4L2Camera(config)
    try:
        facts = await refusal(camera.open(Deadline.after(SHORT_S)))
        return {**facts, "settings": dict(camera.settings())}
    finally:
        await camera.close()


async def raw_pictures() -> Facts:
    """Open at full size and look at two pictures."""
    async with opened() as camera:
        first, asked_s = await fresh(camera), time.monotonic()
        second = await fresh(camera)
        return {
            "settings": dict(camera.settings()), "shape": first.pixels.shape, "type": str(first.pixels.dtype),
            "spread": float(first.pixels.std()), "numbers": [first.sequence, second.sequence],
            "after_asked_s": second.exposure_start_s - asked_s, "age_s": second.received_s - second.exposure_start_s,
        }  # fmt: skip


async def a_size_it_lacks() -> Facts:
    """Ask for more than its widest picture."""
    return await opening(replace(CONFIG, width_px=16_400))


async def a_format_it_lacks() -> Facts:
    """Ask for MJPG."""
    return await opening(replace(CONFIG, encoding="mjpg"))


async def controls() -> Facts:
    """Set a control that is there, and ask for those that are not."""
    press("gain_automatic", 0)
    wanted = replace(CONFIG, gain=77, exposure_us=20_000, focus=120, white_balance_k=4600)
    async with opened(wanted) as camera:
        await fresh(camera)
        return {"settings": dict(camera.settings()), "device": value_of("gain")}


async def in_use() -> Facts:
    """Open the device while another has it open and streams."""
    async with opened():
        return await opening(CONFIG)


async def some_buffers_dropped() -> Facts:
    """Look while half of the buffers never come."""
    async with opened() as camera:
        press("percentage_of_dropped_buffers", 50)
        try:
            numbers = [(await fresh(camera)).sequence for _ in range(3)]
        finally:
            press("percentage_of_dropped_buffers", 0)
        return {"numbers": numbers}


async def all_buffers_dropped() -> Facts:
    """Look while no buffer comes, and again when they do."""
    async with opened() as camera:
        await fresh(camera)
        press("percentage_of_dropped_buffers", 100)
        try:
            error = await refusal(fresh(camera, SHORT_S))
        finally:
            press("percentage_of_dropped_buffers", 0)
        return {**error, "afterwards": await _again(camera)}


async def broken_once(button: str) -> Facts:
    """Look after a button was pressed that breaks one thing once."""
    async with opened() as camera:
        await fresh(camera)
        press(button)
        return {"afterwards": await _again(camera)}


async def broken_start(button: str) -> Facts:
    """Open after a button was pressed that breaks one step of opening once; then open again."""
    press(button)
    camera = V4L2Camera(CONFIG)
    error = await refusal(camera.open(Deadline.after(SHORT_S)))
    facts: Facts = {"opening": error}
    if error["kind"] is not None:
        await camera.open(Deadline.after(PATIENCE_S))
    try:
        facts["afterwards"] = await _again(camera)
    finally:
        await camera.close()
    return facts


async def unplugged() -> Facts:
    """Look after the device has gone, as with a plug that is drawn, and again when it is back under the same name."""
    async with opened() as camera:
        await fresh(camera)
        await asyncio.to_thread(Path(DRIVER, "unbind").write_text, INSTANCE)
        gone = not Path(DEVICE).exists()
        error = await refusal(fresh(camera, SHORT_S))
        await asyncio.to_thread(Path(DRIVER, "bind").write_text, INSTANCE)
        return {**error, "gone": gone, "afterwards": await _again(camera)}


async def _again(camera: V4L2Camera) -> Facts:
    """Look, and tell what it took."""
    asked_s = time.monotonic()
    frame = await fresh(camera)
    counts = camera.statistics()
    return {
        "shape": frame.pixels.shape, "after_asked_s": frame.exposure_start_s - asked_s,
        "took_s": time.monotonic() - asked_s, "reopened": counts.reopened, "timeouts": counts.timeouts,
    }  # fmt: skip


TRIALS: dict[str, Callable[[], Awaitable[Facts]]] = {
    "raw_pictures": raw_pictures,
    "a_size_it_lacks": a_size_it_lacks,
    "a_format_it_lacks": a_format_it_lacks,
    "controls": controls,
    "in_use": in_use,
    "some_buffers_dropped": some_buffers_dropped,
    "all_buffers_dropped": all_buffers_dropped,
    "a_damaged_buffer": lambda: broken_once("inject_v4l2_buf_flag_error"),
    "a_fatal_streaming_error": lambda: broken_once("inject_fatal_streaming_error"),
    "disconnected_and_back": lambda: broken_once("disconnect"),
    "no_buffers_to_be_had": lambda: broken_start("inject_vidioc_reqbufs_error"),
    "no_start_of_the_stream": lambda: broken_start("inject_vidioc_streamon_error"),
    "unplugged": unplugged,
}


def main() -> None:
    """Run all trials."""
    told: dict[str, Facts] = {}
    for name, trial in TRIALS.items():
        with capture_logs() as spoken:
            try:
                told[name] = asyncio.run(trial())  # type: ignore[arg-type]
            except Exception:  # noqa: BLE001  # one trial's end is told like its result; the others go on
                told[name] = {"ended_by": traceback.format_exc(limit=-4)}
        told[name]["outages"] = [entry["cause"] for entry in spoken if entry["event"] == "camera.lost"]
    Path(ANSWER).write_text(json.dumps(told))


if __name__ == "__main__":
    main()
