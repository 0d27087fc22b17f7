"""A page is drawn by a process that ends with the call, however that ends."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest

from daemon.platform.subprocess import draw
from daemon.tools.report.command import NOT_WRITTEN, WRONG
from drivers.deadline import Deadline

FOR_EVER = ("http.server", ["--bind", "127.0.0.1", "0"])


def _children() -> list[str]:
    return Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()


async def test_what_is_wrong_is_told_without_the_commands_name() -> None:
    status, words = await draw(
        "daemon.tools.report.month", ["--journal", "none", "--month", "May", "--station", "s", "-o", "p"], 60.0
    )
    assert status == WRONG
    assert words == "'May' is no month; write it as 2026-11"


async def test_one_that_takes_too_long_is_ended() -> None:
    before = _children()
    assert await draw(*FOR_EVER, 0.2) == (NOT_WRITTEN, "drawing the page took too long")
    assert _children() == before


async def test_who_is_cancelled_takes_the_process_along() -> None:
    before = _children()
    drawing = asyncio.create_task(draw(*FOR_EVER, 60.0))
    soon = Deadline.after(20.0)
    while _children() == before:
        assert not soon.expired
        await asyncio.sleep(0.01)
    drawing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await drawing
    assert _children() == before


async def test_one_that_cannot_be_started_is_told_and_raises_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    status, words = await draw(*FOR_EVER, 60.0)
    assert status == NOT_WRITTEN
    assert "cannot be started" in words
