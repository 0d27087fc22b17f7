"""Examples for the page of the wire: events, and what rows of operations do not hold themselves.

Those of operations are their rows' own.
"""

from __future__ import annotations

from typing import Any, Final

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.wire.example_parts import ALERT, AT, CONTACT, RECORD, RESULT
from daemon.wire.operations.row import Operation

_ENVELOPE: Final = {"v": 1, "version": "0.1.0"}
EVENTS: Final[dict[str, dict[str, Any]]] = {
    "state": {"state": "look", "was": "triggered", "event": "accepted", "job": "board17-TP7-1", "fault": None},
    "result": RESULT,
    "alert": {"raised": True, "change": "raised", **ALERT},
    "heartbeat": {"state": "idle", "version": "0.1.0"},
    "contact": {
        "change": "made",
        "job": "board17-TP7-2",
        **{k: v for k, v in CONTACT.items() if k not in ("id", "since")},
    },
    "point": {"job": "board17-TP7-3", **RECORD},
    "progress": {"job": "map-2025-03-04", "op": "calibrate", "done": 7, "total": 25, "doing": "looking"},
    "log": {"event": "configuration_taken", "changed": ["servo.tolerance_um"]},
}
"""Topic -> what its event says beside the envelope."""

REFUSAL: Final[dict[str, Any]] = {
    **_ENVELOPE, "ok": False, "id": "board17-TP9-1",
    "error": ErrorBody.of(Fault(FaultCode.BUSY, "8 jobs of this client wait already", limit=16, limit_per_client=8)),
}  # fmt: skip


def request(row: Operation) -> dict[str, Any]:
    """Return an example request."""
    return {"v": 1, "op": row.op, **row.example}


def reply(row: Operation) -> dict[str, Any]:
    """Return what an example reply is made of."""
    return {**_ENVELOPE, "ok": True, **row.example_reply}


def event(topic: str) -> dict[str, Any]:
    """Return what an example event is made of."""
    return {"v": 1, "topic": topic, "seq": 4711, "time": AT, "station": "station-1", **EVENTS[topic]}
