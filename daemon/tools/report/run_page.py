"""Report of a run: a folder with a page, its pictures, and the same as CSV, JSON lines and JUnit XML."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

from daemon.domain.board_run import in_a_sentence
from daemon.domain.point_test import PointVerdict
from daemon.platform.atomic_file import replace_whole
from daemon.tools.report.page import Number, environment, write_text
from daemon.tools.report.run_exports import to_csv, to_json_lines, to_junit
from daemon.tools.report.run_facts import STYLES, RunReport, Tested, caption_of, pictures_of
from daemon.tools.report.run_map import draw_map

PAGE = "index.html"
EXPORTS: dict[str, Callable[[RunReport], str]] = {
    "points.csv": to_csv, "points.jsonl": to_json_lines, "junit.xml": to_junit,
}  # fmt: skip
PICTURES = "pictures"
TOLD = frozenset({PointVerdict.PASS_RECOVERED, PointVerdict.OPEN_CONFIRMED, PointVerdict.CONTACT_NOT_MADE})
"""Verdicts whose pictures belong into the report."""


def write_run(report: RunReport, folder: Path) -> Path:
    """Write the report into a folder, each file whole or not at all; return the page's path. OSError as it comes."""
    folder.mkdir(parents=True, exist_ok=True)
    tested = tuple(_with_pictures(one, folder) for one in report.tested)
    report = replace(report, tested=tested)
    for name, export in EXPORTS.items():
        text = export(report)
        replace_whole(folder / name, lambda beside, text=text: write_text(beside, text))  # type: ignore[misc]
    text = render_run(report)
    replace_whole(folder / PAGE, lambda beside: write_text(beside, text))
    return folder / PAGE


def render_run(report: RunReport) -> str:
    """Return the page: one file, no script; only the pictures beside it are fetched."""
    made = environment()
    made.filters["href"] = lambda path: quote(str(path))
    made.filters["caption"] = caption_of
    shown = [one for one in report.tested if one.record is not None and one.record.verdict in TOLD]
    return made.get_template("run.html.j2").render(
        report=report, run=report.run, sentence=in_a_sentence(report.summary), map=draw_map(report),
        numbers=figures(report), styles=STYLES.values(), shown=shown, exports=EXPORTS,
    )  # fmt: skip


def figures(report: RunReport) -> tuple[Number, ...]:
    """Return the figures of a run; those that have no value yet are left out."""
    told = report.summary
    share = None if told.first_touch_yield is None else 100.0 * told.first_touch_yield
    found = [
        ("points with a verdict", told.done, f"of {told.points}", 0),
        ("first-touch yield", share, "%", 1),
        ("false opens, recovered", told.false_opens, "points", 0),
        *((f"... by {rung.replace('_', ' ')}", count, "points", 0) for rung, count in told.recovered_by.items()),
        ("opens confirmed", told.opens_confirmed, "points", 0),
        ("failed", told.failed, "points", 0),
        ("contact not made", told.contact_not_made, "points", 0),
        ("not tested", told.not_tested, "points", 0),
        ("touches a point, mean", told.touches_mean, "", 2),
        ("touches a point, 99 of 100 at most", told.touches_p99, "", 0),
        ("touches a point, most", told.touches_max, "", 0),
        ("time a point", told.seconds_per_point, "s", 2),
        ("reference pad, first", told.reference_first_ohm, "ohm", 3),
        ("reference pad, last", told.reference_last_ohm, "ohm", 3),
    ]
    return tuple(Number(label, float(value), unit, digits) for label, value, unit, digits in found if value is not None)


def _with_pictures(tested: Tested, folder: Path) -> Tested:
    """Copy the kept pictures of a point beside the page, where its verdict is worth them."""
    if tested.record is None or tested.record.verdict not in TOLD:
        return tested
    found = pictures_of(tested.record)
    name = f"{tested.number:04d}-" + re.sub(r"[^\w.+-]", "_", tested.test.point)[:60]
    copied = []
    for picture in found:
        place = Path(PICTURES, name, picture.name)
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(picture, folder / place)
        copied.append(place)
    return replace(tested, pictures=tuple(copied))
