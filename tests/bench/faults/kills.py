"""Kills: the daemon is ended as by a power cut at a random moment of a job, started, and asked the same again."""

from __future__ import annotations

import random
import time

from tests.bench.faults import judge
from tests.bench.faults.station import Station

JOBS = ("place", "place", "place", "queue", "look", "home", "lift", "surface", "surface", "correct")
SPAN_S = {"place": 0.4, "queue": 0.8, "look": 0.25, "home": 1.6, "lift": 0.4, "surface": 4.0, "correct": 0.6}
"""Within so much time after the request it is killed; about what the job takes."""


def one(station: Station, chance: random.Random) -> None:
    """Kill once."""
    deed = chance.choice(JOBS)
    station.recover()
    if deed == "correct":
        station.client.job("place", test_point="TP1")
    requests = _requests(station, deed)
    for request in requests:
        station.send(request)
    if deed == "surface" and chance.random() < 0.6:
        station.until_pressed()
    else:
        time.sleep(chance.uniform(0.0, SPAN_S[deed]))
    station.rig.daemon.kill()
    station.rig.until(lambda truth: not truth["moving"], "it goes on moving without a daemon")
    station.start()
    ask_again(station, requests)
    station.recover()
    station.judge_item()


def _requests(station: Station, deed: str) -> list[dict[str, object]]:
    if deed == "queue":
        return [station.request("place", f"place-{n}", undisturbed=True) for n in range(3)]
    if deed == "surface":
        return [station.request("calibrate", "surface", what="surface", places=4)]
    if deed == "correct":
        return [station.request("correct", "correct", test_point="TP1")]
    return [station.request(deed, deed, undisturbed=True)]


def ask_again(station: Station, requests: list[dict[str, object]]) -> None:
    """Ask the same with the same ids: what was accepted has its answer, and nothing moves for it."""
    accepted = {job.id for job in station.ledger.jobs(station.item) if job.accepted}
    for request in requests:
        before = station.truth()
        station.send({**request, "wait": True})
        if request["id"] in accepted and judge.stirred(before, station.truth()):
            station.found("doubled", f"{request['id']} moved when it was asked again")
