"""Tables of the cycle bench: medians of each operation, and what was asked on the line."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from tests.bench.cycle.line import by_name
from tests.bench.cycle.station import Cycle


def by_operation(cycles: Iterable[Cycle]) -> dict[str, list[Cycle]]:
    """Put the cycles of each operation together, in the order in which they came first."""
    found: defaultdict[str, list[Cycle]] = defaultdict(list)
    for cycle in cycles:
        found[cycle.op].append(cycle)
    return dict(found)


def p95(values: Sequence[float]) -> float:
    """Return the value that 95 of 100 do not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, round(0.95 * len(ordered)))]


def summary(cycles: Sequence[Cycle]) -> list[str]:
    """Return one row an operation: medians, ms where nothing else is said."""
    rows = [
        "| operation | n | measured | p95 | floor | ratio | software | requests (least..most) | bytes |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for op, some in by_operation(cycles).items():
        all_ms = [1e3 * cycle.budget.measured_s for cycle in some]
        asked = [cycle.budget.requests for cycle in some]
        floor_ms = 1e3 * statistics.median(cycle.budget.floor_s for cycle in some)
        ratio = statistics.median(cycle.budget.ratio for cycle in some)
        software_ms = 1e3 * statistics.median(cycle.budget.software_s for cycle in some)
        size = statistics.median(cycle.budget.size for cycle in some)
        times = f"{statistics.median(all_ms):.0f} | {p95(all_ms):.0f} | {floor_ms:.0f} | {ratio:.2f}"
        line = f"{statistics.median(asked):.0f} ({min(asked)}..{max(asked)}) | {size:.0f}"
        rows.append(f"| {op} | {len(some)} | {times} | {software_ms:.0f} | {line} |")
    return rows


def where(cycles: Sequence[Cycle]) -> list[str]:
    """Return of what the floor is made and where the rest went, by name: medians, ms."""
    rows = ["| operation | floor | the rest |", "|---|---|---|"]
    for op, some in by_operation(cycles).items():
        floor = _medians([cycle.budget.floor for cycle in some])
        rest = _medians([cycle.budget.rest for cycle in some])
        rows.append(f"| {op} | {floor} | {rest} |")
    return rows


def asked(cycles: Sequence[Cycle]) -> list[str]:
    """Return what was asked in the median cycle of each operation, the most frequent first."""
    rows = ["| operation | requests | of which |", "|---|---|---|"]
    for op, some in by_operation(cycles).items():
        middle = sorted(some, key=lambda cycle: cycle.budget.requests)[len(some) // 2]
        names = ", ".join(f"{name} {count}" for name, count in by_name(middle.part))
        rows.append(f"| {op} | {middle.budget.requests} | {names} |")
    return rows


def _medians(parts: Sequence[Mapping[str, float]]) -> str:
    told = {name: 1e3 * statistics.median(part[name] for part in parts) for name in parts[0]}
    return ", ".join(f"{name} {ms:.0f}" for name, ms in told.items())
