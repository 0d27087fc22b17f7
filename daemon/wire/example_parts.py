"""Parts of the examples that operations and events share: a time, a result, an alert."""

from __future__ import annotations

from typing import Any, Final

AT: Final = "2025-03-04T09:30:12.345+00:00"
RESULT: Final[dict[str, Any]] = {
    "id": "board17-TP7-1", "op": "correct", "ok": True, "seq": 4711, "station": "station-1", "finished_at": AT,
    "outcome": "corrected", "test_point": "TP7", "error_before_um": 171.3, "error_after_um": 9.8, "looks": 2,
    "moves": 1, "timing_ms": {"look": {"light": 80.1, "exposure": 62.0, "software": 24.5, "total": 166.6}},
    "pictures": None, "detail": {}, "error": None,
}  # fmt: skip
ALERT: Final[dict[str, Any]] = {
    "name": "light_white", "group": "light", "what": "the white ring's brightness on the needle",
    "message": "the white ring's brightness on the needle: 131.2 levels, usually 148.0, limit 139.4 (beyond the limit)",
    "severity": "warning", "figure": 131.2, "usual": 148.0, "limit": 139.4, "unit": "levels",
    "rule": "beyond the limit", "since_touches": 48120, "since_at": AT, "evidence": ["131.2", "board17-TP7-1"],
    "advice": "clean ring and cover; replace the ring before pictures become unusable", "raised_at": AT,
    "updated_at": AT, "acknowledged": None,
}  # fmt: skip
