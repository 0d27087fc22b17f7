"""What arrives is understood whole or refused by name; whatever arrives, nothing else happens."""

import json
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from daemon.wire.docs import examples as wire_examples
from daemon.wire.limits import MAX_FIELDS, MAX_LISTED
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
    {"op": "status", "tag": "17"},
    {"op": "results", "since": 3.0, "limit": 5.0},
    {"op": "calibrate", "id": "a", "what": "rotation", "angles": 24.0},
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
    ({"op": "status", "deadline_ms": "5000"}, FaultCode.INVALID_REQUEST, "deadline_ms"),
    ({"op": "status", "deadline_ms": True}, FaultCode.INVALID_REQUEST, "deadline_ms"),
    ({"op": "status", "tag": 7}, FaultCode.INVALID_REQUEST, "tag"),
    ({"op": "status", "tag": "x" * 129}, FaultCode.INVALID_REQUEST, "tag"),
    ({"op": "home", "id": "a", "wait": "yes"}, FaultCode.INVALID_REQUEST, "wait"),
    ({"op": "home", "id": "a", "wait": 1}, FaultCode.INVALID_REQUEST, "wait"),
    ({"op": "home", "id": 17}, FaultCode.INVALID_REQUEST, "id"),
    ({"op": "look", "id": "a", "pictures": "on"}, FaultCode.INVALID_REQUEST, "pictures"),
    ({"op": "place", "id": "a", "test_point": "TP7", "theta_deg": "45"}, FaultCode.INVALID_REQUEST, "theta_deg"),
    ({"op": "place", "id": "a", "board_um": ["1", 2]}, FaultCode.INVALID_REQUEST, "board_um.0"),
    ({"op": "place", "id": "a", "board_um": [True, 2]}, FaultCode.INVALID_REQUEST, "board_um.0"),
    ({"op": "place", "id": "a", "board_um": {"0": 1, "1": 2}}, FaultCode.INVALID_REQUEST, "board_um"),
    ({"op": "align", "id": "a", "thetas_deg": ["0"]}, FaultCode.INVALID_REQUEST, "thetas_deg.0"),
    ({"op": "align", "id": "a", "fiducials": [1, 2, 3]}, FaultCode.INVALID_REQUEST, "fiducials.0"),
    ({"op": "calibrate", "id": "a", "what": "rotation", "angles": "24"}, FaultCode.INVALID_REQUEST, "angles"),
    ({"op": "calibrate", "id": "a", "what": "surface", "places": 6.5}, FaultCode.INVALID_REQUEST, "places"),
    ({"op": "results", "since": "3"}, FaultCode.INVALID_REQUEST, "since"),
    ({"op": "results", "limit": True}, FaultCode.INVALID_REQUEST, "limit"),
    ({"op": "report", "touches": "20"}, FaultCode.INVALID_REQUEST, "touches"),
    ({"op": "acknowledge", "alert": "a", "by": "Kim", "mended": "true"}, FaultCode.INVALID_REQUEST, "mended"),
]


@pytest.mark.parametrize("raw", [*EXAMPLES, *GOOD], ids=lambda raw: raw["op"])
def test_good_requests_are_understood(raw: dict[str, Any]) -> None:
    request = OPERATIONS.parse(raw)
    assert request.op == raw["op"]
    understood = {**request.model_dump(mode="json", exclude_unset=True), "v": request.v, "tag": request.tag}
    assert understood == {"v": 1, "tag": None, **raw}


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
    assert {k.code // 1000 for k in FaultCode} == {1, 2, 3, 4, 5, 6, 9}
    assert FaultCode.TIP_NOT_FOUND.code == 2101


def test_no_more_bad_fields_are_listed_than_a_person_reads_and_their_names_are_cut() -> None:
    raw = {"op": "status", **{f"{n}" + "x" * 10_000: 0 for n in range(MAX_FIELDS - 1)}}
    with pytest.raises(Fault) as caught:
        OPERATIONS.parse(raw)
    assert len(caught.value.detail["fields"]) == MAX_LISTED
    assert caught.value.detail["more"] == MAX_FIELDS - 1 - MAX_LISTED
    assert len(json.dumps(ErrorBody.of(caught.value).model_dump())) < 4000


def test_of_a_request_with_too_many_fields_none_is_looked_at() -> None:
    class Untouched(dict[str, Any]):
        """A request of which the test sees what is looked at."""

        looked_at: ClassVar[set[str]] = set()

        def get(self, key: str, default: Any = None) -> Any:
            self.looked_at.add(key)
            return super().get(key, default)

        def items(self) -> Any:
            raise AssertionError("its fields are validated")

        __iter__ = keys = values = items

    raw = Untouched({"op": "status", **{f"f{n}": 0 for n in range(MAX_FIELDS)}})
    with pytest.raises(Fault, match=f"{MAX_FIELDS + 1} fields") as caught:
        OPERATIONS.parse(raw)
    assert caught.value.kind is FaultCode.INVALID_REQUEST
    assert raw.looked_at == {"v", "op"}


@pytest.mark.parametrize("field", ["v", "op"])
def test_a_huge_value_where_a_word_belongs_is_refused_in_a_few_words(field: str) -> None:
    for huge in (["x" * 1000] * 1000, {"a": {"b": ["c"] * 10_000}}, "x" * 100_000, _deep(900)):
        with pytest.raises(Fault) as caught:
            OPERATIONS.parse({"op": "status", field: huge})
        assert caught.value.kind in (FaultCode.UNKNOWN_OP, FaultCode.UNSUPPORTED_VERSION)
        assert len(caught.value.message) < 200


def _deep(levels: int) -> Any:
    value: Any = []
    for _ in range(levels):
        value = [value]
    return value


def test_the_tag_is_no_part_of_what_a_job_is_asked_to_do() -> None:
    """It should leave what is kept of a request as it was before there were tags."""
    once, again = (OPERATIONS.parse({"op": "home", "id": "a", **more}) for more in ({}, {"tag": "2", "wait": True}))
    assert once.model_dump_json(exclude={"wait", "deadline_ms"}) == again.model_dump_json(
        exclude={"wait", "deadline_ms"}
    )
    assert json.loads(once.model_dump_json(exclude={"wait", "deadline_ms"})) == {"v": 1, "op": "home", "id": "a"}
