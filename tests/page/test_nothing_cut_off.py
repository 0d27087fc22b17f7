"""What is abnormal is said whole in every language and at every size: header, and the wall's screen."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody
from tests.page.conftest import PageProcess
from tests.page.played import PlayedStation
from tests.page.test_bad_input import ALERT

pytestmark = pytest.mark.timeout(600)
STATES = {
    "not_homed": (FaultCode.NOT_HOMED, ()),
    "dark": (FaultCode.LIGHT_FAILED, ("pictures_unusable", "light_white", "light_red")),
    "full": (FaultCode.JOURNAL_FAILED, ("journal_not_written", "pictures_not_kept")),
}
"""Fault, and the alerts that stand beside it."""
CUT = """() => {
  const shown = [...document.querySelectorAll(
    'header > *, #person > *, #state, #reason, .wall-word, .wall-name, .wall-reason, .wall-big, .wall-alert'
  )].filter((one) => one.offsetParent && !one.classList.contains('hidden'));
  const cut = shown.filter((one) => {
    const box = one.getBoundingClientRect(), held = one.closest('.wall-verdict, #tile')?.getBoundingClientRect();
    const clips = getComputedStyle(one).overflowY !== 'visible' && one.scrollHeight > one.clientHeight + 1;
    return one.scrollWidth > one.clientWidth + 1 || clips
      || box.right > innerWidth + 1 || box.bottom > innerHeight + 1
      || (held && (box.top < held.top - 1 || box.bottom > held.bottom + 1 || box.right > held.right + 1));
  }).map((one) => `${one.id || one.className}: ${one.textContent}`);
  const name = document.querySelector('.wall-name');
  const line = name?.offsetParent && parseFloat(getComputedStyle(name).fontSize);
  const broken = line && name.getBoundingClientRect().height > 2 * line;
  return [...cut, ...(broken ? ['the name is broken'] : [])];
}"""

WORD = """async (name) => {
  const words = await (await fetch(`/words/${document.documentElement.lang}.json`)).json();
  return words[`error.${name}`];
}"""


@pytest.mark.parametrize("size", [(800, 480), (1280, 800), (1920, 1080)], ids=str)
@pytest.mark.parametrize("locale", ["en-GB", "de-DE"])
def test_13_what_is_wrong_is_said_whole(
    station: PlayedStation, page: PageProcess, size: tuple[int, int], locale: str
) -> None:
    width, height = size
    tab = page.tab("Lee", viewport={"width": width, "height": height}, locale=locale)
    for name, (kind, alerts) in STATES.items():
        _bring(station, kind, alerts, name)
        _show(tab, "station", kind.wire_name)
        assert tab.evaluate(CUT) == [], name
        assert tab.locator("#home").evaluate("one => one.getBoundingClientRect().bottom <= innerHeight"), name
        _show(tab, "wall", kind.wire_name)
        assert tab.evaluate(CUT) == [], name


def _bring(station: PlayedStation, kind: FaultCode, alerts: tuple[str, ...], job: str) -> None:
    fault = ErrorBody.of(Fault(kind)).model_dump(mode="json")
    plain = {
        "what": "w",
        "message": "m",
        "unit": "",
        "rule": "r",
        "evidence": ["e"],
        "advice": "a",
        "acknowledged": None,
    }
    nothing = {"tip": False, "map_made_at": None, "aligned": False}
    station.replies["snapshot"] |= {"fault": fault, "state": "fault", "calibration": nothing}
    station.replies["alerts"] |= {"standing": [ALERT | plain | {"name": one} for one in alerts], "fault": fault}
    failed = station.result | {"id": job, "ok": False, "outcome": "failed", "error": fault, "test_point": "TP12"}
    station.replies["history"] = {"results": [failed], "more": False}
    station.ask_again()


def _show(tab: Any, screen: str, fault: str) -> None:
    """Open a screen, and wait until it shows a fault."""
    tab.evaluate("screen => { location.hash = screen }", screen)
    said = tab.evaluate(WORD, fault)
    where = ".wall-reason" if screen == "wall" else "main .what"
    tab.wait_for_function(
        "([where, said]) => [...document.querySelectorAll(where)].some((one) => one.textContent === said)",
        arg=[where, said],
    )


SMALL = """() => [...document.querySelectorAll('main p')].filter(node => node.textContent && node.offsetParent)
  .map(node => [node.textContent, parseFloat(getComputedStyle(node).fontSize)]).filter(([, px]) => px * 0.7 < 43)"""
"""1080 lines on 60 cm of height: 24 mm, which is an arc of 16' at five metres, are 43 lines."""


@pytest.mark.parametrize("locale", ["en-GB", "de-DE"])
def test_alerts_too_are_read_from_five_metres_and_leave_the_verdict_its_room(
    station: PlayedStation, page: PageProcess, locale: str
) -> None:
    tab = page.tab("Lee", viewport={"width": 1920, "height": 1080}, locale=locale)
    said = tab.evaluate("async lang => await (await fetch(`/words/${lang}.json`)).json()", locale[:2])
    names = [key.removeprefix("watch.") for key in said if key.startswith("watch.")]
    longest = sorted(names, key=lambda name: len(said[f"watch.{name}"]))[-3:]
    _bring(station, FaultCode.LIGHT_FAILED, tuple(longest), "dark")
    _show(tab, "wall", FaultCode.LIGHT_FAILED.wire_name)
    tab.locator(".wall-alert").nth(1).wait_for()
    assert "3" in tab.locator(".wall-count").inner_text()
    assert tab.evaluate(SMALL) == []
    assert tab.evaluate(CUT) == []
    assert tab.evaluate("() => document.querySelector('main').scrollHeight <= innerHeight")


@pytest.mark.parametrize("locale", ["en-GB", "de-DE"])
def test_the_last_results_are_said_whole_on_a_telephone(station: PlayedStation, page: PageProcess, locale: str) -> None:
    """A look has an error before and none after; a calibration's name is the widest."""
    landed = station.result | {"id": "one", "error_before_um": 254.2, "error_after_um": 8.1}
    looked = landed | {"id": "two", "op": "look", "test_point": "TP12", "error_after_um": None}
    made = looked | {"id": "three", "op": "calibrate", "test_point": None, "error_before_um": None}
    station.replies["history"] = {"results": [landed, looked, made], "more": False}
    station.ask_again()
    tab = page.tab("Lee", viewport={"width": 390, "height": 844}, locale=locale)
    table = tab.locator("main table").first
    table.locator("tr").nth(2).wait_for()
    assert table.evaluate("one => one.parentElement.scrollWidth <= one.parentElement.clientWidth")
    said = table.locator("tr").nth(1).inner_text()
    assert "254" in said
    assert "nachher" not in said
    assert "after" not in said
