"""Rotational records as CSV: theta_deg, x_um, y_um, one row per head angle (thesis, appendix D).

Anything doubtful is refused with the line it stands in; nothing is repaired, skipped or guessed.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daemon.platform.plain_file import as_text, read_small

Array = NDArray[np.float64]
MOST_BYTES = 50_000_000
COLUMNS = ("theta_deg", "x_um", "y_um")
SAME_ANGLE_DEG = 0.01
TURN_DEG = 360.0


class BadRecord(ValueError):
    """A file is not a rotational record; the message names the line, `advice` says what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


@dataclass(frozen=True)
class RotationalRecord:
    """Head angles and head positions with the tip on one control point; each (N,), in the file's order."""

    theta_deg: Array
    x_um: Array
    y_um: Array

    def __len__(self) -> int:
        return len(self.theta_deg)

    def rows(self, chosen: NDArray[np.bool_]) -> RotationalRecord:
        """Return the rows chosen by (N,) flags."""
        return RotationalRecord(self.theta_deg[chosen], self.x_um[chosen], self.y_um[chosen])


def read_record(path: Path) -> RotationalRecord:
    """Read a record from a file; BadRecord for one that cannot be read or is none."""
    try:
        text = as_text(read_small(path, MOST_BYTES))
    except OSError as exc:
        raise BadRecord(f"{path} cannot be read: {exc.strerror}", "name a CSV file that exists") from exc
    except ValueError as exc:
        wanted = f"give a CSV with the columns {', '.join(COLUMNS)}"
        raise BadRecord(f"{path} is not a text file: {exc}", wanted) from exc
    return parse_record(text.splitlines())


def parse_record(lines: Iterable[str]) -> RotationalRecord:
    """Read a record from the lines of a CSV with a header; empty lines and those from # on do not count."""
    rows = list(_cells(lines))
    if not rows:
        raise BadRecord("the record is empty", f"its first line names the columns {', '.join(COLUMNS)}")
    where = _columns(*rows[0])
    seen: dict[int, tuple[int, float]] = {}
    numbers = []
    for line, cells in rows[1:]:
        if len(cells) != len(rows[0][1]):
            raise BadRecord(f"line {line}: {len(cells)} cells where {len(rows[0][1])} belong", _MEND)
        row = [_number(line, name, cells[column]) for name, column in zip(COLUMNS, where, strict=True)]
        _refuse_twice(seen, line, row[0])
        numbers.append(row)
    if not numbers:
        raise BadRecord("the record has a header and no rows", "record some angles first")
    theta, x, y = np.array(numbers).T
    return RotationalRecord(theta, x, y)


_MEND = "mend the line, or take it out"


def _cells(lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield line numbers, from 1, and stripped cells."""
    for number, line in enumerate(lines, start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                row = next(csv.reader([line]))
            except csv.Error as exc:
                raise BadRecord(f"line {number}: {exc}", _MEND) from exc
            yield number, [cell.strip() for cell in row]


def _columns(line: int, header: list[str]) -> list[int]:
    """Return where the three columns are."""
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise BadRecord(
            f"line {line}: no column {', '.join(missing)} in {', '.join(header)[:80]!r}",
            f"the first line names the columns {', '.join(COLUMNS)}, in any order",
        )
    if doubled := [name for name in COLUMNS if header.count(name) > 1]:
        raise BadRecord(f"line {line}: the column {doubled[0]} is there twice", "keep one of them")
    return [header.index(name) for name in COLUMNS]


def _number(line: int, name: str, cell: str) -> float:
    """Return a cell as a finite number."""
    if not cell:
        raise BadRecord(f"line {line}: {name} is empty", _MEND)
    try:
        value = float(cell)
    except ValueError:
        raise BadRecord(f"line {line}: {name} is {cell[:40]!r}, not a number", _MEND) from None
    if not math.isfinite(value):
        raise BadRecord(f"line {line}: {name} is {cell[:40]}", _MEND)
    return value


def _refuse_twice(seen: dict[int, tuple[int, float]], line: int, theta_deg: float) -> None:
    """Remember an angle by its hundredth of a degree; BadRecord if it was there before, a turn more or less."""
    slots = round(TURN_DEG / SAME_ANGLE_DEG)
    slot = math.floor(theta_deg % TURN_DEG / SAME_ANGLE_DEG) % slots
    for near in (slot - 1, slot, slot + 1):
        earlier, other = seen.get(near % slots, (0, math.inf))
        if earlier and abs((theta_deg - other + TURN_DEG / 2) % TURN_DEG - TURN_DEG / 2) < SAME_ANGLE_DEG:
            raise BadRecord(
                f"line {line}: the angle {theta_deg:g} deg is in line {earlier} as well", "keep one of them"
            )
    seen[slot] = (line, theta_deg)
