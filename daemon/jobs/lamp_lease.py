"""Lamp lease: a person has a lamp on for a while, to see something in the live picture; it never burns on by itself.

It is switched on only while the station is idle, and goes dark when the lease ends, when anything else takes the
station, and when a fault is latched.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import State
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.station_lock import StationLock
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from drivers.lights import Light, Lights

SWITCH_WITHIN_S = 2.0
log = structlog.get_logger(__name__)


class LampLease:
    """The lamp that a person has switched on, if any."""

    def __init__(self, latch: FaultLatch, lock: StationLock, lights: Callable[[], Lights | None]) -> None:
        self._latch, self._lock, self._lights = latch, lock, lights
        self._ending: asyncio.Task[None] | None = None
        latch.subscribe(lambda _change: self._end_soon(0.0) if latch.fault is not None else None)

    async def switch(self, light: Light, lease_s: float) -> None:
        """Switch a lamp on for so long, or all off; raise `Fault` unless the station is idle."""
        self._require_idle()
        async with self._lock.hold("lamp"):
            self._require_idle()
            lights = self._lights()
            if lights is None:
                raise Fault(FaultCode.LINK_LOST, "no device is open")
            self._lock.leave = self.leave
            try:
                await lights.set(light, Deadline.after(SWITCH_WITHIN_S))
            finally:
                self._end_soon(0.0 if light is Light.OFF else lease_s)

    def _require_idle(self) -> None:
        if self._latch.fault is not None:
            raise Fault(FaultCode.IN_FAULT, first=self._latch.fault.kind.wire_name)
        if self._latch.state is not State.IDLE or self._lock.holder not in (None, "lamp", "health check"):
            raise Fault(FaultCode.BUSY, "the station works; its lamps are its own then")

    async def leave(self) -> None:
        """Go dark, as the station is taken for work; a lamp that does not obey is found by the work's first look."""
        self._lock.leave = None
        if self._ending is not None and self._ending is not asyncio.current_task():
            self._ending.cancel()
        lights = self._lights()
        if lights is None:
            return
        try:
            await lights.set(Light.OFF, Deadline.after(SWITCH_WITHIN_S))
        except DeviceError as exc:
            log.warning("lamp_not_dark", error=str(exc))

    def _end_soon(self, within_s: float) -> None:
        """Go dark after so long; a lease before this one ends with it."""
        if self._lock.leave is None:
            return
        if self._ending is not None:
            self._ending.cancel()
        self._ending = asyncio.create_task(self._end(within_s), name="lamp")

    async def _end(self, within_s: float) -> None:
        await asyncio.sleep(within_s)
        async with self._lock.hold("lamp"):
            if self._lock.leave is not None:
                await self.leave()
