"""Drives of a station that could not be opened: what a daemon before this one left running is stopped all the same."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AsyncExitStack

import structlog

from daemon.config.model import Config
from daemon.station.devices import axis_config, bus_line
from drivers.bus import ModbusBus
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from drivers.l4118 import Axis

EACH_WITHIN_S = 1.0
log = structlog.get_logger(__name__)


async def bring_to_rest(config: Config, names: Iterable[str]) -> frozenset[str]:
    """Stop the drives of these axes, each whatever the others do; return those that are known to stand.

    Opens the lines for itself and closes them again. Raises nothing that a device does.
    """
    stand = set()
    async with AsyncExitStack() as stack:
        buses = await _open_what_opens(config, stack)
        for name in names:
            section = getattr(config.axes, name)
            if section.bus not in buses:
                continue
            try:
                await Axis(buses[section.bus], axis_config(name, section)).rest(Deadline.after(EACH_WITHIN_S))
                stand.add(name)
            except DeviceError as exc:
                log.debug("not_brought_to_rest", axis=name, error=str(exc))
    return frozenset(stand)


async def _open_what_opens(config: Config, stack: AsyncExitStack) -> dict[str, ModbusBus]:
    buses = {}
    for name, section in config.bus.items():
        try:
            buses[name] = await ModbusBus.open(
                bus_line(section), gap_s=section.gap_ms / 1e3, timeout_s=section.timeout_ms / 1e3
            )
        except DeviceError as exc:
            log.debug("line_not_opened", bus=name, error=str(exc))
        else:
            stack.push_async_callback(buses[name].close)
    return buses
