"""A month's charts at the page are those of its report, and come as pictures: nothing of them is a part of the page."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from daemon.server.chart_desk import ChartDesk
from daemon.wire.operations.health import ChartsReply
from tests.daemon.tools.report.test_month import keep_a_month
from tests.page.conftest import PageProcess
from tests.page.played import PlayedStation

pytestmark = pytest.mark.timeout(600)
DRAWN = "n => document.images.length === n && [...document.images].every(one => one.complete && one.naturalWidth > 0)"


async def _charts(journal: Path) -> ChartsReply:
    await keep_a_month(journal)
    return await ChartDesk("s", journal).charts("2026-11")


def test_a_months_charts_are_drawn_when_asked_for(station: PlayedStation, page: PageProcess, tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as beside:  # the browser's driver has a loop of its own in this thread
        told = beside.submit(asyncio.run, _charts(tmp_path / "journal.sqlite")).result()
    station.replies["charts"] = told.model_dump(mode="json")
    tab = page.tab("Eve", locale="de-DE")
    said: list[str] = []
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("console", lambda one: said.append(one.text) if one.type == "error" else None)
    tab.evaluate("() => { location.hash = 'watches' }")
    tab.locator("input[name=month]").fill("2026-11")
    tab.locator("#draw").click()
    tab.wait_for_function(DRAWN, arg=len(told.charts))
    assert tab.locator("#charts h3").first.inner_text() == "Wo die Spitze vor einer Korrektur steht"
    assert [one["month"] for one in station.asked if one["op"] == "charts"] == ["2026-11"]
    assert tab.locator("main svg:not(.gauge)").count() == 0
    assert said == []


def test_a_month_in_which_nothing_was_measured_is_said_to_be_empty(station: PlayedStation, page: PageProcess) -> None:
    station.replies["charts"] = {"month": "2026-02", "charts": []}
    tab = page.tab("Eve")
    tab.evaluate("() => { location.hash = 'watches' }")
    tab.locator("#draw").click()
    tab.get_by_text("Nothing was measured in February 2026.").wait_for()
    assert tab.locator("#draw").is_enabled()
