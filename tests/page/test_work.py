"""What people do with boards, points and axes at the page, in a real browser; judged by journal and truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest

from daemon.client import Client
from tests.page.axe import violations
from tests.page.conftest import BOARD_ID, PLAN, POINTS, PageProcess, either_rounding, state_is
from tests.page.test_nothing_cut_off import SMALL

pytestmark = pytest.mark.timeout(600)
KINDS = {"pass_first": "pass", "pass_recovered": "recovered", "fail": "bad", "open_confirmed": "open",
         "contact_not_made": "no_contact", "not_tested": "not_tested"}  # fmt: skip
SCREENS = (
    "station",
    "run",
    "board",
    "point",
    "point/TP1",
    "alerts",
    "watches",
    "teach",
    "history",
    "service",
    "audit",
    "plan/six",
    "wall",
)
SAFE_UM = 12_000.0


@pytest.fixture
def client(testing: PageProcess) -> Iterator[Client]:
    """A tester beside the page, which leaves no run unfinished."""
    with testing.rig.client() as connected:
        yield connected
        run = connected.request("snapshot")["run"]
        if run is not None and run["state"] == "unfinished":
            assert connected.job("run", resume=True, board_id=run["board_id"], timeout_s=300.0).ok


def _show(tab: Any, screen: str) -> None:
    tab.evaluate("screen => { location.hash = screen }", screen)
    tab.wait_for_function("name => document.querySelector(`nav [aria-current]`) !== null", arg=screen)


def _confirm(tab: Any) -> None:
    tab.locator("#confirm").click()
    tab.wait_for_function("() => !document.getElementById('dialog').open")


def _begin_run(tab: Any, how: str = "begin") -> None:
    _show(tab, "run")
    tab.locator(f"#run-{how}:enabled").wait_for()
    tab.fill("input[name=board_id]", BOARD_ID)
    tab.select_option("select[name=plan]", PLAN)
    tab.locator(f"#run-{how}").click()
    _confirm(tab)


def _verdict_is(tab: Any, word: str) -> None:
    tab.wait_for_function("word => document.getElementById('run-verdict')?.textContent === word", arg=word)


def _under_way(tab: Any) -> None:
    """Wait until a point of the run has its verdict."""
    some = f"() => /^[1-9] of {POINTS}$/.test(document.getElementById('run-verdict')?.textContent)"
    tab.wait_for_function(some)


def _ended(tab: Any) -> None:
    """Wait for the verdict of the board."""
    words = ["PASS", "FAIL", "NOT PROVED"]
    tab.wait_for_function("words => words.includes(document.getElementById('run-verdict').textContent)", arg=words)


def _listed(tab: Any) -> list[str]:
    points: list[str] = tab.evaluate(
        "() => [...document.querySelectorAll('#verdicts tr')].map(row => row.dataset.point)"
    )
    return points


# --- run ------------------------------------------------------------------------------------------------------


def test_9_a_run_is_paused_gone_on_with_and_shown_as_the_journal_has_it(testing: PageProcess, client: Client) -> None:
    tab, wall = testing.tab("Kim"), testing.tab("Eve")
    state_is(tab, "READY")
    _show(wall, "wall")
    _begin_run(tab)
    _under_way(tab)
    tab.locator("#pause").click()
    _verdict_is(tab, "UNFINISHED")
    done = len(client.request("points", run="last")["points"])
    assert 0 < done < POINTS
    assert len(_listed(tab)) == done
    tab.locator("#run-resume:enabled").click()
    _confirm(tab)
    wall.wait_for_function("() => document.querySelector('.wall-big').textContent.includes(' of ')")
    tab.wait_for_function(
        "() => ['PASS', 'FAIL', 'NOT PROVED'].includes(document.getElementById('run-verdict').textContent)"
    )
    told = client.request("points", run="last")
    records = {record["point"]: record["verdict"] for record in told["points"]}
    assert (len(records), told["run"]["state"], len(told["run"]["jobs"])) == (POINTS, "done", 2)
    assert sorted(_listed(tab)) == sorted(records)
    shown = tab.evaluate(
        "() => Object.fromEntries([...document.querySelectorAll('svg.map:not(.key) .point')]"
        ".map(node => [node.getAttribute('aria-label').split(',')[0], node.getAttribute('class')]))"
    )
    wrong = {point for point, verdict in records.items() if KINDS[verdict] not in shown[point].split()}
    assert wrong == set()
    word = "PASS" if all(verdict.startswith("pass") for verdict in records.values()) else "NOT PROVED"
    _verdict_is(tab, word)
    wall.wait_for_function("word => document.querySelector('.wall-big').textContent === word", arg=word)
    entries = client.request("audit", limit=20)["entries"]
    assert [one["by"] for one in entries if one["op"] in ("run", "pause")][:3] == ["Kim"] * 3


def test_a_run_is_stopped_by_one_touch_and_another_begun_in_its_place(testing: PageProcess, client: Client) -> None:
    tab = testing.tab("Kim")
    state_is(tab, "READY")
    _begin_run(tab)
    _under_way(tab)
    tab.locator("#stop").click()
    _verdict_is(tab, "UNFINISHED")
    assert client.request("snapshot")["run"]["state"] == "unfinished"
    first = client.request("snapshot")["run"]["id"]
    _begin_run(tab, "abandon")
    _ended(tab)
    assert client.request("points", run=first)["run"]["state"] == "abandoned"
    assert client.request("snapshot")["run"]["state"] == "done"


def test_a_plan_is_changed_on_the_page_stored_and_run(testing: PageProcess, client: Client) -> None:
    planned = [test["point"] for test in client.request("plan", action="show", name=PLAN)["plan"]["plan"]["tests"]]
    other = next(point for point in testing.rig.board.test_points() if point.net and point.name not in planned)
    tab, kim = testing.tab("Lee"), testing.tab("Kim")
    _show(tab, "run")
    tab.locator("#plan-edit").click()
    tab.locator("[data-test]").first.wait_for()
    assert _rows(tab) == planned
    tab.locator("[data-test] input[name=high]").first.fill("5")
    tab.fill("input[name=add]", other.net)
    tab.locator("#plan-add").click()
    tab.fill("input[name=plan_name]", "changed")
    tab.locator("#store-plan:enabled").click()
    _confirm(tab)
    tab.locator("tr.wrong").first.wait_for()
    assert tab.locator("tr.wrong + tr").get_attribute("data-test") == planned[0]
    assert "has no unit" in tab.locator("tr.wrong").inner_text()
    assert tab.locator("#plan-start").is_disabled()
    tab.locator("[data-test] input[name=high]").first.fill("7,5 ohm")
    for _ in (*planned[2:], other):
        tab.locator(f"[data-test='{planned[1]}'] ~ tr button").first.click()
    assert _rows(tab) == planned[:2]
    tab.locator("#check-plan").click()
    tab.wait_for_function("() => document.getElementById('plan-state').textContent === 'All 2 tests can be done.'")
    tab.locator("#store-plan:enabled").click()
    _confirm(tab)
    tab.locator("#plan-start:enabled").wait_for()
    stored = client.request("plan", action="show", name="changed")["plan"]
    assert (stored["version"], stored["stored_by"]) == (1, "Lee")
    assert [test["point"] for test in stored["plan"]["tests"]] == planned[:2]
    assert stored["plan"]["tests"][0]["limits"]["high"] == 7.5
    tab.locator("#plan-start").click()
    tab.locator("#run-begin:enabled").wait_for()
    assert tab.locator("select[name=plan]").input_value() == "changed"
    tab.fill("input[name=board_id]", BOARD_ID)
    tab.locator("#run-begin").click()
    _confirm(tab)
    tab.wait_for_function("() => document.querySelector('#run-head h2').textContent.includes('changed')")
    _ended(tab)
    assert client.request("snapshot")["run"]["plan"] == "changed"
    # Who may run plans may look at them and have one checked, and keeps none.
    _show(kim, "plan/changed")
    kim.locator("#check-plan:enabled").wait_for()
    assert kim.locator("#store-plan").is_hidden()


def _rows(tab: Any) -> list[str]:
    return [row.get_attribute("data-test") for row in tab.locator("[data-test]").all()]


# --- point ----------------------------------------------------------------------------------------------------


def test_a_point_that_is_forbidden_is_left_out_with_its_reason_until_it_is_approved(
    testing: PageProcess, client: Client
) -> None:
    name = client.request("plan", action="show", name=PLAN)["plan"]["plan"]["tests"][0]["point"]
    tab, eve = testing.tab("Kim"), testing.tab("Eve")
    for one in (tab, eve):
        _show(one, f"point/{name}")
    tab.locator("#change-mark:enabled").click()
    tab.locator("dialog .orders button").first.click()
    assert tab.locator("dialog").is_visible(), "a reason is wanted"
    tab.fill("textarea[name=note]", "<i>its trace lifts</i>")
    tab.locator("dialog .orders button").first.click()
    tab.wait_for_function("() => document.getElementById('mark').textContent.includes('Forbidden')")
    assert "<i>its trace lifts</i>" in tab.locator("#mark").inner_text()
    assert tab.locator("#order-probe").is_disabled()
    assert eve.locator(".order:visible").count() == 0
    result = client.job("run", plan=PLAN, board_id=BOARD_ID, timeout_s=300.0)
    assert result.ok, result.error
    record = next(one for one in client.request("points", run="last")["points"] if one["point"] == name)
    assert (record["verdict"], record["touches"]) == ("not_tested", 0)
    assert "its trace lifts" in record["reason"]
    _show(tab, "run")
    _verdict_is(tab, "NOT PROVED")
    _show(tab, "board")
    tab.locator("svg.map .point.forbidden").first.wait_for()
    _show(tab, f"point/{name}")
    tab.locator("#change-mark:enabled").click()
    tab.fill("textarea[name=note]", "mended")
    tab.locator("dialog .orders button").first.click()
    tab.wait_for_function("() => document.getElementById('mark').textContent.includes('Approved')")


def test_a_points_history_is_opened_with_its_readings(testing: PageProcess, client: Client) -> None:
    name = client.request("points", run="last")["points"][-1]["point"]
    tests = client.request("point", test_point=name)["tests"]
    tab = testing.tab("Eve")
    _show(tab, f"point/{name}")
    tab.locator("details.test").first.wait_for()
    assert tab.locator("details.test").count() == len(tests)
    tab.locator("details.test summary").first.click()
    tab.locator("details.test[open] dl").first.wait_for()
    tab.locator("details.test[open] a.button").click()
    tab.wait_for_function("() => location.hash.startsWith('#run/')")


# --- jog ------------------------------------------------------------------------------------------------------


def _steps(testing: PageProcess) -> dict[str, float]:
    truth = testing.rig.truth()
    return {name: truth[name] for name in truth if name in ("x_um", "y_um", "z_um", "theta_deg")}


def _step(tab: Any, button: str) -> None:
    """Press once, and wait until the pad may be pressed again, or the step was refused."""
    before = tab.evaluate("() => document.querySelector('#jog .said').textContent")
    assert before == ""
    tab.locator(f"#{button}:enabled").click()
    tab.locator("#jog-z-plus:enabled").wait_for()


def test_20_a_jog_is_one_small_step_sideways_only_high_up_and_never_while_busy(
    testing: PageProcess, client: Client
) -> None:
    assert client.job("place", test_point="TP1").ok
    lee, kim = testing.tab("Lee"), testing.tab("Kim")
    _show(kim, "service")
    assert kim.locator("#jog").count() == 0
    _show(lee, "service")
    lee.locator("#jog-allow:enabled").click()
    _confirm(lee)
    lee.locator("#jog-z-plus:enabled").wait_for()
    assert lee.locator("#jog-x-plus").is_disabled(), "sideways below the safe height"
    lee.locator("#jog-lift:enabled").click()
    _confirm(lee)
    lee.locator("#jog-x-plus:enabled").wait_for()
    low = client.request("snapshot")["needle"]["z_um"]
    assert low >= SAFE_UM - 5
    results = len(client.request("history", of="jog")["results"])
    for button in ("jog-x-plus", "jog-y-minus", "jog-theta-plus", "jog-z-minus", "jog-z-plus"):
        _step(lee, button)
    told = client.request("history", of="jog")["results"]
    assert [one["outcome"] for one in told] == ["jogged"] * (results + 5)
    places = [one["detail"]["position"] for one in reversed(told)]
    assert [round(b["x_um"] - a["x_um"]) for a, b in pairwise(places)] == [0, 0, 0, 0]
    assert round(places[1]["y_um"] - places[0]["y_um"]) == -100
    assert places[2]["theta_deg"] - places[1]["theta_deg"] == pytest.approx(1.0, abs=0.06)
    assert [round(b["z_um"] - a["z_um"]) for a, b in pairwise(places)] == [0, 0, -100, 100]
    # Held down, a key takes one step and no more.
    lee.locator("#jog-z-minus").focus()
    lee.keyboard.down("Enter")
    for _ in range(5):
        lee.keyboard.down("Enter")
    lee.keyboard.up("Enter")
    lee.locator("#jog-x-plus").wait_for()
    client.job("look")
    assert len(client.request("history", of="jog")["results"]) == len(told) + 1
    # While anything runs, the daemon refuses what the page did not.
    client.request("calibrate", id="long", what="map", test_point="TP5")
    lee.wait_for_function("() => document.getElementById('jog-z-plus').disabled")
    refused = client.raw(json.dumps({"op": "jog", "id": "early", "axis": "z", "by_um": 100}).encode())
    assert refused["error"]["name"] == "busy"
    client.request("cancel", id="long")
    lee.wait_for_function("() => document.getElementById('stop').disabled")
    if client.request("status")["fault"]:
        client.request("reset")
        client.job("home")


# --- teach ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("locale", "home"), [("en-GB", "home the machine"), ("de-DE", "Referenzfahrt")])
def test_a_needle_above_a_bright_pad_is_not_taught_and_it_is_said_where_it_can_be(
    testing: PageProcess, client: Client, locale: str, home: str
) -> None:
    """The touches are right, but the picture cannot show it; the station is left as it was."""
    before = client.request("snapshot")["calibration"]
    assert client.job("place", test_point="TP5").ok
    tab = testing.tab("Lee", locale=locale)
    _touch_the_end(testing, tab)
    assert home in tab.locator("#taught").inner_text()
    assert client.request("snapshot")["calibration"] == before
    assert client.job("home").ok


@pytest.mark.parametrize("scale", [1.0, 1.25, 2.0])
def test_8_the_tip_is_taught_where_it_truly_is_at_any_scale(testing: PageProcess, client: Client, scale: float) -> None:
    assert client.job("home").ok  # where nothing bright lies below the needle
    tab = testing.tab("Lee", device_scale_factor=scale)
    true_px = _touch_the_end(testing, tab)
    assert tab.locator("#taught").inner_text() == "The tip is taught. Calibrate the map next."
    kept = client.request("history", of="calibrate", limit=1)["results"][0]
    assert kept["detail"]["tip_px"] == pytest.approx(true_px, abs=0.01)


def _touch_the_end(testing: PageProcess, tab: Any) -> tuple[float, float]:
    """Take a picture, touch where the needle truly ends in the loupe, order that, and wait for its answer."""
    _show(tab, "teach")
    tab.locator("#teach-take:enabled").click()
    tab.wait_for_function("() => document.querySelector('canvas.loupe').offsetParent !== null")
    true_px = testing.rig.bench.ask("status")["tip_px"]
    loupe = tab.locator("canvas.loupe")
    loupe.scroll_into_view_if_needed()
    corner = tab.evaluate("() => document.querySelector('canvas.loupe').dataset.corner.split(',').map(Number)")
    box = loupe.bounding_box()
    zoom = box["width"] / 400 * 8
    beside = ((0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.0, 0.0))
    aims = [(true_px[0] + dx, true_px[1] + dy) for dx, dy in beside]
    for x_px, y_px in aims:
        at = {"x": (x_px + 0.5 - corner[0]) * zoom, "y": (y_px + 0.5 - corner[1]) * zoom}
        tab.mouse.click(box["x"] + at["x"], box["y"] + at["y"])
    tab.locator("#teach-tip:enabled").wait_for()
    middle = json.loads(tab.locator("#scatter").get_attribute("data-middle"))
    assert middle == pytest.approx(true_px, abs=0.01)
    tab.locator("#teach-tip").click()
    _confirm(tab)
    tab.locator("#taught").wait_for()
    return true_px[0], true_px[1]


def test_touches_that_scatter_teach_nothing(testing: PageProcess) -> None:
    tab = testing.tab("Lee")
    _show(tab, "teach")
    tab.locator("#teach-take:enabled").click()
    tab.wait_for_function("() => document.querySelector('canvas.loupe').offsetParent !== null")
    loupe = tab.locator("canvas.loupe")
    for x, y in ((200, 200), (230, 200), (200, 240), (170, 200), (200, 160)):
        loupe.click(position={"x": x, "y": y})
    tab.wait_for_function("() => document.querySelector('#teach-again:enabled')")
    assert tab.locator("#teach-tip").is_disabled()
    tab.locator("#teach-again").click()
    loupe.focus()
    for _ in range(5):
        tab.keyboard.press("ArrowRight")
        tab.keyboard.press("Enter")
    tab.locator("#teach-tip:enabled").wait_for()


def _map_ordered(client: Client, person: str, point: str) -> dict[str, Any]:
    """Return the fields of a person's newest order to calibrate the map on a point; none: he gave none."""
    entries = client.request("audit")["entries"]
    mine = (one["fields"] for one in entries if one["op"] == "calibrate" and one["by"] == person)
    return next((fields for fields in mine if (fields["what"], fields.get("test_point")) == ("map", point)), {})


