"""Page of a rotation."""

from __future__ import annotations

from typing import Final

import numpy as np

from daemon.storage.calibration_records import RotationRecord
from daemon.tools.report import rotation_figures as figures
from daemon.tools.report.page import Number, PageVerdict, Plot
from daemon.tools.report.rotation_facts import Rotation, drift, lengths_um, linearity

SUBJECT: Final = "Rotation of the head"


def verdict(record: RotationRecord) -> PageVerdict:
    """Judge as the calibration did: by the hold-out error and the landings afterwards, by the limits it had."""
    after, limits = lengths_um(record.after), record.limits
    predicted = record.holdout_rms_um <= limits.holdout_um
    holdout = (
        f"hold-out error {record.holdout_rms_um:.1f} um rms (limit {limits.holdout_um:.0f} um), "
        f"{record.holdout_max_um:.1f} um at most"
    )
    if not after.size:
        return PageVerdict(good=False, because=f"No landing by the new model was seen; {holdout}.")
    good = predicted and bool((after <= limits.landing_um).all())
    share = figures.share_within(record.after, limits.landing_um)
    because = f"First landings at angles that were not fitted: {share}, the farthest {after.max():.1f} um; {holdout}."
    return PageVerdict(good, because)


def numbers(record: RotationRecord) -> tuple[Number, ...]:
    """Return the figures of the table."""
    rotation, limits = Rotation(record), record.limits
    limit = f"at most {limits.landing_um:.0f} um"
    before, after = lengths_um(record.before), lengths_um(record.after)
    model = f"{record.kind}, order {record.order}" if record.order is not None else record.kind
    rows = [
        Number("stops used", f"{sum(record.used)} of {len(record.stops)}"),
        Number("head model", model),
        Number("hold-out error, rms", record.holdout_rms_um, "um", limit=f"at most {limits.holdout_um:.0f} um",
               bad=record.holdout_rms_um > limits.holdout_um),
        Number("hold-out error, largest", record.holdout_max_um, "um"),
        Number("left by the model, rms", record.rms_um, "um"),
        Number("left by a rigid rotation, rms", rotation.rigid_rms_um, "um"),
        Number("circle: radius", record.circle.radius_um, "um"),
        Number("circle: left radially, rms", record.circle.rms_um, "um"),
        Number("circle: centre X", record.circle.centre_um[0], "um"),
        Number("circle: centre Y", record.circle.centre_um[1], "um"),
        Number("circle: direction of the head at θ = 0", rotation.phase_deg, "deg", 3),
        Number("the model in force before: off at these stops, rms (thesis eq. 6.8)",
               record.total_error_um / max(1, len(record.before)) ** 0.5, "um", limit="what this calibration mends"),
        Number("closure: first angle again at the end", record.closure_um, "um"),
        Number("card's surface above the touching plane", record.card_height_um, "um"),
    ]  # fmt: skip
    for when, lengths in (("before", before), ("after", after)):
        if lengths.size:
            bad = when == "after" and bool(lengths.max() > limits.landing_um)
            rows.append(Number(f"landings {when}: median", float(np.median(lengths)), "um"))
            rows.append(Number(f"landings {when}: largest", float(lengths.max()), "um", bad=bad,
                               limit=limit if when == "after" else ""))  # fmt: skip
    if record.legs > 1:
        told = "an interrupted run was gone on with; looks and time are of all"
        rows.append(Number("legs", f"{record.legs}", limit=told))
    return (*rows, Number("looks", float(record.looks), "", 0), Number("time taken", record.seconds, "s"))


def since(record: RotationRecord, previous: RotationRecord) -> str:
    """Say how far the model moved."""
    found = drift(Rotation(record), Rotation(previous))
    return (
        f"the model puts the tip {found.rms_um:.1f} um rms and {found.max_um:.1f} um at most from where it was; radius "
        f"{found.radius_um:+.1f} um."
    )


def plots(record: RotationRecord, previous: RotationRecord | None) -> tuple[Plot, ...]:
    """Return the plots."""
    rotation = Rotation(record)
    drawn = [figures.circle_plot(rotation), figures.residual_plot(rotation)]
    if record.before or record.after:
        drawn.append(figures.landing_plot(record.before, record.after))
    drawn.append(figures.error_plot(rotation))
    if pairs := linearity(record):
        drawn.append(figures.linearity_plot(pairs))
    if previous:
        drawn.append(figures.drift_plot(drift(rotation, Rotation(previous))))
    return tuple(drawn)
