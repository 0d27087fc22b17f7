"""What must not get through the page: each attack is refused, and nothing of it reaches the station."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient, WebSocketDenialResponse

from daemon.page.live_feed import Picture
from daemon.page.lockout import Lockout
from daemon.page.orders import ORDERS
from tests.daemon.page.page_stand import HOST, LIVE, ORIGIN, PEOPLE, SECRET, Stand

PATHS = ("/", "/me", "/history", "/board", "/audit", "/static/main.js")
JOB = {"order": "home", "id": "home-0123456789abcdef"}


@pytest.fixture
def stand(tmp_path: Path) -> Stand:
    return Stand(tmp_path)


# --- from other sites -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["evil.test", "evil.test:8460", "127.0.0.1:8461", "127.0.0.1.evil.test:8460", ""])
@pytest.mark.parametrize("path", PATHS)
def test_a_name_that_is_not_the_pages_is_refused_on_every_path(stand: Stand, path: str, host: str) -> None:
    assert stand.browser().get(path, headers={"host": host}).status_code == 421


def test_a_login_under_another_name_is_refused(stand: Stand) -> None:
    asked = {"name": "Lee", "secret": SECRET}
    told = stand.browser().post("/login", json=asked, headers={"host": "evil.test", "origin": "http://evil.test"})
    assert told.status_code == 421
    assert "set-cookie" not in told.headers


@pytest.mark.parametrize("origin", ["http://evil.test", "null", "https://evil.test:8460", f"{ORIGIN}.evil.test", ""])
@pytest.mark.parametrize("path", ["/login", "/order", "/logout", "/alive"])
def test_what_another_site_sends_is_refused(stand: Stand, path: str, origin: str) -> None:
    browser = stand.logged_in("Lee")
    stand.ask.asked.clear()
    assert browser.post(path, json=JOB, headers={"origin": origin}).status_code == 403
    assert stand.ask.asked == []


def test_what_comes_without_an_origin_is_refused(stand: Stand) -> None:
    browser = stand.logged_in("Lee")
    del browser.headers["origin"]
    assert browser.post("/order", json=JOB).status_code == 403
    assert stand.ask.orders() == []


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"origin": "http://evil.test"}, 403),
        ({"origin": ""}, 403),
        ({"origin": "null"}, 403),
        ({"host": "evil.test"}, 421),
    ],
)
def test_a_websocket_of_another_site_is_not_opened(stand: Stand, headers: dict[str, str], status: int) -> None:
    browser = stand.logged_in("Lee")
    with pytest.raises(WebSocketDenialResponse) as caught, browser.websocket_connect(LIVE, headers=headers):
        pass
    assert caught.value.status_code == status


@pytest.mark.parametrize("token", ["", "x", None])
def test_an_order_without_the_sessions_token_is_refused(stand: Stand, token: str | None) -> None:
    browser = stand.logged_in("Lee")
    del browser.headers["x-token"]
    headers = {} if token is None else {"x-token": token}
    assert browser.post("/order", json=JOB, headers=headers).status_code == 403
    assert stand.ask.orders() == []


def test_a_token_of_another_person_does_not_do(stand: Stand) -> None:
    kim, lee = stand.logged_in("Kim"), stand.logged_in("Lee")
    lee.headers["x-token"] = kim.headers["x-token"]
    assert lee.post("/order", json=JOB).status_code == 403


def test_the_cookie_is_out_of_reach_of_scripts_and_other_sites(tmp_path: Path) -> None:
    for tls in (False, True):
        stand = Stand(tmp_path, tls=tls)
        headers = {"origin": f"https://{HOST}"} if tls else {}
        cookie = (
            stand.browser()
            .post("/login", json={"name": "Kim", "secret": SECRET}, headers=headers)
            .headers["set-cookie"]
        )
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert ("Secure" in cookie) == tls


@pytest.mark.parametrize("path", [*PATHS, "/nothing", "/login"])
def test_every_answer_keeps_foreign_script_and_frames_out(stand: Stand, path: str) -> None:
    headers = stand.browser().get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] in ("no-store", "no-cache")


# --- without a right ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        "/history",
        "/history.csv",
        "/board",
        "/audit",
        "/frame.jpg",
        "/pictures?id=a",
        "/picture?id=a&which=before-red",
        "/run",
        "/plans",
        "/point?name=TP1",
        "/marks",
        "/charts?month=2026-11",
        "/config",
    ],
)
def test_who_is_not_logged_in_sees_nothing(stand: Stand, path: str) -> None:
    told = stand.browser().get(path)
    assert told.status_code == 401
    assert "station-1" not in told.text


def test_a_tab_that_is_not_logged_in_is_told_nothing_of_the_station(stand: Stand) -> None:
    with stand.browser().websocket_connect(LIVE) as socket:
        first, second = socket.receive_json(), socket.receive_json()
    assert first["me"]["role"] is None
    assert "station" not in first
    assert second == {}


@pytest.mark.parametrize("name", PEOPLE)
@pytest.mark.parametrize("order", ORDERS)
def test_an_order_reaches_the_station_only_for_a_role_that_may(stand: Stand, name: str, order: str) -> None:
    ranks = list(PEOPLE.values())
    asked: dict[str, Any] = {
        "order": order, "id": "home-0123456789abcdef", "alert": "light_white", "colour": "red", "note": "why",
        "board_id": "SN-1", "plan": "six", "tip_px": [800.5, 600.25], "axis": "x",
        "by_um": 100, "test_point": "TP1", "mark": "forbidden", "what": "map", "name": "six", "board": "demo",
        "tests": [{"point": "TP1", "method": "contact"}],
    }  # fmt: skip
    told = stand.logged_in(name).post("/order", json=asked)
    if ranks.index(PEOPLE[name]) >= ranks.index(ORDERS[order].role):
        ((role, op, fields),) = stand.ask.orders()
        assert (told.status_code, role, op, fields["by"]) == (200, PEOPLE[name], ORDERS[order].op, name)
    else:
        assert told.status_code == 403
        assert stand.ask.orders() == []
        assert stand.ask.asked[-1] == ("operate", "note", {"by": name, "what": "refused", "detail": ORDERS[order].op})


def test_what_the_daemon_refuses_is_told_with_its_cure(stand: Stand) -> None:
    browser = stand.logged_in("Lee")
    stand.ask.refusal = {"code": 5106, "name": "in_fault", "message": "m", "advice": "a", "detail": {}}
    told = browser.post("/order", json=JOB)
    assert (told.status_code, told.json()["error"]["name"]) == (409, "in_fault")


def test_only_maintenance_sees_who_did_what(stand: Stand) -> None:
    assert stand.logged_in("Kim").get("/audit").status_code == 403
    assert stand.logged_in("Lee").get("/audit").status_code == 200


@pytest.mark.parametrize(
    "body",
    [
        {}, [], "x", {"order": "calibrate"}, {"order": ["home"]}, {"order": None}, {"order": "home"},
        {"order": "home", "id": "../../etc"}, {"order": "home", "id": 7}, {"order": "home", "id": "home-<script>"},
        {"order": "acknowledge", "alert": "a", "note": "x" * 501}, {"order": "acknowledge", "alert": None},
        {"order": "__class__"}, {"order": "light", "colour": "green"}, {"order": "light"},
        {"order": "mended", "alert": "a", "note": {}},
    ],
    ids=str,
)  # fmt: skip
def test_what_is_no_order_is_refused_and_goes_nowhere(stand: Stand, body: Any) -> None:
    assert stand.logged_in("Lee").post("/order", json=body).status_code == 400
    assert stand.ask.orders() == []


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b"[" * 10_000, b"nul"])
def test_what_is_no_json_is_refused(stand: Stand, content: bytes) -> None:
    assert stand.logged_in("Lee").post("/order", content=content).status_code == 400


def test_a_body_larger_than_any_order_is_refused(stand: Stand) -> None:
    assert stand.logged_in("Lee").post("/order", content=b"x" * 20_000).status_code == 413
    assert stand.logged_in("Lee").post("/plan", content=b"x" * 1_300_000).status_code == 413
    assert stand.browser().post("/plan", content=b"x" * 1_300_000).status_code == 401


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_other_methods_are_refused(stand: Stand, method: str) -> None:
    assert stand.logged_in("Lee").request(method, "/order").status_code == 405


# --- guessing and sessions ------------------------------------------------------------------------------------


def _try(browser: TestClient, name: str, secret: str) -> int:
    return browser.post("/login", json={"name": name, "secret": secret}).status_code


def test_the_sixth_try_waits_even_with_the_right_secret(stand: Stand) -> None:
    browser = stand.browser()
    assert [_try(browser, "Kim", "wrong") for _ in range(5)] == [401] * 5
    assert _try(browser, "Kim", SECRET) == 429
    stand.clock.now_s += Lockout.WAIT_S
    assert _try(browser, "Kim", SECRET) == 200


def test_a_guesser_is_stopped_by_his_address_and_others_still_get_in(stand: Stand) -> None:
    guesser, other = stand.browser("10.0.0.9"), stand.browser("10.0.0.7")
    assert [_try(guesser, f"user{n}", "x") for n in range(6)] == [401] * 5 + [429]
    assert _try(other, "Kim", SECRET) == 200


def test_a_name_that_nobody_has_is_answered_as_a_wrong_secret(stand: Stand) -> None:
    asked = stand.browser("10.0.0.1").post("/login", json={"name": "Nobody", "secret": "x"})
    known = stand.browser("10.0.0.2").post("/login", json={"name": "Kim", "secret": "x"})
    assert (asked.status_code, asked.json()) == (known.status_code, known.json())


def test_a_pin_does_not_do_from_elsewhere_or_through_a_proxy(stand: Stand) -> None:
    stand.users.add("Pat", "operate", "123456")
    assert _try(stand.browser("10.0.0.3"), "Pat", "123456") == 401
    proxied = stand.browser()
    proxied.headers["x-forwarded-for"] = "10.0.0.4"
    assert _try(proxied, "Pat", "123456") == 401
    assert _try(stand.browser(), "Pat", "123456") == 200


def test_login_logout_and_refusals_are_written_down(stand: Stand) -> None:
    browser = stand.browser("10.0.0.5")
    _try(browser, "Kim", "wrong")
    browser = stand.logged_in("Kim", "10.0.0.5")
    browser.post("/logout")
    assert [fields for _, op, fields in stand.ask.asked if op == "note"] == [
        {"by": "Kim", "what": "refused", "detail": "login from 10.0.0.5"},
        {"by": "Kim", "what": "login", "detail": "10.0.0.5"},
        {"by": "Kim", "what": "logout", "detail": "10.0.0.5"},
    ]


def test_an_order_from_elsewhere_says_from_where(stand: Stand) -> None:
    stand.logged_in("Kim", "10.0.0.5").post("/order", json={"order": "stop"})
    assert stand.ask.orders() == [("operate", "cancel", {"by": "Kim (10.0.0.5)"})]


def test_who_logged_out_or_was_idle_gives_no_order(stand: Stand) -> None:
    browser = stand.logged_in("Lee")
    stand.clock.now_s += 11 * 60
    assert browser.post("/order", json=JOB).status_code == 401
    browser = stand.logged_in("Lee")
    browser.post("/logout")
    assert browser.post("/order", json=JOB).status_code == 401
    assert stand.ask.orders() == []


def test_a_tab_loses_the_station_when_its_session_ends(stand: Stand) -> None:
    browser = stand.logged_in("Lee")
    with browser.websocket_connect(LIVE) as socket:
        assert socket.receive_json()["station"]["name"] == "station-1"
        stand.users.remove("Lee")
        message: dict[str, Any] = {}
        while "me" not in message:
            message = socket.receive_json()
        assert message["me"]["role"] is None
        assert "station" not in message


def test_a_kiosk_is_looked_at_from_the_machine_and_named_addresses_only(tmp_path: Path) -> None:
    stand = Stand(tmp_path, kiosk=True, watchers=("10.0.0.8",))
    assert stand.browser().get("/board").status_code == 200
    assert stand.browser("10.0.0.8").get("/board").status_code == 200
    assert stand.browser("10.0.0.9").get("/board").status_code == 401
    proxied = stand.browser()
    proxied.headers["x-forwarded-for"] = "10.0.0.9"
    assert proxied.get("/board").status_code == 401
    assert stand.browser().post("/order", json={"order": "stop"}).status_code == 401
    assert stand.ask.orders() == []


# --- paths ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    [
        "/static/../people.py", "/static/%2e%2e/people.py", "/static/..%2fpeople.py", "/words/../../client.py",
        "/static/", "/static", "//etc/passwd", "/etc/passwd", "/static/page.css%00.html", "/users.json",
        "/static/main.js/",
    ],
)  # fmt: skip
def test_no_path_reaches_another_file(stand: Stand, path: str) -> None:
    assert stand.browser().get(path).status_code == 404


def test_a_table_for_a_spreadsheet_holds_no_formula(stand: Stand) -> None:
    nasty = ["=cmd|x", " =1", "\x00=1", "\uff1d1", "\u200b=1"]
    rows = [{"seq": 1, "id": one, "op": "correct", "test_point": "+1", "outcome": "corrected"} for one in nasty]
    stand.ask.replies["history"] = {"results": rows, "more": False}
    read = list(csv.DictReader(io.StringIO(stand.logged_in("Kim").get("/history.csv").text)))
    assert [row["id"] for row in read] == [f"'{one}" for one in nasty]
    assert {row["test_point"] for row in read} == {"'+1"}


def test_a_live_picture_comes_with_what_stands_beside_it_and_none_is_said(stand: Stand) -> None:
    browser = stand.logged_in("Eve")
    assert browser.get("/frame.jpg").status_code == 204
    stand.hub.pictures.append(Picture({"n": 7, "tip_px": [1.5, 2.5]}, b"\xff\xd8"))
    told = browser.get("/frame.jpg?after=6")
    assert (told.content, json.loads(told.headers["x-frame"])["n"]) == (b"\xff\xd8", 7)
    assert browser.get("/frame.jpg?after=7").status_code == 204
    assert browser.get("/frame.jpg?after=x").status_code == 200


def test_a_file_that_a_browser_has_already_is_not_sent_again(stand: Stand) -> None:
    first = stand.browser().get("/static/main.js")
    again = stand.browser().get("/static/main.js", headers={"if-none-match": first.headers["etag"]})
    assert (first.status_code, again.status_code, again.content) == (200, 304, b"")


def test_the_page_weighs_less_than_its_budget(stand: Stand) -> None:
    browser = stand.browser()
    sent = {path: browser.get(path) for path in stand.page.files if path != "/words/de.json"}
    assert {answer.headers["content-encoding"] for answer in sent.values()} == {"gzip"}
    assert sum(int(answer.headers["content-length"]) for answer in sent.values()) < 60_000
    plain = browser.get("/static/main.js", headers={"accept-encoding": "identity"})
    assert plain.content == sent["/static/main.js"].content
