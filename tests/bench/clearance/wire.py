"""A sample of the campaign on the wire: daemon and simulated station with parts, judged by the truth log."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from daemon.client import Client
from daemon.domain.board import BoardPoint
from daemon.tools.demo.session import Session
from tests.bench.clearance.campaign import FIGURES
from tests.station.rig import Rig, running_rig

ANGLES = 24
BESIDE_UM = 35.0
NEIGHBOURS = 12
HIGH_UM = 15_000.0
Say = Callable[[str], None]


@dataclass
class OnTheWire:
    """What came of it: outcomes by operation, and what was hit."""

    outcomes: Counter[str] = field(default_factory=Counter)
    hits: list[dict[str, Any]] = field(default_factory=list)


def settings(heights_um: dict[str, float]) -> str:
    """Return the table of the configuration."""
    figures = [f"{name} = {value}" for name, value in FIGURES.items()]
    heights = ", ".join(f"{letters} = {height}" for letters, height in heights_um.items())
    return "\n".join(["[clearance]", *figures, f"head_from_um = {HIGH_UM}", f"heights_um = {{ {heights} }}", ""])


def run(
    out: Path, folder: Path, heights_um: dict[str, float], places: int, seed: int, say: Say, *, seat: bool
) -> OnTheWire:
    """Set a station up, and place and correct from one point to another.

    seat: head and seat are calibrated; without, only corrections go lower than the safe height.
    """
    with running_rig(
        out, seed=seed, folder=folder, pictures="none", assembled=True, reply_ms=4000.0, arguments=("--unpaced",),
        more_settings=settings(heights_um),
    ) as rig, rig.client() as client:  # fmt: skip
        session = Session(client, rig.bench, rig.board, seed, say)
        session.set_up()
        if seat:
            session.calibrate_fully(ANGLES)
        elif (error := client.job("calibrate", what="surface", places=6, timeout_s=900.0).error) is not None:
            raise SystemExit(f"the surface could not be measured: {error.message}")
        begun = len(_truth(out))
        found = _visit(rig, client, places, Random(seed), say)
        found.hits = [event for event in _truth(out)[begun:] if event["event"] == "hit_body"]
        return found


def _visit(rig: Rig, client: Client, places: int, chance: Random, say: Say) -> OnTheWire:
    found = OnTheWire()
    points = list(rig.board.test_points())
    last = points[0]
    for number in range(places):
        last = _next(points, last, chance)
        if number % 10 == 0:
            say(f"{number} of {places}: {dict(found.outcomes)}")
        for op, fields in (
            ("place", {"test_point": last.name, "theta_deg": 0.0}),
            ("place", {"board_um": [last.x_um + BESIDE_UM, last.y_um + BESIDE_UM], "theta_deg": 0.0}),
            ("correct", {"test_point": last.name}),
        ):
            result = client.job(op, timeout_s=120.0, **fields)
            found.outcomes[f"{op}: {result.outcome if result.error is None else result.error.name}"] += 1
            if result.error is not None:
                client.request("reset")
    return found


def _next(points: list[BoardPoint], last: BoardPoint, chance: Random) -> BoardPoint:
    """Draw one of the nearest, as runs go from one to the next, and now and then any."""
    if chance.random() < 0.25:
        return chance.choice(points)
    nearest = sorted(points, key=lambda point: math.dist(point.place_um, last.place_um))
    return chance.choice(nearest[1 : NEIGHBOURS + 1])


def _truth(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "truth.jsonl").read_text().splitlines()]
