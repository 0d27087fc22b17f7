"""Examples for the page of the wire: a request and an answer of each kind, as they could be on a station."""

from __future__ import annotations

from typing import Any, Final

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody

_AT: Final = "2025-03-04T09:30:12.345+00:00"
_ENVELOPE: Final = {"v": 1, "version": "0.1.0"}
RESULT: Final[dict[str, Any]] = {
    "id": "board17-TP7-1", "op": "correct", "ok": True, "seq": 4711, "station": "station-1", "finished_at": _AT,
    "outcome": "corrected", "test_point": "TP7", "error_before_um": 171.3, "error_after_um": 9.8, "looks": 2,
    "moves": 1, "timing_ms": {"look": {"light": 80.1, "exposure": 62.0, "software": 24.5, "total": 166.6}},
    "pictures": None, "detail": {}, "error": None,
}  # fmt: skip
ALERT: Final[dict[str, Any]] = {
    "name": "light_white", "group": "light", "what": "the white ring's brightness on the needle",
    "message": "the white ring's brightness on the needle: 131.2 levels, usually 148.0, limit 139.4 (beyond the limit)",
    "severity": "warning", "figure": 131.2, "usual": 148.0, "limit": 139.4, "unit": "levels",
    "rule": "beyond the limit", "since_touches": 48120, "since_at": _AT, "evidence": ["131.2", "board17-TP7-1"],
    "advice": "clean ring and cover; replace the ring before pictures become unusable", "raised_at": _AT,
    "updated_at": _AT, "acknowledged": None,
}  # fmt: skip
_STATUS: Final[dict[str, Any]] = {
    "station": "station-1", "state": "idle", "lifecycle": "ready", "fault": None, "running": None, "queued": 0,
    "pictures": "kept",
    "calibration": {"tip": True, "map_made_at": _AT, "made_at": {"map": _AT}, "aligned": True, "not_used": {}},
}  # fmt: skip
_TAKEN: Final[dict[str, Any]] = {"accepted": True}

REQUESTS: Final[dict[str, dict[str, Any]]] = {
    "correct": {"id": "board17-TP7-1", "test_point": "TP7", "wait": True, "deadline_ms": 10_000},
    "place": {"id": "board17-TP7-0", "test_point": "TP7", "theta_deg": 45.0},
    "look": {"id": "look-3", "pictures": True},
    "align": {"id": "board17-align"},
    "calibrate": {"id": "map-2025-03-04", "what": "map"},
    "home": {"id": "home-1", "wait": True},
    "cancel": {"id": "board17-TP7-1"},
    "reset": {},
    "status": {},
    "snapshot": {},
    "result": {"id": "board17-TP7-1"},
    "results": {"since": 4700, "limit": 100},
    "alerts": {"since": 4700},
    "acknowledge": {"alert": "light_white", "by": "M. Weber", "note": "ring is ordered"},
    "report": {"id": "board17-TP7-1", "retest": "pass", "touches": 20},
    "describe": {},
}
"""Operation -> its own fields."""

REPLIES: Final[dict[str, dict[str, Any]]] = {
    "correct": _TAKEN | {"id": "board17-TP7-1", "result": RESULT},
    "place": _TAKEN | {"id": "board17-TP7-0"},
    "look": _TAKEN | {"id": "look-3"},
    "align": _TAKEN | {"id": "board17-align"},
    "calibrate": _TAKEN | {"id": "map-2025-03-04"},
    "home": _TAKEN | {"id": "home-1", "result": RESULT | {"id": "home-1", "op": "home", "outcome": "homed",
                      "test_point": None, "error_before_um": None, "error_after_um": None, "looks": 0}},
    "cancel": {"id": "board17-TP7-1", "cancelled": "board17-TP7-1"},
    "reset": _STATUS,
    "status": _STATUS,
    "snapshot": _STATUS | {
        "next_seq": 4712, "last_result": RESULT, "touches": 48213,
        "links": {"buses": {"main": {"connected": 1, "reconnects": 0}}, "camera": {"frames": 120}},
    },
    "result": {"id": "board17-TP7-1", "done": True, "result": RESULT},
    "results": {"results": [RESULT]},
    "alerts": {
        "alerts": [{"seq": 4702, "time": _AT, "raised": True, "change": "raised", **ALERT}], "healthy": False,
        "touches": 48213, "standing": [ALERT], "off": [],
        "watches": [{"name": "light_white", "group": "light", "what": "the white ring's brightness on the needle",
                     "unit": "levels", "state": "alert", "learned": 1.0, "figure": 131.2, "usual": 148.0,
                     "low": 139.4, "high": 156.6}],
    },
    "acknowledge": {"alert": ALERT | {"acknowledged": {"by": "M. Weber", "at": _AT, "note": "ring is ordered"}}},
    "report": {"id": "board17-TP7-1", "touches": 48213},
    "describe": {
        "station": "station-1", "ops": ["status"], "events": "tcp://127.0.0.1:5556", "versions": [1],
        "topics": ["state"], "errors": [{"code": 1003, "name": "unknown_op", "cause": "...", "advice": "..."}],
        "board": {"name": "demo", "side": "top", "width_um": 50000.0, "height_um": 40000.0,
                  "test_points": [{"name": "TP7", "kind": "site", "x_um": 12000.0, "y_um": 8000.0,
                                   "diameter_um": 400.0, "hole_um": None, "net": "VCC"}], "not_probeable": {}},
        "you": {"client": "tester-1", "role": "observe", "ops": ["status"]},
        "limits": {"max_message_bytes": 1000000, "rate_per_s": 2000.0, "rate_burst": 2000, "queue_length": 16,
                   "queue_per_client": 8},
    },
}  # fmt: skip
"""Operation -> what its reply says beside the envelope."""

EVENTS: Final[dict[str, dict[str, Any]]] = {
    "state": {"state": "look", "was": "triggered", "event": "accepted", "job": "board17-TP7-1", "fault": None},
    "result": RESULT,
    "alert": {"raised": True, "change": "raised", **ALERT},
    "heartbeat": {"state": "idle", "version": "0.1.0"},
    "progress": {"job": "map-2025-03-04", "op": "calibrate", "done": 7, "total": 25, "doing": "looking"},
    "log": {"event": "configuration_taken", "changed": ["servo.tolerance_um"]},
}
"""Topic -> what its event says beside the envelope."""

REFUSAL: Final[dict[str, Any]] = {
    **_ENVELOPE, "ok": False, "id": "board17-TP9-1",
    "error": ErrorBody.of(Fault(FaultCode.BUSY, "8 jobs of this client wait already", limit=16, limit_per_client=8)),
}  # fmt: skip


def request(op: str) -> dict[str, Any]:
    """Return an example request."""
    return {"v": 1, "op": op, **REQUESTS[op]}


def reply(op: str) -> dict[str, Any]:
    """Return what an example reply is made of."""
    return {**_ENVELOPE, "ok": True, **REPLIES[op]}


def event(topic: str) -> dict[str, Any]:
    """Return what an example event is made of."""
    return {"v": 1, "topic": topic, "seq": 4711, "time": _AT, "station": "station-1", **EVENTS[topic]}
