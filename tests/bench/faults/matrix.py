"""Matrix: every fault of the simulated station, switched on in every state, for a random time."""

from __future__ import annotations

import itertools
import random
import time
from typing import Any

from tests.bench.faults.station import LOOKED_EVERY_S, Station

FAULTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("cable_out", {}),
    ("crc_noise", {"rate": 1.0}),
    ("crc_noise", {"rate": 0.3}),
    ("late_replies", {"delay_s": 1.5}),
    ("late_replies", {"delay_s": 0.3, "rate": 0.3}),
    ("exceptions", {"code": 4}),
    ("exceptions", {"code": 6, "rate": 0.3}),
    *(("absent_slave", {"address": address}) for address in (1, 2, 3, 4, 5)),
    *(("stall", {"axis": axis, "detected": True}) for axis in ("x", "y", "z", "theta")),
    *(("stall", {"axis": axis}) for axis in ("x", "z")),
    *(("limit", {"axis": axis}) for axis in ("x", "y", "z")),
    ("estop", {}),
    ("slip", {"axis": "x"}),
    *(("dead_lamp", {"lamp": lamp}) for lamp in ("white", "red")),
    ("relay_stuck", {}),
    *((name, {}) for name in ("frozen", "black", "torn", "silent", "unplugged", "missing")),
)
STATES = ("idle", "place", "home", "look", "correct", "surface", "queue", "start")
ROWS = tuple(itertools.product(FAULTS, STATES))
LOSES_STEPS = ("stall", "slip", "estop", "limit", "absent_slave")
"""After these the axes may stand elsewhere than they count."""
TEST_POINT = "TP1"
ENDS_S = 40.0


def rows(seed: int, count: int) -> list[tuple[tuple[str, dict[str, Any]], str]]:
    """Return so many rows, in a random order, each once before one comes again."""
    order = list(ROWS)
    random.Random(seed).shuffle(order)
    return list(itertools.islice(itertools.cycle(order), count))


def title(row: tuple[tuple[str, dict[str, Any]], str]) -> str:
    (name, parameters), state = row
    return f"{name} {parameters or ''} in {state}".replace("  ", " ")


def one(station: Station, chance: random.Random, row: tuple[tuple[str, dict[str, Any]], str]) -> None:
    """Run one row."""
    (name, parameters), state = row
    station.recover()
    if state == "correct":
        station.client.job("place", test_point=TEST_POINT)
    if state == "start":
        station.rig.daemon.kill()
        with station.holding(name, **parameters):
            station.start()
            time.sleep(chance.uniform(0.0, 0.5))
    else:
        _during(station, chance, row)
    station.recover(home=name in LOSES_STEPS)
    station.judge_item()


def _during(station: Station, chance: random.Random, row: tuple[tuple[str, dict[str, Any]], str]) -> None:
    """Bring the station into the state, hold the fault for a while, and try to move meanwhile."""
    (name, parameters), state = row
    for request in _requests(station, state):
        station.send(request)
    _until_begun(station, state, chance)
    with station.holding(name, **parameters):
        time.sleep(chance.choice((0.05, 0.3, 1.5)))
        station.send(station.request("place", "meanwhile"))
        if chance.random() < 0.5:
            station.client.raw(b'{"op": "reset"}', timeout_s=ENDS_S)
    station.quiet()


def _requests(station: Station, state: str) -> list[dict[str, Any]]:
    if state == "idle":
        return []
    if state == "surface":
        return [station.request("calibrate", "surface", what="surface", places=4)]
    if state == "correct":
        return [station.request("correct", "correct", test_point=TEST_POINT)]
    if state == "queue":
        return [station.request("place", f"place-{number}") for number in range(3)]
    return [station.request(state, state)]


def _until_begun(station: Station, state: str, chance: random.Random) -> None:
    """Wait for what makes the state: a lit lamp, a pressed pin, a moving head; not longer than a job lasts."""
    give_up_s = time.monotonic() + (8.0 if state == "surface" else 1.0)
    while state != "idle" and time.monotonic() < give_up_s:
        truth = station.truth()
        begun = {"look": truth.light > 0, "correct": truth.light > 0, "surface": truth.pressed_um > 0}
        if begun.get(state, truth.moving):
            break
        time.sleep(LOOKED_EVERY_S)
    time.sleep(chance.uniform(0.0, 0.1))
