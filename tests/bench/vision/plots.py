"""Draw the figures as PNG files. Needs matplotlib, as the pages of calibrations do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from tests.bench.vision.campaign import Record
from tests.bench.vision.figures import BLOCKS, by_method, count, crb_ratio, rms_px
from tests.bench.vision.methods import OURS

mpl.use("Agg")
import matplotlib.pyplot as plt

TARGET = {"color": "black", "linestyle": "--", "linewidth": 1.2}
TITLES = {"tip": "tip of the needle", "pads": "test points", "disc": "disc", "control": "control point"}
RMS_TARGET_PX = {"tip": 0.15, "pads": 0.05, "control": 0.2}
P99_TARGET_PX = {"tip": 0.4}
# What the targets above are for, where there is more than one.
WHOSE = {"tip": " (clean)", "pads": " (nothing before it)", "control": " (two arms hidden)"}
TIME_TARGET_MS = {"tip": 8.0, "pads": 3.0}
COLOURS = plt.get_cmap("tab10")


def _style(index: int, method: str) -> dict[str, Any]:
    return {"color": COLOURS(index % 10), "label": method, "linewidth": 2.6 if method == OURS else 1.3}


def _save(figure: Any, path: Path) -> Path:
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return path


def error_cdf(task: str, records: Sequence[Record], path: Path) -> Path:
    """Draw the share of scenes (with a target) answered within an error: a curve that ends low missed many."""
    figure, axes = plt.subplots(figsize=(8, 5))
    with_target = [record for record in records if not record.empty and not record.defect]
    for index, (method, part) in enumerate(by_method(with_target).items()):
        errors = np.sort([record.error_px for record in part if np.isfinite(record.error_px)])
        share = 100 * np.arange(1, errors.size + 1) / len(part)
        axes.step(errors, share, where="post", **_style(index, method))
    axes.set_xscale("log")
    axes.set_xlim(0.005, 10)
    axes.set_ylim(0, 101)
    if task in RMS_TARGET_PX:
        axes.axvline(RMS_TARGET_PX[task], **TARGET, label=f"target rms {RMS_TARGET_PX[task]} px{WHOSE[task]}")
    if task in P99_TARGET_PX:
        axes.axvline(
            P99_TARGET_PX[task], color="black", linestyle=":", label=f"target p99 {P99_TARGET_PX[task]} px{WHOSE[task]}"
        )
    axes.set(xlabel="error, px", ylabel="scenes within it, %", title=f"Error, {TITLES[task]}")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend(fontsize=8, loc="upper left")
    return _save(figure, path)


def _bars(
    groups: dict[str, list[Record]], height: Callable[[list[Record]], float], label: str, title: str
) -> tuple[Any, Any]:
    """Draw a bar per group and method."""
    names = list(groups)
    methods = list(by_method([record for part in groups.values() for record in part]))
    figure, axes = plt.subplots(figsize=(max(8.0, 1.5 + 1.1 * len(names)), 5.5))
    width = 0.84 / len(methods)
    for index, method in enumerate(methods):
        heights = [height(by_method(groups[name]).get(method, [])) for name in names]
        places = np.arange(len(names)) + (index - (len(methods) - 1) / 2) * width
        axes.bar(places, heights, width, color=COLOURS(index % 10), label=method)
    axes.set_xticks(np.arange(len(names)), names, rotation=30, ha="right", fontsize=8)
    axes.set(ylabel=label, title=title)
    axes.grid(visible=True, axis="y", alpha=0.25)
    return figure, axes


def rms_by_kind(task: str, records: Sequence[Record], path: Path) -> Path:
    kinds: dict[str, list[Record]] = {}
    for record in records:
        if not record.empty and not record.defect:
            hidden = ", needle over it" if task == "pads" and record.hidden > 0 else ""
            kinds.setdefault(f"{record.plain_kind}{hidden}", []).append(record)
    figure, axes = _bars(kinds, rms_px, "2-D rms error of the right answers, px", f"Error by kind, {TITLES[task]}")
    axes.set_yscale("log")
    if task in RMS_TARGET_PX:
        axes.axhline(RMS_TARGET_PX[task], **TARGET, label=f"target {RMS_TARGET_PX[task]} px{WHOSE[task]}")
    axes.legend(fontsize=8)
    return _save(figure, path)


def misses(task: str, records: Sequence[Record], path: Path) -> Path:
    """Draw missed (pale) upon wrong (full) in percent of each block's scenes."""
    groups = {block: list(filter(keep, records)) for block, keep in BLOCKS[task].items()}
    groups = {block: part for block, part in groups.items() if part}

    def percent(outcome: str) -> Callable[[list[Record]], float]:
        # A needle with a defect is rightly refused.
        if outcome == "missed":
            return lambda part: 100 * sum(r.outcome == outcome and not r.defect for r in part) / max(len(part), 1)
        return lambda part: 100 * count(part, outcome) / max(len(part), 1)

    figure, axes = _bars(groups, percent("wrong"), "share of scenes, %", f"Wrong (full) and missed, {TITLES[task]}")
    methods = list(by_method(records))
    width = 0.84 / len(methods)
    for index, method in enumerate(methods):
        parts = [by_method(groups[name]).get(method, []) for name in groups]
        base = [percent("wrong")(part) for part in parts]
        places = np.arange(len(groups)) + (index - (len(methods) - 1) / 2) * width
        axes.bar(places, [percent("missed")(p) for p in parts], width, base, color=COLOURS(index % 10), alpha=0.35)
    if task == "pads":
        axes.axhline(0.5, **TARGET, label="target: at most 0.5 % missed, none wrong")
    axes.legend(fontsize=8)
    return _save(figure, path)


