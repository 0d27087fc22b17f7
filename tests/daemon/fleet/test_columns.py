"""What of a record is asked for over years is taken out of it; unknown fields are no error."""

from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.fleet.columns import BadRow, read_row
from daemon.wire.example_parts import ALERT, RECORD, RESULT

AROUND = {"program": "1.0", "board": "demo", "needle": "N-1", "calibrated": {"map": "2026-01-01"}}
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)


def _row(kind: str, body: Any, **more: Any) -> dict[str, Any]:
    return {"seq": 7, "kind": kind, "at": "2026-03-04T10:30:00+01:00", "body": body, "circumstances": AROUND, **more}


def test_a_verdict_of_a_point_is_found_in_columns_and_kept_whole_where_it_was_not_good() -> None:
    found = read_row(_row("point", RECORD | {"n": 12, "job": "j"})).columns
    assert found.at == datetime(2026, 3, 4, 9, 30, tzinfo=UTC)
    assert (found.point, found.board_id, found.board, found.needle, found.item) == (
        "TP7",
        "board17",
        "demo",
        "N-1",
        "12",
    )
    assert (found.outcome, found.recovered_by, found.cause) == ("pass_recovered", "look", "misplaced")
    assert found.error_before_um == 287.4
    assert found.body is not None
    good = read_row(_row("point", RECORD | {"verdict": "pass_first"}))
    assert good.columns.body is None
    assert good.body is not None


def test_a_result_and_an_alert_are_found_in_columns() -> None:
    result = read_row(_row("result", RESULT | {"board_id": "B-1"})).columns
    assert (result.op, result.ok, result.point, result.job, result.error_after_um) == (
        "correct", True, "TP7", "board17-TP7-1", 9.8,
    )  # fmt: skip
    assert result.body is None
    assert read_row(_row("result", RESULT | {"ok": False})).columns.body is not None
    alert = read_row(_row("alert", ALERT)).columns
    assert (alert.outcome, alert.item) == ("warning", None)
    assert alert.body is not None


def test_a_kind_of_a_newer_station_is_stored_whole_and_costs_nothing() -> None:
    found = read_row(_row("weather", {"rain": True}))
    assert (found.columns.kind, found.columns.outcome, found.body) == ("weather", None, '{"rain": true}')


@given(body=ANYTHING, at=ANYTHING, kind=ANYTHING, around=ANYTHING)
def test_whatever_a_row_holds_it_is_read_or_refused_in_words(body: Any, at: Any, kind: Any, around: Any) -> None:
    try:
        found = read_row(_row(kind, body, at=at, circumstances=around))
    except BadRow:
        return
    assert "\\u0000" not in f"{found.body}{found.circumstances}"
    assert found.columns.kind == kind


@pytest.mark.parametrize("value", [True, "12", None, [], 10**400, -(2**63) - 1])
def test_a_value_of_another_type_is_as_if_it_were_not_there(value: Any) -> None:
    body = {"touches": value, "ok": "yes", "error_um": value if value != -(2**63) - 1 else None, "point": 7}
    found = read_row(_row("point", body)).columns
    assert (found.touches, found.ok, found.point, found.error_before_um) == (None, None, None, None)
