"""What came of one point's test: the daemon's word, and what was true meanwhile. One JSON line each."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from daemon.tools.demo.truth_log import Stretch, Stroke


@dataclass
class Visit:
    """One point of one visit of a board. `board_id` and `point` name the pad over visits."""

    seed: int
    board: str
    board_id: str
    point: str
    net: str
    """As the truth spells it."""
    sound: bool
    """Whether the pad reaches its net's pin of the harness, by the truth."""
    verdict: str
    """As the daemon said; `error:NAME` where it answered with an error."""
    reason: str = ""
    rung: str | None = None
    cause: str | None = None
    first_value: float | None = None
    last_value: float | None = None
    said_force_n: float | None = None
    """Of the last press."""
    said_touches: int = 0
    said_presses: int = 0
    looks: int = 0
    simulated_s: float = 0.0
    wall_s: float = 0.0
    happened: Stretch = field(default_factory=Stretch)
    pressed_after_um: float = 0.0
    """At the end of the job."""
    height_after_um: float = 1e9
    """Of the free needle over what is below it, at the end of the job."""
    had_verdict: bool = False
    """Whether a verdict was on record before this stretch began: a test that was interrupted and resumed."""
    killed: bool = False

    @property
    def passed(self) -> bool:
        """Whether the daemon said that the net is whole."""
        return self.verdict.startswith("pass_")


@dataclass(frozen=True)
class Station:
    """How a station fared. `broken`: why it could not go on, if it could not."""

    seed: int
    board: str
    points: int = 0
    boards: int = 0
    kills: int = 0
    set_up_s: float = 0.0
    wall_s: float = 0.0
    floor_z_um: float = 0.0
    dent_n: float = 0.9
    broken: str | None = None


Record = Visit | Station


def to_line(record: Record) -> str:
    """Return a record as one line of JSON."""
    return json.dumps({"what": type(record).__name__, **asdict(record)})


def from_line(line: str) -> Record:
    """Read a record back; raise ValueError for anything else."""
    try:
        raw: dict[str, Any] = json.loads(line)
        what = raw.pop("what")
        if what == "Station":
            return Station(**raw)
        if what != "Visit":
            raise ValueError(what)
        happened = raw.pop("happened")
        strokes = [Stroke(**{**one, "nets": tuple(one["nets"]), "joined": tuple(one["joined"])})
                   for one in happened.pop("strokes")]  # fmt: skip
        return Visit(**raw, happened=Stretch(strokes=strokes, **happened))
    except (AttributeError, KeyError, TypeError, ValueError) as exc:
        raise ValueError(f"no record of a nets campaign: {line[:80]!r} ({exc})") from exc


def read_lines(path: Path) -> list[Record]:
    """Read all records of a file."""
    return [from_line(line) for line in path.read_text(encoding="utf-8").splitlines() if line]
