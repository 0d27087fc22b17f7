"""A tester that measures itself is held for by `reprobe probe --measure tester`, and tells each press in a line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, Self

import pytest
from typer.testing import CliRunner

from daemon.cli import probe_tester
from daemon.cli.app import app
from daemon.cli.probe_tester import Lines, as_measured

RESULT = {
    "id": "p", "op": "probe", "ok": False, "seq": 7, "station": "s", "finished_at": "2026-01-01T00:00:00.000+00:00",
    "outcome": "failed", "test_point": "TP1", "looks": 0, "moves": 0,
    "error": {"code": 6001, "name": "any", "message": "any", "advice": "any", "detail": {}},
}  # fmt: skip


@pytest.mark.parametrize(("line", "unit", "told"), [
    ("pass", "ohm", {"verdict": "pass"}), (" OPEN ", "ohm", {"verdict": "open"}), ("fail", None, {"verdict": "fail"}),
    ("0.4", "ohm", {"value": 0.4, "unit": "ohm"}), ("1.2e3 ohms", "ohm", {"value": 1200.0, "unit": "ohm"}),
    ("2.5 mohm", "ohm", {"value": 0.0025, "unit": "ohm"}), ("4.7kohm", "ohm", {"value": 4700.0, "unit": "ohm"}),
    ("-3.3V", "V", {"value": -3.3, "unit": "V"}), ("", None, {}),
])  # fmt: skip
def test_a_line_tells_a_word_or_a_value(line: str, unit: str | None, told: dict[str, Any]) -> None:
    assert as_measured(line, unit) == told


@pytest.mark.parametrize(("line", "unit"), [
    ("", "ohm"), ("good", "ohm"), ("3 V", "ohm"), ("3 bananas", "ohm"),
    ("nan", "ohm"), ("1.2.3", "ohm"), ("1e999", "ohm"), ("0.4", None),
])  # fmt: skip
def test_another_line_is_nothing_that_was_measured(line: str, unit: str | None) -> None:
    with pytest.raises(ValueError, match="type pass, fail"):
        as_measured(line, unit)


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    """The two ends of a pipe; a test may close one."""
    ends = os.pipe()
    yield ends
    for end in ends:
        with suppress(OSError):
            os.close(end)


def test_lines_that_come_at_once_are_told_one_by_one_and_the_last_needs_no_end(pipe: tuple[int, int]) -> None:
    lines = Lines(pipe[0])
    assert lines.next(0.0) is None
    os.write(pipe[1], b"open\npa")
    assert lines.next(0.0) == "open"
    assert lines.next(0.0) is None
    os.write(pipe[1], b"ss\nfail")
    os.close(pipe[1])
    assert [lines.next(1.0) for _ in range(2)] == ["pass", "fail"]
    with pytest.raises(EOFError):
        lines.next(1.0)


class _Daemon:
    """Stands for a client of a daemon whose needle stands twice."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.held = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def request(self, op: str, **fields: Any) -> dict[str, Any]:
        self.asked.append({"op": op, **fields})
        presses = sum(one["op"] in ("probe", "lift") for one in self.asked)
        contact = {"id": "p", "test_point": "TP1", "pressed_um": 300.0, "force_n": 0.7, "press": presses}
        return {"contact": contact} if presses < 3 else {"result": RESULT}

    def hold(self, _job: str, _lease_ms: float) -> None:
        self.held += 1


def _probed(monkeypatch: pytest.MonkeyPatch, pipe: tuple[int, int], *words: str) -> tuple[_Daemon, Any]:
    daemon = _Daemon()
    monkeypatch.setattr(probe_tester, "Client", lambda *_, **__: daemon)
    monkeypatch.setattr(probe_tester, "sys", SimpleNamespace(stdin=SimpleNamespace(fileno=lambda: pipe[0])))
    return daemon, CliRunner().invoke(app, ["probe", "TP1", "--measure", "tester", "--id", "p", *words])


def test_each_press_is_told_by_its_own_line_and_what_is_no_measurement_is_asked_again(
    monkeypatch: pytest.MonkeyPatch, pipe: tuple[int, int]
) -> None:
    os.write(pipe[1], b"opne\nopen\n0.4 ohm\n")
    daemon, done = _probed(monkeypatch, pipe)
    lifts = [one for one in daemon.asked if one["op"] == "lift"]
    assert [(one["press"], one.get("verdict"), one.get("value")) for one in lifts] == [
        (1, "open", None),
        (2, None, 0.4),
    ]
    assert "'opne' is nothing that was measured" in done.stderr
    assert daemon.asked[1]["measure"] == "tester"
    assert done.exit_code == 3, "it ended in an error: nothing is known of the net"


def test_the_lease_is_renewed_while_nothing_is_said(monkeypatch: pytest.MonkeyPatch, pipe: tuple[int, int]) -> None:
    said = iter([None, None, "pass", None, "pass"])
    monkeypatch.setattr(Lines, "next", lambda *_: next(said))
    daemon, _ = _probed(monkeypatch, pipe)
    assert daemon.held == 3


def test_where_no_line_comes_the_needle_is_lifted_with_nothing_said(
    monkeypatch: pytest.MonkeyPatch, pipe: tuple[int, int]
) -> None:
    os.close(pipe[1])
    daemon, done = _probed(monkeypatch, pipe)
    lift = next(one for one in daemon.asked if one["op"] == "lift")
    assert not {"verdict", "value"} & lift.keys()
    assert done.exit_code == 3


def test_ctrl_c_lifts_and_is_no_verdict(monkeypatch: pytest.MonkeyPatch, pipe: tuple[int, int]) -> None:
    def interrupted(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(Lines, "next", interrupted)
    daemon, done = _probed(monkeypatch, pipe)
    assert daemon.asked[-1] == {"op": "cancel", "id": "p"}
    assert done.exit_code == 3


@pytest.mark.parametrize(("measure", "code"), [("station", 2), ("tester", 3)])
def test_only_a_tester_inserts_faults(
    monkeypatch: pytest.MonkeyPatch, pipe: tuple[int, int], measure: str, code: int
) -> None:
    os.close(pipe[1])
    _, done = _probed(monkeypatch, pipe, "--method", "insert", "--measure", measure)
    assert done.exit_code == code
