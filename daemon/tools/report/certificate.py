"""Calibration certificate: one page of what is calibrated, when, with which reference, how well, and until when."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from daemon.config.model import Config
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import utc_now
from daemon.storage.calibration_in_force import InForce
from daemon.storage.calibration_records import (
    AlignmentRecord,
    BacklashRecord,
    MapRecord,
    Record,
    RotationRecord,
    SurfaceRecord,
)
from daemon.tools.report.page import Number, Page, PageVerdict, render, spoken_time, write_text

NEEDED: Final = ("map", "rotation", "surface", "backlash", "alignment")


def certificate(config: Config, now: InForce) -> Page:
    """Return the page of the calibrations in force."""
    max_days = config.servo.calibration_days
    rows: list[Number] = [Number("probe", f"fingerprint {now.fingerprint[:12]}" if now.fingerprint else "not taught")]
    missing = [kind for kind in NEEDED if kind not in now.records]
    late = []
    for kind in NEEDED:
        record = now.records.get(kind)
        if record is None:
            rows.append(Number(kind, now.problems.get(kind, "not calibrated"), bad=True))
            continue
        until = datetime.fromisoformat(record.made_at) + timedelta(days=max_days)
        over = kind == "map" and until < datetime.now(UTC)
        late += [kind] if over else []
        valid = f"valid until {until:%Y-%m-%d}" if kind == "map" else "until probe, head or nest are changed"
        rows += [Number(kind, spoken_time(record.made_at), limit=valid, bad=over), Number(f"{kind}: by", _by(record))]
    budget = [(name, um) for record in now.records.values() for name, um in _errors(record)]
    rows += [Number(f"error budget: {name}", um, "um") for name, um in budget]
    total = math.sqrt(math.fsum(um * um for _, um in budget))
    limit = config.servo.first_landing_um
    rows.append(
        Number(
            "error budget: together (root of the sum of squares), rms",
            total,
            "um",
            1,
            f"at most {limit:g} um",
            total > limit,
        )
    )
    good = not missing and not late and total <= limit
    return Page(
        kind="certificate", subject="Calibration certificate", station=config.station.name, made_at=utc_now(), job="",
        verdict=PageVerdict(good, _because(missing, late, total, limit)), numbers=tuple(rows), plots=(),
        done="written",
    )  # fmt: skip


def write_certificate(config: Config, now: InForce, path: Path) -> None:
    """Write the page; OSError."""
    text = render(certificate(config, now))
    replace_whole(path, lambda beside: write_text(beside, text))


def _because(missing: list[str], late: list[str], total_um: float, limit_um: float) -> str:
    if missing:
        return f"Not calibrated, or not for this probe and board: {', '.join(missing)}."
    if late:
        return f"Too old: {', '.join(late)}."
    return f"All is calibrated; a first landing is {total_um:.0f} um off, rms (at most {limit_um:g} um)."


def _by(record: Record) -> str:
    """Say what a calibration was made with, its reference first."""
    match record:
        case MapRecord():
            return f"reference {record.mark}, {len(record.sightings)} sightings (job {record.job})"
        case RotationRecord():
            x_mm, y_mm = (value / 1e3 for value in record.control_um)
            return f"printed cross at X {x_mm:.2f}, Y {y_mm:.2f} mm, {sum(record.used)} stops (job {record.job})"
        case SurfaceRecord():
            return f"the needle itself, {len(record.touches)} touches (job {record.job})"
        case BacklashRecord():
            return f"approaches from both sides, {record.looks} looks (job {record.job})"
        case AlignmentRecord():
            return f"CAD of {record.board}, {record.side}, {len(record.fiducials)} places (job {record.job})"


def _errors(record: Record) -> Iterator[tuple[str, float]]:
    """Yield what a calibration leaves of error in a first landing."""
    match record:
        case RotationRecord():
            yield "head at angles not measured, rms", record.holdout_rms_um
        case AlignmentRecord():
            yield "place of the board, rms", record.rms_um
        case BacklashRecord():
            yield "play of X and Y, scatter", math.hypot(record.x.sigma_um, record.y.sigma_um)
        case _:
            return
