"""Memory of the page and of a browser's tab over a shift of events, told faster than it lasts.

    python -m tests.bench.page_memory [--hours 8] [--minutes 10]

A station that is played tells so many hours of work, ten seconds a correction, within so many minutes; a tab shows
them. Prints both memories and their slopes over the last two thirds; fails where, by its slope, either grows over a
shift of eight hours by more than is allowed, or where an event is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.packages import not_installed
from tests.page.conftest import ARGUMENTS, BROWSER, PageProcess, free_port, state_is, write_people
from tests.page.played import PlayedStation
from tests.page.shift import JOB_S, heap_bytes, rss_bytes, shown_to_the_end, tell_job

SHIFT_H, SAMPLES = 8.0, 60
MOST_MB = {"page": 4.0, "tab": 2.0}
"""What either may grow by over a shift."""


def _told(station: PlayedStation, page: PageProcess, tab: Any, hours: float, minutes: float) -> np.ndarray[Any, Any]:
    """Tell all; return (N, 3): hours told, the page's memory, the tab's, MB."""
    jobs, begun_s, rows = int(hours * 3600 / JOB_S), time.monotonic(), []
    every = max(1, jobs // SAMPLES)
    for n in range(jobs):
        tell_job(station, n)
        if n % every == every - 1 or n == jobs - 1:
            shown_to_the_end(tab, n)
            rows.append((n * JOB_S / 3600, rss_bytes(page.process) / 1e6, heap_bytes(tab) / 1e6))
        time.sleep(max(0.0, begun_s + (n + 1) * minutes * 60 / jobs - time.monotonic()))
    return np.array(rows)


def _judged(rows: np.ndarray[Any, Any]) -> bool:
    """Print both courses; whether neither grows."""
    late = rows[len(rows) // 3 :]
    good = True
    for column, (name, most_mb) in enumerate(MOST_MB.items(), start=1):
        slope, _ = np.polyfit(late[:, 0], late[:, column], 1)
        good &= slope * SHIFT_H <= most_mb
        print(f"{name}: {rows[0, column]:.2f} -> {rows[-1, column]:.2f} MB, {1e3 * slope:+.1f} kB an hour told, "
              f"{slope * SHIFT_H:+.2f} MB a shift (allowed {most_mb:g})")  # fmt: skip
    return bool(good)


def main(argv: list[str] | None = None) -> int:
    """Tell a shift, measure, judge."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.page_memory", description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=SHIFT_H)
    parser.add_argument("--minutes", type=float, default=10.0)
    asked = parser.parse_args(argv)
    if not BROWSER:
        print(not_installed("chromium"), file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright  # dear, and not everywhere

    with tempfile.TemporaryDirectory(prefix="reprobe-") as name, sync_playwright() as playwright:
        folder = Path(name)
        station = PlayedStation(folder)
        browser = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        write_people(folder / "people")
        page = PageProcess(
            SimpleNamespace(), browser, folder / "people", free_port(), station.control, folder / "page.log"
        )
        try:
            page.start()
            tab = page.tab("Kim")
            state_is(tab, "READY")
            begun_s = time.monotonic()
            rows = _told(station, page, tab, asked.hours, asked.minutes)
            print(f"{asked.hours:g} hours, {station.seq} events, told in {(time.monotonic() - begun_s) / 60:.1f} min")
            return 0 if _judged(rows) else 1
        finally:
            page.end()
            browser.close()
            station.end()


if __name__ == "__main__":
    sys.exit(main())
