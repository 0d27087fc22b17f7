"""Housekeeping: what is given up at rest, and when."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.app import housekeeping


async def _turns(monkeypatch: pytest.MonkeyPatch, running: list[object]) -> tuple[int, int]:
    """Keep house for so many turns; return how often what was drawn, and memory, was given up."""
    forgotten, given = [0], [0]
    monkeypatch.setattr(housekeeping, "EVERY_S", 0.0)
    monkeypatch.setattr(housekeeping, "give_back_memory", lambda: given.__setitem__(0, given[0] + 1))

    def lag(_s: float) -> None:
        if not running:
            raise asyncio.CancelledError
        latch.running = running.pop(0)

    latch = SimpleNamespace(running=None)
    parts: Any = latch, SimpleNamespace(lag=lag)
    with pytest.raises(asyncio.CancelledError):
        await housekeeping.keep_house(*parts, lambda: forgotten.__setitem__(0, forgotten[0] + 1))
    return forgotten[0], given[0]


async def test_what_was_drawn_is_given_up_once_in_a_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    rest: list[object] = [None] * (3 * housekeeping.FORGET_TURNS)
    forgotten, given = await _turns(monkeypatch, rest)
    assert forgotten == 1
    assert given == 3


async def test_a_station_that_works_keeps_what_it_drew(monkeypatch: pytest.MonkeyPatch) -> None:
    between: list[object] = ([None] * (housekeeping.FORGET_TURNS - 1) + ["job"]) * 3
    assert (await _turns(monkeypatch, between))[0] == 0
