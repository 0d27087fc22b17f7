"""Fuzzed messages: good requests of every operation, and what chance makes of them."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from typing import Any

JOB_SHARE = 0.003
"""So many are jobs as they should be; more would only wait for each other."""
GOOD: tuple[dict[str, Any], ...] = (
    {"op": "status"},
    {"op": "snapshot"},
    {"op": "describe"},
    {"op": "result", "id": "fuzz-0"},
    {"op": "results", "since": 0, "limit": 3},
    {"op": "alerts", "since": 0, "limit": 3},
    {"op": "acknowledge", "alert": "needle_worn"},
    {"op": "report", "id": "fuzz-0", "retest": "pass", "touches": 1},
    {"op": "cancel"},
    {"op": "cancel", "id": "fuzz-1"},
    {"op": "correct", "id": "c", "test_point": "TP1", "deadline_ms": 1.0},
    {"op": "place", "id": "p", "test_point": "TP99", "theta_deg": 0.0},
    {"op": "align", "id": "a", "fiducials": ["FID1", "FID9", "FID8"]},
    {"op": "calibrate", "id": "k", "what": "tip", "tip_px": [-1.0, 1e9]},
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 2**200, 0.1, -1e308, 1e308, "", "x", "yes", "5000", "\x00",
    "\x1b[2J", "=1+1", "../../etc/passwd", "é" * 70, "a" * 5000, [], [[]], {}, {"a": {"b": [None]}}, [1] * 1000,
)  # fmt: skip
RAW = (
    b"", b"{", b"[]", b"null", b"\xff\xfe\x00", b"[" * 20_000, b'{"op":' * 500, b'{"op": NaN}', b'{"op":"status"}{}',
    b'{"op":"status","op":"describe"}', b'{"v":9,"op":"status"}', b" " * 100_000,
    b'{"op":"status","x":"' + b"a" * 1_100_000,
)  # fmt: skip
BIG_SHARE = 0.02
"""Large raw messages come less often: they cost more than they show."""


def messages(chance: random.Random, job: Callable[[str], dict[str, Any]]) -> Iterator[bytes]:
    """Yield without end; `job` makes a good request of an operation."""
    made: list[bytes] = []
    while True:
        dice = chance.random()
        if dice < JOB_SHARE:
            request = job(chance.choice(("place", "place", "place", "look", "home", "lift", "reset")))
            if request["op"] != "reset" and chance.random() < 0.2:
                request["deadline_ms"] = chance.choice((1.0, 200.0, 1000.0))
            made.append(json.dumps(request).encode())
            yield made[-1]
        elif dice < 2 * JOB_SHARE and made:
            yield chance.choice(made[-30:])
        elif dice < 0.12:
            raw = chance.choice(RAW)
            yield raw if len(raw) < 10_000 or chance.random() < BIG_SHARE else raw[:100]
        elif dice < 0.5:
            yield _bytes(chance, json.dumps(chance.choice(GOOD)).encode())
        else:
            yield json.dumps(_fields(chance, dict(chance.choice(GOOD)))).encode()


def _fields(chance: random.Random, request: dict[str, Any]) -> dict[str, Any]:
    """Change, drop or add a few fields."""
    for _ in range(chance.randint(0, 3)):
        name = chance.choice([*request, "v", "tag", "wait", "deadline_ms", "extra", "theta_deg", "board_um"])
        if chance.random() < 0.3:
            request.pop(name, None)
        else:
            request[name] = chance.choice(VALUES)
    return request


def _bytes(chance: random.Random, text: bytes) -> bytes:
    """Cut, double or flip a few bytes."""
    changed = bytearray(text)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(changed) + 1)
        match chance.randrange(4):
            case 0:
                changed[at : at + chance.randint(1, 5)] = b""
            case 1:
                changed[at:at] = bytes([chance.randrange(256)])
            case 2:
                changed[at:at] = changed[at : at + chance.randint(1, 9)]
            case _ if at < len(changed):
                changed[at] ^= 1 << chance.randrange(8)
    return bytes(changed)
