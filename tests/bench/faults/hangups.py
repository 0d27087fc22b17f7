"""Hang-ups: SIGHUP during jobs, with a configuration that is good, broken, gone, or no file at all."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

from tests.bench.faults.station import Station

JOBS = {"place": 0.3, "look": 0.2, "home": 1.2, "surface": 3.0}
"""Job -> within so many seconds after its request the signal is sent."""
READ_S = 0.5
"""The daemon waits for the file to be whole, then reads it."""


def _comment(path: Path, text: str) -> None:
    path.write_text(f"{text}\n# {time.monotonic_ns()}\n")


def _changed(path: Path, text: str) -> None:
    path.write_text(text.replace("pictures_quota_mb = 500.0", "pictures_quota_mb = 400.0"))


def _broken(path: Path, text: str) -> None:
    path.write_text(f"{text}\n[axes.x]\n")


def _deep(path: Path, text: str) -> None:
    path.write_text(f"{text}\nx = {'[' * 900}\n")


def _gone(_path: Path, _text: str) -> None:
    return


def _pipe(path: Path, _text: str) -> None:
    os.mkfifo(path)


# Each is called while no file is there
FILES: tuple[Callable[[Path, str], None], ...] = (_comment, _changed, _broken, _deep, _gone, _pipe)


def one(station: Station, chance: random.Random) -> None:
    """Hang up one to three times during one job of a healthy station, which is to end as if nothing had been."""
    path = station.rig.places.out / "station.toml"
    text = path.read_text()
    op = chance.choice(list(JOBS))
    station.recover()
    if op == "surface":
        request = station.request("calibrate", "surface", what="surface", places=4, wait=True)
    else:
        request = station.request(op, op, undisturbed=True, wait=True)
    try:
        with station.sending(request) as replies:
            for _ in range(chance.randint(1, 3)):
                time.sleep(chance.uniform(0.0, JOBS[op]))
                path.unlink(missing_ok=True)
                chance.choice(FILES)(path, text)
                os.kill(station.rig.daemon.pid, signal.SIGHUP)
        time.sleep(READ_S)
    finally:
        path.unlink(missing_ok=True)
        path.write_text(text)
    os.kill(station.rig.daemon.pid, signal.SIGHUP)
    station.must_have_worked(request, replies[0])
    station.recover()
    station.judge_item()