def ratio_to_bound(records: Sequence[Record], path: Path) -> Path:
    figure, axes = plt.subplots(figsize=(8, 5))
    noises = sorted({record.noise for record in records})
    for index, (method, part) in enumerate(by_method(records).items()):
        ratios = [crb_ratio([record for record in part if record.noise == noise]) for noise in noises]
        axes.plot(noises, ratios, marker="o", **_style(index, method))
    axes.axhline(1.0, color="gray", linewidth=1, label="Cramer-Rao bound")
    axes.plot([8.0], [1.5], "k_", markersize=24, markeredgewidth=2, label="target at noise 8: 1.5")
    axes.set_yscale("log")
    axes.set(xlabel="noise, grey levels (1 sigma)", ylabel="rms error / bound", title="Disc centre against its bound")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend(fontsize=8)
    return _save(figure, path)


def times(task: str, records: Sequence[Record], path: Path) -> Path:
    figure, axes = plt.subplots(figsize=(8, 5))
    groups = by_method(records)
    longest = max(float(np.percentile([r.ms for r in part], 99)) for part in groups.values())
    bins = np.geomspace(0.2, max(longest, 1.0), 60)
    for index, (method, part) in enumerate(groups.items()):
        axes.hist([record.ms for record in part], bins, histtype="step", **_style(index, method))
    if task in TIME_TARGET_MS:
        axes.axvline(TIME_TARGET_MS[task], **TARGET, label=f"target median {TIME_TARGET_MS[task]:g} ms")
    axes.set_xscale("log")
    axes.set(xlabel="time, ms (one thread)", ylabel="scenes", title=f"Time, {TITLES[task]}")
    axes.legend(fontsize=8)
    return _save(figure, path)


def draw_all(folder: Path, records: Sequence[Record]) -> list[Path]:
    """Write every plot the records allow and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for task in TITLES:
        part = [record for record in records if record.task == task]
        if not part:
            continue
        made.append(times(task, part, folder / f"{task}_times.png"))
        if task == "disc":
            made.append(ratio_to_bound(part, folder / "disc_crb.png"))
            continue
        made.append(error_cdf(task, part, folder / f"{task}_errors.png"))
        made.append(rms_by_kind(task, part, folder / f"{task}_kinds.png"))
        made.append(misses(task, part, folder / f"{task}_misses.png"))
    return made
