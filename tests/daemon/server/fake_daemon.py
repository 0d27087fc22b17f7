"""An idle station as handlers see it, and how they are asked."""

from __future__ import annotations

import asyncio
import hashlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from daemon.config.model import load_config
from daemon.domain.board import Board, BoardPoint
from daemon.domain.contact import ContactFacts
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointUnit
from daemon.domain.results import JobResult
from daemon.domain.roles import Caller
from daemon.jobs.fault_latch import FaultLatch
from daemon.jobs.held_touch import HeldTouch
from daemon.maintenance.alerts import Alert
from daemon.server.handlers import Handlers
from daemon.station.needle import Needle
from daemon.storage.journal import Journal
from daemon.telemetry.vitals import Vitals
from daemon.wire.example_parts import ALERT, CONTACT, RESULT
from daemon.wire.operations.table import OPERATIONS
from daemon.wire.requests import JobRequest
from drivers.lights import Light

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"
CALLER = Caller("tester-1", "operate")
MAINTAINER = Caller("page-maintain", "maintain")
JOBS = [row for row in OPERATIONS.rows if row.is_job]
DONE = JobResult.model_validate(RESULT)
VITALS = Vitals(
    fault=None,
    waiting=0,
    threads=1,
    journal_bytes=0,
    calibration_age_s={},
    buses={"main": {"connected": 1, "reconnects": 2}},
    camera={"frames": 7},
)  # fmt: skipfrom drivers.gantry import Position


class Wipe(JobRequest):
    """A job that no station has yet."""

    op: Literal["wipe"]


class Jobs:
    """A job runner that takes every job and ends it when told."""

    def __init__(self) -> None:
        self.running: Any = None
        self.progress: dict[str, Any] | None = None
        self.queued = 0
        self.taken: asyncio.Queue[tuple[Any, str]] = asyncio.Queue()
        self.done: asyncio.Future[JobResult] = asyncio.get_running_loop().create_future()
        self.refusal: Fault | None = None
        self.touches: dict[str, HeldTouch] = {"board17-TP7-2": standing("board17-TP7-2")}
        """Open ones, by their ids."""
        self.contact: ContactFacts | None = None

    def touch(self, job_id: str) -> HeldTouch | None:
        return self.touches.get(job_id)

    def result_of(self, job_id: str) -> asyncio.Future[JobResult] | None:
        return self.done if job_id in self.touches else None

    async def submit(self, request: Any, client: str = "", key: str = "") -> asyncio.Future[JobResult]:  # noqa: ARG002
        if self.refusal is not None:
            raise self.refusal
        self.taken.put_nowait((request, client))
        return self.done

    def pause(self, job_id: str | None) -> str:
        return job_id or "run-1"

    def cancel(self, job_id: str | None) -> str:
        if self.running is None:
            raise Fault(FaultCode.UNKNOWN_JOB, "no job runs", id=job_id)
        return job_id or str(self.running.id)


class Monitor:
    """One alert stands; touches and acknowledgements are written down."""

    def __init__(self) -> None:
        self.alert = Alert.from_dict(ALERT)
        self.touches: list[int] = []
        self.acknowledged: list[tuple[str, str, str, bool]] = []

    def overview(self) -> dict[str, Any]:
        return {"healthy": False, "standing": [self.alert.to_dict()], "watches": [], "touches": 48, "off": ["light"]}

    async def acknowledge(self, name: str, by: str, note: str, *, mended: bool) -> Alert:
        if name != self.alert.name:
            raise Fault(FaultCode.UNKNOWN_ALERT, standing=[self.alert.name])
        self.acknowledged.append((name, by, note, mended))
        return self.alert

    def on_touches(self, touches: int) -> None:
        self.touches.append(touches)


class Pictures:
    """An archive with one picture of each job."""

    full = None

    async def hashes_of(self, job_id: str) -> dict[str, str]:
        return {"before-red": hashlib.sha256(job_id.encode()).hexdigest()}

    async def picture(self, job_id: str, which: str) -> bytes | None:
        return job_id.encode() if which == "before-red" else None


class Daemon:
    """An idle station as handlers see it; each part is as simple as it can be."""

    def __init__(self) -> None:
        self.config = load_config(EXAMPLE)
        self.latch = FaultLatch()
        self.latch.opened()
        self.jobs = Jobs()
        self.needle = Needle()
        self.needle.adopt(lambda _at: 5_200.0, lambda _at: 5_000.0)
        self.board = Board(
            name="demo", side="top", width_um=50_000.0, height_um=40_000.0, hidden={"TP9": "on the other side"},
            points=(
                BoardPoint(name="TP1", kind="site", x_um=1.0, y_um=2.0, diameter_um=400.0, net="VCC"),
                BoardPoint(name="FID1", kind="fiducial", x_um=3.0, y_um=4.0, diameter_um=1000.0, why_not="a fiducial"),
            ),
        )  # fmt: skip
        self.calibrations = SimpleNamespace(
            probe=None,
            mapped_at=None,
            made_at=lambda: {"map": "2025-03-04"},
            alignment=lambda _board: None,
            problems={"surface": "it was made with another probe"},
        )
        self.pictures = Pictures()
        self.reports: list[tuple[str | None, int]] = []
        self.metrics = SimpleNamespace(report=lambda retest, touches: self.reports.append((retest, touches)))
        self.monitor = Monitor()
        self.resets = 0
        self.lit: list[tuple[Light, float]] = []
        self.against: Fault | None = None

    def vitals(self) -> Vitals:
        return VITALS

    async def light(self, light: Light, lease_s: float) -> None:
        self.lit.append((light, lease_s))

    async def reset(self) -> Fault | None:
        self.resets += 1
        return self.against


async def ask(handlers: Handlers, op: str, *, caller: Caller = CALLER, **fields: Any) -> Any:
    """Ask as the control socket does: first on the spot, then with patience."""
    request = OPERATIONS.parse({"op": op, **fields})
    return handlers.at_once(request, caller) or await handlers.handle(request, caller)


async def refusal(handlers: Handlers, op: str, *, caller: Caller = CALLER, **fields: Any) -> Fault:
    with pytest.raises(Fault) as caught:
        await ask(handlers, op, caller=caller, **fields)
    return caught.value


def standing(job_id: str, key: str = "", *, judged: bool = False, unit: PointUnit | None = None) -> HeldTouch:
    """Return a touch that is held down."""
    held = HeldTouch(job_id, key, judged=judged, unit=unit)
    held.stands(ContactFacts(**CONTACT | {"id": job_id}), lease_ms=20_000.0, hold_ms=60_000.0)
    return held


async def kept_job(journal: Journal, job_id: str, *, finished: bool = True) -> JobResult:
    """Write a job into the journal as the runner does."""
    await journal.add_job(job_id, "correct", "{}")
    result = DONE.model_copy(update={"id": job_id, "seq": journal.take_seq()})
    if finished:
        await journal.finish_job(result)
    return result
