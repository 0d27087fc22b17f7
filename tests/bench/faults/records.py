"""Records that the fault campaign judges: what was true, what was said, and what was asked and answered."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from daemon.domain.results import JobResult

KINDS = ("lost", "doubled", "contradictory", "pressed at rest", "sideways while pressed", "lights on at rest", "other")


@dataclass(frozen=True)
class Violation:
    """One bound that was broken: which, in which item (`kills:17`), and what was seen."""

    kind: str
    item: str
    what: str


@dataclass(frozen=True)
class Truth:
    """Where the simulated station really was at one moment of its own time, um and degrees; lamps 0..1."""

    t_s: float
    x_um: float
    y_um: float
    z_um: float
    theta_deg: float
    pressed_um: float
    moving: bool = False
    light: float = 0.0
    slipped: bool = False
    """The fault `slip` was held: the simulated station itself may have put the carriage elsewhere."""

    @classmethod
    def of(cls, record: Mapping[str, Any], *, slipped: bool = False) -> Truth:
        """Read a truth record, from the bench socket or a line `settled` of the truth log."""
        axes = record["axes"]
        return cls(
            t_s=record["t_s"],
            x_um=axes["x_um"],
            y_um=axes["y_um"],
            z_um=axes["z_um"],
            theta_deg=axes["theta_deg"],
            pressed_um=record["pressed_um"],
            moving=record.get("moving", False),
            light=max(record.get("white", 0.0), record.get("red", 0.0)),
            slipped=slipped,
        )


@dataclass(frozen=True)
class Glance:
    """The truth, then what `status` says, then the truth again; `at_s` by the clock, `held` the faults that were on."""

    at_s: float
    before: Truth
    status: Mapping[str, Any]
    after: Truth
    held: tuple[str, ...] = ()


@dataclass
class Job:
    """One id: what was asked under it, and every result that anybody gave for it."""

    id: str
    item: str
    op: str = ""
    place_um: tuple[float, float] | None = None
    """Where a `place` goes, board frame; no other job goes there."""
    accepted: bool = False
    undisturbed: bool = False
    """Nothing but the daemon's end or a `reset` came between: what it answers as done must be true."""
    results: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    """Who said it (answer, result, results, event, journal), and the result."""


class Ledger:
    """All ids of a station, for several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._jobs: dict[str, Job] = {}

    def ask(self, job: Job) -> None:
        """Note what is about to be asked; an id that is known already stays as it is."""
        with self._lock:
            self._jobs.setdefault(job.id, job)

    def answered(self, reply: Mapping[str, Any], item: str) -> None:
        """Note the answer to a job's request."""
        if not reply.get("ok") or not reply.get("accepted"):
            return
        with self._lock:
            self._jobs.setdefault(reply["id"], Job(reply["id"], item)).accepted = True
        if reply.get("result"):
            self.said("answer", reply["result"], item)

    def said(self, source: str, result: Mapping[str, Any], item: str) -> None:
        """Note a result, as one of the sources gave it."""
        body = JobResult.model_validate(result).model_dump()
        with self._lock:
            self._jobs.setdefault(body["id"], Job(body["id"], item)).results.append((source, body))

    def jobs(self, item: str | None = None) -> list[Job]:
        """Return the jobs of an item, or all."""
        with self._lock:
            return [job for job in self._jobs.values() if item in (None, job.item)]
