"""Whatever is wrong with a request gets its own clear error; nothing moves, and the daemon goes on."""

import json
import time
from typing import Any

import pytest

from daemon.client import Client
from tests.station.rig import EVENTUALLY_S, Rig

BAD: list[tuple[str, bytes, str]] = [
    ("malformed JSON", b'{"op": "correct"', "bad_json"),
    ("not an object", b"[1, 2]", "bad_json"),
    ("not UTF-8", b"\xff\xfe\x00", "bad_json"),
    ("deeply nested", b"[" * 100_000, "bad_json"),
    ("10 MB", b'{"op":"status","x":"' + b"a" * 10_000_000 + b'"}', "message_too_large"),
    ("unknown op", b'{"op": "explode"}', "unknown_op"),
    ("unknown version", b'{"v": 9, "op": "status"}', "unsupported_version"),
    ("unknown field", b'{"op": "status", "speed": 3}', "invalid_request"),
    ("no id", b'{"op": "correct", "test_point": "TP1"}', "invalid_request"),
    ("unknown test point", b'{"op": "correct", "id": "u1", "test_point": "TP99"}', "unknown_test_point"),
    ("a fiducial", b'{"op": "correct", "id": "u2", "test_point": "FID1"}', "unknown_test_point"),
    ("stale deadline", b'{"op": "correct", "id": "u3", "test_point": "TP1", "deadline_ms": -1}', "stale_deadline"),
    ("deadline in 1970", b'{"op": "correct", "id": "u4", "test_point": "TP1", "deadline_ms": 1e11}', "stale_deadline"),
    ("unknown job", b'{"op": "result", "id": "never"}', "unknown_job"),
    ("nothing to cancel", b'{"op": "cancel"}', "unknown_job"),
    ("report of no job", b'{"op": "report", "id": "never", "retest": "pass"}', "unknown_job"),
]


@pytest.mark.parametrize(("what", "message", "name"), BAD, ids=[row[0] for row in BAD])
def test_a_bad_request_is_answered_by_name(rig: Rig, client: Client, what: str, message: bytes, name: str) -> None:
    before = rig.truth()["axes"]
    reply = client.raw(message, timeout_s=EVENTUALLY_S)
    assert reply["ok"] is False
    assert reply["error"]["name"] == name
    assert reply["error"]["advice"]
    assert rig.truth()["axes"] == before
    assert client.request("status")["state"] == "idle"


REFUSED_JOBS: list[tuple[str, dict[str, Any], str]] = [
    ("elsewhere", {"op": "correct", "test_point": "TP11"}, "not_at_test_point"),
    ("forbidden angle", {"op": "place", "test_point": "TP1", "theta_deg": 120.0}, "outside_envelope"),
    ("outside", {"op": "place", "board_um": [400_000.0, 0.0]}, "outside_envelope"),
    ("late", {"op": "place", "test_point": "TP2", "deadline_ms": 1.0}, "stale_deadline"),
]


@pytest.mark.parametrize(("what", "fields", "name"), REFUSED_JOBS, ids=[row[0] for row in REFUSED_JOBS])
def test_a_job_that_must_not_run_is_refused(
    rig: Rig, client: Client, what: str, fields: dict[str, Any], name: str
) -> None:
    client.job("place", test_point="TP1", theta_deg=0.0)
    before = rig.truth()["axes"]
    reply = client.raw(json.dumps({"v": 1, "id": f"refused {what}", "wait": True, **fields}).encode())
    error = reply["error"] if not reply["ok"] else reply["result"]["error"]
    assert error["name"] in (name, "deadline_missed" if name == "stale_deadline" else name)
    assert rig.truth()["axes"] == before
    assert client.request("status")["state"] == "idle"


def test_a_far_deadline_in_unix_time_is_good(client: Client) -> None:
    result = client.job("look", deadline_ms=(time.time() + 60.0) * 1e3)
    assert result.ok, result.error
