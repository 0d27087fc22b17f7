"""A run's report says the same in a page, CSV, JSON lines and JUnit XML, and can be read by whoever has to."""

from __future__ import annotations

import csv
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from daemon.domain.board_run import BoardRun, summarise
from daemon.domain.point_test import Cause, PointRecord, PointVerdict, Rung
from daemon.jobs import image_archive
from daemon.storage.journal import Journal
from daemon.tools.report.run_exports import to_csv, to_json_lines, to_junit
from daemon.tools.report.run_facts import NoRun, RunReport, caption_of, read_run, report_of
from daemon.tools.report.run_page import write_run
from tests.daemon.domain.test_board_run import a_record, a_run

POINTS = ("A", "B", "C", "D", "E", "F", "G")


def _records(pictures: Path | None = None) -> list[PointRecord]:
    kept = str(pictures) if pictures else None
    return [
        a_record("A", PointVerdict.PASS_FIRST),
        a_record("B", PointVerdict.PASS_RECOVERED, 2, recovered_by=Rung.LOOK, cause=Cause.MISPLACED, looks=2,
                 error_um=287.0, pictures=kept),
        a_record("C", PointVerdict.FAIL, 2),
        a_record("D", PointVerdict.OPEN_CONFIRMED, 2, reason="both sites"),
        a_record("E", PointVerdict.CONTACT_NOT_MADE, 3, reason="budget spent"),
        a_record("F", PointVerdict.NOT_TESTED, 0, reason="out of reach"),
    ]  # fmt: skip


@pytest.fixture
def run() -> BoardRun:
    return a_run(POINTS, summary=summarise(7, _records(), [0.3, 0.4]))


@pytest.fixture
def report(run: BoardRun) -> RunReport:
    return report_of(run, _records())


