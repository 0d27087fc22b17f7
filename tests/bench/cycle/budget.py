"""Budget of one operation: measured, its floor, and where the rest went. Pure; times are seconds.

The floor is what light, exposure, motion and the line's own bytes cannot do without: the moves that are needed by
their trapezoids, one after the other with the frames that are needed, each after its lamp or the head has settled, and
the bytes that pass while nothing moves. Nothing of it overlaps but the first lamp with the move before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tests.bench.cycle.legs import Leg, needed_s
from tests.bench.cycle.line import Exchange, lit_frames


@dataclass(frozen=True)
class StationFacts:
    """What the configuration says of light, camera and line."""

    head_settles_s: float
    light_settles_s: float
    exposure_s: float
    readout_s: float
    byte_s: float
    dwell_s: float


@dataclass(frozen=True)
class Budget:
    """One operation."""

    measured_s: float
    floor: Mapping[str, float]
    rest: Mapping[str, float]
    """What it took beside, by name; below zero where it ran beside something of the floor.

    `detour`: rising higher than the ends of a hop, and coming from one side. `line`: gaps, turn-arounds and thought
    of the requests made while nothing moved. `seen late`: how long an axis stood before that was seen. `lamps`: waits
    for steady light. `camera`: waits for a frame to begin. `not told`: what no name was found for.
    """
    requests: int
    size: int
    frames: int
    software_s: float

    @property
    def floor_s(self) -> float:
        """Return what it could not do without."""
        return sum(self.floor.values())

    @property
    def ratio(self) -> float:
        """Return how many times the floor it took."""
        return self.measured_s / self.floor_s if self.floor_s else float("inf")


def budget(
    timing_ms: Mapping[str, Mapping[str, float]],
    part: Sequence[Exchange],
    legs: Sequence[Leg],
    facts: StationFacts,
    *,
    dwells: int = 0,
) -> Budget:
    """Hold a job's own clock against the facts of the line. `dwells`: how often it stood on a pad on purpose."""
    spent = {what: _spent_s(timing_ms, what) for what in ("total", "motion", "bus", "light", "exposure", "software")}
    still = [exchange for exchange in part if not _moving(exchange, legs)]
    frames = lit_frames(part)
    looks = _looks_after_moves(part, legs)
    steady_s = looks * facts.head_settles_s + (frames - looks) * facts.light_settles_s
    driven_s = sum(leg.seconds for leg in legs)
    floor = {
        "moves": needed_s(legs),
        "dwell": dwells * facts.dwell_s,
        "steady": steady_s,
        "exposure": frames * (facts.exposure_s + facts.readout_s),
        "bytes": sum(exchange.size for exchange in still) * facts.byte_s,
    }
    rest = {
        "detour": driven_s - floor["moves"],
        "line": _taken_s(still, legs) - floor["bytes"],
        "seen late": spent["motion"] - driven_s - _in_motion_s(still, legs),
        "lamps": spent["light"] - steady_s,
        "camera": spent["exposure"] - floor["exposure"],
        "software": spent["software"] - floor["dwell"],
    }
    rest["not told"] = spent["total"] - sum(floor.values()) - sum(rest.values())
    size = sum(exchange.size for exchange in part)
    return Budget(spent["total"], floor, rest, len(part), size, frames, rest["software"])


def _spent_s(timing_ms: Mapping[str, Mapping[str, float]], what: str) -> float:
    return sum(row.get(what, 0.0) for row in timing_ms.values()) / 1e3


def _moving(exchange: Exchange, legs: Sequence[Leg]) -> bool:
    return any(leg.begun_s < exchange.sent_s < leg.begun_s + leg.seconds for leg in legs)


def _taken_s(part: Sequence[Exchange], legs: Sequence[Leg]) -> float:
    """Return how long the line was busy with requests while nothing moved; a set-point's own time is the move's."""
    starts = {leg.begun_s for leg in legs}
    return sum(exchange.done_s - exchange.sent_s for exchange in part if exchange.sent_s not in starts)


def _in_motion_s(still: Sequence[Exchange], legs: Sequence[Leg]) -> float:
    """Return how much of that lies between the first leg's and the last leg's begin: it is booked as motion."""
    if not legs:
        return 0.0
    inside = [e for e in still if legs[0].begun_s < e.sent_s < legs[-1].begun_s + legs[-1].seconds]
    return _taken_s(inside, legs)


def _looks_after_moves(part: Sequence[Exchange], legs: Sequence[Leg]) -> int:
    """Count the moves that a lit frame follows: only there the head has to settle."""
    lit = [e.sent_s for e in part if lit_frames([e])]
    ends = [leg.begun_s + leg.seconds for leg in legs]
    nexts = [leg.begun_s for leg in legs[1:]] + [float("inf")]
    followed = 0
    for before_s, end_s, next_s in zip((leg.begun_s for leg in legs), ends, nexts, strict=False):
        in_time = [when_s for when_s in lit if before_s <= when_s < next_s]
        followed += bool(in_time) and (next_s - end_s > 0.0)
    return followed
