"""Parts of the examples of plans and runs: a plan, a run with its figures."""

from __future__ import annotations

from typing import Any, Final

from daemon.wire.example_parts import AT

PLAN: Final[dict[str, Any]] = {
    "name": "power", "board": "demo", "board_revision": "9c2f1b7e44d0a853", "learned_from": [], "note": "",
    "tests": [
        {
            "point": "TP7", "net": "VCC", "method": "continuity", "limits": {"low": None, "high": 5.0, "unit": "ohm"},
            "theta_deg": None, "look": "on_open", "touches": None, "second_site": True, "note": "",
        }
    ],
}  # fmt: skip
SUMMARY: Final[dict[str, Any]] = {
    "points": 1, "done": 1, "first_touch_yield": 0.0, "passed_first": 0, "false_opens": 1, "recovered_by": {"look": 1},
    "causes": {"misplaced": 1}, "opens_confirmed": 0, "failed": 0, "contact_not_made": 0, "not_tested": 0, "touches": 2,
    "touches_mean": 2.0, "touches_p99": 2, "touches_max": 2, "looks": 2, "seconds": 2.4, "seconds_per_point": 2.4,
    "reference_first_ohm": 0.31, "reference_last_ohm": 0.31,
}  # fmt: skip
RUN: Final[dict[str, Any]] = {
    "id": "board17-run-1", "board_id": "board17", "plan": PLAN, "plan_version": 3, "plan_hash": "5d41402abc4b2a76",
    "board": {
        "name": "demo", "side": "top", "revision": "9c2f1b7e44d0a853", "width_um": 50000.0, "height_um": 40000.0,
    },
    "order": [0], "places": [{"x_um": 12000.0, "y_um": 8000.0, "theta_deg": 0.0}], "station": "station-1",
    "software": "0.1.0", "calibrated": {"map": AT}, "begun_at": AT, "ended_at": AT, "state": "done",
    "jobs": ["board17-run-1"], "stopped_by": "", "summary": SUMMARY,
}  # fmt: skip
