"""Page and browser killed a hundred times while jobs run, beside the same work that nobody disturbs.

    python -m tests.bench.page_kills [--kills 100] [--seed 1]

Two simulated stations do the same corrections with the same dice. At the second each correction is ordered in a real
browser at the page, and at a moment of its own, drawn over the length of such a job, either the page's process or the
browser is killed (SIGKILL); then whatever was killed is started anew. Every job must have ended as beside it, once,
with the tip as near its target. Exit code 1 if one did not. Needs Chromium and requirements/browser.txt.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.client import Client
from daemon.domain.board import BoardPoint
from daemon.tools.demo.true_place import off_um
from tests.packages import not_installed
from tests.page.conftest import ARGUMENTS, BROWSER, PageProcess, free_port, write_people
from tests.station.rig import Rig, running_rig

POINTS = ("TP1", "TP3", "TP5", "TP7")
LEAST_UM, MOST_UM = 70.0, 220.0
"""How far beside its point the tip is put: never so near that nothing is to be done."""
OVER_THE_END = 1.2
"""Some kills come after the job's end, of the length of a job."""
BROWSER_WITHIN_S = 60.0
ORDER = """([key, point]) => { window.sent = fetch("/me").then((who) => who.json()).then((me) => fetch("/order", {
  method: "POST", headers: { "Content-Type": "application/json", "X-Token": me.token },
  body: JSON.stringify({ order: "correct", id: key, test_point: point }) })).then((taken) => taken.status) }"""


@dataclass(frozen=True)
class Ended:
    """What came of one correction."""

    point: str
    outcome: str
    error: str
    moves: int
    off_um: float
    """True, between tip and target."""
    seconds: float


