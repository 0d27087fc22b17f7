"""Ramp-down and switching off of a running drive, by FC 43 alone; each step ends by itself."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

import structlog

from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, MotionTimeout, ReplyError
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess
from drivers.l4118.objects import Control, PowerState

# Time given to the answers of one step, which must end by itself even when everything else is broken
STOP_S: Final = 3.0
Command = Callable[[Control, Deadline], Awaitable[None]]


async def bring_to_rest(drive: DriveAccess, command: Command, off: Control = Control.SHUTDOWN) -> PowerState | None:
    """Halt a drive that runs, wait until it stands, and switch it off (a halt released would finish the old move).

    Returns the state that it was found in. A drive that does not heed the halt is switched off all the same, as soon as
    its ramp must be over. Raises what the line raises, and MotionTimeout for a drive that cannot be switched off.
    """
    found = od.decode_state(await drive.statusword(Deadline.after(STOP_S)))
    if found is not PowerState.OPERATION_ENABLED:
        return found
    try:
        await command(Control.HALT, Deadline.after(STOP_S))
        await _ramp(drive)
    except (DeviceRefused, ReplyError) as exc:
        structlog.get_logger().warning("axis.halt_refused", device=drive.config.name, cause=str(exc))
    await switch_off(drive, command, off)
    return found


async def switch_off(drive: DriveAccess, command: Command, first: Control) -> None:
    """Take the drive out of operation enabled by `first`, and by "disable voltage" if it does not heed that."""
    for control in (first, Control.DISABLE_VOLTAGE):
        try:
            await command(control, Deadline.after(STOP_S))
            if await _left(drive):
                return
        except (DeviceRefused, ReplyError):
            if control is Control.DISABLE_VOLTAGE:
                raise
    raise MotionTimeout("runs and cannot be switched off", device=drive.config.name, advice="Press the emergency stop.")


async def _ramp(drive: DriveAccess) -> None:
    """Wait until the drive stands, no longer than its ramp takes."""
    limit = Deadline.after(min(STOP_S, drive.config.ramp_s + drive.config.state_timeout_s))
    while not limit.expired:
        # With a deadline of its own: at the end of the wait the drive is switched off, whatever it says
        statusword = await drive.statusword(Deadline.after(STOP_S))
        if not _enabled(statusword) or statusword & od.SW_TARGET_REACHED:
            return
        await asyncio.sleep(drive.config.poll_s)
    structlog.get_logger().warning("axis.halt_not_heeded", device=drive.config.name)


async def _left(drive: DriveAccess) -> bool:
    limit = Deadline.after(drive.config.state_timeout_s)
    while _enabled(await drive.statusword(Deadline.after(STOP_S))):
        if limit.expired:
            return False
        await asyncio.sleep(drive.config.poll_s)
    return True


def _enabled(statusword: int) -> bool:
    return od.decode_state(statusword) is PowerState.OPERATION_ENABLED
