"""From records to numbers: what a line of the table and a line of the verdict say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.bench.vision.campaign import Record
from tests.bench.vision.methods import OURS


@dataclass(frozen=True)
class Line:
    """One method's figures. rms_px (2-D) and p99_px are over the found ones; nan where there are none."""

    method: str
    scenes: int
    found: int
    missed: int
    wrong: int
    rms_px: float
    p99_px: float
    ms: float
    p95_ms: float
    crb_ratio: float


def rms_px(records: Iterable[Record]) -> float:
    errors = [record.error_px for record in records if record.outcome == "found"]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")


def p99_px(records: Iterable[Record]) -> float:
    errors = [record.error_px for record in records if record.outcome == "found"]
    return float(np.percentile(errors, 99)) if errors else float("nan")


def crb_ratio(records: Iterable[Record]) -> float:
    """Return rms error over rms bound, nan without a bound."""
    found = [record for record in records if record.outcome == "found" and record.bound_px > 0]
    bounds = [record.bound_px for record in found]
    return rms_px(found) / float(np.sqrt(np.mean(np.square(bounds)))) if found else float("nan")


def count(records: Iterable[Record], outcome: str) -> int:
    return sum(record.outcome == outcome for record in records)


def timed(records: Iterable[Record]) -> list[float]:
    """Return the times, ms, of calls that looked at a picture: a needle that could not be taught is not looked for."""
    return [record.ms for record in records if not record.reason.startswith("not taught")]


def line(method: str, records: Sequence[Record]) -> Line:
    times = timed(records) or [float("nan")]
    return Line(
        method,
        len(records),
        count(records, "found"),
        count(records, "missed"),
        count(records, "wrong"),
        rms_px(records),
        p99_px(records),
        float(np.median(times)),
        float(np.percentile(times, 95)),
        crb_ratio(records),
    )


