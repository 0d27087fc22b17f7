"""Many stations at one centre: `python -m tests.bench.fleet_load`. Nothing may be lost, late, or hold states up.

Real Mosquitto, PostgreSQL and collector with its rollups, each a process; the uplinks are real and run here, each with
a connection of its own, over stations whose records are made up. First each station writes on for a minute; then the
collector is away until an hour's records wait at every station, and catches up while all of them write on.
Fails where a record is missing or there twice, and beyond the bounds below.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import json
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import asyncpg

from daemon.fleet.broker import Broker
from daemon.fleet.database import Connection
from daemon.fleet.send_window import Position
from daemon.fleet.uplink import Place, Uplink
from daemon.platform.logs import set_up
from daemon.wire.example_parts import RECORD, RESULT
from tests.bench.fleet import NO_TLS, Process
from tests.fleet.engines import Mosquitto, PostgreSQL, engines, missing
from tests.packages import not_installed

COMMITTED_MS = 500.0
"""From publishing to commit, 99 of 100."""
FRESH_S = 2.0
"""From a station's word of how it is to the database, 99 of 100, while an outage is caught up."""
PAGE = 100
AWAY_S = 10.0
"""So long the collector is away before it finds an hour's records."""
PATIENCE_S = 300.0
AROUND = {
    "program": "1.0", "configuration": "77d0c5d0a5b1e0f2", "board": "demo", "board_side": "top", "needle": "N-1",
    "tip": "tip-1", "calibrated": {"map": "2026-03-04T09:30:12+00:00", "pin": "2026-03-04T09:30:12+00:00"},
}  # fmt: skip


@dataclass
class Pace:
    """What all stations write: so many at once, and from `begun_s` (monotonic) to the end so many a second each."""

    rate: float
    waiting: int = 0
    state_s: float = 30.0
    """How often a station's state changes."""
    begun_s: float = float("inf")
    ended_s: float = float("inf")

    def written(self, phase: float) -> int:
        """Return how many records a station has; `phase`: 0..1, where in the interval between two it is."""
        spent_s = max(0.0, min(time.monotonic(), self.ended_s) - self.begun_s)
        return self.waiting + int(spent_s * self.rate + phase)


class MadeUp:
    """One station, as the uplink sees its daemon. A record's `at` is when the uplink first took it to publish it."""

    def __init__(self, number: int, pace: Pace, phase: float) -> None:
        self._name, self._pace, self._phase = f"station-{number:04}", pace, phase
        self._taken_at: list[str] = []
        self._told_at = 0.0

    async def page(self, position: Position) -> dict[str, Any]:
        """Return one page of its only journal."""
        last = self._pace.written(self._phase)
        begin = max(1, position.since)
        through = min(last, begin + PAGE - 1)
        now = _utc(time.time())
        self._taken_at += [now] * (through - len(self._taken_at))
        return {
            "journal": f"journal of {self._name}", "first_seq": 1, "previous": None, "lost": None,
            "next_seq": last + 1, "records": [self._row(seq) for seq in range(begin, through + 1)],
        }  # fmt: skip

    def _row(self, seq: int) -> dict[str, Any]:
        kind = ("touch", "point", "result")[seq % 3]
        body = (
            dict(RESULT, id=f"{self._name}-{seq}") if kind == "result" else dict(RECORD, n=seq, job=f"run-{seq // 60}")
        )
        if kind != "result":
            body["point"] = f"TP{seq % 40}"
        return {"seq": seq, "kind": kind, "at": self._taken_at[seq - 1], "body": body, "circumstances": AROUND}

    async def name(self) -> str:
        """Return what it is called."""
        return self._name

    async def state(self) -> dict[str, Any]:
        """Return how it is; another one every so often, for the uplink tells only what is new."""
        if time.time() - self._told_at >= self._pace.state_s:
            self._told_at = time.time()
        return {"online": True, "daemon": True, "state": "idle", "fault": None, "alerts": [], "told_at": self._told_at}


