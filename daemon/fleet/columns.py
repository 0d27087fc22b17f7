"""Columns of a record: what of a row is asked for over years, taken out of its body. Pure.

Unknown kinds and missing fields are no error: a newer station tells more than an older centre asks. A row that no table
can hold is `BadRow`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

from daemon.fleet.batch import Row

MAX_TEXT = 256
BIG = 2**63
KEPT_WHOLE = frozenset({"alert", "order", "run", "lost"})
"""Kinds of which the whole body is kept for as long as the columns."""
GOOD = frozenset({"pass_first"})
"""Verdicts of points that say all there is to say."""
Facts = Mapping[str, Any]


class BadRow(ValueError):
    """A row that cannot be stored; the text tells why."""


class Columns(NamedTuple):
    """One row of `records`, from `kind` on; None: not known, or not of this kind."""

    kind: str
    at: datetime | None
    item: str | None
    job: str | None
    op: str | None
    board: str | None
    board_side: str | None
    board_revision: str | None
    board_id: str | None
    point: str | None
    outcome: str | None
    ok: bool | None
    recovered_by: str | None
    cause: str | None
    error_before_um: float | None
    error_after_um: float | None
    theta_deg: float | None
    value: float | None
    touches: int | None
    needle: str | None
    tip: str | None
    program: str | None
    configuration: str | None
    body: str | None


class Whole(NamedTuple):
    """A record's columns, and all of it as JSON for the days it is kept whole."""

    columns: Columns
    body: str | None
    circumstances: str


def read_row(row: Row) -> Whole:
    """Return what is stored of a row; raise `BadRow` if that cannot be."""
    kind = row.get("kind")
    if not isinstance(kind, str) or not 0 < len(kind) <= 32 or not kind.isprintable():
        raise BadRow("it has no kind")
    body, around = row.get("body"), row.get("circumstances", {})
    if not (body is None or isinstance(body, dict)) or not isinstance(around, dict):
        raise BadRow("body or circumstances are no object")
    whole = None if body is None else _json(body)
    columns = _columns(kind, row.get("at"), body or {}, around)
    if body is None or _says_more(columns):
        columns = columns._replace(body=whole)
    return Whole(columns, whole, _json(around))


def _columns(kind: str, at: object, body: Facts, around: Facts) -> Columns:
    point = body.get("test_point") if kind == "result" else body.get("point")
    return Columns(
        kind=kind,
        at=_time(at),
        item=_item(kind, body),
        job=_text(body.get("id") if kind == "result" else body.get("job")),
        op=_text(body.get("op")),
        board=_text(around.get("board")),
        board_side=_text(around.get("board_side")),
        board_revision=_text(around.get("board_revision")),
        board_id=_text(body.get("board_id")),
        point=_text(point),
        outcome=_outcome(kind, body),
        ok=body["ok"] if isinstance(body.get("ok"), bool) else None,
        recovered_by=_text(body.get("recovered_by")),
        cause=_text(body.get("cause")),
        error_before_um=_number(body.get("error_before_um", body.get("error_um"))),
        error_after_um=_number(body.get("error_after_um")),
        theta_deg=_number(_detail(body).get("theta_deg")),
        value=_number(body.get("value")),
        touches=_count(body.get("touches")),
        needle=_text(around.get("needle")),
        tip=_text(around.get("tip")),
        program=_text(around.get("program")),
        configuration=_text(around.get("configuration")),
        body=None,
    )


def _outcome(kind: str, body: Facts) -> str | None:
    names = {"point": "verdict", "touch": "verdict", "run": "state", "report": "retest", "alert": "severity"}
    return _text(body.get(names.get(kind, "outcome")))


def _item(kind: str, body: Facts) -> str | None:
    """Return which thing of its kind it is; alerts, reports and holes are told once."""
    name = body.get("id") if kind in {"result", "run"} else body.get("n")
    return _text(str(name)) if isinstance(name, str | int) else None


def _says_more(columns: Columns) -> bool:
    """Whether the whole of it is kept for as long as its columns."""
    if columns.kind in KEPT_WHOLE:
        return True
    if columns.kind == "point":
        return columns.outcome not in GOOD
    return columns.kind == "result" and columns.ok is not True


def _detail(body: Facts) -> Facts:
    detail = body.get("detail")
    return detail if isinstance(detail, dict) else {}


def _json(value: Facts) -> str:
    """Return JSON that a database takes."""
    try:
        text = json.dumps(value, allow_nan=False, ensure_ascii=False)
        text.encode()
    except (ValueError, RecursionError) as exc:
        raise BadRow(f"it is no JSON that can be stored: {exc}"[:200]) from exc
    if "\\u0000" in text:
        raise BadRow("a text in it has a zero character")
    return text


def _text(value: object) -> str | None:
    return value[:MAX_TEXT] if isinstance(value, str) else None


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _count(value: object) -> int | None:
    return value if type(value) is int and -BIG <= value < BIG else None


def _time(value: object) -> datetime | None:
    """Return a station's time, which no order depends on; None for none that can be read."""
    try:
        time = datetime.fromisoformat(value) if isinstance(value, str) else None
        if time is None:
            return None
        return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except (ValueError, OverflowError):
        return None
