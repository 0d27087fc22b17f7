"""Overview of all watches, for `reprobe health` and the operation `alerts`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from daemon.config.watch_names import GROUPS
from daemon.maintenance.alerts import Alert
from daemon.maintenance.panel import Panel


def is_flag(panel: Panel, name: str) -> bool:
    """Tell whether an alert is told by the daemon itself and not found by a watch."""
    return panel.specs[name].group == "daemon"


def overview(panel: Panel, standing: Mapping[str, Alert]) -> dict[str, Any]:
    """Return the alerts that stand and the state of every watch."""
    watches = []
    for name, spec in sorted(panel.specs.items(), key=lambda item: GROUPS.index(item[1].group)):
        if is_flag(panel, name):
            continue
        stands = panel.watches[name].standing
        state = "alert" if name in standing else "good" if stands.learned >= 1.0 else "learning"
        watches.append(
            {"name": name, "group": spec.group, "what": spec.what, "unit": spec.unit, "state": state,
             "learned": round(stands.learned, 3), "figure": stands.figure, "usual": stands.usual,
             "low": stands.low, "high": stands.high}
        )  # fmt: skip
    return {
        "healthy": not standing,
        "standing": [alert.to_dict() for _, alert in sorted(standing.items())],
        "watches": watches,
    }
