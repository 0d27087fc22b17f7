"""Campaign: the parts shared out among stations, several stations at a time, each item with its own dice."""

from __future__ import annotations

import random
import tempfile
import threading
import traceback
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from tests.bench.faults import (
    calibrations,
    cancels,
    full_disk,
    fuzz,
    half_open,
    hangups,
    kills,
    matrix,
    resets,
)
from tests.bench.faults.records import Violation
from tests.bench.faults.station import Station, running_station
from tests.station.rig import PROGRAM

PLAIN: dict[str, Callable[[Station, random.Random], None]] = {
    "kills": kills.one, "resets": resets.one, "cancels": cancels.one, "hangups": hangups.one, "disks": full_disk.one,
    "peers": half_open.one, "calibrations": calibrations.one,
}  # fmt: skip
"""Parts whose items are told apart by their dice alone."""
PARTS = (*PLAIN, "rows", "messages")
"""In this order: after the rows the axes need not stand where they count."""


@dataclass(frozen=True)
class Plan:
    """What is asked; `only` is one item, such as `rows:17`; `program` is what is run as the daemon."""

    seed: int
    counts: dict[str, int]
    stations: int
    workers: int
    speed: float
    only: str | None = None
    program: tuple[str, ...] = PROGRAM

    def items(self, part: str) -> int:
        """Return how many items a part has; messages go by batches."""
        return -(-self.counts[part] // fuzz.BATCH) if part == "messages" else self.counts[part]

    def share(self, number: int) -> list[tuple[str, int]]:
        """Return what one station does: part and number of each item."""
        mine = [(part, n) for part in PARTS for n in range(self.items(part)) if n % self.stations == number]
        return [item for item in mine if self.only in (None, f"{item[0]}:{item[1]}")]

    def repeat(self, violation: Violation) -> str:
        """Return the command that does the same item again."""
        words = f"python -m tests.bench.faults --seed {self.seed} --stations {self.stations} --speed {self.speed:g}"
        counts = " ".join(f"--{part} {count}" for part, count in self.counts.items())
        return f"{words} {counts}" + (f" --only {violation.item}" if ":" in violation.item else "")


@dataclass
class Tally:
    """What came of it."""

    done: Counter[str] = field(default_factory=Counter)
    accepted: int = 0
    violations: list[Violation] = field(default_factory=list)


def run(plan: Plan, say: Callable[[str], None], enough: threading.Event | None = None) -> Tally:
    """Run all stations; return what was done and found. `enough`: once set, each ends after the item it is at."""
    enough = enough or threading.Event()
    tally = Tally()
    with ThreadPoolExecutor(plan.workers) as pool:
        for part in pool.map(lambda number: _station(plan, number, say, enough), range(plan.stations)):
            tally.done += part.done
            tally.accepted += part.accepted
            tally.violations += part.violations
    return tally


def _station(plan: Plan, number: int, say: Callable[[str], None], enough: threading.Event) -> Tally:
    """Run one station's share; a station that cannot go on is replaced by another of the same seed."""
    tally, share = Tally(), plan.share(number)
    while share and not enough.is_set():
        at_start = len(share)
        station: Station | None = None
        try:
            with (
                tempfile.TemporaryDirectory() as out,
                running_station(Path(out), plan.seed + number, plan.speed, plan.program) as station,
            ):
                while share and not enough.is_set():
                    part, n = share.pop(0)
                    _item(plan, station, part, n)
                    tally.done[part] += 1
                    say(f"{part}:{n}")
        except Exception as exc:  # noqa: BLE001  # whatever ends an item is what is looked for
            item = station.item if station else "all"
            where = traceback.extract_tb(exc.__traceback__)[-1].name
            tally.violations.append(Violation("other", item, f"{type(exc).__name__} in {where}: {exc}"))
            say(f"{item} ended: {exc}")
            if len(share) == at_start:
                break
        if station:
            tally.violations += station.violations
            tally.accepted += sum(job.accepted for job in station.ledger.jobs())
    return tally


def _item(plan: Plan, station: Station, part: str, n: int) -> None:
    """Do one item with the dice that belong to it."""
    chance = random.Random(f"{plan.seed}:{part}:{n}")
    station.begin(f"{part}:{n}")
    if part in PLAIN:
        PLAIN[part](station, chance)
    elif part == "rows":
        matrix.one(station, chance, matrix.rows(plan.seed, plan.counts["rows"])[n])
    else:
        fuzz.one(station, chance, min(fuzz.BATCH, plan.counts["messages"] - n * fuzz.BATCH))
