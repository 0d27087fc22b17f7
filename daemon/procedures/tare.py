"""Tare: what leads and needle add to a resistance, as the reference pad read it, while that can be believed.

It is of one needle, one instrument, one reference pad and their settings, and it ages: contacts wear and wires move. A
value from which none was taken is too high, never too low.
"""

from __future__ import annotations

from daemon.jobs.context import StationContext
from daemon.station.needle_health import NeedleHealth, Tare


def what_was_read(context: StationContext) -> tuple[object, ...]:
    """Return by what the reference pad is read now: needle, instrument, its settings, and the pad."""
    needle = context.calibrations.in_force.fingerprint
    return needle, context.station.meter, context.config.meter, context.config.reference


def tare_of(context: StationContext, health: NeedleHealth) -> Tare | None:
    """Return the tare that counts now; None where there is none, it is too old, or it was another needle's."""
    reference = context.config.reference
    return None if reference is None else health.tare(what_was_read(context), reference.tare_s)
