"""What a browser may send becomes an order of the wire; anything else is refused before it leaves the page."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.page.orders import BadOrder, asked
from daemon.wire.operations.table import OPERATIONS

KEY = "run-0123456789abcdef"


def _fields(**body: Any) -> dict[str, Any]:
    order, given = asked(body)
    fields = order.fields(given)
    OPERATIONS.parse({"op": order.op, **fields})  # what goes out is what the wire takes
    return fields


@pytest.mark.parametrize(
    ("body", "fields"),
    [
        ({"order": "run", "how": "begin", "plan": "six"}, {"plan": "six"}),
        ({"order": "run", "plan": "six"}, {"plan": "six"}),
        ({"order": "run", "how": "abandon", "plan": "six"}, {"plan": "six", "abandon": True}),
        ({"order": "run", "how": "resume", "plan": "other"}, {"resume": True}),
    ],
)
def test_a_run_is_begun_gone_on_with_or_begun_anew(body: dict[str, Any], fields: dict[str, Any]) -> None:
    assert _fields(**body, id=KEY, board_id="SN-1") == {"id": KEY, "board_id": "SN-1", **fields}


def test_a_point_is_forbidden_with_a_reason() -> None:
    body = {"order": "mark", "test_point": "TP1", "mark": "forbidden", "note": "<b>lifts</b>"}
    assert _fields(**body) == {"test_point": "TP1", "mark": "forbidden", "reason": "<b>lifts</b>"}


def test_a_tip_is_taught_where_the_touches_were_to_the_fraction_of_a_pixel() -> None:
    fields = _fields(order="teach", id=KEY, tip_px=[812.3456, 600])
    assert fields == {"id": KEY, "what": "tip", "tip_px": [812.3456, 600.0]}


@pytest.mark.parametrize("what", ["map", "rotation", "backlash", "surface"])
def test_a_calibration_is_of_its_kind_and_on_a_point_only_where_it_looks_at_one(what: str) -> None:
    on_point = {"test_point": "TP5"} if what in ("map", "backlash") else {}
    assert _fields(order="calibrate", id=KEY, what=what, test_point="TP5") == {"id": KEY, "what": what, **on_point}


@pytest.mark.parametrize(("axis", "step"), [("x", {"by_um": -1000}), ("z", {"by_um": 5.0}), ("theta", {"by_deg": 5})])
def test_a_jog_goes_out_with_a_deadline_so_that_none_is_taken_late(axis: str, step: dict[str, float]) -> None:
    fields = _fields(order="jog", id=KEY, axis=axis, **step)
    assert fields == {"id": KEY, "axis": axis, "deadline_ms": 10_000, **step}


@pytest.mark.parametrize(
    "body",
    [
        {"order": "run", "id": KEY, "plan": "six"},
        {"order": "run", "id": KEY, "board_id": "SN 1", "plan": "six"},
        {"order": "run", "id": KEY, "board_id": "SN-1"},
        {"order": "run", "id": KEY, "board_id": "SN-1", "plan": "six", "how": "twice"},
        {"order": "run", "id": "x", "board_id": "SN-1", "plan": "six"},
        {"order": "calibrate", "id": KEY, "what": "tip"},
        {"order": "calibrate", "id": KEY, "what": "map", "test_point": "no such"},
        {"order": "calibrate", "id": KEY},
        {"order": "mark", "test_point": "TP1", "mark": "forbidden", "note": "  "},
        {"order": "mark", "test_point": "TP1", "mark": "hidden", "note": "x"},
        {"order": "mark", "test_point": "TP1", "mark": "forbidden", "note": "x" * 301},
        {"order": "probe", "id": KEY, "test_point": ["TP1"]},
        {"order": "probe", "test_point": "TP1"},
        {"order": "place", "id": KEY, "test_point": ""},
        {"order": "jog", "id": KEY, "axis": "x", "by_um": 1000.1},
        {"order": "jog", "id": KEY, "axis": "x", "by_um": -1000.1},
        {"order": "jog", "id": KEY, "axis": "x", "by_um": True},
        {"order": "jog", "id": KEY, "axis": "x", "by_um": float("nan")},
        {"order": "jog", "id": KEY, "axis": "x", "by_deg": 1.0},
        {"order": "jog", "id": KEY, "axis": "theta", "by_deg": 5.1},
        {"order": "jog", "id": KEY, "axis": "w", "by_um": 1.0},
        {"order": "jog", "axis": "x", "by_um": 10.0},
        {"order": "teach", "id": KEY, "tip_px": [1.0]},
        {"order": "teach", "id": KEY, "tip_px": [1.0, "2"]},
        {"order": "teach", "id": KEY, "tip_px": [1.0, float("inf")]},
        {"order": "teach", "id": KEY},
    ],
    ids=str,
)
def test_what_is_no_whole_order_goes_nowhere(body: dict[str, Any]) -> None:
    with pytest.raises(BadOrder):
        _fields(**body)
