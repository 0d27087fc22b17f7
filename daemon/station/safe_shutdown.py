"""Safe shutdown: the machine is left so that somebody may open the hood; still, needle up, lamps off.

All of it is bounded in time and gives up where the drives do not answer: a stop must not hang on a lost bus.
"""

from __future__ import annotations

import asyncio

import structlog

from daemon.domain.errors import REFERENCE_LOST, Fault, FaultCode
from daemon.station.device_errors import as_fault
from daemon.station.devices import Hardware
from daemon.station.station import Station
from drivers.deadline import Deadline
from drivers.errors import DeviceError

UNSAFE_TO_RAISE = REFERENCE_LOST | {FaultCode.LINK_LOST, FaultCode.DEVICE_REFUSED, FaultCode.NOT_HOMED}
"""In these faults an axis may not stand, or not go, where it is told to: not even straight up."""
UNSURE = UNSAFE_TO_RAISE | {FaultCode.NEEDLE_DOWN}
"""In these faults nothing is moved when the daemon ends, not even away from the board: a person looks first."""
ASK_WITHIN_S = 1.5
LIFT_WITHIN_S = 6.0
CLOSE_WITHIN_S = 2.0
log = structlog.get_logger(__name__)


async def shut_down(hardware: Hardware, station: Station | None, fault: Fault | None) -> None:
    """Lift the needle if that is safe, darken, and let go of the devices. No motion is under way any more."""
    if station is not None:
        if fault is not None and fault.kind in UNSURE:
            log.warning("needle_not_lifted", why=fault.kind.wire_name)
        else:
            await raise_needle(station)
    await hardware.close(Deadline.after(CLOSE_WITHIN_S))


async def raise_needle(station: Station) -> Fault | None:
    """Bring Z straight up to the safe height, in its own time; return what keeps it from there, None if it is there."""
    try:
        # Asked first: a move that fails for want of an answer would try to stop four silent drives.
        if not await station.homed(Deadline.after(ASK_WITHIN_S)):
            log.warning("needle_not_lifted", why=FaultCode.NOT_HOMED.wire_name)
            return Fault(FaultCode.NOT_HOMED)
        await station.retract(Deadline.after(LIFT_WITHIN_S))
    except (DeviceError, Fault) as exc:
        log.error("needle_not_lifted", why=str(exc))
        return as_fault(exc)
    except asyncio.CancelledError:
        log.warning("needle_not_lifted", why="told to end at once")
        raise
    return None
