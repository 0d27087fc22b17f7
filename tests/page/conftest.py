"""A station, its page and a real browser, as processes; run by `make test-page`."""

from __future__ import annotations

import json
import math
import os
import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from daemon.client import Client
from daemon.page.people import USERS_FILE, Users
from daemon.tools.demo.processes import Process
from tests.packages import not_installed
from tests.page.played import PlayedStation
from tests.station.rig import STARTED_WITHIN_S, Rig, running_rig

WANTED = bool(os.environ.get("REPROBE_TEST_PAGE"))
BROWSER = os.environ.get("REPROBE_CHROMIUM") or shutil.which("chromium") or ""
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
PEOPLE = {"Eve": "observe", "Kim": "operate", "Kai": "operate", "Lee": "maintain"}
BOARD_ID, PLAN, POINTS = "SN-0042", "six", 6
SECRET = "a long secret"  # noqa: S105  # of nobody


def either_rounding(value: float, digits: int = 1) -> list[str]:
    """Return a figure rounded down and up: of one in the middle browser and Python do not take the same."""
    scale = 10**digits
    return [f"{round_(value * scale) / scale:.{digits}f}" for round_ in (math.floor, math.ceil)]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip where nobody asked for a browser; asked for and not there is a failure."""
    for item in items:
        if Path(item.path).parent == Path(__file__).parent and not WANTED:
            item.add_marker(pytest.mark.skip(reason="`make test-page` runs it: it needs Chromium"))


@dataclass
class PageProcess:
    """The page as a process, and the browser it is looked at with."""

    rig: Any
    browser: Any
    state: Path
    port: int
    control: str
    log: Path
    process: Process | None = None
    keys: Path | None = None
    """Folder of its keys; None where the daemon asks for none."""
    kiosk: bool = False

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> None:
        arguments = [
            "daemon.cli",
            "page",
            "--station",
            self.control,
            "--state",
            str(self.state),
            "--port",
            str(self.port),
            *(("--keys", str(self.keys)) if self.keys else ()),
            *(("--kiosk",) if self.kiosk else ()),
        ]
        self.process = Process("page", arguments, self.log, ready_line=False)
        give_up_s = time.monotonic() + STARTED_WITHIN_S
        while True:
            assert self.process.alive(), self.process.last_words()
            try:
                urlopen(f"{self.url}me", timeout=5).close()  # noqa: S310  # our own page
                return
            except OSError:
                assert time.monotonic() < give_up_s, self.process.last_words()
                time.sleep(0.05)

    def end(self) -> None:
        """End it, if it was started."""
        if self.process is not None:
            self.process.end()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Start it, and end it whatever comes."""
        try:
            self.start()
            yield
        finally:
            self.end()

    def tab(self, name: str | None = None, **options: Any) -> Any:
        """Return a tab of a browser of its own, with somebody logged in; what goes wrong in it is an error."""
        context = self.browser.new_context(**{"viewport": {"width": 1280, "height": 800}, "locale": "en-GB", **options})
        context.set_default_timeout(60_000)
        tab = context.new_page()
        tab.goto(self.url)
        if name is not None:
            login(tab, name)
        return tab


def login(tab: Any, name: str, secret: str = SECRET) -> None:
    """Log somebody in and wait until the station is shown."""
    tab.locator("#log").click()
    give_name(tab, name, secret)


def give_name(tab: Any, name: str, secret: str = SECRET) -> None:
    """Answer the question who is there, and wait until the station is shown."""
    tab.fill("input[name=name]", name)
    tab.fill("input[name=secret]", secret)
    tab.locator("dialog form .orders button").first.click()
    tab.locator("nav button").first.wait_for()


def state_is(tab: Any, word: str) -> None:
    """Wait until the tile shows a state."""
    tab.wait_for_function("word => document.getElementById('state').textContent === word", arg=word)


def free_port() -> int:
    """Return a port that nobody listens at."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    assert BROWSER, not_installed("chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        yield started
        started.close()


@pytest.fixture(scope="module")
def shown(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    """A station that is set up, and its page; tests leave it idle."""
    with _served(browser, tmp_path_factory.mktemp("page"), lambda _rig, _client: None) as page:
        yield page


@pytest.fixture(scope="module")
def testing(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    """The same with a meter, a board that lies aligned and measured, and a plan of six points."""
    with _served(browser, tmp_path_factory.mktemp("page"), _lay_in, electric=True, reply_ms=1000.0) as page:
        yield page


def _lay_in(rig: Rig, client: Client) -> None:
    for op, fields in (("align", {"board_id": BOARD_ID}), ("calibrate", {"what": "surface", "places": 4})):
        result = client.job(op, timeout_s=300.0, **fields)
        assert result.ok, result.error
    nets = sorted({point.net for point in rig.board.test_points() if point.net})[:POINTS]
    text = f'[plan]\nboard = "{rig.board.name}"\nnets = {json.dumps(nets)}\n[defaults]\nhigh = "5 ohm"\n'
    client.request("plan", action="store", text=text, name=PLAN)


@contextmanager
def _served(browser: Any, folder: Path, lay_in: Callable[[Rig, Client], None], **options: Any) -> Iterator[PageProcess]:
    with running_rig(folder, **options) as rig:
        rig.bench.ask("set", name="drive_boot_s", value=0.0)
        with rig.client() as client:
            rig.session(client).set_up()
            lay_in(rig, client)
        write_people(folder / "people")
        page = PageProcess(rig, browser, folder / "people", free_port(), rig.control, rig.places.out / "page.log")
        with page.running():
            yield page


def write_people(folder: Path) -> None:
    """Write the file of users; scrypt is slow on purpose, and done once for all tests."""
    file = folder / USERS_FILE
    if not _WRITTEN:
        users = Users(file)
        for name, role in PEOPLE.items():
            users.add(name, role, SECRET)  # type: ignore[arg-type]
        _WRITTEN.append(file.read_text())
        return
    folder.mkdir(parents=True, exist_ok=True)
    file.touch(mode=0o600)
    file.write_text(_WRITTEN[0])


_WRITTEN: list[str] = []


@pytest.fixture
def station() -> Iterator[PlayedStation]:
    """A station that is played."""
    with tempfile.TemporaryDirectory(prefix="reprobe-") as sockets:
        played = PlayedStation(Path(sockets))
        try:
            yield played
        finally:
            played.end()


@pytest.fixture
def page(station: PlayedStation, browser: Any, tmp_path: Path) -> Iterator[PageProcess]:
    """A page of the station that is played."""
    people = tmp_path / "people"
    write_people(people)
    served = PageProcess(None, browser, people, free_port(), station.control, tmp_path / "page.log")
    try:
        served.start()
        yield served
    finally:
        if served.process is not None:
            served.process.end()


@pytest.fixture(autouse=True)
def closed_tabs(request: pytest.FixtureRequest) -> Iterator[None]:
    """Close a test's tabs at its end."""
    yield
    if {"browser", "shown", "testing", "page"} & set(request.fixturenames):
        for context in list(request.getfixturevalue("browser").contexts):
            context.close()
