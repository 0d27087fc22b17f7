"""A page without a daemon: a mirror that is set by hand, and a station that writes down what it is asked."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from starlette.testclient import TestClient

from daemon.client import Refused
from daemon.domain.roles import Role
from daemon.page.app import Page, Settings, make_app
from daemon.page.live_feed import Picture
from daemon.page.mirror import Station
from daemon.page.people import USERS_FILE, Users

HOST = "127.0.0.1:8460"
ORIGIN = f"http://{HOST}"
LIVE = f"ws://{HOST}/live"
SECRET = "a long secret"  # noqa: S105  # of nobody
PEOPLE: dict[str, Role] = {"Eve": "observe", "Kim": "operate", "Lee": "maintain"}


class Clock:
    """A clock that is set by hand."""

    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class FakeHub:
    """A mirror that stands still."""

    def __init__(self) -> None:
        self.station = Station(live=True, name="station-1", state="idle", lifecycle="ready")
        self.board: dict[str, Any] = {"name": "demo", "test_points": []}
        self.errors: list[dict[str, Any]] = []
        self.feed: Any = SimpleNamespace(after=self.picture)
        self.pictures: list[Picture] = []

    async def picture(self, n: int, within_s: float) -> Picture | None:  # noqa: ARG002  # it has one or none
        return next((picture for picture in self.pictures if picture.header["n"] > n), None)

    async def run(self) -> None:
        await asyncio.Event().wait()

    async def changed(self, within_s: float) -> None:  # noqa: ARG002  # nothing changes by itself
        await asyncio.sleep(0.01)


class FakeAsk:
    """A daemon that takes everything."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, dict[str, Any]]] = []
        self.replies: dict[str, dict[str, Any]] = {"history": {"results": [], "more": False}, "audit": {"entries": []}}
        self.refusal: dict[str, Any] | None = None

    async def request(self, role: str, op: str, **fields: Any) -> dict[str, Any]:
        fields.pop("within_s", None)
        self.asked.append((role, op, fields))
        if self.refusal is not None:
            raise Refused(self.refusal)
        return {"ok": True, **self.replies.get(op, {})}

    def orders(self) -> list[tuple[str, str, dict[str, Any]]]:
        """Return what was ordered, without what the page only tells."""
        return [one for one in self.asked if one[1] not in ("note", "history", "audit")]


def _people_in(folder: Path) -> Path:
    """Write the file of users; scrypt is slow on purpose, and done once for all tests."""
    file = folder / USERS_FILE
    if not _WRITTEN:
        users = Users(file)
        for name, role in PEOPLE.items():
            users.add(name, role, SECRET)
        _WRITTEN.append(file.read_text())
    file.write_text(_WRITTEN[0])
    file.chmod(0o600)
    return file


_WRITTEN: list[str] = []


class Stand:
    """The page and its surroundings."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.clock, self.hub, self.ask = Clock(), FakeHub(), FakeAsk()
        self.users = users = Users(_people_in(folder))
        self.page = Page(Settings((HOST,), **settings), self.hub, self.ask, users, self.clock)
        self.app = make_app(self.page)

    def browser(self, address: str = "127.0.0.1") -> TestClient:
        """Return a browser of its own, with no cookie yet."""
        return TestClient(self.app, base_url=ORIGIN, headers={"origin": ORIGIN}, client=(address, 40000))

    def logged_in(self, name: str, address: str = "127.0.0.1") -> TestClient:
        """Return a browser whose person is logged in, with the token each order needs."""
        browser = self.browser(address)
        told = browser.post("/login", json={"name": name, "secret": SECRET})
        assert told.status_code == 200, told.text
        browser.headers["x-token"] = told.json()["token"]
        return browser
