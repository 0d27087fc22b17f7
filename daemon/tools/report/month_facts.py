"""Facts of a month, read once from the journal, a day at a time, in bounded memory."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.domain.errors import FaultCode
from daemon.maintenance.catalogue import Spec, all_specs
from daemon.maintenance.proportion_test import ShareSettings
from daemon.storage.journal_reader import JournalReader

FIRST_OF_THE_STATION = 2000
"""Codes below are of requests."""
OF_A_LINE = re.compile(r"bus_(?:timeouts|garbled)_(.+)")


@dataclass
class Course:
    """One watch's numbers over the month: days (N,) from 1.0 on, values (N,); events and trials by day for a share."""

    spec: Spec
    days: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    by_day: dict[int, tuple[int, int]] = field(default_factory=dict)

    def daily(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return days, their means and standard deviations, (N,) each."""
        days = np.floor(np.array(self.days))
        values = np.array(self.values)
        found = np.unique(days)
        rows = [values[days == day] for day in found]
        return found + 0.5, np.array([r.mean() for r in rows]), np.array([r.std() for r in rows])

    @property
    def is_share(self) -> bool:
        """Whether it counts events among trials."""
        return isinstance(self.spec.settings, ShareSettings)


@dataclass(frozen=True)
class AlertLine:
    """One alert event of the month."""

    at: str
    day: float
    name: str
    change: str
    message: str
    by: str
    note: str


@dataclass(frozen=True)
class Month:
    """Everything the page says."""

    station: str
    first: datetime
    last: datetime
    touches: int
    """Of runs and testers alike."""
    jobs: int
    failures: Mapping[str, int]
    """Error name -> how many jobs ended with it."""
    courses: Mapping[str, Course]
    alerts: tuple[AlertLine, ...]
    still_standing: tuple[str, ...]
    """Alerts of this month, or of before, that stood at its end."""

    @property
    def own_failures(self) -> int:
        """How many jobs failed at the station's own work: not for what they asked, nor because they were cancelled."""
        asked = {kind.name.lower() for kind in FaultCode if kind.value.code < FIRST_OF_THE_STATION}
        return sum(count for name, count in self.failures.items() if name not in asked)


def read_month(journal: Path, station: str, first: datetime, after: datetime) -> Month:
    """Read one month; raise `NoJournal` if the journal cannot be read."""
    since, before = (moment.isoformat(timespec="milliseconds") for moment in (first, after))
    with JournalReader(journal) as reader:
        courses = _courses(reader, since, before, first)
        touches = reader.touches(since, before)
        failures: Counter[str] = Counter()
        jobs = 0
        for job in reader.jobs(since=since):
            if job.received_at >= before:
                continue
            jobs += 1
            if job.error is not None:
                failures[job.error["name"]] += 1
        lines, standing = _alerts(reader, since, before, first)
    return Month(station, first, after, touches, jobs, dict(failures.most_common()), courses, lines, standing)


def _courses(reader: JournalReader, since: str, before: str, first: datetime) -> dict[str, Course]:
    """Return the courses of all watches that have numbers."""
    found: dict[str, Course] = {}
    known: dict[str, Spec | None] = {}
    for at, _, body in reader.measurements(since, before):
        day = _day(at, first)
        for name, values in body["numbers"].items():
            if name not in known:
                known[name] = _spec_of(name)
            spec = known[name]
            if spec is None or not values or not (spec.settings or spec.unit):  # what is yes or no has no course
                continue
            course = found.setdefault(name, Course(spec))
            if not course.is_share:
                numbers = values if spec.settings else values[:1]  # a figure stands before its limits
                course.days += [day] * len(numbers)
                course.values += numbers
            else:
                events, trials = course.by_day.get(int(day), (0, 0))
                course.by_day[int(day)] = (events + int(values[0]), trials + int(values[1]))
    order = {spec.name: k for k, spec in enumerate(all_specs(_buses(found)))}
    return {name: found[name] for name in sorted(found, key=lambda name: order[name])}


def _spec_of(name: str) -> Spec | None:
    """Return a watch by its name; a line is known by what its watch is called."""
    return next((spec for spec in all_specs(_buses([name])) if spec.name == name), None)


def _buses(names: Iterable[str]) -> list[str]:
    return sorted({line[1] for name in names if (line := OF_A_LINE.fullmatch(name))})


def _day(at: str, first: datetime) -> float:
    """Return a moment as days of the month, 1.0 being its first."""
    return 1.0 + (datetime.fromisoformat(at) - first).total_seconds() / 86400.0


def _alerts(
    reader: JournalReader, since: str, before: str, first: datetime
) -> tuple[tuple[AlertLine, ...], tuple[str, ...]]:
    """Return the month's alert events, and the names of what stood at its end."""
    lines: list[AlertLine] = []
    stands: defaultdict[str, bool] = defaultdict(bool)
    for event in reader.alerts():
        at = str(event["at"])
        if at >= before:  # not the end of them: a clock may have been set back
            continue
        stands[str(event["name"])] = bool(event["raised"])
        if at >= since:
            lines.append(_line(event, at, first))
    return tuple(lines), tuple(sorted(name for name, raised in stands.items() if raised))


def _line(event: Mapping[str, Any], at: str, first: datetime) -> AlertLine:
    known = event.get("acknowledged") or {}
    change = str(event.get("change") or ("raised" if event["raised"] else "cleared"))
    by, note = (str(known.get(key, "")) for key in ("by", "note"))
    return AlertLine(at, _day(at, first), str(event["name"]), change, str(event["message"]), by, note)