def _utc(at_s: float) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(at_s)) + f".{int(at_s % 1 * 1e6):06}+00:00"


class Centre:
    """The collector as a process, and a connection to the database that says what is there."""

    def __init__(self, folder: Path, broker: Mosquitto, database: PostgreSQL, connection: Connection) -> None:
        told = {"part": "collect", "broker": broker.address, "recent_days": 7, "record_months": None, **NO_TLS}
        self.collector = Process(
            folder / "collect.log", "-m", "daemon.fleet", json.dumps(told | {"metrics_port": 0}),
            REPROBE_DATABASE=database.url,
        )  # fmt: skip
        self._db = connection

    async def one(self, sql: str, *values: Any) -> tuple[Any, ...]:
        """Return the only row of an answer; nothing while there are no tables yet."""
        try:
            row = await self._db.fetchrow(sql, *values)
        except asyncpg.UndefinedTableError:
            return ()
        return () if row is None else tuple(row)

    async def until(self, words: str, sql: str, expected: Callable[[], int]) -> float:
        """Wait until a number is reached; return how long it took, s, or raise TimeoutError."""
        begun_s = time.monotonic()
        while (found := (await self.one(sql) or (0,))[0]) < expected():
            if time.monotonic() - begun_s > PATIENCE_S:
                raise TimeoutError(f"{words}: {found} of {expected()} after {PATIENCE_S:g} s")
            await asyncio.sleep(0.25)
        return time.monotonic() - begun_s

    async def watch_states(self) -> None:
        """Write down of each state when it was told and when it was stored."""
        await self._db.execute(
            "CREATE TABLE told (station int, told_at float8, stored_at timestamptz);"
            "CREATE FUNCTION note_state() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN INSERT INTO told VALUES"
            " (NEW.station, (NEW.body ->> 'told_at')::float8, clock_timestamp()); RETURN NULL; END $$;"
            "CREATE TRIGGER note AFTER INSERT OR UPDATE ON states FOR EACH ROW EXECUTE FUNCTION note_state()"
        )


STORED = "SELECT coalesce(sum(stored_seq), 0)::bigint FROM journals"
ONLINE = "SELECT count(*) FROM states WHERE online"
THERE = "SELECT count(*), count(DISTINCT (journal, seq)), (SELECT count(*) FROM refused) FROM records"
COMMITTED = """
    SELECT percentile_cont(ARRAY[0.5, 0.99, 1.0]) WITHIN GROUP (
        ORDER BY 1e3 * extract(epoch FROM pg_xact_commit_timestamp(xmin) - at)::float8)
    FROM records
"""
FRESH = """
    SELECT percentile_cont(ARRAY[0.5, 0.99, 1.0]) WITHIN GROUP (ORDER BY late_s), max(gap_s) FROM (
        SELECT extract(epoch FROM stored_at)::float8 - told_at AS late_s,
               extract(epoch FROM stored_at - lag(stored_at) OVER (PARTITION BY station ORDER BY stored_at)) AS gap_s
        FROM told WHERE told_at BETWEEN $1 AND $2) AS t
"""


@asynccontextmanager
async def stations(count: int, pace: Pace, address: str) -> AsyncIterator[None]:
    """Run so many uplinks here."""
    broker = Broker.of(address, None, None, None)
    async with asyncio.TaskGroup() as group:
        running = []
        for number in range(count):
            made_up = MadeUp(number, pace, number / count)
            running.append(group.create_task(Uplink(made_up, broker, Place("north", f"L{number % 20}")).run()))
            await asyncio.sleep(0.005)
        try:
            yield
        finally:
            for task in running:
                task.cancel()


