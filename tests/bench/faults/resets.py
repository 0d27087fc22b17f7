"""Resets against running jobs: no job is cut, and `reset` says that the station is busy or that all is well."""

from __future__ import annotations

import random
import time

from tests.bench.faults.station import Station

JOBS = {"place": 0.3, "look": 0.2, "home": 1.2, "surface": 3.0}
"""Job -> within so many seconds after its request `reset` is sent."""


def one(station: Station, chance: random.Random) -> None:
    """Send one to three resets against one job of a healthy station."""
    op = chance.choice(list(JOBS))
    station.recover()
    if op == "surface":
        request = station.request("calibrate", "surface", what="surface", places=4, wait=True)
    else:
        request = station.request(op, op, undisturbed=True, wait=True)
    with station.sending(request) as replies:
        for _ in range(chance.randint(1, 3)):
            time.sleep(chance.uniform(0.0, JOBS[op]))
            _reset(station)
    station.must_have_worked(request, replies[0])
    station.recover()
    station.judge_item()


def _reset(station: Station) -> None:
    reply = station.client.raw(b'{"op": "reset"}')
    if not reply["ok"] and reply["error"]["name"] != "busy":
        station.found("contradictory", f"reset says {reply['error']['name']}: nothing is wrong")
