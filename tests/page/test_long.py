"""A shift of events, told in a moment: nothing is missed, and neither page nor tab grows."""

from __future__ import annotations

import os

import pytest

from tests.page.conftest import PageProcess, state_is
from tests.page.played import PlayedStation
from tests.page.shift import JOB_S, heap_bytes, rss_bytes, shown_to_the_end, tell_job

pytestmark = pytest.mark.timeout(900)
HOURS = float(os.environ.get("REPROBE_TEST_PAGE_HOURS", "8"))
"""How long a shift is told; eight hours take less than a minute."""
JOBS_AT_ONCE = 20
PAGE_MAY_GROW_BYTES, TAB_MAY_GROW_BYTES = 16e6, 4e6


def test_16_a_shift_of_events_is_shown_to_the_last_and_nothing_grows(station: PlayedStation, page: PageProcess) -> None:
    tab = page.tab("Kim")
    state_is(tab, "READY")
    total = max(3 * JOBS_AT_ONCE, int(HOURS * 3600 / JOB_S))
    first: tuple[int, int] | None = None
    for n in range(total):
        tell_job(station, n)
        if n % JOBS_AT_ONCE == JOBS_AT_ONCE - 1:
            shown_to_the_end(tab, n)
        if first is None and n >= total // 3:
            first = rss_bytes(page.process), heap_bytes(tab)
    assert first is not None
    shown_to_the_end(tab, total - 1)
    assert tab.locator("#banner").is_hidden()
    last = rss_bytes(page.process), heap_bytes(tab)
    print(f"{total} jobs, {station.seq} events; page {first[0] / 1e6:.1f} -> {last[0] / 1e6:.1f} MB, "  # noqa: T201  # measured
          f"tab {first[1] / 1e6:.2f} -> {last[1] / 1e6:.2f} MB")  # fmt: skip
    assert last[0] - first[0] < PAGE_MAY_GROW_BYTES
    assert last[1] - first[1] < TAB_MAY_GROW_BYTES
