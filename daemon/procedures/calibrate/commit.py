"""The end of every calibration: its record is put in force and on disk, and its page is drawn."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.platform.clock import utc_now
from daemon.platform.subprocess import draw
from daemon.storage.calibration_records import Record
from daemon.storage.calibration_store import stamp

PAGE_WITHIN_S = 60.0
NICER = 10
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
        }


async def keep(context: StationContext, record: Record) -> dict[str, object]:
    """Put the record in force and draw its page; return where both are. The page never decides over the record."""
    try:
        previous = await asyncio.to_thread(context.calibrations.store, record)
    except OSError as exc:
        advice = "free disk space, then calibrate again"
        raise Fault(FaultCode.CALIBRATION_FAILED, f"it cannot be kept: {exc}", advice=advice) from exc
    file = context.calibrations.file(record.what)
    page = context.calibrations.folder / "reports" / f"{record.what}-{stamp(record.made_at)}.html"
    drawn = await _draw(file, previous, page)
    return {"record": str(file), "report": str(page) if drawn else None, "seconds": record.seconds}


async def _draw(record: Path, previous: Path | None, page: Path) -> bool:
    """Draw the page; return whether it was drawn."""
    arguments = [str(record), "-o", str(page)]
    if previous is not None:
        arguments += ["--previous", str(previous)]
    status, words = await draw("daemon.tools.report", arguments, PAGE_WITHIN_S, NICER)
    if status:
        log.warning("page_not_drawn", record=str(record), why=words[-300:])
    return status == 0
