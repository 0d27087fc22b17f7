"""Approach of X and Y: as long as their measured play asks for, and none where there is hardly any.

Every axis comes to its target from below, so that the nut lies at the same flank of the screw. The length for that is
configured for the worst axis; where the play was measured, a shorter one takes it up as well, in less time.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from daemon.config.sections.motion import GantrySection
from daemon.storage.calibration_in_force import InForce
from daemon.storage.calibration_records import AxisBacklash, BacklashRecord
from drivers.gantry import Approach

SIGMAS = 3.0
NO_PLAY_UM = 5.0
"""Play that is not worth a leg of its own: less than stops scatter by."""
TIMES = 2.0
"""So many times the largest play that was measured: elsewhere on the screw it may be more, and it wears."""
SPARE_UM = 40.0
"""More than it by at least this."""


def approach_of(gantry: GantrySection, in_force: InForce, max_age_days: float) -> Approach:
    """Return how far below its target each axis turns back, at most as far as is configured.

    That it is where the play was not measured within so many days.
    """
    record = in_force.records.get("backlash")
    x_um = y_um = gantry.approach_um
    if isinstance(record, BacklashRecord) and _age_of(record) <= timedelta(days=max_age_days):
        x_um, y_um = (min(_asked_for_um(play), gantry.approach_um) for play in (record.x, record.y))
    return Approach(x_um, y_um, gantry.approach_deg)


def _age_of(record: BacklashRecord) -> timedelta:
    made = datetime.fromisoformat(record.made_at)
    return datetime.now(UTC) - (made if made.tzinfo is not None else made.replace(tzinfo=UTC))


def _asked_for_um(play: AxisBacklash) -> float:
    """Return what takes up any play that the measured one leaves possible."""
    most_um = abs(play.backlash_um) + SIGMAS * play.sigma_um
    return 0.0 if most_um <= NO_PLAY_UM else max(TIMES * most_um, most_um + SPARE_UM)
