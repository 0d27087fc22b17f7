"""Draw the campaigns as PNG files. Needs matplotlib, as the pages of calibrations do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from tests.bench.landing.judge import (
    CORRECTED_P95_UM,
    CORRECTED_UM,
    FIRST_P99_UM,
    FIRST_UM,
    SCATTER_UM,
    percentile,
)
from tests.bench.landing.trials import Trial, Way

mpl.use("Agg")
import matplotlib.pyplot as plt

BOUND = {"color": "black", "linestyle": "--", "linewidth": 1.2}
SHARE = {"color": "black", "linestyle": ":", "linewidth": 1.4}
DOT = 9
BLUE, ORANGE, GREEN = (plt.get_cmap("tab10")(k) for k in (0, 1, 2))


def draw_all(folder: Path, trials: Sequence[Trial]) -> list[Path]:
    """Write every plot and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    drawings = {"errors": errors, "targets": targets, "theta": over_theta, "looks": looks}
    return [_save(draw(trials), folder / f"{name}.png") for name, draw in drawings.items()]


def _save(figure: Any, path: Path) -> Path:
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return path


def errors(trials: Sequence[Trial]) -> Any:
    """Draw how the errors of both campaigns are spread: a histogram, and the share within an error."""
    figure, rows = plt.subplots(2, 2, figsize=(11, 7))
    first, corrected = [t.first for t in trials], [t.corrected for t in trials]
    _spread(rows[0], "first landing", first, FIRST_UM, (0.99, FIRST_P99_UM), BLUE)
    _spread(rows[1], "after the correction", corrected, CORRECTED_UM, (0.95, CORRECTED_P95_UM), GREEN)
    return figure


def _spread(
    row: Any, name: str, values: Sequence[float], limit_um: float, share: tuple[float, float], colour: Any
) -> None:
    finite = np.sort([v for v in values if np.isfinite(v)])
    # What lies beyond the picture is piled up at its right edge: it must not vanish.
    top_um = 1.25 * limit_um
    row[0].hist(np.minimum(finite, top_um), np.linspace(0.0, top_um, 60), color=colour)
    row[0].set(
        ylabel="trials", title=f"{name}: {len(finite)} of {len(values)}, the rest without landing or good answer"
    )
    row[1].step(finite, 100.0 * np.arange(1, finite.size + 1) / max(len(values), 1), where="post", color=colour)
    row[1].set(ylabel="within it, % of all trials", ylim=(0, 101), xlim=(0, top_um))
    part, part_um = share
    row[1].set_title(f"p{100 * part:.0f} {percentile(values, part):.1f} um")
    for axes in row:
        axes.axvline(limit_um, **BOUND, label=f"100 % within {limit_um:.0f} um")
        axes.axvline(part_um, **SHARE, label=f"{100 * part:.0f} % within {part_um:.0f} um")
        axes.set_xlabel("error, um")
        axes.grid(visible=True, alpha=0.25)
        axes.legend(fontsize=8)


def targets(trials: Sequence[Trial]) -> Any:
    """Draw where the tip landed round the pad, as the thesis does in figure 6.11."""
    figure, row = plt.subplots(1, 3, figsize=(14, 5.2))
    rings = (50.0, 100.0, FIRST_UM)
    _target(row[0], "first landing, by calibration alone", [t.first_um for t in trials], rings, BLUE)
    _target(row[1], "before: an offset within 400 um", [t.before_um for t in trials], (200.0, 400.0, 600.0), ORANGE)
    after = (10.0, CORRECTED_P95_UM, CORRECTED_UM)
    _target(row[2], "after the correction", [t.after_um for t in trials], after, GREEN)
    return figure


def _target(axes: Any, title: str, ways: Sequence[Way | None], rings: Sequence[float], colour: Any) -> None:
    reach = 1.15 * rings[-1]
    for ring in rings:
        axes.add_patch(plt.Circle((0.0, 0.0), ring, fill=False, color="black", linewidth=0.8))
        axes.annotate(f"{ring:.0f}", (0.0, ring), fontsize=8, ha="center", va="bottom")
    landed = np.array([way for way in ways if way is not None]).reshape(-1, 2)
    outside = int((np.abs(landed).max(axis=1) > reach).sum()) if len(landed) else 0
    axes.scatter(*landed.T, s=DOT, alpha=0.6, color=colour, linewidths=0)
    axes.axhline(0.0, color="gray", linewidth=0.5)
    axes.axvline(0.0, color="gray", linewidth=0.5)
    more = f", {outside} outside the picture" if outside else ""
    axes.set(title=f"{title}\n{len(landed)} landings{more}", xlabel="x, um", ylabel="y, um")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")


def over_theta(trials: Sequence[Trial]) -> Any:
    """Draw the errors over the head's angle, the forbidden band grey."""
    figure, column = plt.subplots(2, 1, figsize=(11, 7), sharex=True)
    rows = (
        ("first landing", [t.first for t in trials], FIRST_UM, FIRST_P99_UM, BLUE),
        ("after the correction", [t.after for t in trials], CORRECTED_UM, CORRECTED_P95_UM, GREEN),
    )
    angles = np.array([t.theta_deg for t in trials])
    for axes, (name, values, limit_um, part_um, colour) in zip(column, rows, strict=True):
        top_um = 1.25 * limit_um
        axes.axvspan(101.0, 139.0, color="lightgray")
        axes.scatter(angles, np.minimum(values, top_um), s=DOT, alpha=0.6, color=colour, linewidths=0)
        axes.axhline(limit_um, **BOUND)
        axes.axhline(part_um, **SHARE)
        axes.set(ylabel="error, um", title=name, ylim=(0, 1.02 * top_um), xlim=(0, 360))
        axes.grid(visible=True, alpha=0.25)
    column[-1].set_xlabel("head angle, deg")
    return figure


def looks(trials: Sequence[Trial]) -> Any:
    """Draw how many looks a correction took, and what it made of the error."""
    figure, row = plt.subplots(1, 2, figsize=(12, 5))
    for ok, colour, bottom in ((True, GREEN, Counter[int]()), (False, "tab:red", _looks(trials, ok=True))):
        counts = _looks(trials, ok=ok)
        bars = sorted(counts)
        row[0].bar(bars, [counts[k] for k in bars], bottom=[bottom[k] for k in bars], color=colour,
                   label="corrected" if ok else "error answer")  # fmt: skip
    row[0].set(xlabel="looks", ylabel="corrections", title="Looks a correction took")
    row[0].legend(fontsize=8)
    known = [t for t in trials if t.before_um is not None and t.after_um is not None]
    before, after = np.array([t.before for t in known]), np.array([t.after for t in known])
    colours = ["tab:red" if t.error else GREEN for t in known]
    row[1].scatter(before, np.maximum(after, 0.5), s=DOT, alpha=0.6, c=colours, linewidths=0)
    line = np.linspace(0.0, before.max(initial=1.0), 200)
    row[1].plot(line, np.maximum(line, 0.5), **BOUND, label="as far off as before")
    row[1].plot(line, line + SCATTER_UM, **SHARE, label=f"{SCATTER_UM:.0f} um farther (scatter)")
    row[1].set(xlabel="error before, um", ylabel="error after, um", yscale="log", title="What a correction made of it")
    row[1].legend(fontsize=8)
    return figure


def _looks(trials: Sequence[Trial], *, ok: bool) -> Counter[int]:
    return Counter(t.looks for t in trials if (t.error is None) is ok)
