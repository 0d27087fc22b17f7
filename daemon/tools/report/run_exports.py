"""Exports of a run for other programs: CSV, JSON lines and JUnit XML."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any, Final
from xml.etree import ElementTree as ET

from daemon.domain.point_test import PointVerdict
from daemon.platform.finite_json import to_json
from daemon.platform.spreadsheet import plain_cell
from daemon.tools.report.run_facts import RunReport, Tested

_NO_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
FAILURES: Final = frozenset({PointVerdict.FAIL, PointVerdict.OPEN_CONFIRMED})
"""The board is to blame."""
ERRORS: Final = frozenset({PointVerdict.CONTACT_NOT_MADE})
"""Nobody knows what is to blame."""


def flat_rows(report: RunReport) -> Iterator[dict[str, Any]]:
    """Yield each test as one flat row of text and numbers; every row says by itself of which run and plan it is."""
    run = report.run
    whole = {
        "run": run.id, "board": run.board.name, "board_id": run.board_id, "plan": run.plan.name,
        "plan_version": run.plan_version, "plan_hash": run.plan_hash, "station": run.station, "software": run.software,
    }  # fmt: skip
    for tested in report.tested:
        record, limits = tested.record, tested.test.limits
        yield whole | {
            "point": tested.test.point, "net": tested.test.net, "method": tested.test.method,
            "low": limits.low if limits else None, "high": limits.high if limits else None,
            "unit": limits.unit if limits else None, "verdict": record.verdict.value if record else None,
            "reason": record.reason if record else None,
            "recovered_by": record.recovered_by.value if record and record.recovered_by else None,
            "cause": record.cause.value if record and record.cause else None,
            "first_value": record.first_value if record else None, "last_value": record.last_value if record else None,
            "touches": record.touches if record else None, "presses": record.presses if record else None,
            "looks": record.looks if record else None, "error_um": record.error_um if record else None,
            "sigma_um": record.sigma_um if record else None, "seconds": record.seconds if record else None,
            "at": record.at if record else None, "x_um": tested.place.x_um, "y_um": tested.place.y_um,
            "theta_deg": tested.place.theta_deg,
        }  # fmt: skip


def to_csv(report: RunReport) -> str:
    """Return the run as CSV with a line of names; a text that a spreadsheet would take for a formula gets a quote."""
    rows = list(flat_rows(report))
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: plain_cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue()


def to_json_lines(report: RunReport) -> str:
    """Return the records as they are, one JSON object a line, each with the run and the plan it belongs to."""
    run = report.run
    whole = {
        "run": run.id, "board": run.board.name, "plan": run.plan.name, "plan_version": run.plan_version,
        "plan_hash": run.plan_hash, "station": run.station, "software": run.software, "calibrated": run.calibrated,
    }  # fmt: skip
    records = [tested.record for tested in report.tested if tested.record is not None]
    return "".join(to_json(record.model_dump(mode="json") | whole) + "\n" for record in records)


def to_junit(report: RunReport) -> str:
    """Return the run as JUnit XML: a test case a point; fail and open are failures, no contact is an error."""
    run, tested = report.run, report.tested
    verdicts = [one.record.verdict if one.record else None for one in tested]
    counts = {
        "tests": str(len(tested)),
        "failures": str(sum(verdict in FAILURES for verdict in verdicts)),
        "errors": str(sum(verdict in ERRORS for verdict in verdicts)),
        "skipped": str(sum(verdict in (None, PointVerdict.NOT_TESTED) for verdict in verdicts)),
        "time": f"{report.summary.seconds:.3f}",
    }
    root = ET.Element("testsuites", {"name": "reprobe", **{key: counts[key] for key in counts if key != "skipped"}})
    suite = ET.SubElement(
        root, "testsuite",
        {"id": "0", "package": _xml(run.board.name), "name": _xml(f"{run.plan.name} on {run.board_id}"),
         "timestamp": _moment(run.begun_at), "hostname": _xml(run.station), **counts},
    )  # fmt: skip
    properties = ET.SubElement(suite, "properties")
    facts = {"run": run.id, "board_id": run.board_id, "plan_hash": run.plan_hash, "software": run.software}
    for name, value in {**facts, **{f"calibrated.{kind}": at for kind, at in run.calibrated.items()}}.items():
        ET.SubElement(properties, "property", {"name": _xml(name), "value": _xml(value)})
    for one in tested:
        _case(suite, one, run.board.name)
    ET.SubElement(suite, "system-out")
    ET.SubElement(suite, "system-err")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _case(suite: ET.Element, tested: Tested, board: str) -> None:
    test, record = tested.test, tested.record
    seconds = f"{record.seconds:.3f}" if record else "0.000"
    named = {"name": _xml(f"{test.point} {test.method}"), "classname": _xml(f"{board}.{test.net or test.point}")}
    case = ET.SubElement(suite, "testcase", named | {"time": seconds})
    if record is None or record.verdict is PointVerdict.NOT_TESTED:
        ET.SubElement(case, "skipped", {"message": _xml(record.reason if record else "the run has not come to it")})
    elif record.verdict in FAILURES | ERRORS:
        said = f"{tested.style.words}: first {tested.first or '-'}, last {tested.last or '-'}; {tested.limits or '-'}"
        kind = "failure" if record.verdict in FAILURES else "error"
        ET.SubElement(case, kind, {"type": record.verdict.value, "message": _xml(said)}).text = _xml(record.reason)


def _xml(text: str) -> str:
    """Return a text without the characters that XML cannot hold at all."""
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def _moment(at: str) -> str:
    """Return a moment as JUnit's schema has it: UTC, whole seconds, no zone."""
    return datetime.fromisoformat(at).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