def test_a_calibration_is_ordered_from_the_page_and_says_what_it_reached(testing: PageProcess, client: Client) -> None:
    tab = testing.tab("Lee")
    _show(tab, "teach")
    tab.fill("#calibrations input[name=test_point]", "NOBODY")
    tab.locator("#calibrate-map:enabled").click()
    tab.locator("#confirm").click()
    tab.wait_for_function(
        "() => document.querySelector('dialog .what')?.textContent === 'The board has no point of that name'"
    )
    tab.keyboard.press("Escape")
    tab.fill("#calibrations input[name=test_point]", "TP5")
    tab.locator("#calibrate-map:enabled").click()
    _confirm(tab)
    while not (ordered := _map_ordered(client, "Lee", "TP5")):  # the test's own time-out ends it
        tab.wait_for_timeout(20)
    made = client.job("calibrate", job_id=ordered["id"], what="map", test_point="TP5", timeout_s=300.0)
    assert made.outcome == "calibrated", made.error
    near = [f"residual {one} µm" for one in either_rounding(made.detail["residual_um"])]
    tab.wait_for_function(
        "near => near.some(one => document.querySelector('[data-made=map]').textContent.includes(one))", arg=near
    )


# --- seeing it ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Lee", "Eve"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_15_no_screen_keeps_anybody_out(testing: PageProcess, name: str, scheme: str) -> None:
    tab = testing.tab(name, color_scheme=scheme, locale="de-DE")
    for screen in SCREENS:
        if name == "Eve" and screen in ("teach", "audit", "plan/six"):
            continue
        _show(tab, screen)
        tab.wait_for_function("() => document.getElementById('screen').children.length > 0")
        assert violations(tab) == [], screen


