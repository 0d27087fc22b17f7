"""Page of a month: a verdict, the figures, the alerts, and the courses of all watches."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from daemon.config.watch_names import GROUPS
from daemon.platform.atomic_file import replace_whole
from daemon.tools.report.month_facts import Course, Month
from daemon.tools.report.page import Number, PageVerdict, Plot, environment, rounded, write_text
from daemon.tools.report.svg import BAD, MAIN, MUTED, SECOND, alone, new_figure, to_svg

TITLES: Final = {
    "placement": "Placement: where the tip lands before it is corrected",
    "corrections": "Corrections",
    "tip": "The needle",
    "light": "Light on the needle",
    "camera": "Camera",
    "axes": "Axes",
    "bus": "Lines",
    "calibration": "Calibrations",
    "probe": "The probe",
}
MOST_DOTS: Final = 240
"""Of more numbers only some are drawn; the daily means are of all."""
MOST_FAILED, FEWEST = 0.1, 3
"""Share and number of jobs that may fail at the station's own work in a month that is called healthy."""
COLUMNS: Final = 2
PANEL_IN: Final = 2.3


def write_month(month: Month, path: Path) -> None:
    """Write the page as one HTML file, whole or not at all; OSError if it cannot be written."""
    text = environment().get_template("month.html.j2").render(
        month=month, verdict=verdict(month), numbers=numbers(month), plots=plots(month), name=f"{month.first:%Y-%m}"
    )  # fmt: skip
    replace_whole(path, lambda beside: write_text(beside, text))


def write_charts(month: Month, path: Path) -> None:
    """Write the charts of the page by themselves, as JSON: a list of group, title, caption and a whole SVG."""
    colours = environment().get_template("colours.css").render()
    told = [
        {"group": group, "title": plot.title, "caption": plot.caption, "svg": alone(plot.svg, colours)}
        for group, plot in zip(drawn_groups(month), plots(month), strict=True)
    ]
    replace_whole(path, lambda beside: write_text(beside, json.dumps(told)))


def verdict(month: Month) -> PageVerdict:
    """Judge a month by what stood at its end."""
    raised = sum(line.change == "raised" for line in month.alerts)
    failed, own = sum(month.failures.values()), month.own_failures
    good = not month.still_standing and (own < FEWEST or own <= MOST_FAILED * month.jobs)
    jobs = f" {failed} of {month.jobs} jobs failed, {own} of them at the station's own work." if failed else ""
    if not month.courses:
        return PageVerdict(good=good, because=f"Nothing was measured in this month.{jobs}")
    stood = ", ".join(month.still_standing) or "No alert"
    return PageVerdict(good=good, because=f"{stood} stood at its end; {raised} were raised in it.{jobs}")


def numbers(month: Month) -> tuple[Number, ...]:
    """Return the figures of the table."""
    rows = [
        Number("touches", float(month.touches), "", 0),
        Number("jobs", float(month.jobs), "", 0),
        *(Number(f"failed: {name}", float(count), "jobs", 0) for name, count in month.failures.items()),
    ]
    for name, course in month.courses.items():
        spec = course.spec
        if spec.name.startswith("placement_at"):
            continue
        if course.is_share:
            events, trials = (sum(column) for column in zip(*course.by_day.values(), strict=True))
            if trials:
                rows.append(Number(spec.what, events / trials, spec.unit, spec.digits, f"{events} in {trials}"))
        elif spec.settings is None:
            rows.append(Number(spec.what, course.values[-1], spec.unit, spec.digits, "when last asked",
                               bad=name in month.still_standing))  # fmt: skip
        else:
            values = np.array(course.values)
            said = f"sd {rounded(float(values.std()), spec.digits + 1)}, {values.size} numbers"
            rows.append(Number(spec.what, float(values.mean()), spec.unit, spec.digits + 1, said,
                               bad=name in month.still_standing))  # fmt: skip
    return tuple(rows)


def drawn_groups(month: Month) -> tuple[str, ...]:
    """Return the groups that have numbers, in their order."""
    found = {course.spec.group for course in month.courses.values()}
    return tuple(group for group in GROUPS if group in found and group in TITLES)


def plots(month: Month) -> tuple[Plot, ...]:
    """Return one figure a group."""
    return tuple(
        _group(month, group, [course for course in month.courses.values() if course.spec.group == group])
        for group in drawn_groups(month)
    )


def _group(month: Month, group: str, courses: Sequence[Course]) -> Plot:
    """Draw all watches of a group."""
    rows = -(-len(courses) // COLUMNS)
    figure, axes = new_figure(rows, COLUMNS, height_in=PANEL_IN * rows + 0.3)
    for panel, course in zip(axes, courses, strict=False):
        (_share if course.is_share else _values)(panel, course)
        panel.set_title(course.spec.what if len(course.spec.what) < 60 else course.spec.name)
        panel.set(xlim=(1, (month.last - month.first).days + 1), ylabel=course.spec.unit)
        for line in month.alerts:
            if line.name == course.spec.name and line.change == "raised":
                panel.axvline(line.day, color=BAD, linestyle="--")
    for spare in axes[len(courses) :]:
        spare.set_visible(False)
    caption = (
        "Over the days of the month. Dots are single numbers, the line is their mean by day; a dashed line is where an "
        "alert was raised."
    )
    return Plot(TITLES[group], to_svg(figure, f"{TITLES[group]}, over the month"), caption)


def _values(panel: Axes, course: Course) -> None:
    step = max(1, len(course.values) // MOST_DOTS)
    panel.plot(course.days[::step], course.values[::step], ".", color=MUTED, markersize=2.5, alpha=0.6)
    days, means, _ = course.daily()
    panel.plot(days, means, "o-", color=MAIN, markersize=3.5)
    low, high = np.percentile(course.values, (0.5, 99.5))
    room = max(high - low, 1e-6) * 0.35
    panel.set_ylim(low - room, high + room)


def _share(panel: Axes, course: Course) -> None:
    days = sorted(day for day, (_, trials) in course.by_day.items() if trials)
    shares = [course.by_day[day][0] / course.by_day[day][1] for day in days]
    panel.bar([day + 0.5 for day in days], shares, color=SECOND, width=0.8)
    panel.set_ylim(0, max(shares, default=0.0) * 1.3 or 1.0)
