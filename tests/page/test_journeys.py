"""What people do at the page, in a real browser, against simulated station, daemon and page as processes."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest

from daemon.client import Client, Refused
from tests.page.conftest import PageProcess, either_rounding, login, state_is
from tests.station.rig import in_fault, started

pytestmark = pytest.mark.timeout(600)
RED = "rgb(176, 0, 32)"
LOOKED_AT = ("station", "run", "board", "point", "alerts", "watches", "history", "service", "wall")
ALL_SCREENS = (*LOOKED_AT, "point/TP7", "teach", "audit", "plan")


@pytest.fixture
def client(shown: PageProcess) -> Any:
    with shown.rig.client() as connected:
        yield connected


def _errors(tab: Any) -> list[str]:
    """Collect what the browser complains of from now on, a broken policy among it."""
    found: list[str] = []
    tab.on("pageerror", lambda error: found.append(str(error)))
    tab.on("console", lambda said: found.append(said.text) if said.type == "error" else None)
    return found


def _home(tab: Any) -> None:
    """Order homing. A late answer to what was pressed before may take the question's place: then it is asked again."""
    from playwright.sync_api import TimeoutError as NotThere  # collected without a browser, too

    for _ in range(12):
        with suppress(NotThere):
            tab.locator("#home").click(timeout=5000)
            tab.locator("#confirm").click(timeout=5000)
            return
        tab.keyboard.press("Escape")
    raise AssertionError("the question for homing is never there")


def _ready(client: Client) -> None:
    """Leave the station idle whatever came before."""
    if client.request("status")["fault"]:
        with suppress(Refused):
            client.request("reset")
        client.job("home")


# --- who ------------------------------------------------------------------------------------------------------


def test_1_a_wrong_login_is_said_a_right_one_shows_the_station_and_logout_takes_it_away(shown: PageProcess) -> None:
    tab = shown.tab()
    errors = _errors(tab)
    tab.locator("#log").click()
    tab.fill("input[name=name]", "Kim")
    tab.fill("input[name=secret]", "wrong")
    tab.locator("dialog form .orders button").first.click()
    tab.wait_for_function("() => document.querySelector('dialog .said').textContent !== ''")
    assert tab.locator("dialog .said").text_content() == "Name or password is wrong."
    tab.keyboard.press("Escape")
    login(tab, "Kim")
    state_is(tab, "READY")
    assert tab.locator("#who").text_content() == "Kim · operator"
    tab.locator("#log").click()
    tab.wait_for_function("() => document.querySelectorAll('nav button').length === 0")
    assert "demo" not in tab.locator("body").inner_text()
    assert [one for one in errors if "401" not in one] == []


def test_11_who_only_looks_finds_no_order_on_any_screen(shown: PageProcess) -> None:
    tab = shown.tab("Eve")
    for screen in LOOKED_AT:
        tab.evaluate("screen => { location.hash = screen }", screen)
        tab.wait_for_timeout(100)
        assert tab.locator(".order:visible").count() == 0
    assert tab.locator("nav button").count() == len(LOOKED_AT)


def test_a_page_that_opens_says_of_no_connection_that_it_is_lost_before_it_is(shown: PageProcess) -> None:
    """Nothing moves below the hand of who logs in: no banner comes and goes while the page first connects."""
    tab = shown.browser.new_context(locale="en-GB").new_page()
    tab.add_init_script("window.WebSocket = class { constructor() { window.made = this } close() {} }")
    tab.goto(shown.url)
    tab.locator("#log:enabled").wait_for()
    assert tab.locator("#banner").is_hidden()
    tab.evaluate("made.onclose()")
    tab.locator("#banner").wait_for()
    tab.context.close()


# --- the station at work --------------------------------------------------------------------------------------


def test_2_a_correction_shows_its_states_its_verdict_and_stands_in_the_history(
    shown: PageProcess, client: Client
) -> None:
    tab = shown.tab("Kim")
    state_is(tab, "READY")
    tab.evaluate(
        "() => { window.seen = []; new MutationObserver(() => {"
        " const word = document.getElementById('state').textContent;"
        " if (window.seen.at(-1) !== word) window.seen.push(word)"
        "}).observe(document.getElementById('state'), {childList: true, characterData: true, subtree: true}) }"
    )
    # Beside it, so that it never stands well enough by chance
    point = shown.rig.board.point("TP3")
    assert client.job("place", board_um=[point.x_um + 80.0, point.y_um]).ok
    result = client.job("correct", test_point="TP3")
    tab.wait_for_function("() => document.getElementById('verdict').textContent.includes('TP3: Landed')")
    state_is(tab, "READY")
    seen = tab.evaluate("() => window.seen")
    way = ["LOOKING", *["MOVING", "CHECKING"] * result.moves]
    assert [word for word in seen if word in way][-len(way) :] == way
    tab.evaluate("() => { location.hash = 'history' }")
    tab.locator("#history tbody tr").first.wait_for()
    first = tab.locator("#history tbody tr").first.inner_text()
    assert "TP3" in first
    assert result.error_before_um is not None
    assert any(f"before {one} µm" in first for one in either_rounding(result.error_before_um))
    tab.fill("input[name=test_point]", "NOBODY")
    tab.keyboard.press("Enter")
    tab.wait_for_function("() => document.querySelectorAll('#history tbody tr').length === 0")