@pytest.mark.parametrize("locale", ["en-GB", "de-DE"])
def test_the_wall_is_read_from_five_metres_and_takes_no_order(testing: PageProcess, locale: str) -> None:
    tab = testing.tab("Lee", viewport={"width": 1920, "height": 1080}, locale=locale)
    _show(tab, "wall")
    tab.locator(".wall-big").wait_for()
    assert tab.locator("button:visible, a:visible, input:visible").count() == 0
    assert tab.evaluate(SMALL) == []
    assert tab.evaluate("() => document.querySelector('main').scrollHeight <= innerHeight")
    tab.keyboard.press("Escape")
    tab.wait_for_function("() => location.hash === '#station'")


def test_a_run_on_another_board_says_that_it_is_not_aligned_and_offers_that(testing: PageProcess) -> None:
    """The last test of this file: from here on the station takes it that another board lies there."""
    tab = testing.tab("Kim")
    _show(tab, "run")
    tab.locator("#run-begin:enabled").wait_for()
    tab.fill("input[name=board_id]", "SN-OTHER")
    tab.locator("#run-begin").click()
    _confirm(tab)
    tab.locator("#run-error").wait_for()
    assert tab.locator("#run-error").inner_text() == "The board has not been aligned. Align it."
    assert tab.locator("#run-align:enabled").inner_text() == "Align the board"
