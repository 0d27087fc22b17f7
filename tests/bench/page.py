"""Budgets of the operator's page, measured in a real browser against a station that is played.

    python -m tests.bench.page

Memory and processor time of the page's process, what a browser fetches, first paint, and how long an event takes from
the station's socket into the browser's document. Needs Chromium and requirements/browser.txt.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from tests.packages import not_installed
from tests.page.conftest import ARGUMENTS, BROWSER, PageProcess, free_port, give_name, state_is, write_people
from tests.page.played import PlayedStation

RELOADS, EVENTS, WATCHED_S = 40, 100, 10.0
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
PAINTED = "performance.getEntriesByName('first-contentful-paint')[0]"
SEEN = """() => { window.seen = {}; new MutationObserver(() => {
  const point = document.getElementById("verdict")?.textContent.match(/E\\d+/)?.[0];
  if (point && !(point in window.seen)) requestAnimationFrame(() => { window.seen[point] ??= Date.now() });
}).observe(document.getElementById("screen"), { childList: true, subtree: true, characterData: true }) }"""


def _rss_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _cpu_share(pid: int) -> float:
    """Share of one core that a process takes, over some seconds."""

    def spent_s() -> float:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) * TICK_S

    before_s, begun_s = spent_s(), time.monotonic()
    time.sleep(WATCHED_S)
    return (spent_s() - before_s) / (time.monotonic() - begun_s)


def _delays_ms(station: PlayedStation, tab: Any) -> list[float]:
    """Return how long each of many results took from being said to being drawn."""
    tab.evaluate(SEEN)
    said = {}
    for n in range(EVENTS):
        said[f"E{n}"] = time.time() * 1e3
        station.say("result", **station.result | {"id": f"e-{n}", "test_point": f"E{n}", "finished_at": station.now})
        tab.wait_for_function("name => name in window.seen", arg=f"E{n}")
    seen = tab.evaluate("() => window.seen")
    return sorted(seen[name] - at_ms for name, at_ms in said.items())


def _measure(station: PlayedStation, page: PageProcess) -> None:
    assert page.process is not None
    pid = page.process.pid
    print(f"page, no viewer: {_rss_mb(pid):.1f} MB, {_cpu_share(pid):.1%} of a core")
    tab = page.tab("Kim")
    state_is(tab, "READY")
    for _ in range(RELOADS):
        tab.reload()
        state_is(tab, "READY")
    tab.wait_for_function(f"() => {PAINTED}")  # what stands in the document is drawn a little later
    paint = tab.evaluate(f"() => {PAINTED}.startTime")
    fetched = tab.evaluate("() => performance.getEntriesByType('resource').map(one => one.name).length")
    print(f"after a login and {RELOADS} reloads: {_rss_mb(pid):.1f} MB; first paint {paint:.0f} ms, {fetched} files")
    tab.locator("#log").click()
    give_name(tab, "Lee")  # who was logged out is asked who is there
    state_is(tab, "READY")
    delays = _delays_ms(station, tab)
    print(f"event to document, {EVENTS}: p50 {delays[EVENTS // 2]:.0f} ms, p95 {delays[EVENTS * 95 // 100]:.0f} ms, "
          f"worst {delays[-1]:.0f} ms")  # fmt: skip
    print(f"one viewer: {_rss_mb(pid):.1f} MB, {_cpu_share(pid):.1%} of a core; load {os.getloadavg()[0]:.1f}")


def main() -> int:
    """Measure all and print it."""
    if not BROWSER:
        print(not_installed("chromium"), file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright  # dear, and not everywhere

    with tempfile.TemporaryDirectory(prefix="reprobe-") as folder, sync_playwright() as playwright:
        station = PlayedStation(Path(folder))
        browser = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        people = Path(folder) / "people"
        write_people(people)
        page = PageProcess(SimpleNamespace(), browser, people, free_port(), station.control, Path(folder) / "page.log")
        try:
            page.start()
            _measure(station, page)
        finally:
            page.end()
            browser.close()
            station.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
