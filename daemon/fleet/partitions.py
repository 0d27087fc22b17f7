"""Partitions of the records by month and of what is kept whole by day: made ahead, dropped when their time is over."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, date, datetime, timedelta
from typing import NamedTuple


class Partition(NamedTuple):
    """One partition: a table's rows that were received from one time on and before another, UTC."""

    table: str
    name: str
    begin: date
    end: date

    @property
    def sql(self) -> str:
        """What makes it."""
        return (
            f"CREATE TABLE IF NOT EXISTS {self.name} PARTITION OF {self.table}"
            f" FOR VALUES FROM ('{self.begin} 00:00+00') TO ('{self.end} 00:00+00')"
        )


def month_of(day: date) -> Partition:
    """Return the partition of `records` for a day."""
    begin = day.replace(day=1)
    end = (begin + timedelta(days=31)).replace(day=1)
    return Partition("records", f"records_{begin:%Y_%m}", begin, end)


def day_of(day: date) -> Partition:
    """Return the partition of `recent` for a day."""
    return Partition("recent", f"recent_{day:%Y_%m_%d}", day, day + timedelta(days=1))


def needed(now: datetime) -> tuple[Partition, ...]:
    """Return the partitions that must be there at a time, those of tomorrow, too."""
    today = now.astimezone(UTC).date()
    days = (today, today + timedelta(days=1))
    return tuple(dict.fromkeys((*map(month_of, days), *map(day_of, days))))


def over(names: Iterable[str], now: datetime, recent_days: int, record_months: int | None) -> list[str]:
    """Return the names of partitions whose rows are all past retention; `record_months` None: records have none."""
    today = now.astimezone(UTC).date()
    oldest_day = today - timedelta(days=recent_days)
    gone: list[str] = []
    for name in names:
        if found := re.fullmatch(r"recent_(\d{4})_(\d\d)_(\d\d)", name):
            if date(*map(int, found.groups())) < oldest_day:
                gone.append(name)
        elif (found := re.fullmatch(r"records_(\d{4})_(\d\d)", name)) and record_months is not None:
            year, month = map(int, found.groups())
            if (today.year - year) * 12 + today.month - month > record_months:
                gone.append(name)
    return gone
