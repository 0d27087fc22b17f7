"""A station's journal behind a control socket, and nothing else of the daemon: `python -m tests.fleet.journal_server`.

The journal, the operation and its answer are the daemon's own; what works at a station is left out, so that ten
thousand records are there at once.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import zmq
import zmq.asyncio

from daemon.domain.errors import Fault
from daemon.domain.results import ErrorBody
from daemon.server.record_desk import RecordDesk
from daemon.storage.journal import Journal
from daemon.wire.operations.records import Records
from daemon.wire.operations.table import OPERATIONS
from daemon.wire.replies import Refusal

CIRCUMSTANCES = {"program": "1.0", "configuration": "c0ffee", "board": "demo", "board_side": "top", "needle": "N-1"}


async def fill(path: Path, station: str, count: int) -> None:
    """Write results, as many as asked, in one transaction, after those that are there."""
    journal = await Journal.open(path)
    journal.stream.set_circumstances(CIRCUMSTANCES)
    await journal.touches()  # the circumstances are written with it
    sql = "INSERT INTO jobs(id, op, request, received_at) VALUES (?, 'correct', ?, ?)"
    update = "UPDATE jobs SET seq=?, finished_at=?, ok=?, result=? WHERE id=?"

    # By a connection beside it: one flush to disk instead of twenty thousand
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("BEGIN")
        (first,) = db.execute("SELECT coalesce(max(seq) + 1, 1000) FROM jobs").fetchone()
        rows = [_job(station, number, first + number) for number in range(count)]
        db.executemany(sql, [(job["id"], json.dumps({"board_id": "B-1"}), job["finished_at"]) for job in rows])
        db.executemany(
            update, [(job["seq"], job["finished_at"], job["ok"], json.dumps(job), job["id"]) for job in rows]
        )
        db.execute("COMMIT")
    await journal.close()


def _job(station: str, number: int, event: int) -> dict[str, Any]:
    good = number % 10 != 0
    return {
        "id": f"{station}-{number}", "op": "correct", "ok": good, "seq": event, "station": station,
        "finished_at": "2026-03-04T09:30:12+00:00", "outcome": "corrected" if good else "failed",
        "test_point": f"TP{number % 40}", "error_before_um": 100.0 + number % 7, "error_after_um": 8.0, "looks": 2,
        "moves": 1, "timing_ms": {"look": {"light": 80.1, "exposure": 62.0, "total": 166.6}}, "detail": {},
    }  # fmt: skip


async def serve(journal: Journal, station: str, endpoint: str, program: str = "1.0") -> None:
    """Answer until cancelled or killed."""
    desk = RecordDesk(station, journal.stream)
    socket = zmq.asyncio.Context().socket(zmq.ROUTER)
    socket.bind(endpoint)
    while True:
        *route, body = await socket.recv_multipart()
        raw = json.loads(body)
        said = await _status(journal, station, program, raw["op"]) or await _records(desk, raw)
        await socket.send_multipart([*route, said])


async def _status(journal: Journal, station: str, program: str, op: str) -> bytes:
    """Return the answer to what asks how the station is; empty for other operations."""
    if op == "status":
        said = {"station": station, "state": "idle", "lifecycle": "ready", "version": program, "fault": None}
        return json.dumps({"ok": True, **said, "calibration": {"made_at": {}}}).encode()
    if op == "alerts":
        return json.dumps({"ok": True, "standing": await journal.standing()}).encode()
    return b""


async def _records(desk: RecordDesk, raw: dict[str, Any]) -> bytes:
    try:
        request = OPERATIONS.parse(raw)
        assert isinstance(request, Records)
        return (await desk.records(request.journal, request.since, request.limit, request.kinds)).to_json()
    except Fault as fault:
        return Refusal(error=ErrorBody.of(fault)).to_json()


async def main(path: Path, station: str, endpoint: str) -> None:
    """Open a journal and answer until killed."""
    await serve(await Journal.open(path), station, endpoint)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), sys.argv[2], sys.argv[3]))
