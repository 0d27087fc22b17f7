"""Safe ending of a job: motion stops, the needle is raised, the lamps go off; in this order, whatever ended it.

Each step has a deadline of its own, for the job's may be what ended it. What a step could not do becomes a fault to be
latched. A needle that is up already costs nothing: where it is, is known from the last move.
"""

from __future__ import annotations

from collections.abc import Iterable

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.fault_latch import FaultLatch
from daemon.platform.clock import Stopwatch
from daemon.station.allowance import Allowance
from daemon.station.device_errors import as_fault
from daemon.station.needle import Needle
from daemon.station.safe_shutdown import UNSAFE_TO_RAISE, raise_needle
from daemon.station.station import Station
from drivers.deadline import Deadline

DARK_WITHIN_S = 2.0
UNSEEN = frozenset({FaultCode.TIP_NOT_FOUND, FaultCode.WRONG_HEIGHT})
"""After these nobody has seen that the pin is free: Z may stand lower than its drive counts."""
log = structlog.get_logger(__name__)


async def make_safe(
    station: Station, latch: FaultLatch, ended_by: Fault | None, watch: Stopwatch, found: list[Fault], *,
    moved: bool = True,
) -> None:  # fmt: skip
    """Leave the station still, with the needle up, and dark; add to `found` what could not be done, cause first.

    `ended_by`: how the job ended; a needle that may be down stays where it is in a fault in which no axis can be
    trusted. `moved`: the job has moved the head; where it then saw no free tip, that is raised, whatever Z counts.
    """
    await _stop(station, found)
    unseen = moved and ended_by is not None and ended_by.kind in UNSEEN
    if station.needle.may_be_down or unseen:
        found += await _raise(station, _unsafe((ended_by, *found, *latch.causes), latch))
    await _darken(station, watch, found)


async def _stop(station: Station, found: list[Fault]) -> None:
    """Stop a motion that goes on; the job's own ones were stopped by what ended it."""
    if not station.moving:
        return
    try:
        await station.stop()
    except Exception as exc:  # noqa: BLE001  # the rest is to be done all the same
        log.error("not_stopped", error=str(exc))
        found.append(as_fault(exc))


def _unsafe(known: Iterable[Fault | None], latch: FaultLatch) -> Fault | None:
    """Return what speaks against raising the needle."""
    if latch.doubtful:
        return Fault(FaultCode.NOT_HOMED, "the reference of an axis is in doubt")
    return next((fault for fault in known if fault is not None and fault.kind in UNSAFE_TO_RAISE), None)


async def _raise(station: Station, unsafe: Fault | None) -> list[Fault]:
    """Raise the needle if that is safe; return the faults of one that stays down, its own cause first."""
    if unsafe is not None:
        log.error("needle_not_raised", why=unsafe.message)
        return [_stays_down(station.needle, unsafe)]
    try:
        cause = await raise_needle(station)
    except Exception as exc:  # a bug must not keep the lamps on, nor the job without an end
        log.exception("needle_not_raised")
        cause = as_fault(exc)
    if cause is None:
        return []
    first = [cause] if cause.kind.latched else []
    return [*first, _stays_down(station.needle, cause)]


def _stays_down(needle: Needle, cause: Fault) -> Fault:
    return needle.fault(f"it was not raised: {cause.message}")


async def _darken(station: Station, watch: Stopwatch, found: list[Fault]) -> None:
    """Switch the lights off."""
    try:
        await station.lights_off(Allowance(Deadline.after(DARK_WITHIN_S), watch))
    except Exception as exc:  # noqa: BLE001  # the job's own end matters more; the light's trouble latches a fault
        log.error("lights_not_off", error=str(exc))
        found.append(as_fault(exc))
