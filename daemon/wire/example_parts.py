"""Parts of the examples that operations and events share: a time, a result, a contact, an alert."""

from __future__ import annotations

from typing import Any, Final

from daemon.domain.point_test import Rung

AT: Final = "2025-03-04T09:30:12.345+00:00"
RESULT: Final[dict[str, Any]] = {
    "id": "board17-TP7-1", "op": "correct", "ok": True, "seq": 4711, "station": "station-1", "finished_at": AT,
    "outcome": "corrected", "test_point": "TP7", "error_before_um": 171.3, "error_after_um": 9.8, "looks": 2,
    "moves": 1, "timing_ms": {"look": {"light": 80.1, "exposure": 62.0, "software": 24.5, "total": 166.6}},
    "pictures": None, "detail": {}, "error": None,
}  # fmt: skip
CONTACT: Final[dict[str, Any]] = {
    "id": "board17-TP7-2", "press": 1, "test_point": "TP7", "board_id": None, "z_um": 4712.5, "pressed_um": 300.0,
    "force_n": 0.48, "since": AT,
}  # fmt: skip
RECORD: Final[dict[str, Any]] = {
    "point": "TP7", "net": "CLK", "board_id": "board17", "method": "continuity",
    "limits": {"low": None, "high": 5.0, "unit": "ohm"}, "verdict": "pass_recovered", "reason": "",
    "recovered_by": Rung.LOOK.value, "cause": "misplaced",
    "readings": [
        {
            "rung": Rung.TOUCH.value, "site_um": [0.0, 0.0], "pressed_um": 300.0, "force_n": 0.48, "proof": False,
            "contact_ohm": None, "seen": False, "value": None, "overload": True, "unit": "ohm", "said": None,
        },
        {
            "rung": Rung.LOOK.value, "site_um": [0.0, 0.0], "pressed_um": 300.0, "force_n": 0.48, "proof": None,
            "contact_ohm": None, "tare_ohm": 0.18, "tare_age_s": 42.0, "seen": True, "value": 0.21, "overload": False,
            "unit": "ohm", "said": None,
        },
    ],
    "touches": 2, "presses": 2, "looks": 2, "error_um": 287.4, "sigma_um": 1.9, "seconds": 2.4, "at": AT,
    "pictures": None,
}  # fmt: skip
ALERT: Final[dict[str, Any]] = {
    "name": "light_white", "group": "light", "what": "the white ring's brightness on the needle",
    "message": "the white ring's brightness on the needle: 131.2 levels, usually 148.0, limit 139.4 (beyond the limit)",
    "severity": "warning", "figure": 131.2, "usual": 148.0, "limit": 139.4, "unit": "levels",
    "rule": "beyond the limit", "since_touches": 48120, "since_at": AT, "evidence": ["131.2", "board17-TP7-1"],
    "advice": "clean ring and cover; replace the ring before pictures become unusable", "raised_at": AT,
    "updated_at": AT, "acknowledged": None,
}  # fmt: skip
