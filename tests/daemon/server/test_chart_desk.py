"""The charts of a month go out as the month's page has them, drawn once for who asks again."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.server.chart_desk import LASTS_S, ChartDesk
from tests.daemon.tools.report.test_month import keep_a_month


async def test_each_group_with_numbers_is_a_picture_that_stands_alone(tmp_path: Path) -> None:
    await keep_a_month(tmp_path / "j.sqlite")
    reply = await ChartDesk("s", tmp_path / "j.sqlite").charts("2026-11")
    groups = [chart.group for chart in reply.charts]
    assert {"placement", "corrections", "light"} <= set(groups)
    assert len(groups) == len(set(groups))
    for chart in reply.charts:
        drawn = ET.fromstring(chart.svg)  # noqa: S314  # our own
        assert drawn.tag == "{http://www.w3.org/2000/svg}svg"
        assert "--ink:" in chart.svg, "it brings the colours that it names"
        assert "<script" not in chart.svg
    assert (await ChartDesk("s", tmp_path / "j.sqlite").charts("2026-12")).charts == []


async def test_who_asks_again_gets_what_was_drawn_until_that_is_old(tmp_path: Path) -> None:
    await keep_a_month(tmp_path / "j.sqlite")
    now = [0.0]
    desk = ChartDesk("s", tmp_path / "j.sqlite", lambda: now[0])
    first = await desk.charts("2026-12")
    now[0] = LASTS_S - 1.0
    assert await desk.charts("2026-12") is first
    now[0] = LASTS_S
    assert await desk.charts("2026-12") is not first


async def test_a_journal_that_cannot_be_read_is_told_without_its_path(tmp_path: Path) -> None:
    with pytest.raises(Fault) as caught:
        await ChartDesk("s", tmp_path / "none.sqlite").charts("2026-11")
    assert caught.value.kind is FaultCode.CHARTS_NOT_DRAWN
    assert str(tmp_path) not in caught.value.message
    assert "does not exist" in caught.value.message
