"""Timeline of one correction: its states, light, exposures, moves and the line, read from a bench's record. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tests.bench.cycle.legs import Leg
from tests.bench.cycle.line import WRITE_COILS, Exchange, lit_frames

MARKS = "marks.jsonl"
"""Beside the line's record: when the states of jobs began, and frames of looks were there."""
STATES = ("triggered", "look", "move", "verify")
"""Of a correction with one move."""
FRAMES = 4
LAMPS = {0: "dark", 1: "white", 2: "red"}
"""By the coils of the bench's station: white on the first, red on the second."""


@dataclass(frozen=True)
class Span:
    """Something that lasted, seconds since the correction began."""

    name: str
    begun_s: float
    over_s: float


@dataclass(frozen=True)
class Timeline:
    """One correction, in seconds since it began. frames: from the exposure's begin until it was decoded."""

    seconds: float
    states: tuple[Span, ...]
    lamps: tuple[Span, ...]
    exposures: tuple[Span, ...]
    frames: tuple[Span, ...]
    moves: tuple[Span, ...]
    line: tuple[Span, ...]


@dataclass(frozen=True)
class _Job:
    """The states of a job with the times at which they began, and when it was over."""

    states: tuple[tuple[float, str], ...]
    over_s: float


def corrections(marks: Iterable[str], part: Sequence[Exchange], legs: Sequence[Leg]) -> list[Timeline]:
    """Return every correction of one move and two looks, in the order of the record."""
    told = [json.loads(line) for line in marks]
    found = []
    for job in _jobs([(when_s, what[0]) for when_s, kind, *what in told if kind == "state"]):
        begun_s, over_s = job.states[0][0], job.over_s
        inside = [exchange for exchange in part if begun_s <= exchange.sent_s <= over_s]
        if tuple(name for _, name in job.states) != STATES or lit_frames(inside) != FRAMES:
            continue
        frames = [(when_s, *what) for when_s, kind, *what in told if kind == "frame" and begun_s <= when_s <= over_s]
        driven = [leg for leg in legs if begun_s <= leg.begun_s <= over_s]
        found.append(_timeline(job, frames, inside, driven))
    return found


def _jobs(entered: Sequence[tuple[float, str]]) -> list[_Job]:
    """Put states together to jobs: each begins as triggered, and ends where its last state is told once more."""
    jobs: list[_Job] = []
    states: list[tuple[float, str]] = []
    for when_s, name in entered:
        if name == STATES[0]:
            states = [(when_s, name)]
        elif states and name == states[-1][1]:
            jobs.append(_Job(tuple(states), when_s))
            states = []
        elif states:
            states.append((when_s, name))
    return jobs


def _timeline(
    job: _Job, frames: Sequence[tuple[float, float, float]], part: Sequence[Exchange], legs: Sequence[Leg]
) -> Timeline:
    zero_s = job.states[0][0]

    def span(name: str, begun_s: float, over_s: float) -> Span:
        return Span(name, begun_s - zero_s, over_s - zero_s)

    ends = [begun_s for begun_s, _ in job.states[1:]] + [job.over_s]
    switched = [e for e in part if e.request[1] == WRITE_COILS]
    until = [e.done_s for e in switched[1:]] + [job.over_s]
    return Timeline(
        seconds=job.over_s - zero_s,
        states=tuple(span(name, at_s, end_s) for (at_s, name), end_s in zip(job.states, ends, strict=True)),
        lamps=tuple(span(LAMPS[e.request[7]], e.done_s, end_s) for e, end_s in zip(switched, until, strict=True)),
        exposures=tuple(span("", start_s, start_s + length_s) for _, start_s, length_s in frames),
        frames=tuple(span("", start_s, there_s) for there_s, start_s, _ in frames),
        moves=tuple(
            span(name, leg.begun_s, leg.begun_s + way.seconds) for leg in legs for name, way in leg.ways.items()
        ),
        line=tuple(span(e.name, e.sent_s, e.done_s) for e in part),
    )