def test_stop_ends_a_job_by_one_touch_and_says_who_did_it(shown: PageProcess, client: Client) -> None:
    tab = shown.tab("Kim")
    state_is(tab, "READY")
    client.request("calibrate", id="long-map", what="map", test_point="TP5")
    tab.wait_for_function("() => !document.getElementById('stop').disabled")
    tab.locator("#stop").click()
    tab.wait_for_function("() => document.getElementById('verdict').textContent.includes('Not tested')")
    reply = client.request("result", id="long-map")
    assert reply["result"]["error"]["name"] == "cancelled"
    entry = next(one for one in client.request("audit")["entries"] if one["op"] == "cancel")
    assert (entry["by"], entry["outcome"]) == ("Kim", "done")
    _ready(client)


def test_10_two_persons_press_home_and_stop_at_once_and_both_are_answered(shown: PageProcess, client: Client) -> None:
    lee, kim = shown.tab("Lee"), shown.tab("Kim")
    state_is(kim, "READY")
    _home(lee)
    kim.wait_for_function("() => !document.getElementById('stop').disabled")
    kim.locator("#stop").click()
    state_is(lee, kim.locator("#state").text_content())
    kim.wait_for_function("() => document.querySelector('#stop').disabled")
    entries = client.request("audit", limit=10)["entries"]
    assert {("home", "Lee"), ("cancel", "Kim")} <= {(one["op"], one["by"]) for one in entries}
    _ready(client)
    state_is(lee, "READY")
    state_is(kim, "READY")


# --- trouble --------------------------------------------------------------------------------------------------


def test_3_a_fault_is_red_with_cause_and_cure_and_ends_by_reset_at_the_page(shown: PageProcess, client: Client) -> None:
    tab = shown.tab("Lee")
    state_is(tab, "READY")
    with shown.rig.fault("cable_out"):
        client.job("look")
        state_is(tab, "FAULT")
        assert tab.locator("#tile").evaluate("tile => getComputedStyle(tile).backgroundColor") == RED
        text = tab.locator("#screen").inner_text()
        assert "The drives do not answer" in text
        assert "Check cable and power, then reset." in text
        assert "/" not in tab.locator("#reason").text_content()
    tab.locator("#reset").click()
    tab.wait_for_function("() => document.getElementById('state').textContent !== 'FAULT'")
    _ready(client)
    state_is(tab, "READY")


def test_4_after_an_emergency_stop_the_steps_lead_back_to_work(shown: PageProcess) -> None:
    tab = shown.tab("Lee")
    state_is(tab, "READY")
    try:
        shown.rig.bench.ask("fault", name="estop", on=True)
        state_is(tab, "EMERGENCY STOP")
        banner = tab.locator("#banner")
        assert banner.inner_text() == "Emergency stop: release it at the machine, then Reset, then Home"
        assert banner.evaluate("node => getComputedStyle(node).backgroundColor") == RED
        assert tab.locator(".steps .now").inner_text() == "Release the emergency stop at the machine"
        tab.locator("#reset").click()
        tab.wait_for_function("() => document.getElementById('dialog').open")
        state_is(tab, "EMERGENCY STOP")
        tab.keyboard.press("Escape")
    finally:
        shown.rig.bench.ask("fault", name="estop", on=False)
    tab.wait_for_function(
        "() => { const state = document.getElementById('state').textContent;"
        " if (state === 'EMERGENCY STOP' && !document.getElementById('dialog').open)"
        "  document.getElementById('reset').click();"
        " if (document.getElementById('dialog').open) document.getElementById('dialog').close();"
        " return state === 'NOT HOMED' }",
        polling=500,
    )
    tab.wait_for_function("() => document.querySelector('.steps .now')?.textContent === 'Home the axes'")
    _home(tab)
    state_is(tab, "READY")
    assert tab.locator("#banner").is_hidden()


def test_5_a_daemon_that_is_gone_is_lost_at_once_and_back_by_itself(shown: PageProcess, client: Client) -> None:
    tab = shown.tab("Lee")
    state_is(tab, "READY")
    shown.rig.daemon.kill()
    state_is(tab, "UNKNOWN")
    banner = tab.locator("#banner").inner_text()
    assert banner.startswith("No connection to the station, what you see is from ")
    assert tab.title().startswith("UNKNOWN")
    assert tab.locator("button.order:visible:enabled").count() == 0
    shown.rig.start_daemon(started)
    tab.wait_for_function("() => document.getElementById('banner').hidden")
    _ready(client)
    state_is(tab, "READY")


