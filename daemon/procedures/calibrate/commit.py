"""Commit of a calibration: its record goes to disk and into force, and its page is drawn.

The answer says which calibration is in force, however the job ends.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.platform.clock import utc_now
from daemon.platform.oldest import drop_oldest
from daemon.platform.subprocess import draw
from daemon.station.conditions import conditions_of
from daemon.storage.calibration_history import stamp
from daemon.storage.calibration_in_force import OF_THE_PROBE, InForce
from daemon.storage.calibration_records import Record
from daemon.wire.operations.jobs import AFTER_THE_TIP
from vision import ProbeModel

PAGE_WITHIN_S = 60.0
PAGES_KEPT, PAGES_BYTES = 50, 200_000_000
"""Of each kind; any page is drawn again from its record by `reprobe calibrate page`."""
NICER = 10
_T = TypeVar("_T")
_R = TypeVar("_R")
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Began:
    """When a calibration began, and what the job had seen by then."""

    at_s: float
    looks: int

    @classmethod
    def now(cls, job: JobContext) -> Began:
        """Begin."""
        return cls(time.monotonic(), job.looks)

    def facts(self, job: JobContext, context: StationContext) -> dict[str, Any]:
        """Return what every record says of itself (`records.Made`)."""
        return {
            "station": context.config.station.name,
            "made_at": utc_now(),
            "job": job.request.id,
            "probe": context.calibrations.fingerprint,
            "seconds": round(time.monotonic() - self.at_s, 2),
            "looks": job.looks - self.looks,
            "conditions": conditions_of(context.config, context.board),
        }


def tell_old(job: JobContext, context: StationContext, what: str) -> None:
    """Note in the answer, should the job fail, that what was in force stays so; the first thing a calibration does."""
    job.partial.detail |= {"what": what} | _in_force(context, what, "old")


async def keep(job: JobContext, context: StationContext, record: Record) -> dict[str, object]:
    """Put the record on disk and in force, and draw its page; return what to answer of both.

    Raises `Fault` if it cannot be kept; the old one then stays. From the moment it is in force the answer says so,
    whatever cuts the job short; a cancel or the deadline cuts the drawing, and the page never decides over the record.
    """
    before = context.calibrations.in_force
    try:
        previous = await on_disk(context.calibrations.store, record)
    finally:
        if context.calibrations.in_force is not before:
            _tell_new(job, context, record.what)
    file = context.calibrations.file(record.what)
    page = context.calibrations.folder / "reports" / f"{record.what}-{stamp(record.made_at)}.html"
    drawn = await _draw(file, previous, page)
    drop_oldest(page.parent, f"{record.what}-*.html", keep=PAGES_KEPT, keep_bytes=PAGES_BYTES)
    paths = {"record": str(file), "report": str(page) if drawn else None, "seconds": record.seconds}
    return paths | _in_force(context, record.what, "new")


async def keep_probe(job: JobContext, context: StationContext, model: ProbeModel) -> dict[str, object]:
    """Put a taught probe on disk and in force; return what to answer: with it what is void now, and what comes next.

    Raises `Fault` if it cannot be kept.
    """
    before = context.calibrations.in_force
    try:
        await on_disk(context.calibrations.store_probe, model)
    finally:
        if context.calibrations.in_force is not before:
            _tell_new(job, context, "tip")
            job.partial.detail |= _undone(before, context.calibrations.in_force)
    return _in_force(context, "tip", "new") | _undone(before, context.calibrations.in_force)


def _undone(before: InForce, now: InForce) -> dict[str, object]:
    """Return what a new probe has made void, and the operations that a station still needs, in their order."""
    return {
        "void": [what for what in OF_THE_PROBE if what in before.records and what not in now.records],
        "next": [op for what, op in AFTER_THE_TIP.items() if what not in now.records],
    }


async def on_disk(write: Callable[[_T], _R], what: _T) -> _R:
    """Write in a thread and wait for its end even if cancelled meanwhile: only then is it known what is on disk.

    Raises `Fault` if it could not be written, CancelledError if the caller was cancelled, in both cases afterwards.
    """
    writing = asyncio.ensure_future(asyncio.to_thread(write, what))
    cut: asyncio.CancelledError | None = None
    while not writing.done():
        try:
            await asyncio.wait([writing])
        except asyncio.CancelledError as cancelled:
            cut = cancelled
    try:
        written = writing.result()
    except (OSError, ValueError) as exc:
        log.warning("not_kept", why=str(exc))
        if cut is None:
            advice = "free disk space, then calibrate again" if isinstance(exc, OSError) else ""
            raise Fault(FaultCode.CALIBRATION_FAILED, f"it cannot be kept: {exc}", advice=advice) from exc
    if cut is not None:
        raise cut
    return written


def _tell_new(job: JobContext, context: StationContext, what: str) -> None:
    """Note in the answer that this kind is new, beside what was asked for if it is another (a map for a rotation)."""
    detail, new = job.partial.detail, _in_force(context, what, "new")
    detail |= new if detail.get("what", what) == what else {what: new}


def _in_force(context: StationContext, what: str, which: str) -> dict[str, object]:
    """Return which calibration of a kind is in force, and when it was made; of a probe, its fingerprint."""
    now = context.calibrations.in_force
    if what == "tip":
        return {"in_force": which if now.probe else "none", "probe": now.fingerprint or None}
    record = now.records.get(what)
    return {"in_force": which, "made_at": record.made_at} if record else {"in_force": "none", "made_at": None}


async def _draw(record: Path, previous: Path | None, page: Path) -> bool:
    """Draw the page; return whether it was drawn."""
    arguments = [str(record), "-o", str(page)]
    if previous is not None:
        arguments += ["--previous", str(previous)]
    status, words = await draw("daemon.tools.report", arguments, PAGE_WITHIN_S, NICER)
    if status:
        log.warning("page_not_drawn", record=str(record), why=words[-300:])
    return status == 0
