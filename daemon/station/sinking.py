"""Sinking of Z at rest: a needle that goes down by itself, because a brake, a coupling or a drive does not hold it."""

from __future__ import annotations

from daemon.domain.errors import Fault, FaultCode
from daemon.station.needle import Needle
from drivers.gantry import Position

GIVES_UM = 50.0
"""What Z may settle by when its motor is switched off and its brake takes over; at working height it hovers higher."""


def sunk(needle: Needle, position: Position) -> Fault | None:
    """Return the fault of a Z that now stands lower than it was left, None if it stays where it was.

    `position`: what the drives say now. Where the needle is not known nothing can be told.
    """
    left_um = needle.left_um(position)
    if left_um is None or left_um - position.z_um <= GIVES_UM:
        return None
    by_um = left_um - position.z_um
    return Fault(
        FaultCode.NEEDLE_DOWN,
        f"Z sank by {by_um:.0f} um, to {position.z_um / 1e3:.3f} mm, while nothing moved it",
        advice="look at brake and coupling of Z, then send `lift`",
        axis="z",
        z_um=round(position.z_um, 1),
        sunk_um=round(by_um, 1),
    )
