"""Type-1 study of a measuring process: Cg and Cgk of repeated landings on one point, and their page.

Cg compares the spread with a part of the tolerance, Cgk the spread and the bias together: Cg = 0.2 T / 6 s,
Cgk = (0.1 T - |mean - reference|) / 3 s, with the tolerance T, the standard deviation s and the reference 0, the point
itself (VDA volume 5; Minitab, type 1 gage study). 1.33 is what both have to reach.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from daemon.platform.atomic_file import replace_whole
from daemon.tools.report.page import Number, Page, PageVerdict, Plot, render, write_text
from daemon.tools.report.svg import INK, MAIN, MUTED, SECOND, new_figure, to_svg

WANTED: Final = 1.33
LEAST: Final = 10
"""Fewer repetitions say nothing of a spread."""
SHARE, SIGMAS = 0.2, 6.0


class Study(BaseModel):
    """Landings of one point, measured by a look after each: how far the tip was from it, um."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    format: Literal["reprobe-study-1"] = "reprobe-study-1"
    station: str
    made_at: str
    test_point: str
    tolerance_um: float = Field(gt=0)
    dx_um: tuple[float, ...] = Field(min_length=LEAST)
    dy_um: tuple[float, ...] = Field(min_length=LEAST)

    @model_validator(mode="after")
    def _both_of_each(self) -> Self:
        """See that each landing has both."""
        if len(self.dx_um) != len(self.dy_um):
            raise ValueError(f"{len(self.dx_um)} landings have an x and {len(self.dy_um)} a y")
        return self


@dataclass(frozen=True)
class Capability:
    """What the repetitions of one direction are worth; `cg`, `cgk` are infinite where nothing spreads."""

    mean_um: float
    sd_um: float
    cg: float
    cgk: float

    @property
    def least_tolerance_um(self) -> float:
        """The smallest tolerance for which both reach `WANTED`."""
        return (SIGMAS * WANTED * self.sd_um + 2.0 * abs(self.mean_um)) / SHARE


def capability(values_um: Sequence[float], tolerance_um: float) -> Capability:
    """Return Cg and Cgk of repeated values whose reference is 0; ValueError for fewer than `LEAST`."""
    if len(values_um) < LEAST:
        raise ValueError(f"{len(values_um)} repetitions say nothing of a spread; take {LEAST} or more")
    mean_um, sd_um = statistics.fmean(values_um), statistics.stdev(values_um)
    room_um = SHARE / 2 * tolerance_um - abs(mean_um)
    if sd_um == 0.0:
        return Capability(mean_um, sd_um, math.inf, math.copysign(math.inf, room_um))
    return Capability(mean_um, sd_um, SHARE * tolerance_um / (SIGMAS * sd_um), room_um / (SIGMAS / 2 * sd_um))


def study_page(study: Study) -> Page:
    """Return the page of a study."""
    found = {"X": capability(study.dx_um, study.tolerance_um), "Y": capability(study.dy_um, study.tolerance_um)}
    worst = min(min(one.cg, one.cgk) for one in found.values())
    enough = math.ceil(max(one.least_tolerance_um for one in found.values()))
    good = worst >= WANTED
    because = (
        f"{len(study.dx_um)} landings on {study.test_point}: the least of Cg and Cgk is {worst:.2f} (at least {WANTED} "
        f"for a tolerance of {study.tolerance_um:g} um). It is good enough for tolerances from {enough:.0f} um on."
    )
    rows = [Number("landings", float(len(study.dx_um)), "", 0), Number("tolerance T", study.tolerance_um, "um", 0)]
    for axis, one in found.items():
        rows += [
            Number(f"{axis}: bias (mean)", one.mean_um, "um", 1, f"within {SHARE / 2 * study.tolerance_um:.0f} um",
                   abs(one.mean_um) > SHARE / 2 * study.tolerance_um),
            Number(f"{axis}: standard deviation", one.sd_um, "um"),
            Number(f"{axis}: Cg", one.cg, "", 2, f"at least {WANTED}", one.cg < WANTED),
            Number(f"{axis}: Cgk", one.cgk, "", 2, f"at least {WANTED}", one.cgk < WANTED),
            Number(f"{axis}: smallest T for which both are {WANTED}", one.least_tolerance_um, "um", 0),
        ]  # fmt: skip
    return Page(
        kind="study", subject=f"Type-1 study of {study.test_point}", station=study.station, made_at=study.made_at,
        job="", verdict=PageVerdict(good, because), numbers=tuple(rows), plots=(_run(study), _scatter(study)),
        done="measured",
    )  # fmt: skip


def write_study(study: Study, path: Path) -> None:
    """Write the page, and the numbers beside it, from which it is drawn again; OSError."""
    text = render(study_page(study))
    replace_whole(path, lambda beside: write_text(beside, text))
    numbers = study.model_dump_json(indent=1)
    replace_whole(path.with_suffix(".json"), lambda beside: write_text(beside, numbers))


def _run(study: Study) -> Plot:
    figure, (upper, lower) = new_figure(2, height_in=4.6, sharex=True)
    band = SHARE / 2 * study.tolerance_um
    for axes, values, colour, axis in ((upper, study.dx_um, MAIN, "X"), (lower, study.dy_um, SECOND, "Y")):
        axes.plot(range(1, len(values) + 1), values, ".-", color=colour, linewidth=0.8, markersize=5)
        axes.axhline(statistics.fmean(values), color=INK, linewidth=0.9)
        for limit in (-band, band):
            axes.axhline(limit, color=MUTED, linewidth=0.9, linestyle="--")
        axes.set(ylabel=f"{axis} off the point, um")
    lower.set(xlabel="landing")
    caption = f"The line is the mean, the dashes are a tenth of the tolerance to each side, {band:g} um."
    return Plot("One landing after the other", to_svg(figure, "deviations in the order of the landings"), caption)


def _scatter(study: Study) -> Plot:
    figure, (axes,) = new_figure(height_in=4.6)
    axes.plot(study.dx_um, study.dy_um, ".", color=MAIN, markersize=6)
    axes.plot(0.0, 0.0, "+", color=INK, markersize=12)
    reach = float(np.abs([*study.dx_um, *study.dy_um]).max(initial=SHARE / 2 * study.tolerance_um)) * 1.15
    axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="X off the point, um",
             ylabel="Y off the point, um")  # fmt: skip
    return Plot("Where the tip landed", to_svg(figure, "landings about the point"), "The cross is the point itself.")