async def measure(folder: Path, told: argparse.Namespace) -> bool:
    """Do both; return whether all was as it has to be."""
    pace = Pace(told.rate / told.connections)
    with engines(folder, track_commit_timestamp="on") as (broker, database):
        connection = await asyncpg.connect(database.url)
        centre = Centre(folder, broker, database, connection)
        try:
            async with stations(told.connections, pace, broker.address):
                await centre.until("all stations are known", ONLINE, lambda: told.connections)
                # A thousand uplinks in one heap: each full collection held all of them for 0.2 s, every 1.3 s. One
                # uplink in a process of its own has no such heap.
                gc.freeze()
                good = await steady(centre, pace, told)
                if told.outage:
                    good &= await outage(centre, pace, told)
            return good
        finally:
            centre.collector.stop()
            await connection.close()


async def steady(centre: Centre, pace: Pace, told: argparse.Namespace) -> bool:
    """Let all stations write, and see how soon it is committed."""
    pace.begun_s = time.monotonic()
    pace.ended_s = pace.begun_s + told.seconds
    await asyncio.sleep(told.seconds)
    written = sum(pace.written(number / told.connections) for number in range(told.connections))
    await centre.until("all records are stored", STORED, lambda: written)
    rows, distinct, refused = await centre.one(THERE)
    (committed,) = await centre.one(COMMITTED)
    p50, p99, most = committed
    print(
        f"{told.connections} connections, {written / told.seconds:.0f} records/s for {told.seconds:g} s: {rows} of"
        f" {written} stored, {rows - distinct} twice, {refused} refused; publish to commit p50"
        f" {p50:.0f}, p99 {p99:.0f}, most {most:.0f} ms",
        flush=True,
    )
    return bool(rows == distinct == written and not refused and p99 < COMMITTED_MS)


async def outage(centre: Centre, pace: Pace, told: argparse.Namespace) -> bool:
    """Let the collector be away while an hour's records come together, and see how it catches up."""
    centre.collector.stop()
    await asyncio.sleep(AWAY_S)
    before, pace.state_s = pace.written(0.0), 0.0  # as often as it is asked
    pace.waiting, pace.begun_s, pace.ended_s = before + told.outage, time.monotonic(), float("inf")
    await centre.watch_states()
    centre.collector.start()
    phases = [number / told.connections for number in range(told.connections)]
    begun_s = time.time()
    took_s = await centre.until("the outage is caught up", STORED, lambda: sum(map(pace.written, phases)) - told.slack)
    ended_s, pace.ended_s = time.time(), time.monotonic()
    written = sum(map(pace.written, phases))
    await centre.until("all records are stored", STORED, lambda: written)
    rows, distinct, refused = await centre.one(THERE)
    (late_s, gap_s) = await centre.one(FRESH, begun_s, ended_s)
    p50, p99, most = late_s or (0.0, 0.0, 0.0)
    print(
        f"{told.outage * told.connections} records of an hour's outage caught up in {took_s:.0f} s, while"
        f" {told.rate:.0f}/s were written: {rows} of {written} stored, {rows - distinct} twice, {refused} refused;"
        f" states told meanwhile are in the database after p50 {p50:.2f}, p99 {p99:.2f}, most {most:.2f} s, and"
        f" no station's is older than {gap_s or 0:.1f} s",
        flush=True,
    )
    return bool(rows == distinct == written and not refused and p99 < FRESH_S)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what came of it; exit code 1 where anything is missing, there twice, or late."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fleet_load", description=__doc__.splitlines()[0])
    parser.add_argument("--connections", type=int, default=1000)
    parser.add_argument("--rate", type=float, default=1000.0, help="records a second of all stations")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument(
        "--outage", type=int, default=60, help="records that wait at each station: an hour of one a minute"
    )
    parser.add_argument("--keep", type=Path, help="folder to keep logs in")
    told = parser.parse_args(arguments)
    told.slack = 2 * told.rate  # what was written in two seconds is on its way
    if lacking := missing():
        print(not_installed(*lacking), file=sys.stderr)
        return 2
    set_up(as_json=True)
    with tempfile.TemporaryDirectory(prefix="reprobe-fleet-") as scratch:
        folder = Path(scratch) if told.keep is None else told.keep
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o711)  # the broker becomes another user
        return 0 if asyncio.run(measure(folder, told)) else 1


if __name__ == "__main__":
    sys.exit(main())