class KilledBrowser:
    """Chromium as a process group of its own, so that it can be killed whole."""

    def __init__(self, playwright: Any, folder: Path) -> None:
        self._playwright, self._folder, self._count = playwright, folder, 0
        self.start()

    def start(self) -> None:
        """Start it anew, with nothing that it had kept."""
        self._count += 1
        own = self._folder / f"browser-{self._count}"
        own.mkdir()
        self._process = subprocess.Popen(  # ended by `kill`
            [BROWSER, "--headless", "--remote-debugging-port=0", f"--user-data-dir={own}", *ARGUMENTS, "about:blank"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        told, give_up_s = own / "DevToolsActivePort", time.monotonic() + BROWSER_WITHIN_S
        while not (told.exists() and "\n" in told.read_text()):
            if time.monotonic() > give_up_s:
                raise RuntimeError("the browser did not start")
            time.sleep(0.02)
        port = told.read_text().split()[0]
        self.browser = self._playwright.chromium.connect_over_cdp(f"http://127.0.0.1:{port}")

    def kill(self) -> None:
        """End it and all its helpers as a power cut would."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        with suppress(Exception):  # the connection to it is gone, whatever it says
            self.browser.close()


class Disturber:
    """Orders at the page, and kills."""

    def __init__(self, page: PageProcess, chromium: KilledBrowser, chance: random.Random, span_s: float) -> None:
        self._page, self._chromium, self._chance, self._span_s = page, chromium, chance, span_s
        self._tab: Any = None
        self.killed: Counter[str] = Counter()
        self._open()

    def _open(self) -> None:
        """Have a tab that shows the station, with somebody logged in."""
        if self._tab is not None and not self._tab.is_closed():
            self._tab.context.close()
        self._page.browser = self._chromium.browser
        self._tab = self._page.tab("Kim")
        self._tab.wait_for_function("() => document.querySelector('section:not(.old) > canvas.live')?.width > 300")

    def order(self, key: str, point: str) -> None:
        """Order a correction, and kill one of both while it may be under way."""
        self._tab.evaluate(ORDER, [key, point])
        if self._chance.random() < 0.5:
            self._tab.evaluate("() => window.sent")
        time.sleep(self._chance.uniform(0.0, OVER_THE_END * self._span_s))
        what = self._chance.choice(("page", "browser"))
        self.killed[what] += 1
        if what == "browser":
            self._chromium.kill()
        else:
            assert self._page.process is not None
            self._page.process.kill()

    def repair(self) -> None:
        """Start anew what was killed."""
        assert self._page.process is not None
        if not self._page.process.alive():
            self._page.start()
            self._tab.context.close()
        else:
            self._tab = None
            self._chromium.start()
        self._open()


def _work(rig: Rig, client: Client, jobs: int, seed: int, order: Callable[[str, BoardPoint], None]) -> list[Ended]:
    """Do all corrections; `order` may give the order first, by another way."""
    chance, ended = random.Random(seed), []
    for n in range(jobs):
        point = rig.board.point(POINTS[n % len(POINTS)])
        far_um, turn = chance.uniform(LEAST_UM, MOST_UM), chance.uniform(0.0, 1.0)
        beside = [point.x_um + far_um * (2 * turn - 1), point.y_um + far_um * (1 - abs(2 * turn - 1))]
        placed = client.job("place", job_id=f"place-{n}", board_um=beside)
        assert placed.ok, placed.error
        begun_s = time.monotonic()
        order(_key(n), point)
        # The answer of the job that was ordered, or, where the order was never given, the job itself.
        result = client.job("correct", job_id=_key(n), test_point=point.name)
        seconds = time.monotonic() - begun_s
        error = result.error.name if result.error else ""
        x_um, y_um = rig.truth()["board_um"]
        off = off_um(point, result, (x_um, y_um))
        ended.append(Ended(point.name, result.outcome, error, result.moves, off, seconds))
    return ended


def _key(n: int) -> str:
    return f"correct-{n:012x}"


@contextmanager
def _station(folder: Path) -> Iterator[tuple[Rig, Client]]:
    folder.mkdir()
    with running_rig(folder) as rig, rig.client() as client:
        rig.session(client).set_up()
        yield rig, client


def _undisturbed(folder: Path, jobs: int, seed: int) -> list[Ended]:
    with _station(folder) as (rig, client):
        return _work(rig, client, jobs, seed, lambda _key, _point: None)


def _disturbed(folder: Path, jobs: int, seed: int, span_s: float) -> tuple[list[Ended], list[str]]:
    """Return how the jobs ended, and what else is wrong."""
    from playwright.sync_api import sync_playwright  # dear, and not everywhere

    with _station(folder) as (rig, client), sync_playwright() as playwright:
        write_people(folder / "people")
        chromium = KilledBrowser(playwright, folder)
        page = PageProcess(rig, chromium.browser, folder / "people", free_port(), rig.control, folder / "page.log")
        try:
            page.start()
            disturber = Disturber(page, chromium, random.Random(seed + 1), span_s)

            def order(key: str, point: BoardPoint) -> None:
                if key != _key(0):
                    disturber.repair()
                disturber.order(key, point.name)

            ended = _work(rig, client, jobs, seed, order)
            daemon = rig.daemon.alive()
            ordered = sum(
                one["op"] == "correct" and one["by"] == "Kim" for one in _all(client, "audit", "entries", "n")
            )
            print(f"killed: {dict(disturber.killed)}; {ordered} of {jobs} corrections began by the page's order")
            return ended, [*_kept_wrong(client, jobs), *([] if daemon else ["the daemon ended"])]
        finally:
            page.end()
            chromium.kill()


def _all(client: Client, op: str, part: str, number: str, **fields: Any) -> list[dict[str, Any]]:
    """Return all entries of a record that is told newest first."""
    found: list[dict[str, Any]] = []
    while True:
        reply = client.request(op, limit=500, **fields)
        found += reply[part]
        if not reply["more"]:
            return found
        fields["before"] = found[-1][number]


def _kept_wrong(client: Client, jobs: int) -> list[str]:
    """Return what the journal has too often, or lacks, and what stands against the station."""
    kept = Counter(one["id"] for one in _all(client, "history", "results", "seq", of="correct"))
    wrong = [f"{key} is kept {kept[key]} times" for key in map(_key, range(jobs)) if kept[key] != 1]
    wrong += [f"{key} was asked by nobody" for key in kept if key not in set(map(_key, range(jobs)))]
    status = client.request("status")
    wrong += [f"in fault: {status['fault']['name']}"] if status["fault"] else []
    return wrong


def _said(name: str, ended: list[Ended]) -> str:
    off = sorted(one.off_um for one in ended)
    return (f"{name}: {len(ended)} jobs, {dict(Counter(one.outcome for one in ended))}, "
            f"{sum(one.moves for one in ended)} moves, true error p50 {statistics.median(off):.1f} um, "
            f"worst {off[-1]:.1f} um")  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Run both, compare, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.page_kills", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(argv)
    if not BROWSER:
        print(not_installed("chromium"), file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory(prefix="reprobe-") as name:
        folder = Path(name)
        quiet = _undisturbed(folder / "quiet", asked.kills, asked.seed)
        print(_said("undisturbed", quiet), flush=True)
        span_s = statistics.median(one.seconds for one in quiet)
        ended, wrong = _disturbed(folder / "killed", asked.kills, asked.seed, span_s)
        print(_said("killed", ended))
    differs = [f"job {n}: {a} beside {b}" for n, (a, b) in enumerate(zip(quiet, ended, strict=True))
               if (a.point, a.outcome, a.error) != (b.point, b.outcome, b.error)]  # fmt: skip
    print(f"{len(differs)} of {asked.kills} jobs ended otherwise than undisturbed")
    for line in (*differs, *wrong):
        print(line)
    return 1 if differs or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
