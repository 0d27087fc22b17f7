"""What a browser looks up is asked of the daemon with the least key that may, and comes whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.daemon.page.page_stand import Stand


@pytest.fixture
def stand(tmp_path: Path) -> Stand:
    return Stand(tmp_path)


def test_a_long_run_comes_whole_however_many_pages_it_is(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    records = [{"n": 10 + n, "point": f"TP{n}"} for n in range(2300)]

    browser = stand.logged_in("Eve")

    async def points(_role: str, op: str, *, run: str, since: int, limit: int) -> dict[str, Any]:
        assert (op, run) == ("points", "last" if since == 0 else "run-1")
        return {"run": {"id": "run-1"}, "points": [one for one in records if one["n"] >= since][:limit]}

    monkeypatch.setattr(stand.ask, "request", points, raising=True)
    told = browser.get("/run").json()
    assert told["points"] == records


def test_plans_are_shown_to_who_may_run_them(stand: Stand) -> None:
    stand.ask.replies["plan"] = {"plans": [{"name": "six"}]}
    eve, kim = stand.logged_in("Eve"), stand.logged_in("Kim")
    assert eve.get("/plans").status_code == 403
    assert kim.get("/plans").json()["plans"] == [{"name": "six"}]
    assert [asked for asked in stand.ask.asked if asked[1] == "plan"] == [("operate", "plan", {"action": "list"})]


def test_a_points_tests_come_with_what_people_said_of_it(stand: Stand) -> None:
    stand.ask.replies |= {"point": {"tests": [{"n": 1}], "more": False}, "marks": {"marks": [{"point": "TP1"}]}}
    told = stand.logged_in("Eve").get("/point?name=TP1&board_id=SN-1").json()
    assert told == {"tests": [{"n": 1}], "more": False, "marks": [{"point": "TP1"}]}
    assert ("observe", "point", {"test_point": "TP1", "limit": 100, "board_id": "SN-1"}) in stand.ask.asked
    assert stand.logged_in("Eve").get("/marks").json() == {"marks": [{"point": "TP1"}]}


def test_a_months_charts_are_asked_with_the_least_key_and_come_whole(stand: Stand) -> None:
    charts = [{"group": "light", "title": "Light", "caption": "c", "svg": "<svg/>"}]
    stand.ask.replies["charts"] = {"month": "2026-11", "drawn_at": "t", "charts": charts}
    assert stand.logged_in("Eve").get("/charts?month=2026-11").json() == {"month": "2026-11", "charts": charts}
    assert ("observe", "charts", {"month": "2026-11"}) in stand.ask.asked
