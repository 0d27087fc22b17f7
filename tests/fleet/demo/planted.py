"""What is planted in the demonstration's ten stations, and what one test of a point then comes to. Pure, by a seed.

This is a model of results, not of a station: nothing looks and nothing moves. One station drifts, one needle is worn,
one pad of one board design is bad wherever it is made, one program is older.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random

from daemon.domain.point_test import Cause, PointVerdict, Rung

POINTS = tuple(f"TP{n}" for n in range(1, 13))
BAD_BOARD, BAD_POINT = "sensor", "TP7"
DRIFTS, WORN, OLDER, SILENT = "station-03", "station-08", "station-05", "station-10"
WORN_NEEDLE = "N-0008"
BOARD = "B-000117"
TESTED_AT = {"station-02": 3, "station-04": 5}
"""Where that board is laid in, as how many-th of the station's boards."""
DRIFT_UM = 120.0
"""From the first board to the last."""
SCATTER_UM = 15.0
"""Of a look's error, one axis."""
MISSES, MISSES_WORN, MISSES_BAD = 0.01, 0.3, 0.5
"""Shares of points that are no pass at the first touch: usually, with the worn needle, on the bad pad."""


@dataclass(frozen=True)
class Station:
    """One of the ten."""

    name: str
    line: str
    board: str
    program: str = "1.4.0"
    drift_um: float = 0.0
    """From the first board to the last."""
    misses: float = MISSES
    changes_needle: bool = True

    def needle(self, board: int, boards: int) -> str:
        """Return the needle's serial number: each gets another one half way, but the worn one."""
        again = self.changes_needle and board >= boards // 2
        return f"N-{int(self.name[-2:]) + (100 if again else 0):04d}"

    def board_id(self, board: int) -> str:
        """Return the serial number of its board of that number."""
        return BOARD if TESTED_AT.get(self.name) == board else f"B-{self.name[-2:]}{board:04d}"


@dataclass(frozen=True)
class Tested:
    """What came of one point."""

    point: str
    verdict: PointVerdict
    recovered_by: Rung | None
    cause: Cause | None
    touches: int
    value_ohm: float


def stations() -> tuple[Station, ...]:
    """Return the ten, five a line; each line makes a design of its own."""
    names = [f"station-{n:02d}" for n in range(1, 11)]
    return tuple(
        Station(
            name,
            "L1" if n < 5 else "L2",
            "gateway" if n < 5 else BAD_BOARD,
            program="1.3.2" if name == OLDER else "1.4.0",
            drift_um=DRIFT_UM if name == DRIFTS else 0.0,
            misses=MISSES_WORN if name == WORN else MISSES,
            changes_needle=name != WORN,
        )
        for n, name in enumerate(names)
    )


def first_look_um(station: Station, part: float, chance: Random) -> float:
    """Return by how much the tip is off at the first look on a board, after that part of all boards."""
    off_um = station.drift_um * part
    return math.hypot(chance.gauss(off_um, SCATTER_UM), chance.gauss(0.0, SCATTER_UM))


def test_of(station: Station, point: str, chance: Random) -> Tested:
    """Return what comes of one point."""
    value = chance.uniform(0.2, 0.4)
    bad = (station.board, point) == (BAD_BOARD, BAD_POINT)
    if bad and chance.random() < MISSES_BAD:
        if chance.random() < 0.4:
            return Tested(point, PointVerdict.OPEN_CONFIRMED, None, None, 3, math.inf)
        return Tested(point, PointVerdict.PASS_RECOVERED, Rung.SECOND_SITE, Cause.FILM, 2, value)
    if chance.random() < station.misses:
        if station.changes_needle:
            return Tested(point, PointVerdict.PASS_RECOVERED, Rung.LOOK, Cause.MISPLACED, 2, value)
        return Tested(point, PointVerdict.PASS_RECOVERED, Rung.REFERENCE, Cause.NEEDLE, 3, value)
    return Tested(point, PointVerdict.PASS_FIRST, None, None, 1, value)
