"""Cancels: a job is cancelled, or its deadline passes, at a random moment; then the head is sent elsewhere at once."""

from __future__ import annotations

import random
import time

from tests.bench.faults.station import Station

JOBS = ("surface", "surface", "surface", "place", "home", "look")
CANCELLED_AT_S = 0.3
"""Within so much time after it has begun, or after the pin was pressed."""
DEADLINES_MS = (150.0, 2500.0)
STANDS_S = 0.15
"""Looked at before it is sent elsewhere."""


def one(station: Station, chance: random.Random) -> None:
    """End one job before its time."""
    op, by_deadline = chance.choice(JOBS), chance.random() < 0.3
    station.recover()
    fields = {"deadline_ms": chance.uniform(*DEADLINES_MS)} if by_deadline else {}
    if op == "surface":
        station.send(station.request("calibrate", "surface", what="surface", places=4, **fields))
    else:
        station.send(station.request(op, op, **fields))
    if op == "surface" and not by_deadline:
        station.until_pressed()
    time.sleep(chance.uniform(0.0, CANCELLED_AT_S))
    if not by_deadline:
        station.client.raw(b'{"op": "cancel"}')
    station.quiet()
    time.sleep(STANDS_S)
    station.send(station.request("place", "elsewhere", undisturbed=True, wait=True))
    station.recover()
    station.judge_item()
