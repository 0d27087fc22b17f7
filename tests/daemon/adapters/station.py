"""A control socket that answers probes by a list: the far end of the adapters, without a station."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import zmq

AT = "2026-01-01T00:00:00Z"


def record(point: str, verdict: str = "pass_first", **facts: Any) -> dict[str, Any]:
    """Return a point's record as it is on the wire."""
    made = {"point": point, "net": "CLK", "board_id": None, "method": "continuity", "limits": None, "verdict": verdict,
            "readings": [reading(0.4)], "seconds": 1.0, "at": AT}  # fmt: skip
    return {**made, **facts}


def reading(value: float | None, unit: str | None = "ohm", **facts: Any) -> dict[str, Any]:
    """Return a reading as it is on the wire."""
    made = {"rung": "touch", "site_um": [0.0, 0.0], "pressed_um": 300.0, "force_n": 0.48, "proof": True, "value": value,
            "unit": unit, "overload": value is None}  # fmt: skip
    return {**made, **facts}


def result(point: str, told: Mapping[str, Any]) -> dict[str, Any]:
    """Return a job's result that carries a record, or an error."""
    error = told.get("error")
    detail = {} if error else {"record": told}
    outcome = "failed" if error else told["verdict"]
    return {"id": "x", "op": "probe", "ok": error is None, "seq": 1, "station": "s", "finished_at": AT,
            "outcome": outcome, "test_point": point, "detail": detail, "error": error}  # fmt: skip


class Listed:
    """What the station answers, point by point, and what it was asked."""

    def __init__(self, endpoint: str, records: Mapping[str, Mapping[str, Any]]) -> None:
        self.endpoint, self._records = endpoint, records
        self.asked: list[dict[str, Any]] = []

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Answer one request."""
        self.asked.append(request)
        if request["op"] == "status":
            return {"ok": True}
        point = request["test_point"]
        if point not in self._records:
            error = {
                "code": 1005,
                "name": "unknown_test_point",
                "message": f"no {point}",
                "advice": "see",
                "detail": {},
            }
            return {"ok": False, "error": error}
        return {"ok": True, "result": result(point, self._records[point])}


@contextmanager
def listed_station(endpoint: str, records: Mapping[str, Mapping[str, Any]]) -> Iterator[Listed]:
    """Serve until the end of the block."""
    listed, context = Listed(endpoint, records), zmq.Context()
    socket, ending = context.socket(zmq.REP), threading.Event()
    socket.bind(endpoint)

    def serve() -> None:
        while not ending.is_set():
            if socket.poll(20):
                socket.send_json(listed.answer(json.loads(socket.recv())))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield listed
    finally:
        ending.set()
        thread.join()
        socket.close(linger=0)
        context.term()
