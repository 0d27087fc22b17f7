"""What the centre says is looked at beside what the daemon says."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from daemon.client import NoAnswer
from daemon.fleet.batch import Stored
from daemon.fleet.record_source import EACH_S, RecordSource
from daemon.fleet.send_window import Position, SendWindow

PAGE = {"journal": "J", "first_seq": 1, "next_seq": 5, "previous": None, "lost": None, "records": []}


class _Daemon:
    """Answers one page, or nothing."""

    def __init__(self, page: dict[str, Any] | None) -> None:
        self._page = page

    async def page(self, position: Position) -> dict[str, Any]:  # noqa: ARG002  # it has but one
        if self._page is None:
            raise NoAnswer("away")
        return self._page


async def _after(page: dict[str, Any] | None, said: Stored) -> Position:
    """Return where reading goes on once there was nothing to send."""
    window = SendWindow()
    window.heard(said, 0.0)
    assert await RecordSource(_Daemon(page)).following(window) is None
    return window.position


async def test_a_number_that_was_never_written_is_not_believed_and_all_is_sent_again() -> None:
    assert await _after(PAGE, Stored("J", 900)) == Position(None, 1)


async def test_the_newest_number_is_believed() -> None:
    assert await _after(PAGE, Stored("J", 4)) == Position("J", 5)


async def test_a_daemon_that_is_away_leaves_the_place_as_it_is() -> None:
    assert await _after(None, Stored("J", 4)) == Position("J", 5)


async def test_a_centre_that_wants_everything_again_and_again_does_not_have_the_daemon_asked_more_often() -> None:
    window, source = SendWindow(), RecordSource(_Daemon(PAGE))
    resolution_s = time.get_clock_info("monotonic").resolution
    asked = 6
    begun_s = asyncio.get_running_loop().time()
    for _ in range(asked):
        window.heard(Stored(None, 0, resume=True), 0.0)
        await source.following(window)
    assert asyncio.get_running_loop().time() - begun_s >= (asked - 1) * (EACH_S - 2 * resolution_s)
