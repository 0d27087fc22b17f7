"""The homing run of one drive: set up by its objects, started, and watched to its end."""

import asyncio
import time
from collections.abc import Callable

from drivers.deadline import Deadline
from drivers.errors import MotionError
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess
from drivers.l4118.objects import Control, Mode
from drivers.l4118.power import PowerMachine
from drivers.l4118.travel import TravelWatch

Counts = Callable[[float], int]
"""Gives a speed or a ramp, in the axis' unit, as the drive counts it."""
# Homing where the axis stands: nothing turns, so the status never shows it under way
_HOMING_IN_PLACE = frozenset({35, 37})


async def set_up(drive: DriveAccess, counts: Counts, deadline: Deadline) -> None:
    """Write the objects of the run."""
    homing = drive.config.homing
    for entry, value in (
        (od.SOFTWARE_LIMIT_MIN, 0),
        (od.SOFTWARE_LIMIT_MAX, 0),
        (od.HOME_OFFSET, 0),
        (od.HOMING_METHOD, homing.method),
        (od.HOMING_SPEED_SWITCH, counts(homing.switch_speed_units_s)),
        (od.HOMING_SPEED_ZERO, counts(homing.zero_speed_units_s)),
        (od.HOMING_ACCELERATION, counts(homing.acceleration_units_s2)),
    ):
        await drive.write_checked(entry, value, deadline)


async def must_heed_switch(drive: DriveAccess, deadline: Deadline) -> None:
    """Raise MotionError when the drive is not told to heed the switch that the homing method looks for."""
    needs = drive.config.homing_switch
    heeds = await drive.read_if_there(od.SWITCH_INPUTS, deadline) if needs else None
    if heeds is None or heeds & needs:
        return
    method = drive.config.homing.method
    text = f"homing (method {method}) would pass its switch, for the drive is set up not to heed it"
    technical = f"3240h:01 = {heeds:X}h, without bit {needs.bit_length() - 1}"
    advice = "Set switch_inputs of this axis in the configuration (7: both limits and home), or 3240h:01 in the drive."
    error = MotionError(text, device=drive.config.name, advice=advice, technical=technical)
    error.object = od.SWITCH_INPUTS.place
    raise error


async def run(drive: DriveAccess, power: PowerMachine, deadline: Deadline) -> None:
    """Run it, and wait for its end; raise what made it fail."""
    config = drive.config
    await power.enable(Mode.HOMING, deadline)
    await power.command(Control.ENABLE, deadline)
    status = await drive.status(deadline)
    stale, travel = status.acknowledged, TravelWatch(config, status.position_units, time.monotonic())
    await power.command(Control.START, deadline)
    status = await drive.status(deadline)
    if stale and config.homing.method not in _HOMING_IN_PLACE:
        await power.until(lambda s: not s.acknowledged, status, "homing did not start", deadline)
    status = await drive.status(deadline)
    while not (status.acknowledged and status.target_reached):
        # First of all: a drive in fault may show any of the mode's bits
        await power.must_run(status, deadline)
        if status.mode_error:
            technical = f"method {config.homing.method} failed, status {status.statusword:04X}h"
            advice = "Check the home and limit switches, and homing_method of this axis in the configuration."
            raise MotionError("homing failed", device=config.name, advice=advice, technical=technical)
        travel.look(status.position_units, time.monotonic())
        await asyncio.sleep(config.poll_s)
        status = await drive.status(deadline)
    await power.must_run(status, deadline)
    await power.command(Control.ENABLE, deadline)