def by_artist(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Return records by artist, in the order artists first appear."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.artist, []).append(record)
    return groups


def by_method(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Return records by method, in the order methods first appear."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.method, []).append(record)
    return groups


Keep = Callable[[Record], bool]
# What a table shows in blocks of its own.
BLOCKS: dict[str, dict[str, Keep]] = {
    "tip": {
        "clean": lambda r: not r.hard and not r.defect,
        "hard": lambda r: r.hard and not r.defect,
        "defects": lambda r: r.defect,
    },
    "pads": {
        "whole, clean": lambda r: r.hidden == 0 and not r.hard and not r.empty,
        "whole, hard": lambda r: r.hidden == 0 and r.hard and not r.empty,
        "needle over up to a third": lambda r: r.hidden > 0 and not r.empty,
        "no pad there": lambda r: r.empty,
    },
    "disc": {f"noise {noise:g}": (lambda r, noise=noise: r.noise == noise) for noise in (2.0, 4.0, 8.0)},
    "control": {
        "two arms hidden": lambda r: r.plain_kind == "two arms hidden",
        "one arm hidden or none": lambda r: r.plain_kind != "two arms hidden",
    },
}


@dataclass(frozen=True)
class Verdict:
    """A target, what was measured, and whether it was reached (None: not measured in this run)."""

    target: str
    measured: str
    reached: bool | None


def _at_most(target: str, limit: float, value: float, unit: str, records: Sequence[Record]) -> Verdict:
    """Judge a figure of the right answers, and say how many of the scenes have none."""
    if not records:
        return Verdict(target, "not measured", None)
    right = f"{count(records, 'found')} of {len(records)} scenes"
    if not np.isfinite(value):
        return Verdict(target, f"no right answer in {len(records)} scenes", reached=False)
    return Verdict(target, f"{value:.4g} {unit}, the right answers of {right}", value <= limit)


def _none_wrong(target: str, records: Sequence[Record]) -> Verdict:
    wrong = count(records, "wrong")
    if not records:
        return Verdict(target, "not measured", None)
    return Verdict(target, f"{wrong} in {len(records)} scenes", wrong == 0)


def _right(records: Sequence[Record]) -> Verdict:
    target = "right pad of all scenes that have one, 99.5 %, the rest not found"
    if not records:
        return Verdict(target, "not measured", None)
    share, wrong = 100 * count(records, "found") / len(records), count(records, "wrong")
    missed = count(records, "missed")
    text = f"{share:.2f} % of {len(records)}, {missed} not found, {wrong} wrong"
    return Verdict(target, text, share >= 99.5 and wrong == 0)


def verdicts(records: Iterable[Record]) -> list[Verdict]:
    """Return the targets in turn for ours as a station calls it."""
    ours = [record for record in records if record.method == OURS]
    found: list[Verdict] = []
    tasks = {record.task for record in ours}
    for task in ("tip", "pads", "disc", "control"):
        if task in tasks:
            found += _VERDICTS[task]([record for record in ours if record.task == task])
    return found


def _tip(ours: list[Record]) -> list[Verdict]:
    found = []
    for block, rms, p99 in (("clean", 0.15, 0.4), ("hard", 0.3, 0.9)):
        part = [record for record in ours if BLOCKS["tip"][block](record)]
        found.append(_at_most(f"tip, {block}: rms at most {rms} px", rms, rms_px(part), "px", part))
        found.append(_at_most(f"tip, {block}: 99 % within {p99} px", p99, p99_px(part), "px", part))
    found.append(_none_wrong("wrong tip: none (3 px), defects included", ours))
    # How soon a damaged needle is refused is not what a correction waits for.
    whole = [record for record in ours if not record.defect]
    return [*found, _time("tip (TEDA): 8 ms median", 8.0, whole)]


def _pads(ours: list[Record]) -> list[Verdict]:
    found = []
    for block, rms in (("whole, clean", 0.05), ("whole, hard", 0.05), ("needle over up to a third", 0.2)):
        part = [record for record in ours if BLOCKS["pads"][block](record)]
        found.append(_at_most(f"target, {block}: rms at most {rms} px", rms, rms_px(part), "px", part))
    found.append(_right([record for record in ours if not record.empty]))
    found.append(_none_wrong("wrong pad: none (3 px), empty scenes included", ours))
    return [*found, _time("pads (TDEA): 3 ms median", 3.0, ours)]


def _disc(ours: list[Record]) -> list[Verdict]:
    part = [record for record in ours if record.noise == 8.0]
    target = "disc centre at noise 8: within 1.5 x the Cramer-Rao bound"
    return [_at_most(target, 1.5, crb_ratio(part), "x", part)]


def _control(ours: list[Record]) -> list[Verdict]:
    part = [record for record in ours if BLOCKS["control"]["two arms hidden"](record)]
    return [_at_most("control point, two arms hidden: rms at most 0.2 px", 0.2, rms_px(part), "px", part)]


def _time(target: str, limit: float, records: list[Record]) -> Verdict:
    times = timed(records)
    if not times:
        return Verdict(target, "not measured", None)
    median = float(np.median(times))
    return Verdict(target, f"{median:.3g} ms over {len(times)} scenes", median <= limit)


_VERDICTS = {"tip": _tip, "pads": _pads, "disc": _disc, "control": _control}


def worst(records: Iterable[Record], many: int = 10) -> list[Record]:
    """Return ours' worst scenes: wrong picks by error, then missed ones and the largest errors half and half."""
    ours = [record for record in records if record.method == OURS]
    wrong = [record for record in ours if record.outcome == "wrong"]
    # A defect that is refused is no failure.
    missed = [record for record in ours if record.outcome == "missed" and not record.defect]
    found = sorted((record for record in ours if record.outcome == "found"), key=lambda record: -record.error_px)
    wrong.sort(key=lambda record: -record.error_px if np.isfinite(record.error_px) else -np.inf)
    left = max(many - len(wrong), 0)
    some = _varied(missed)[: max(left // 2, left - len(found))]
    return [*wrong[:many], *some, *found[: left - len(some)]]


def _varied(records: list[Record]) -> list[Record]:
    """Return the records with the first of each artist, kind and reason in front."""
    first = {(record.artist, record.plain_kind, record.reason): record for record in reversed(records)}
    front = sorted(first.values(), key=records.index)
    return front + [record for record in records if record not in front]
