"""What arrives is understood whole or refused by name; whatever arrives, nothing else happens."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.wire.docs import examples as wire_examples
from daemon.wire.operations.jobs import Correct, Place
from daemon.wire.operations.table import OPERATIONS

EXAMPLES: list[dict[str, Any]] = [wire_examples.request(row) for row in OPERATIONS.rows]
"""One of each operation."""
GOOD: list[dict[str, Any]] = [
    {"op": "correct", "id": "a", "test_point": "TP7"},
    {"v": 1, "op": "correct", "id": "a", "test_point": "TP7", "wait": True, "deadline_ms": 500},
    {"op": "place", "id": "a", "test_point": "TP7", "theta_deg": 359.9},
    {"op": "place", "id": "a", "board_um": [-9000.0, 12.5]},
    {"op": "look", "id": "a"},
    {"op": "calibrate", "id": "a", "what": "tip", "tip_px": [428, 620]},
    {"op": "calibrate", "id": "a", "what": "map", "test_point": "FID1"},
    {"op": "calibrate", "id": "a", "what": "rotation", "angles": 24, "model": "fourier", "resume": False},
    {"op": "calibrate", "id": "a", "what": "surface", "places": 6},
    {"op": "calibrate", "id": "a", "what": "backlash"},
    {"op": "align", "id": "a"},
    {"op": "align", "id": "a", "fiducials": ["FID1", "FID2", "TP3"], "thetas_deg": [0.0, 90.0]},
    {"op": "home", "id": "a"},
    {"op": "cancel"},
    {"op": "reset"},
    {"op": "status"},
    {"op": "snapshot"},
    {"op": "result", "id": "a"},
    {"op": "results", "since": 3, "limit": 5},
    {"op": "alerts", "since": 3, "limit": 5},
    {"op": "acknowledge", "alert": "light_white", "by": "Kim", "note": "ring ordered", "mended": False},
    {"op": "report", "id": "a", "retest": "pass", "touches": 20},
    {"op": "describe"},
]
BAD: list[tuple[Any, FaultCode, str]] = [
    ([], FaultCode.BAD_JSON, ""),
    ("hello", FaultCode.BAD_JSON, ""),
    ({}, FaultCode.UNKNOWN_OP, ""),
    ({"op": "fly"}, FaultCode.UNKNOWN_OP, ""),
    ({"op": ["correct"]}, FaultCode.UNKNOWN_OP, ""),
    ({"v": 2, "op": "status"}, FaultCode.UNSUPPORTED_VERSION, ""),
    ({"v": True, "op": "status"}, FaultCode.UNSUPPORTED_VERSION, ""),
    ({"op": "correct", "test_point": "TP7"}, FaultCode.INVALID_REQUEST, "id"),
    ({"op": "correct", "id": "", "test_point": "TP7"}, FaultCode.INVALID_REQUEST, "id"),
    ({"op": "correct", "id": "x" * 129, "test_point": "TP7"}, FaultCode.INVALID_REQUEST, "id"),
    ({"op": "correct", "id": "a", "test_point": "../etc/passwd\x00"}, FaultCode.INVALID_REQUEST, "test_point"),
    ({"op": "correct", "id": "a", "test_point": "TP7", "speed": 9}, FaultCode.INVALID_REQUEST, "speed"),
    ({"op": "place", "id": "a"}, FaultCode.INVALID_REQUEST, ""),
    ({"op": "results", "since": 2**63}, FaultCode.INVALID_REQUEST, "since"),
    ({"op": "alerts", "since": 2**63}, FaultCode.INVALID_REQUEST, "since"),
    (
        {"op": "place", "id": "a", "test_point": "TP7", "theta_deg": float("nan")},
        FaultCode.INVALID_REQUEST,
        "theta_deg",
    ),
    ({"op": "place", "id": "a", "board_um": [1e300, 0]}, FaultCode.INVALID_REQUEST, "board_um"),
    ({"op": "calibrate", "id": "a", "what": "tip"}, FaultCode.INVALID_REQUEST, ""),
    ({"op": "calibrate", "id": "a", "what": "everything"}, FaultCode.INVALID_REQUEST, "what"),
    ({"op": "calibrate", "id": "a", "what": "rotation", "angles": 5}, FaultCode.INVALID_REQUEST, "angles"),
    ({"op": "calibrate", "id": "a", "what": "rotation", "angles": 9, "every_deg": 2}, FaultCode.INVALID_REQUEST, ""),
    ({"op": "align", "id": "a", "fiducials": ["FID1", "FID2"]}, FaultCode.INVALID_REQUEST, "fiducials"),
    ({"op": "align", "id": "a", "thetas_deg": [400.0]}, FaultCode.INVALID_REQUEST, "thetas_deg"),
    ({"op": "status", "deadline_ms": "soon"}, FaultCode.INVALID_REQUEST, "deadline_ms"),
]


@pytest.mark.parametrize("raw", [*EXAMPLES, *GOOD], ids=lambda raw: raw["op"])
def test_good_requests_are_understood(raw: dict[str, Any]) -> None:
    request = OPERATIONS.parse(raw)
    assert request.op == raw["op"]
    assert all(
        getattr(request, key) in (value, tuple(value) if isinstance(value, list) else value)
        for key, value in raw.items()
    )


@pytest.mark.parametrize(("raw", "kind", "field"), BAD)
def test_bad_requests_are_refused_by_name(raw: Any, kind: FaultCode, field: str) -> None:
    with pytest.raises(Fault) as caught:
        OPERATIONS.parse(raw)
    assert caught.value.kind is kind
    if field:
        assert any(f["field"].startswith(field) for f in caught.value.detail["fields"])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=10,
)


@given(st.dictionaries(st.sampled_from(["v", "op", "id", "test_point", "wait", "deadline_ms", "x"]), JSON))
def test_any_json_is_a_request_or_a_fault(raw: dict[str, Any]) -> None:
    try:
        answer = OPERATIONS.parse(raw).model_dump(mode="json")
    except Fault as fault:
        answer = ErrorBody.of(fault).model_dump(mode="json")
    json.dumps(answer)
    assert answer.get("op") in OPERATIONS.ops or answer["code"] in {k.code for k in FaultCode}


def test_wait_and_deadline_are_not_part_of_what_is_asked() -> None:
    """The same work asked for with another patience is the same job."""
    exclude = {"wait", "deadline_ms"}
    one = OPERATIONS.parse({"op": "correct", "id": "a", "test_point": "TP7"})
    two = OPERATIONS.parse({"op": "correct", "id": "a", "test_point": "TP7", "wait": True, "deadline_ms": 7})
    assert isinstance(one, Correct)
    assert one.model_dump_json(exclude=exclude) == two.model_dump_json(exclude=exclude)
    assert not isinstance(one, Place)


def test_codes_and_names_are_unique_and_in_their_ranges() -> None:
    assert len({k.code for k in FaultCode}) == len(FaultCode)
    assert {k.code // 1000 for k in FaultCode} == {1, 2, 3, 4, 5, 9}
    assert FaultCode.TIP_NOT_FOUND.code == 2101
