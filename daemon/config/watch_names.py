"""Names of the watches and of their groups, as `maintenance.off` takes them.

`daemon.maintenance.catalogue` says what each of them follows; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

GROUPS: Final = (
    "placement", "corrections", "tip", "light", "camera", "axes", "bus", "calibration", "probe", "daemon",
    "contact",
)  # fmt: skip
AXES: Final = ("x", "y", "z", "theta")
SECTOR_DEG: Final = 45
"""Head angles of one sector's watch."""
_SINGLE: Final = (
    "placement_error", "placement_x", "placement_y", "head_along", "head_across", "placement_scatter",
    "correction_share", "tip_refused", "pictures_unusable", "pads_not_found", "tip_length", "tip_width",
    "tip_contrast", "tip_bend", "tip_x", "tip_y", "light_white", "light_red", "focus", "noise",
    "frames_missed", "frames", "stop_scatter", "more_moves", "calibration_age", "head_total_error",
    "head_closure", "backlash_x", "backlash_y", "surface", "probe_life", "pictures_not_kept",
    "journal_moved_aside", "journal_not_written", "needle_down", "repeated_failures", "not_served",
    "clock_behind",
    "first_touch_misses", "contact_not_made", "recovered_by_look", "recovered_by_pump", "recovered_by_reference",
    "recovered_by_site", "reference_ohms",
)  # fmt: skip
_EACH_BUS: Final = ("bus_timeouts", "bus_garbled")
_EACH_AXIS: Final = ("arrival", "following", "drive")


def sector_name(theta_deg: float) -> str:
    """Return the name of the sector watch that a head angle belongs to."""
    return f"placement_at_{int(theta_deg % 360.0 // SECTOR_DEG) * SECTOR_DEG:03d}"


def watch_names(buses: Iterable[str]) -> Iterator[str]:
    """Yield the name of every watch of a station with these lines."""
    yield from _SINGLE
    yield from (sector_name(start) for start in range(0, 360, SECTOR_DEG))
    yield from (f"{name}_{bus}" for bus in sorted(buses) for name in _EACH_BUS)
    yield from (f"{name}_{axis}" for axis in AXES for name in _EACH_AXIS)


def is_known(name: str, buses: Iterable[str]) -> bool:
    """Tell whether a name is that of a watch or a group."""
    return name in GROUPS or name in watch_names(buses)