def test_6_a_page_that_is_killed_touches_no_job_and_the_browser_comes_back(shown: PageProcess, client: Client) -> None:
    tab = shown.tab("Kim")
    state_is(tab, "READY")
    client.request("place", id="p-killed", test_point="TP7")
    assert shown.process is not None
    shown.process.kill()
    tab.wait_for_function("() => document.getElementById('banner').textContent.includes(\"this page's server\")")
    state_is(tab, "UNKNOWN")
    assert client.job("place", job_id="p-killed", test_point="TP7").ok
    shown.start()
    tab.wait_for_function("() => document.getElementById('log').textContent === 'Log in'")
    if not tab.locator("dialog input[name=name]").is_visible():
        tab.locator("#log").click()
    tab.fill("input[name=name]", "Kim")
    tab.fill("input[name=secret]", "a long secret")
    tab.locator("dialog form .orders button").first.click()
    state_is(tab, "READY")


def test_7_an_alert_that_one_person_knows_of_is_known_to_all(shown: PageProcess, client: Client) -> None:
    pictures = shown.rig.places.out / "station" / "pictures"
    kept = pictures.with_name("kept")
    lee, kim = shown.tab("Lee"), shown.tab("Kim")
    state_is(kim, "READY")
    pictures.rename(kept)
    pictures.write_text("a file lies where the pictures go")
    try:
        client.job("look", pictures=True)
        for tab in (lee, kim):
            tab.locator("#alert-count").click()
            tab.locator("[data-alert]").first.wait_for()
        kim.locator("[data-alert] .orders button").first.click()
        kim.fill("textarea[name=note]", "<b>on my way</b>")
        kim.locator("dialog .orders button").first.click()
        lee.wait_for_function("() => document.querySelector('[data-alert]').textContent.includes('Kim,')")
        assert "<b>on my way</b>" in lee.locator("[data-alert]").first.inner_text()
    finally:
        pictures.unlink()
        kept.rename(pictures)
        client.job("look", pictures=True)
    lee.wait_for_function("() => document.getElementById('alert-count').hidden")


# --- seeing it ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(800, 480), (1280, 800), (1920, 1080)], ids=str)
@pytest.mark.parametrize("locale", ["en-GB", "de-DE"])
def test_13_nothing_is_cut_off_and_every_target_takes_a_glove(
    shown: PageProcess, size: tuple[int, int], locale: str
) -> None:
    width, height = size
    tab = shown.tab("Lee", viewport={"width": width, "height": height}, locale=locale, has_touch=True)
    for screen in ALL_SCREENS:
        tab.evaluate("screen => { location.hash = screen }", screen)
        tab.wait_for_function("s => document.querySelector('nav [aria-current]')", arg=screen)
        small = tab.evaluate(
            "() => [...document.querySelectorAll('button, input, a.button')].filter(n => n.offsetParent)"
            ".map(n => [n.textContent || n.name, n.getBoundingClientRect()])"
            ".filter(([, box]) => box.width < 56 || box.height < 56)"
            ".map(([text, box]) => [text, box.width, box.height])"
        )
        assert small == []
        cut = tab.evaluate(
            "() => [...document.querySelectorAll('header button, nav button, main button, #state')]"
            ".filter(n => n.offsetParent && (n.scrollWidth > n.clientWidth + 1 ||"
            " n.getBoundingClientRect().right > innerWidth + 1)).map(n => n.textContent)"
        )
        assert cut == [], screen
        assert tab.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


def test_14_everything_is_reached_by_keys_alone(shown: PageProcess) -> None:
    tab = shown.tab("Lee")
    state_is(tab, "READY")
    tab.keyboard.press("Alt+8")
    tab.wait_for_function("() => location.hash === '#history'")
    tab.keyboard.press("Alt+1")
    tab.wait_for_function("() => location.hash === '#station'")
    tab.locator("#home").focus()
    tab.keyboard.press("Enter")
    tab.locator("#confirm").wait_for()
    tab.keyboard.press("Escape")
    tab.wait_for_function("() => !document.getElementById('dialog').open")
    tab.evaluate("() => { location.hash = 'board' }")
    tab.locator("svg[role=group] .point").first.focus()
    tab.wait_for_function("() => document.querySelector('svg .point.chosen')")


def test_the_station_is_shown_in_fault_when_it_starts_so(shown: PageProcess, client: Client) -> None:
    tab = shown.tab("Lee")
    shown.rig.bench.ask("fault", name="cable_out", on=True)
    try:
        shown.rig.daemon.kill()
        shown.rig.start_daemon(in_fault)
        state_is(tab, "FAULT")
    finally:
        shown.rig.bench.ask("fault", name="cable_out", on=False)
    tab.locator("#reset").click()
    tab.wait_for_function("() => document.getElementById('state').textContent !== 'FAULT'")
    _ready(client)
    state_is(tab, "READY")
