"""`reprobe probe --measure tester`: the needle is held at each press until a line tells what was measured in it."""

from __future__ import annotations

import math
import os
import re
import select
import sys
import uuid
from typing import Any, cast

from daemon.cli.interruption import taken_as_ctrl_c
from daemon.cli.output import err, out, say_json
from daemon.client import Client, NoAnswer, Refused
from daemon.config.plan_units import parse_value
from daemon.domain.point_test import TESTER_WORDS, UNIT_OF_METHOD, PointUnit
from daemon.domain.results import JobResult

LEASE_MS, RENEW_S, HOLD_MS = 2000.0, 0.5, 600_000.0
ANSWER_WITHIN_S = 5.0
_VALUE = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(\S*)", re.IGNORECASE)
_CHUNK = 4096


class Lines:
    """Lines that come by a file descriptor, each waited for with a time limit."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self._over = False

    def next(self, within_s: float) -> str | None:
        """Return the next line, None if none comes in time; raise EOFError where none will come."""
        if b"\n" not in self._rest and not self._over:
            ready, _, _ = select.select([self._descriptor], [], [], within_s)
            if not ready:
                return None
            more = os.read(self._descriptor, _CHUNK)
            self._rest, self._over = self._rest + more, not more
        if b"\n" not in self._rest and not self._over:
            return None
        if self._over and not self._rest:
            raise EOFError
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode(errors="replace").strip()


def probe_for_tester(
    endpoint: str, job_id: str | None, timeout_s: float, given: dict[str, Any], *, as_json: bool
) -> JobResult:
    """Test a point that the caller measures, and return the result; Ctrl-C, which lifts the needle, goes on up."""
    asked = {"lease_ms": LEASE_MS, "hold_ms": HOLD_MS, **given, "measure": "tester", "wait": "contact"}
    asked["id"] = job_id or f"probe-{uuid.uuid4().hex[:12]}"
    try:
        with taken_as_ctrl_c(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
            client.request("status")
            return _to_its_end(client, asked, timeout_s, as_json=as_json)
    except KeyboardInterrupt:
        _cancel(endpoint, asked["id"])
        raise


def _to_its_end(client: Client, asked: dict[str, Any], timeout_s: float, *, as_json: bool) -> JobResult:
    lines, unit = Lines(sys.stdin.fileno()), UNIT_OF_METHOD[asked["method"]]
    reply = client.request("probe", timeout_s=timeout_s, **asked)
    while reply.get("result") is None:
        contact = reply["contact"]
        _tell(contact, unit, as_json=as_json)
        said = _said(client, contact["id"], lines, unit)
        press = {"press": contact["press"]} if "press" in contact else {}
        reply = client.request("lift", id=contact["id"], timeout_s=timeout_s, **press, **said)
    return JobResult.model_validate(reply["result"])


def _tell(contact: dict[str, Any], unit: str | None, *, as_json: bool) -> None:
    """Say that the needle stands, and what is waited for."""
    if as_json:
        say_json({"contact": contact})
        return
    wanted = "Enter lifts it" if unit is None else f"measure, then type pass, fail, open, or a value in {unit}"
    out.print(
        f"the needle stands on {contact['test_point']}: pushed in by {contact['pressed_um']:.0f} um, "
        f"{contact['force_n']:.2f} N (press {contact.get('press', 1)}); {wanted}",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip


def _said(client: Client, job_id: str, lines: Lines, unit: str | None) -> dict[str, Any]:
    """Return what is told of a press, while its lease is renewed; nothing where no line will come."""
    while True:
        try:
            line = lines.next(RENEW_S)
        except EOFError:
            return {}
        if line is None:
            client.hold(job_id, LEASE_MS)
            continue
        try:
            return as_measured(line, unit)
        except ValueError as exc:
            err.print(str(exc), highlight=False, markup=False, soft_wrap=True)


def as_measured(line: str, unit: str | None) -> dict[str, Any]:
    """Return what a line tells, as `lift` has it: a word, or a value in the unit itself; ValueError for another.

    A value without a unit is in that of the method; one with a prefix, such as 2.5 mohm, is converted.
    """
    word = line.strip().lower()
    if unit is None and not word:
        return {}
    if word in TESTER_WORDS:
        return {"verdict": word}
    found = _VALUE.fullmatch(line.strip()) if unit is not None else None
    value = _number(found[1]) if found is not None else math.nan
    if found is None or not math.isfinite(value):
        known = "press Enter, or type pass, fail or open" if unit is None else f"type pass, fail, open, or 0.4 {unit}"
        raise ValueError(f"{line[:60]!r} is nothing that was measured: {known}")
    if not found[2]:
        return {"value": value, "unit": str(unit)}
    try:
        return {"value": parse_value(line.strip(), cast("PointUnit", unit)), "unit": str(unit)}
    except ValueError as exc:
        raise ValueError(f"{exc}; or type pass, fail, open") from exc


def _number(said: str) -> float:
    try:
        return float(said)
    except ValueError:
        return math.nan


def _cancel(endpoint: str, job_id: str) -> None:
    """Have the needle lifted, by a connection of its own: the other one may wait for an answer."""
    err.print("lifting ...")
    try:
        with Client(endpoint, timeout_s=ANSWER_WITHIN_S) as another:
            another.request("cancel", id=job_id)
    except Refused:
        return  # it has ended
    except NoAnswer:
        err.print("[red]the daemon does not answer; its lease lifts the needle[/]")
