"""Full disk: the data folder's disk is filled at a random moment of a job, and has room again a while later."""

from __future__ import annotations

import random
import time

from tests.bench.faults.station import Station
from tests.daemon.storage.small_disk import fill, make_room

JOBS = {"place": 0.3, "look": 0.2, "home": 1.2, "surface": 3.0, "idle": 0.1}
"""Job -> within so many seconds after its request the disk is filled."""
FULL_S = (0.1, 1.5)
GOES_ON_S = 20.0


def one(station: Station, chance: random.Random) -> None:
    """Fill it once; sometimes the daemon is killed while it is full."""
    if station.disk is None:
        station.found("other", "no small disk can be mounted here")
        return
    op, kill = chance.choice(list(JOBS)), chance.random() < 0.3
    station.recover()
    if op == "surface":
        station.send(station.request("calibrate", "surface", what="surface", places=4))
    elif op != "idle":
        station.send(station.request(op, op))
    time.sleep(chance.uniform(0.0, JOBS[op]))
    fill(station.disk)
    try:
        time.sleep(chance.uniform(*FULL_S))
        if kill:
            station.rig.daemon.kill()
            station.rig.until(lambda truth: not truth["moving"], "it goes on moving without a daemon")
            station.start()
        station.send(station.request("place", "meanwhile"))
    finally:
        make_room(station.disk)
    _until_it_goes_on(station)
    station.recover()
    station.judge_item()


def _until_it_goes_on(station: Station) -> None:
    """Wait until the journal is written again, with nobody's help."""
    give_up_s = time.monotonic() + GOES_ON_S
    while (station.quiet()["fault"] or {}).get("name") == "journal_failed":
        if time.monotonic() > give_up_s:
            station.found("other", f"{GOES_ON_S:g} s after there was room the journal is still in trouble")
            return
        time.sleep(0.05)
