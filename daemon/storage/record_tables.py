"""Tables of the record stream: what numbers each row that the journal writes, and how a row is read for the stream."""

from __future__ import annotations

from collections.abc import Mapping

CIRCUMSTANCES = "circumstances"


def _on_insert(kind: str, table: str, key: str) -> str:
    return _trigger(f"{kind}_told", f"AFTER INSERT ON {table}", kind, key)


def _on_update(kind: str, table: str, key: str, columns: str, when: str) -> str:
    return _trigger(f"{kind}_told_again", f"AFTER UPDATE OF {columns} ON {table} WHEN {when}", kind, key)


def _trigger(name: str, event: str, kind: str, key: str) -> str:
    return (
        f"CREATE TRIGGER {name} {event} BEGIN INSERT INTO records(kind, ref, circumstances)"  # noqa: S608  # our names
        f" VALUES ('{kind}', NEW.{key}, (SELECT value FROM meta WHERE key='{CIRCUMSTANCES}')); END;\n"
    )


_TABLES = """
CREATE TABLE records (
    seq INTEGER PRIMARY KEY AUTOINCREMENT, kind TEXT NOT NULL, ref INTEGER NOT NULL, circumstances INTEGER
) STRICT;
CREATE TABLE journals (n INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, first_seq INTEGER NOT NULL) STRICT;
CREATE TABLE circumstances (n INTEGER PRIMARY KEY AUTOINCREMENT, body TEXT NOT NULL) STRICT;
INSERT INTO records(kind, ref) SELECT kind, ref FROM (
    SELECT 'result' AS kind, seq AS ref, finished_at AS at FROM jobs WHERE seq IS NOT NULL
    UNION ALL SELECT 'alert', seq, at FROM alerts
    UNION ALL SELECT 'report', n, at FROM reports
    UNION ALL SELECT 'touch', n, at FROM touches
    UNION ALL SELECT 'point', n, at FROM points
    UNION ALL SELECT 'order', n, at FROM orders
    UNION ALL SELECT 'measurement', n, at FROM measurements
    UNION ALL SELECT 'run', n, begun_at FROM runs
) ORDER BY at;
"""
_RUN_TOLD = "NEW.state IS NOT OLD.state OR NEW.summary IS NOT OLD.summary OR NEW.stopped_by NOT IN ('', OLD.stopped_by)"
STREAM_TABLES = _TABLES + "".join(
    (
        _on_update("result", "jobs", "seq", "result", "NEW.seq IS NOT NULL AND OLD.seq IS NULL"),
        _on_insert("alert", "alerts", "seq"),
        _on_insert("report", "reports", "n"),
        _on_insert("touch", "touches", "n"),
        _on_update("touch", "touches", "n", "ended_by, verdict, value", "NEW.ended_by IS NOT NULL"),
        _on_insert("point", "points", "n"),
        _on_insert("order", "orders", "n"),
        _on_update("order", "orders", "n", "outcome", "NEW.outcome IS NOT NULL"),
        _on_insert("measurement", "measurements", "n"),
        _on_insert("run", "runs", "n"),
        _on_update("run", "runs", "n", "state, summary, stopped_by", _RUN_TOLD),
    )
)
"""What a file of the version before lacks; what it has kept comes first, in the order of time."""


SOURCES: Mapping[str, str] = {
    "result": (
        "SELECT finished_at, json_set(result, '$.board_id', json_extract(request, '$.board_id')) FROM jobs WHERE seq=?"
    ),
    "alert": ("SELECT at, body FROM alerts WHERE seq=?"),
    "report": (
        "SELECT at, json_object('n', n, 'job', job, 'retest', retest, 'touches', touches) FROM reports WHERE n=?"
    ),
    "touch": (
        "SELECT at, json_object('n', n, 'job', job, 'board_id', board_id, 'point', point, 'z_end_um', z_end_um,"
        " 'pressed_um', pressed_um, 'force_n', force_n, 'speed_um_s', speed_um_s, 'ended_by', ended_by,"
        " 'verdict', verdict, 'value', value, 'unit', unit, 'visit', visit, 'rung', rung, 'presses', presses,"
        " 'proof', proof, 'reading', reading) FROM touches WHERE n=?"
    ),
    "point": ("SELECT at, json_set(record, '$.n', n, '$.job', job) FROM points WHERE n=?"),
    "order": (
        "SELECT at, json_object('n', n, 'client', client, 'role', role, 'by', by, 'op', op, 'outcome', outcome)"
        " FROM orders WHERE n=?"
    ),
    "measurement": (
        "SELECT at, json_object('n', n, 'touches', touches, 'job', job, 'measured', json(body))"
        " FROM measurements WHERE n=?"
    ),
    "run": (
        "SELECT coalesce(ended_at, begun_at), json_object('id', id, 'board_id', board_id, 'plan', plan, 'plan_hash',"
        " plan_hash, 'state', state, 'begun_at', begun_at, 'ended_at', ended_at, 'stopped_by', stopped_by,"
        " 'jobs', json(jobs), 'summary', json(summary)) FROM runs WHERE n=?"
    ),
}  # fmt: skip
"""Kind -> its row, as time and JSON text. What an order asked in its fields is told by `audit`, to who may maintain."""
