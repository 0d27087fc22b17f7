"""A shift of events as a station tells them, and what page and tab need of memory meanwhile."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from tests.page.conftest import state_is
from tests.page.played import PlayedStation

JOB_S = 10.0
"""How long a job that is told would have taken."""
WAY = (("triggered", "idle"), ("look", "triggered"), ("move", "look"), ("verify", "move"))


def tell_job(station: PlayedStation, n: int) -> None:
    """Tell what a station tells in ten seconds of work: its heart beats, one correction goes its way."""
    key = f"job-{n}"
    for state, was in WAY:
        station.say("state", state=state, was=was, event="seen", job=key, fault=None)
    station.say("result", **station.result | {"id": key, "test_point": f"P{n}", "finished_at": station.now})
    station.say("state", state="idle", was="verify", event="on_target", job=None, fault=None)
    for _ in range(int(JOB_S)):
        station.say("heartbeat", state="idle", version="0.1.0")


def shown_to_the_end(tab: Any, n: int) -> None:
    """Wait until a tab shows the job that was told last."""
    tab.wait_for_function("name => document.getElementById('verdict')?.textContent.includes(name)", arg=f"P{n}:")
    state_is(tab, "READY")


def rss_bytes(process: Any) -> int:
    """Return what a process has resident."""
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def heap_bytes(tab: Any) -> int:
    """Return what a tab's scripts and document need, without what is to be collected."""
    tools = tab.context.new_cdp_session(tab)
    tools.send("HeapProfiler.collectGarbage")
    used: int = tools.send("Runtime.getHeapUsage")["usedSize"]
    tools.detach()
    return used