class _Page(HTMLParser):
    """Collects links, ids, letters of marks, and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: list[str] = []
        self.classes: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, _tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.links += [value for name in ("href", "src") if (value := given.get(name))]
        self.ids += [given["id"] or ""] if "id" in given else []
        self.classes += (given.get("class") or "").split()

    def handle_data(self, data: str) -> None:
        self.text += data


def test_each_point_stands_on_the_map_and_in_the_table_with_the_letter_of_its_verdict(
    report: RunReport, tmp_path: Path
) -> None:
    text = write_run(report, tmp_path).read_text()
    marks = re.findall(r'href="#p(\d)"><g class="mark v-(\w+)">.*?<text[^>]*>(.)</text>', text)
    assert sorted(marks) == [
        ("1", "first", "P"), ("2", "recovered", "R"), ("3", "fail", "F"), ("4", "open", "O"), ("5", "contact", "C"),
        ("6", "none", "N"), ("7", "left", "-"),
    ]  # fmt: skip
    page = _Page(text)
    assert [f"p{n}" for n in range(1, 8)] == [name for name in page.ids if name.startswith("p")]
    assert {link for link in page.links if link.startswith("#")} == {f"#p{n}" for n in range(1, 8)}
    assert "unfinished" in page.text
    assert "1 false open recovered (1 by look)" in page.text
    assert "287 um off" in page.text


def test_the_map_has_y_upwards_as_the_board_has(run: BoardRun, tmp_path: Path) -> None:
    low, high = run.places[0], run.places[1].model_copy(update={"y_um": 39_000.0})
    text = write_run(
        report_of(run.model_copy(update={"places": (low, high, *run.places[2:])}), []), tmp_path
    ).read_text()
    places = {n: float(y) for n, y in re.findall(r'href="#p(\d)">.*?<circle cx="[^"]*" cy="([^"]*)"', text)}
    assert places["2"] < places["1"]


def test_pictures_of_what_was_recovered_lie_beside_the_page(run: BoardRun, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "before-board.jpg").write_bytes(b"one")
    (kept / "after-board.jpg").write_bytes(b"two")
    (kept / "before-landing.jpg").write_bytes(b"where it came down")
    (kept / "after-red.jpg").write_bytes(b"nothing is drawn in it")
    (kept / "result.json").write_text("{}")
    out = tmp_path / "out"
    page = _Page(write_run(report_of(run, _records(kept)), out).read_text())
    linked = list(dict.fromkeys(link for link in page.links if link.startswith("pictures/")))
    names = ("before-landing", "before-board", "after-board")
    assert linked == [f"pictures/0002-B/{name}.jpg" for name in names]
    assert (out / "pictures/0002-B/before-board.jpg").read_bytes() == b"one"
    assert "First look: where the needle came down" in page.text
    assert "before-" not in page.text


def test_every_picture_that_the_daemon_keeps_is_captioned_in_words() -> None:
    for name in (f"{look}-{kind}" for look in image_archive.LOOKS for kind in image_archive.KINDS):
        assert name not in caption_of(Path(f"{name}.jpg"))
    assert caption_of(Path("somebody's.png")) == "somebody's"


def test_everything_the_page_links_is_there(report: RunReport, tmp_path: Path) -> None:
    page = _Page(write_run(report, tmp_path).read_text())
    files = [link for link in page.links if not link.startswith("#")]
    assert {"points.csv", "points.jsonl", "junit.xml"} <= set(files)
    assert all((tmp_path / link).is_file() for link in files)


def test_names_of_cad_are_no_markup(tmp_path: Path) -> None:
    run = a_run(("<b>A</b>", "B&C", 'Q"1'))
    page = _Page(write_run(report_of(run, []), tmp_path).read_text())
    assert "b" not in page.classes
    assert all(name in page.text for name in ("<b>A</b>", "B&C", 'Q"1'))


def test_every_row_of_the_csv_says_of_which_run_plan_and_board_it_is(report: RunReport) -> None:
    rows = list(csv.DictReader(io.StringIO(to_csv(report))))
    assert [row["point"] for row in rows] == list(POINTS)
    assert {(row["run"], row["plan_hash"], row["board_id"]) for row in rows} == {("run-1", report.run.plan_hash, "b1")}
    assert [row["verdict"] for row in rows][-2:] == ["not_tested", ""]
    assert (rows[1]["recovered_by"], rows[1]["cause"], rows[1]["error_um"]) == ("look", "misplaced", "287.0")


@pytest.mark.parametrize("name", ["=1+1", "\u200b=1", "\uff1d1"])
def test_a_name_that_a_spreadsheet_would_reckon_is_told_as_text(name: str) -> None:
    (row,) = csv.DictReader(io.StringIO(to_csv(report_of(a_run((name,)), []))))
    assert row["point"] == f"'{name}"


def test_a_json_line_is_the_record_with_its_plan(report: RunReport) -> None:
    lines = [json.loads(line) for line in to_json_lines(report).splitlines()]
    assert len(lines) == 6
    assert {line["plan_hash"] for line in lines} == {report.run.plan_hash}
    of_plan = _records()[1].model_copy(update={"plan_hash": report.run.plan_hash})
    assert PointRecord.model_validate(lines[1]) == of_plan


# JUnit XML as Ant's and Jenkins' readers have it: element -> (attributes that must be, others that may, children).
SCHEMA: dict[str, tuple[set[str], set[str], tuple[str, ...]]] = {
    "testsuites": (set(), {"name", "tests", "failures", "errors", "time"}, ("testsuite",)),
    "testsuite": (
        {"name", "timestamp", "hostname", "tests", "failures", "errors", "time", "id", "package"},
        {"skipped"},
        ("properties", "testcase", "system-out", "system-err"),
    ),
    "properties": (set(), set(), ("property",)),
    "property": ({"name", "value"}, set(), ()),
    "testcase": ({"name", "classname", "time"}, set(), ("skipped", "error", "failure")),
    "skipped": (set(), {"message"}, ()),
    "error": ({"type"}, {"message"}, ()),
    "failure": ({"type"}, {"message"}, ()),
    "system-out": (set(), set(), ()),
    "system-err": (set(), set(), ()),
}
WHOLE = {"tests", "failures", "errors", "skipped", "id"}


def _parsed(text: str) -> ET.Element:
    return ET.fromstring(text.split("\n", 1)[1])  # noqa: S314  # our own text


def _check_schema(element: ET.Element) -> None:
    must, may, children = SCHEMA[element.tag]
    given = set(element.keys())
    assert must <= given <= must | may, (element.tag, given)
    assert all(re.fullmatch(r"\d+", element.attrib[name]) for name in WHOLE & given)
    assert re.fullmatch(r"\d+\.\d{3}", element.get("time", "0.000"))
    if element.tag == "testsuite":
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", element.attrib["timestamp"])
    order = [children.index(child.tag) for child in element]
    assert order == sorted(order), "children in another order than the schema's"
    if element.tag == "testcase":
        assert len(element) <= 1
    for child in element:
        _check_schema(child)


def test_the_junit_file_keeps_to_the_schema_and_its_counts_are_those_of_its_cases(report: RunReport) -> None:
    root = _parsed(to_junit(report))
    _check_schema(root)
    (suite,) = root
    cases = suite.findall("testcase")
    kinds = [case[0].tag if len(case) else "passed" for case in cases]
    assert kinds == ["passed", "passed", "failure", "failure", "error", "skipped", "skipped"]
    assert [int(suite.attrib[name]) for name in ("tests", "failures", "errors", "skipped")] == [7, 2, 1, 2]
    assert cases[3][0].attrib["type"] == "open_confirmed"


def test_a_name_with_characters_that_xml_has_not_makes_no_broken_file() -> None:
    root = _parsed(to_junit(report_of(a_run(("A\x07<&>",)), [])))
    assert "A\N{REPLACEMENT CHARACTER}<&>" in root[0].findall("testcase")[0].attrib["name"]


async def test_of_a_run_that_is_not_there_the_cure_is_one_of_those_that_are_or_to_make_the_first(
    run: BoardRun, tmp_path: Path
) -> None:
    """To answer "the newest" with "there is none, name the newest" leads round in a circle."""
    file = tmp_path / "journal.sqlite"
    journal = await Journal.open(file)
    try:
        with pytest.raises(NoRun) as caught:
            read_run(file, "last")
        assert "`reprobe run " in caught.value.advice
        assert "last" not in caught.value.advice
        await journal.runs.begin(run)
        with pytest.raises(NoRun, match=run.id) as caught:
            read_run(file, "nil")
        assert "`last`" in caught.value.advice
    finally:
        await journal.close()
