"""What an uplink costs a correction: `python -m tests.bench.fleet_pairs [--rounds N] [--paced]`. Judges nothing.

One simulated station with its daemon, an uplink, and the centre's broker, database and collector. Each round is three
corrections from the same placement: with the uplink stopped (SIGSTOP), at work, and nagged: a centre that says fifty
times a second that nothing is stored, so that the uplink reads the journal as fast as it ever does. The order changes
from round to round, each equally often.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import random
import statistics
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import aiomqtt

from daemon.client import Client
from daemon.fleet.batch import Stored
from tests.bench.fleet import NO_TLS, Process
from tests.bench.idle import cpu_s
from tests.bench.side_by_side import POINT, SHARE, interval
from tests.fleet.engines import Mosquitto, engines
from tests.station.rig import FAST, running_rig

ARMS = ("stopped", "at work", "nagged")
NAG_S = 0.02
TOPIC = "reprobe/v1/north/L1/{}/stored"


class Nag(threading.Thread):
    """A centre that wants everything again, again and again, while `on` is set."""

    def __init__(self, broker: Mosquitto, station: str) -> None:
        super().__init__(daemon=True)
        self.on, self._over = threading.Event(), threading.Event()
        self._port, self._topic = broker.port, TOPIC.format(station)
        self.start()

    def run(self) -> None:
        asyncio.run(self._nag())

    async def _nag(self) -> None:
        said = Stored(None, 0, resume=True).to_json()
        async with aiomqtt.Client("127.0.0.1", self._port) as client:
            while not self._over.is_set():
                if self.on.is_set():
                    await client.publish(self._topic, said, qos=0)
                await asyncio.sleep(NAG_S)

    def stop(self) -> None:
        self._over.set()
        self.join()


def correct(client: Client, name: str, theta_deg: float) -> dict[str, Any]:
    """Place and correct once; return how many looks it took and how long, ms."""
    results = [client.job("place", test_point=POINT, theta_deg=theta_deg)]
    began_s = time.perf_counter()
    results.append(client.job("correct", job_id=name, test_point=POINT))
    whole_ms = (time.perf_counter() - began_s) * 1e3
    for one in results:
        if one.error is not None:
            raise SystemExit(f"{one.op} failed: {one.error.message}; {one.error.advice}")
    return {"looks": results[1].looks, "whole": whole_ms}


def measure(folder: Path, rounds: int, seed: int, arguments: tuple[str, ...]) -> None:
    """Run the rounds and print."""
    dice = random.Random(seed)
    orders = list(itertools.permutations(ARMS))
    found: list[dict[str, dict[str, Any]]] = []
    with engines(folder) as (broker, database), running_rig(folder, seed=seed, arguments=arguments) as rig:
        told = {"part": "collect", "broker": broker.address, "recent_days": 7, "record_months": None, **NO_TLS}
        up = {"part": "uplink", "site": "north", "line": "L1", "station": rig.control, "keys": None, **NO_TLS}
        collect = Process(
            folder / "collect.log", "-m", "daemon.fleet", json.dumps(told | {"metrics_port": 0}),
            REPROBE_DATABASE=database.url,
        )  # fmt: skip
        with rig.client(120.0) as client:
            rig.session(client).set_up()
            station = client.request("status")["station"]
            uplink = Process(folder / "uplink.log", "-m", "daemon.fleet", json.dumps(up | {"broker": broker.address}))
            nag = Nag(broker, station)
            spent = dict.fromkeys(ARMS, 0.0)
            try:
                for n in range(rounds):
                    theta_deg, row = dice.uniform(0.0, 100.0), {}
                    for arm in orders[n % len(orders)]:
                        uplink.pause(paused=arm == "stopped")
                        (nag.on.set if arm == "nagged" else nag.on.clear)()
                        before_s = cpu_s(uplink.pid)
                        row[arm] = correct(client, f"round-{n}-{arm}", theta_deg)
                        spent[arm] += cpu_s(uplink.pid) - before_s
                    found.append(row)
            finally:
                nag.stop()
                uplink.pause(paused=False)
                uplink.stop()
                collect.stop()
    show(found, dice)
    print("processor time of the uplink, s: " + ", ".join(f"{arm} {seconds:.2f}" for arm, seconds in spent.items()))


def show(rounds: Sequence[dict[str, dict[str, Any]]], dice: random.Random) -> None:
    """Print the differences in the rounds that took equally many looks."""
    alike = [row for row in rounds if len({one["looks"] for one in row.values()}) == 1]
    print(f"{len(rounds)} rounds, {len(alike)} of them with equally many looks; corrections, ms")
    without = [row["stopped"]["whole"] for row in alike]
    for arm in ARMS[1:]:
        own = [row[arm]["whole"] for row in alike]
        differences = [a - b for a, b in zip(own, without, strict=True)]
        low, high = interval(differences, dice)
        print(
            f"{arm:>8}: {statistics.median(own):7.1f}, stopped {statistics.median(without):7.1f};"
            f" of pairs {statistics.median(differences):+6.1f}, {SHARE:.0%} within {low:+.1f} .. {high:+.1f}"
        )


def main() -> None:
    """Measure once."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fleet_pairs", description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--paced", action="store_true", help="at the clock's pace; setting up takes minutes then")
    told = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="reprobe-fleet-") as scratch:
        folder = Path(scratch)
        folder.chmod(0o711)  # the broker becomes another user
        measure(folder, told.rounds, told.seed, () if told.paced else FAST)


if __name__ == "__main__":
    main()
