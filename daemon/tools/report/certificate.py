"""Calibration certificate: one page of what is calibrated, when, with which reference, how well, and until when."""

from __future__ import annotations

import math
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
BUDGET: Final = {
    "rotation": "head at angles not measured, rms",
    "alignment": "place of the board, rms",
    "backlash": "play of X and Y, scatter",
}
"""What leaves an error in a first landing, and how that is called."""


def certificate(config: Config, now: InForce) -> Page:
    """Return the page of the calibrations in force."""
    max_days = config.servo.calibration_days
    rows: list[Number] = [Number("probe", f"fingerprint {now.fingerprint[:12]}" if now.fingerprint else "not taught")]
    missing = [kind for kind in NEEDED if kind not in now.records]
    late = []
    for kind in NEEDED:
        record = now.records.get(kind)
        if record is None:
            rows.append(_not_measured(kind, kind, now.problems.get(kind, "")))
            continue
        until = datetime.fromisoformat(record.made_at) + timedelta(days=max_days)
        over = kind == "map" and until < datetime.now(UTC)
        late += [kind] if over else []
        valid = f"valid until {until:%Y-%m-%d}" if kind == "map" else "until probe, head or nest are changed"
        rows += [Number(kind, spoken_time(record.made_at), limit=valid, bad=over), Number(f"{kind}: by", _by(record))]
    limit = config.servo.first_landing_um
    budget, total = _budget(now, limit)
    good = not missing and not late and total is not None and total <= limit
    return Page(
        kind="certificate", subject="Calibration certificate", station=config.station.name, made_at=utc_now(), job="",
        verdict=PageVerdict(good, _because(missing, late, total, limit)), numbers=(*rows, *budget), plots=(),
        done="written",
    )  # fmt: skip


def write_certificate(config: Config, now: InForce, path: Path) -> None:
    """Write the page; OSError."""
    text = render(certificate(config, now))
    replace_whole(path, lambda beside: write_text(beside, text))


def _not_measured(label: str, kind: str, why: str = "") -> Number:
    """Return the line of what is not known, with the command that measures it."""
    command = "reprobe align" if kind == "alignment" else f"reprobe calibrate {kind}"
    return Number(label, f"not measured: {why}" if why else "not measured", limit=f"`{command}` measures it", bad=True)


def _budget(now: InForce, limit_um: float) -> tuple[list[Number], float | None]:
    """Return the lines of the error budget and their sum, None where a part of it is not known: it is no sum then."""
    rows, parts = [], []
    for kind, name in BUDGET.items():
        um = _left_by(now.records.get(kind))
        parts.append(um)
        label = f"error budget: {name}"
        rows.append(_not_measured(label, kind) if um is None else Number(label, um, "um"))
    known = [um for um in parts if um is not None]
    total = math.sqrt(math.fsum(um * um for um in known)) if len(known) == len(parts) else None
    label, limit = "error budget: together (root of the sum of squares), rms", f"at most {limit_um:g} um"
    together = Number(label, "not known: a part is not measured", limit=limit, bad=True)
    rows.append(together if total is None else Number(label, total, "um", 1, limit, total > limit_um))
    return rows, total


def _because(missing: list[str], late: list[str], total_um: float | None, limit_um: float) -> str:
    if missing or total_um is None:
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


def _left_by(record: Record | None) -> float | None:
    """Return what a calibration leaves of error in a first landing, um; None where it was not made."""
    match record:
        case RotationRecord():
            return record.holdout_rms_um
        case AlignmentRecord():
            return record.rms_um
        case BacklashRecord():
            return math.hypot(record.x.sigma_um, record.y.sigma_um)
        case _:
            return None
