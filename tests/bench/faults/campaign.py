"""Campaign: the parts shared out among stations, several stations at a time, each item with its own dice."""

from __future__ import annotations

import random
import tempfile
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
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
OWN = (*PLAIN, "rows")
"""In this order: after the rows the axes need not stand where they count."""
PARTS = (*OWN, "messages")
Item = tuple[str, int]
"""Part and number."""


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

    def share(self, number: int) -> list[Item]:
        """Return what only one station does: part and number of each item."""
        mine = [(part, n) for part in OWN for n in range(self.items(part)) if n % self.stations == number]
        return [item for item in mine if self.wants(item)]

    def anybodys(self) -> list[Item]:
        """Return what any station does once its own share is done."""
        return [("messages", n) for n in range(self.items("messages")) if self.wants(("messages", n))]

    def wants(self, item: Item) -> bool:
        return self.only in (None, f"{item[0]}:{item[1]}")

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
    tally, common = Tally(), deque(plan.anybodys())
    with ThreadPoolExecutor(plan.workers) as pool:
        for part in pool.map(lambda number: _station(plan, number, common, say, enough), range(plan.stations)):
            tally.done += part.done
            tally.accepted += part.accepted
            tally.violations += part.violations
    return tally


def _station(
    plan: Plan, number: int, common: deque[Item], say: Callable[[str], None], enough: threading.Event
) -> Tally:
    """Run one station's share, then what is left of the common one, of which others take too.

    A station that cannot go on is replaced by another of the same seed.
    """
    tally, share = Tally(), deque(plan.share(number))
    while (share or common) and not enough.is_set():
        begun = False
        station: Station | None = None
        try:
            with (
                tempfile.TemporaryDirectory() as out,
                running_station(Path(out), plan.seed + number, plan.speed, plan.program) as station,
            ):
                while not enough.is_set() and (item := _next(share, common)):
                    begun, (part, n) = True, item
                    _item(plan, station, part, n)
                    tally.done[part] += 1
                    say(f"{part}:{n}")
        except Exception as exc:  # noqa: BLE001  # whatever ends an item is what is looked for
            at = station.item if station else "all"
            where = traceback.extract_tb(exc.__traceback__)[-1].name
            tally.violations.append(Violation("other", at, f"{type(exc).__name__} in {where}: {exc}"))
            say(f"{at} ended: {exc}")
            if not begun:
                break
        if station:
            tally.violations += station.violations
            tally.accepted += sum(job.accepted for job in station.ledger.jobs())
    return tally


def _next(share: deque[Item], common: deque[Item]) -> Item | None:
    """Take the next item; None where nothing is left."""
    for items in (share, common):
        with suppress(IndexError):  # another station may have taken the last of the common ones
            return items.popleft()
    return None


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
