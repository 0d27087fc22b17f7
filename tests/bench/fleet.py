"""Records over kills: `python -m tests.bench.fleet`. Every record of two stations must arrive, and none twice.

Real Mosquitto, real PostgreSQL, uplinks and collector as processes, two journals of 5,000 results each. Every 1.5 s one
of them is killed, in an order by seed: collector, uplink and broker by SIGKILL, the database by an immediate restart.
Fails where a record is missing, there twice, or under the wrong journal.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import asyncpg

from tests.fleet.engines import Mosquitto, PostgreSQL, end, engines, missing
from tests.fleet.journal_server import fill
from tests.packages import not_installed

KILL_EVERY_S = 1.5
KILL_FOR_S, WITHIN_S = 30.0, 300.0
"""A computer too busy to start a process between two kills would never end: what is left then has peace."""
ROOT = Path(__file__).parents[2]
NO_TLS = {"ca": None, "certificate": None, "certificate_key": None, "as_json": False}
STATIONS = ("station-1", "station-2")


class Process:
    """One of our processes; it is started again each time it is killed."""

    def __init__(self, log: Path, *arguments: str, **environment: str) -> None:
        self._log, self._arguments, self._environment = log, arguments, environment
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), **self._environment}
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, *self._arguments], stdout=log, stderr=log, env=environment, cwd=ROOT
            )

    def kill(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.wait()
        self.start()

    @property
    def is_over(self) -> bool:
        """Whether it ended, by itself or ended by somebody."""
        return self._process is None or self._process.poll() is not None

    def stop(self, how: signal.Signals = signal.SIGTERM) -> None:
        end(self._process, how)

    def pause(self, *, paused: bool) -> None:
        """Let it do nothing, or go on."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP if paused else signal.SIGCONT)

    @property
    def pid(self) -> int:
        """Its number."""
        assert self._process is not None
        return self._process.pid


class Plant:
    """Two stations, a broker, a database and a collector."""

    def __init__(self, folder: Path, broker: Mosquitto, database: PostgreSQL) -> None:
        self.broker, self.database = broker, database
        self.stations = [
            Process(folder / f"{name}.log", "-m", "tests.fleet.journal_server", str(folder / f"{name}.sqlite"), name,
                    _endpoint(folder, name)) for name in STATIONS
        ]  # fmt: skip
        # What `reprobe uplink` and `reprobe collect` become; starting by way of them takes longer than a kill leaves.
        self.uplinks = [
            Process(folder / f"uplink-{name}.log", "-m", "daemon.fleet", uplink_arguments(folder, name, broker))
            for name in STATIONS
        ]
        collect = {"part": "collect", "broker": broker.address, "recent_days": 7, "record_months": None, **NO_TLS}
        self.collector = Process(
            folder / "collect.log", "-m", "daemon.fleet", json.dumps(collect | {"metrics_port": 0}),
            REPROBE_DATABASE=database.url,
        )  # fmt: skip

    def kill(self, what: str, chance: random.Random) -> None:
        """Kill one part without warning; it is up again when this returns, or starting."""
        if what == "collector":
            self.collector.kill()
        elif what == "uplink":
            chance.choice(self.uplinks).kill()
        elif what == "broker":
            self.broker.kill()
            self.broker.start()
        else:
            self.database.restart_at_once()

    def stop(self) -> None:
        for process in (*self.uplinks, self.collector, *self.stations):
            process.stop()


def uplink_arguments(folder: Path, name: str, broker: Mosquitto) -> str:
    """Return how an uplink is started."""
    told = {"part": "uplink", "site": "north", "line": "L1", "station": _endpoint(folder, name), "keys": None}
    return json.dumps(told | {"broker": broker.address, **NO_TLS})


def _endpoint(folder: Path, name: str) -> str:
    return f"ipc://{folder}/{name}.ipc"


@contextmanager
def plant(folder: Path, counts: Mapping[str, int]) -> Iterator[Plant]:
    """Run all of it, with so many results in each journal."""
    for name, count in counts.items():
        asyncio.run(fill(folder / f"{name}.sqlite", name, count))
    with engines(folder) as (broker, database):
        running = Plant(folder, broker, database)
        try:
            yield running
        finally:
            running.stop()


def ask(database: PostgreSQL, sql: str) -> list[tuple[Any, ...]]:
    """Ask the database; empty while it is away, or has no tables yet."""
    return [tuple(row) for row in _ask(database, sql)]


def ask_named(database: PostgreSQL, sql: str) -> list[dict[str, Any]]:
    """Ask as `ask` does, for columns by name."""
    return [dict(row) for row in _ask(database, sql)]


def _ask(database: PostgreSQL, sql: str) -> list[asyncpg.Record]:
    async def query() -> list[asyncpg.Record]:
        connection = await asyncpg.connect(database.url, timeout=5.0)
        try:
            return await connection.fetch(sql)
        finally:
            await connection.close()

    try:
        return asyncio.run(query())
    except (asyncpg.PostgresError, asyncpg.InterfaceError, OSError):
        return []


STORED = """
    SELECT count(*), count(DISTINCT (s.name, r.job)), count(DISTINCT (r.journal, r.seq))
    FROM records r JOIN stations s ON s.id = r.station WHERE r.kind = 'result'
"""


def one_run(folder: Path, seed: int, records: int) -> dict[str, Any]:
    """Return what came of one run."""
    chance = random.Random(seed)
    kills = dict.fromkeys(("collector", "uplink", "broker", "database"), 0)
    counts = {STATIONS[0]: records // 2, STATIONS[1]: records - records // 2}
    with plant(folder, counts) as running:
        begun_s = kill_at_s = time.monotonic()
        stored: tuple[Any, ...] = (0, 0, 0)
        order: list[str] = []
        while stored[1] < records and time.monotonic() - begun_s < WITHIN_S:
            time.sleep(0.1)
            killing = stored[0] and time.monotonic() - begun_s < KILL_FOR_S
            if killing and time.monotonic() - kill_at_s >= KILL_EVERY_S:
                order = order or chance.sample(sorted(kills), len(kills))
                what = order.pop()
                running.kill(what, chance)
                kills[what] += 1
                kill_at_s = time.monotonic()
            stored = next(iter(ask(running.database, STORED)), stored)
        took_s = time.monotonic() - begun_s
        refused = len(ask(running.database, "SELECT 1 FROM refused"))
        whole = ask(running.database, "SELECT count(*) FROM recent WHERE body ->> 'id' IS NOT NULL")
    return {"seed": seed, "records": records, "stored": stored[0], "distinct": stored[1],
            "whole": next(iter(whole), (0,))[0], "refused": refused, "seconds": round(took_s, 1), **kills}  # fmt: skip


def main() -> int:
    """Print a table; exit code 1 where anything is missing or there twice."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="folder to keep logs in")
    parser.add_argument("--records", type=int, default=10_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    told = parser.parse_args()
    if lacking := missing():
        print(not_installed(*lacking), file=sys.stderr)
        return 2
    good = True
    for number, seed in enumerate(told.seeds):
        with tempfile.TemporaryDirectory(prefix="reprobe-fleet-") as scratch:
            folder = Path(scratch) if told.keep is None else told.keep / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            folder.chmod(0o711)
            found = one_run(folder, seed, told.records)
        if not number:
            print("".join(f"{name:>11}" for name in found))
        right = found["stored"] == found["distinct"] == found["whole"] == told.records and not found["refused"]
        good = good and right
        print("".join(f"{value!s:>11}" for value in found.values()) + ("" if right else "   WRONG"), flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
