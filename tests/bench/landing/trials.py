"""What is asked of a station and what came of it: trials and set-ups, one JSON line each.

A trial's question follows from the station's seed and the trial's number there alone, so a station is played again by
starting the campaign with its seed.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from daemon.tools.demo.true_place import same_net

STEP_DEG = 0.05625
"""The head's step: 512 increments of its drive."""
ALLOWED_DEG = (0.0, 100.0), (140.0, 360.0)
OFFSET_UM = 400.0
"""Radius of the disc from which the offset before a correction is drawn."""
Way = tuple[float, float]


@cache
def allowed_angles_deg() -> tuple[float, ...]:
    """Return every head angle at which the motor can stand, without the forbidden band and without 360 itself."""
    steps = round(360.0 / STEP_DEG)
    every = (k * STEP_DEG for k in range(steps))
    return tuple(angle for angle in every if any(low <= angle <= high for low, high in ALLOWED_DEG))


@dataclass(frozen=True)
class Question:
    """One trial before it is run. The offset is in the board's frame."""

    seed: int
    index: int
    test_point: str
    theta_deg: float
    offset_um: Way

    @classmethod
    def drawn(cls, seed: int, index: int, test_points: Sequence[str]) -> Question:
        """Draw the trial of that number on the station of that seed."""
        rng = random.Random(f"{seed}/landing/{index}")
        point = rng.choice(test_points)
        theta_deg = rng.choice(allowed_angles_deg())
        radius_um, turn = OFFSET_UM * math.sqrt(rng.random()), rng.uniform(0.0, 2.0 * math.pi)
        return cls(seed, index, point, theta_deg, (radius_um * math.cos(turn), radius_um * math.sin(turn)))


@dataclass(frozen=True)
class Landed:
    """What is under the tip, by the truth: `metal` with net, pin and distance to its edge, or what else."""

    what: str
    net: str | None = None
    pin: str | None = None
    inside_um: float | None = None


@dataclass(frozen=True)
class Trial:
    """One trial and the truth of it: tip minus pad in the board's frame, um; None where it never came to that."""

    seed: int
    index: int
    board: str
    side: str
    test_point: str
    theta_deg: float
    offset_um: Way
    first_um: Way | None = None
    """After the first landing, by calibration alone."""
    before_um: Way | None = None
    """After the landing that an offset spoiled, before the correction."""
    after_um: Way | None = None
    """After the correction, also where it ended in an error."""
    outcome: str = ""
    error: str | None = None
    """Name of the error answer, of whichever job gave one."""
    message: str | None = None
    looks: int = 0
    moves: int = 0
    said_before_um: float | None = None
    said_after_um: float | None = None
    """The daemon's own word; nothing is judged by it."""
    pictures: str | None = None
    """Folder of the pictures, kept when the correction failed."""
    net: str = ""
    """Net of the point that was asked for."""
    on: Landed | None = None
    """What was under the tip after the correction."""

    @property
    def first(self) -> float:
        """Length of the first landing's error; infinite where there was no landing."""
        return length(self.first_um)

    @property
    def before(self) -> float:
        """Length of the error before the correction."""
        return length(self.before_um)

    @property
    def after(self) -> float:
        """Length of the error where the correction left the tip, whatever it answered."""
        return length(self.after_um)

    @property
    def wrong(self) -> bool:
        """Whether success was said over metal of another net."""
        on = self.on
        return self.error is None and on is not None and on.what == "metal" and not same_net(on.net, self.net)

    @property
    def corrected(self) -> float:
        """Length of the error after the correction; infinite if it ended in an error answer, which is a miss."""
        return math.inf if self.error is not None else self.after


@dataclass(frozen=True)
class Step:
    """One step of a station's set-up. `simulated_s` is the station's own time."""

    name: str
    simulated_s: float
    wall_s: float
    detail: dict[str, Any] = field(default_factory=dict)
    error: str | None = None


@dataclass(frozen=True)
class Setup:
    """How a station was set up. `by_clock` is one whose time is the clock's and whose line is as slow as a real one."""

    seed: int
    by_clock: bool
    speed: float
    steps: tuple[Step, ...] = ()
    broken: str | None = None
    """Why the station could not go on, if it could not."""
    trials: int = 0
    trials_s: float = 0.0
    """How long they took by the clock."""
    sim_ms: float = 0.0
    """Processor time of the simulated station for all its trials, set-up left out."""
    daemon_ms: float = 0.0
    setup_ms: float = 0.0
    """Processor time of both programs before the first trial."""

    def step(self, name: str) -> Step | None:
        """Return the step of that name, if it was done."""
        return next((step for step in self.steps if step.name == name), None)


Record = Trial | Setup


def length(way: Way | None) -> float:
    """Return a way's length; infinite for none."""
    return math.inf if way is None else math.hypot(*way)


def to_line(record: Record) -> str:
    """Return a record as one line of JSON."""
    return json.dumps({"what": type(record).__name__.lower(), **asdict(record)}, allow_nan=False)


def from_line(line: str) -> Record:
    """Read a record back; raise ValueError for anything else."""
    try:
        raw = json.loads(line)
        what = raw.pop("what")
        if what == "setup":
            raw["steps"] = tuple(Step(**step) for step in raw["steps"])
            return Setup(**raw)
        if what != "trial":
            raise ValueError(f"what is {what!r}")
        ways = ("offset_um", "first_um", "before_um", "after_um")
        if raw.get("on") is not None:
            raw["on"] = Landed(**raw["on"])
        return Trial(**raw | {name: tuple(raw[name]) if raw[name] is not None else None for name in ways})
    except (AttributeError, KeyError, TypeError, ValueError) as exc:
        raise ValueError(f"no record of a landing campaign: {line[:80]!r} ({exc})") from exc


def read_lines(path: Path) -> list[Record]:
    """Read all records of a file."""
    return [from_line(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def split(records: Iterable[Record]) -> tuple[list[Trial], list[Setup]]:
    """Tell trials and set-ups apart."""
    listed = list(records)
    return [r for r in listed if isinstance(r, Trial)], [r for r in listed if isinstance(r, Setup)]
