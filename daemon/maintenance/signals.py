"""Signals of jobs and devices: numbers from a finished correction and from the drives' own words. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from daemon.config.watch_names import sector_name
from daemon.domain.results import JobResult
from daemon.storage.calibration_records import BacklashRecord, Record, RotationRecord, SurfaceRecord

Numbers = dict[str, list[float]]
Step = tuple[str, Mapping[str, Any]]
CLOSURE_UM = 25.0
"""Two stops at one place that differ by more than three sigma of a good station (8 um each way)."""
LEAST_DRIFT_UM = 30.0
DRIFT_TIMES = 2.0
"""The head has moved when the model in force misses by so many times what it promised when it was made."""
PLAY_UM = 40.0
FAILED_AS = {
    "tip_not_found": "tip_refused",
    "frame_unusable": "pictures_unusable",
    "test_point_not_found": "pads_not_found",
    "undecided": "pads_not_found",
    "ambiguous": "pads_not_found",
}
"""How a correction fails -> the watch that counts it."""
TIP_STREAMS = (("tip_width", "width_px"), ("tip_contrast", "contrast"), ("tip_bend", "bend_px"), ("focus", "sharpness"))


class Landings:
    """Turn corrections into the numbers of placement. Remembers the landing before, for the scatter."""

    def __init__(self, phase_deg: float) -> None:
        self._phase_deg = phase_deg
        self._before: tuple[float, float] | None = None

    def restart(self) -> None:
        """Forget the landing before: it was made by another calibration."""
        self._before = None

    def numbers(self, result: JobResult, steps: Sequence[Step]) -> Numbers:
        """Return what one correction says of the landing that it found, um.

        The miss is where the tip was from the target, robot frame. Turned into the head's frame it says whether the
        head has slipped; against the miss before, how much the machine scatters, whatever its bias is. What is left
        after the first move is free of board and head: it is the scatter of the stops alone.
        """
        if result.error_before_um is None:
            return {}
        numbers: Numbers = {"placement_error": [result.error_before_um]}
        first = steps[0][1] if steps and steps[0][0] == "look" else {}
        if "dx_um" not in first:  # it had to step aside to see anything
            return numbers
        x_um, y_um, theta_deg = -float(first["dx_um"]), -float(first["dy_um"]), float(first["theta_deg"])
        out = math.radians(theta_deg + self._phase_deg)
        numbers |= {
            "placement_x": [x_um],
            "placement_y": [y_um],
            "head_across": [x_um * math.cos(out) + y_um * math.sin(out)],
            "head_along": [y_um * math.cos(out) - x_um * math.sin(out)],
            sector_name(theta_deg): [result.error_before_um],
        }
        if len(steps) > 2 and [kind for kind, _ in steps[1:3]] == ["move", "look"] and "dx_um" in steps[2][1]:
            numbers["stop_scatter"] = [math.hypot(float(steps[2][1]["dx_um"]), float(steps[2][1]["dy_um"]))]
        if self._before is None:
            self._before = (x_um, y_um)
        else:  # pairs, not a chain: differences that share a landing would hang together
            moved_um = math.hypot(x_um - self._before[0], y_um - self._before[1])
            numbers["placement_scatter"] = [moved_um / math.sqrt(2.0)]
            self._before = None
        return numbers


def of_looks(steps: Iterable[Step], tip_px: tuple[float, float]) -> Numbers:
    """Return what the looks of a job say of the needle; `tip_px` is where its end was taught."""
    numbers: Numbers = {}
    for kind, body in steps:
        needle = body.get("needle")
        if kind != "look" or needle is None:
            continue
        for stream, key in TIP_STREAMS:
            numbers.setdefault(stream, []).append(float(needle[key]))
        x_px, y_px = body["tip_px"]
        numbers.setdefault("tip_x", []).append(float(x_px) - tip_px[0])
        numbers.setdefault("tip_y", []).append(float(y_px) - tip_px[1])
    return numbers


def of_ending(result: JobResult) -> Numbers:
    """Return [1 or 0, 1] for each way in which a correction can fail to see, and for whether it moved again."""
    failed = FAILED_AS.get(result.error.name, "") if result.error is not None else ""
    numbers = {name: [float(name == failed), 1.0] for name in sorted(set(FAILED_AS.values()))}
    if result.moves:
        numbers["more_moves"] = [float(result.moves > 1), 1.0]
    return numbers


class Counters:
    """Turn counts since something was opened into counts since it was last asked."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, int]] = {}

    def since(self, name: str, events: int, trials: int) -> list[float]:
        """Return [events, trials] since the last call; all of them if it was opened again meanwhile."""
        before = self._seen.get(name, (0, 0))
        if events < before[0] or trials < before[1]:
            before = (0, 0)
        self._seen[name] = (events, trials)
        return [float(events - before[0]), float(trials - before[1])]


@dataclass(frozen=True)
class AxisWords:
    """What one drive said of itself. following: its following error, in um or deg, None if it has none."""

    name: str
    warning: bool
    error: str
    following: float | None


def of_axes(axes: Iterable[AxisWords], arrivals: Mapping[str, float]) -> tuple[Numbers, dict[str, str]]:
    """Return the drives' numbers, and their own words; `arrivals`: how far off each axis stopped at worst."""
    numbers: Numbers = {f"arrival_{axis}": [abs(off)] for axis, off in arrivals.items()}
    words: dict[str, str] = {}
    for axis in axes:
        complaint = axis.error or ("the drive's warning bit is set" if axis.warning else "")
        numbers[f"drive_{axis.name}"] = [float(bool(complaint)) + float(bool(axis.error)), 1.0, 2.0]
        if complaint:
            words[f"drive_{axis.name}"] = complaint
        if axis.following is not None:
            numbers[f"following_{axis.name}"] = [abs(axis.following)]
    return numbers, words


def of_calibrations(
    records: Mapping[str, Record], before: RotationRecord | None, max_age_days: float, now: datetime
) -> Numbers:
    """Return what the calibrations in force say; `before` is the rotation's predecessor, with the same probe."""
    numbers: Numbers = {}
    if "map" in records:
        numbers["calibration_age"] = [age_days(records["map"].made_at, now), 0.8 * max_age_days, max_age_days]
    match records.get("rotation"):
        case RotationRecord() as rotation:
            numbers["head_closure"] = [rotation.closure_um, CLOSURE_UM, 2 * CLOSURE_UM]
            if before is not None:
                rms_um = rotation.total_error_um / math.sqrt(max(1, sum(rotation.used)))
                promised_um = max(LEAST_DRIFT_UM, DRIFT_TIMES * before.holdout_rms_um)
                numbers["head_total_error"] = [rms_um, promised_um, 3 * promised_um]
    match records.get("backlash"):
        case BacklashRecord() as play:
            for name, axis in (("x", play.x), ("y", play.y)):
                limit_um = min(PLAY_UM, play.approach_um / 2)
                numbers[f"backlash_{name}"] = [abs(axis.backlash_um), limit_um, play.approach_um]
    match records.get("surface"):
        case SurfaceRecord() as surface:
            numbers["surface"] = [surface.flatness_um, surface.limit_um, 3 * surface.limit_um]
    return numbers


def age_days(made_at: str, now: datetime) -> float:
    """Return how old something is, days."""
    made = datetime.fromisoformat(made_at)
    made = made if made.tzinfo else made.replace(tzinfo=UTC)
    return (now - made).total_seconds() / 86400.0
