"""Page of the backlash of X and Y."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes

from daemon.storage.calibration_records import AxisBacklash, BacklashRecord
from daemon.tools.report.page import Number, PageVerdict, Plot
from daemon.tools.report.svg import INK, MUTED, SECOND, WARM, new_figure, to_svg

SUBJECT: Final = "Play of X and Y"
SIGMAS: Final = 3.0


def _axes(record: BacklashRecord) -> tuple[tuple[str, AxisBacklash], ...]:
    """Return both axes by name; ValueError if one was not measured from both sides."""
    both = (("X", record.x), ("Y", record.y))
    for name, axis in both:
        if not axis.from_below_um or not axis.from_above_um:
            raise ValueError(f"{name} was not measured from both sides; calibrate the backlash again")
    return both


def _at_most_um(axis: AxisBacklash) -> float:
    """Return the play that may be expected."""
    return abs(axis.backlash_um) + SIGMAS * axis.sigma_um


def verdict(record: BacklashRecord) -> PageVerdict:
    """Judge by whether the one-sided approach overshoots more than any play."""
    good = all(_at_most_um(axis) < record.approach_um for _, axis in _axes(record))
    plays = ", ".join(f"{name} {axis.backlash_um:.1f} ± {axis.sigma_um:.1f} um" for name, axis in _axes(record))
    covers = "is larger than any of it" if good else "does not cover it: lengthen approach_um"
    return PageVerdict(good, f"Play: {plays}. The one-sided approach of {record.approach_um:.0f} um {covers}.")


def numbers(record: BacklashRecord) -> tuple[Number, ...]:
    """Return the figures of the table."""
    rows = []
    for name, axis in _axes(record):
        most = _at_most_um(axis)
        rows += [
            Number(f"{name}: play", axis.backlash_um, "um"),
            Number(f"{name}: its sigma", axis.sigma_um, "um"),
            Number(f"{name}: play and {SIGMAS:.0f} sigma", most, "um",
                   limit=f"below the approach of {record.approach_um:.0f} um", bad=most >= record.approach_um),
            Number(f"{name}: repeats from below / above", f"{len(axis.from_below_um)} / {len(axis.from_above_um)}"),
        ]  # fmt: skip
    return (
        *rows,
        Number("approach", record.approach_um, "um", 0),
        Number("looks", float(record.looks), "", 0),
        Number("time taken", record.seconds, "s"),
    )


def since(record: BacklashRecord, previous: BacklashRecord) -> str:
    """Say how the play changed."""
    both = zip(_axes(record), _axes(previous), strict=True)
    changes = (f"{name} {now.backlash_um - then.backlash_um:+.1f} um" for (name, now), (_, then) in both)
    return f"play changed by {', '.join(changes)}."


def plots(record: BacklashRecord, previous: BacklashRecord | None) -> tuple[Plot, ...]:
    """Return the plots."""
    figure, both = new_figure(1, 2, height_in=3.6)
    for axes, (name, axis) in zip(both, _axes(record), strict=True):
        _strips(axes, name, axis)
    caption = (
        "Where the tip was seen along the axis when it came from below and from above; zero is the middle of both. "
        "Each dot is one arrival, the bars are the means, the play is what lies between them."
    )
    drawn = (Plot("Arrivals", to_svg(figure, "Arrivals from below and from above, per axis"), caption),)
    return (*drawn, _against(record, previous))


def _strips(axes: Axes, name: str, axis: AxisBacklash) -> None:
    """Draw the repeats of one axis side by side, with their means and the play between."""
    below, above = np.array(axis.from_below_um), np.array(axis.from_above_um)
    middle = (below.mean() + above.mean()) / 2
    for at, values, colour in ((0.0, below - middle, SECOND), (1.0, above - middle, WARM)):
        spread = np.linspace(-0.16, 0.16, values.size) if values.size > 1 else np.zeros(1)
        axes.plot(at + spread, values, "o", color=colour)
        axes.hlines(values.mean(), at - 0.28, at + 0.28, color=INK, linewidth=1.6)
    low, high = below.mean() - middle, above.mean() - middle
    axes.annotate(
        "", (0.5, low), (0.5, high), arrowprops={"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0}
    )
    axes.hlines((low, high), (0.28, 0.5), (0.5, 0.72), color=MUTED, linewidth=0.8, linestyle=":")
    axes.set(xticks=(0, 1), xlim=(-0.5, 1.5), ylabel=f"{name} from the middle, um",
             title=f"{name}: {axis.backlash_um:.1f} ± {axis.sigma_um:.1f} um")  # fmt: skip
    axes.set_xticklabels(("from below", "from above"))
    axes.margins(y=0.12)


def _against(record: BacklashRecord, previous: BacklashRecord | None) -> Plot:
    """Draw the play with its sigma against the approach, and the previous play below."""
    rows = [(name, axis, INK) for name, axis in _axes(record)]
    if previous:
        rows += [(f"{name}, previous", axis, MUTED) for name, axis in _axes(previous)]
    figure, (axes,) = new_figure(height_in=1.2 + 0.38 * len(rows))
    for at, (_, axis, colour) in enumerate(rows):
        axes.errorbar(abs(axis.backlash_um), at, xerr=SIGMAS * axis.sigma_um, fmt="o", color=colour, capsize=4)
    axes.axvline(record.approach_um, color=WARM, linestyle="--", label=f"approach, {record.approach_um:.0f} um")
    axes.set(xlim=(0, None), ylim=(len(rows) - 0.4, -0.6), xlabel=f"play, um (bars: {SIGMAS:.0f} sigma)")
    axes.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    axes.legend(loc="upper center")
    caption = "Every move ends with an approach from one side; it has to be longer than the play or the play remains."
    return Plot("Play against the approach", to_svg(figure, "Play of each axis against the approach"), caption)
