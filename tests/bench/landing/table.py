"""Print what the campaigns reached, where the rest went, and what a trial cost."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from tests.bench.landing.judge import (
    SCATTER_UM,
    Verdict,
    enlarged,
    errors_by_name,
    faults_of,
    misses,
    percentile,
    um,
)
from tests.bench.landing.trials import Setup, Trial, Way

WORST = 12
SHARES = (0.5, 0.95, 0.99, 1.0)
COUNTED = (
    "Judged by the simulated station's truth alone. Percentiles and 100 % are of all trials: a landing that did not "
    "take place and a correction that ended in an error answer count as infinitely far off. Enlarging: the tip stood "
    f"farther from the pad after the correction than before it by more than {SCATTER_UM:.0f} um, which is 3 sigma of "
    "where one stop comes to rest; corrections that ended in an error answer are asked too."
)


def show(console: Console, trials: Sequence[Trial], setups: Sequence[Setup], verdicts: Sequence[Verdict]) -> None:
    """Print everything."""
    console.print(_errors(trials))
    console.print(_verdicts(verdicts))
    console.print(COUNTED, style="dim")
    if trials:
        console.print(f"Of n trials without a miss, 95 % sure is a share of {100 * 0.05 ** (1 / len(trials)):.2f} %.",
                      style="dim")  # fmt: skip
    names = errors_by_name(trials)
    if names:
        console.print("error answers: " + ", ".join(f"{name} {count}" for name, count in names.items()), style="red")
    console.print(_stations(setups))
    console.print(_cost(setups))
    bad = misses(trials)
    if bad:
        console.print(_worst(bad))


def _errors(trials: Sequence[Trial]) -> Table:
    table = Table(title="Error, um", title_justify="left", title_style="bold")
    table.add_column("landing")
    for head in ("n", "p50", "p95", "p99", "worst", "enlarged", "beyond scatter"):
        table.add_column(head, justify="right")
    rows = {
        "first, by calibration alone": [t.first for t in trials],
        "before the correction (offset)": [t.before for t in trials],
        "after the correction": [t.corrected for t in trials],
        "after, also of error answers": [t.after for t in trials],
    }
    for name, values in rows.items():
        counts = [str(len(enlarged(trials))), str(len(enlarged(trials, SCATTER_UM)))]
        more = counts if name.endswith("answers") else ["", ""]
        table.add_row(name, str(len(values)), *[_number(percentile(values, share)) for share in SHARES], *more)
    return table


def _number(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "-" if math.isnan(value) else "inf"


def _verdicts(verdicts: Sequence[Verdict]) -> Table:
    table = Table(title="Bounds", title_justify="left", title_style="bold")
    for head in ("campaign", "bound", "measured", ""):
        table.add_column(head)
    words = {True: ("reached", "green"), False: ("MISSED", "bold red"), None: ("not measured", "yellow")}
    for verdict in verdicts:
        word, style = words[verdict.reached]
        table.add_row(verdict.campaign, verdict.bound, verdict.measured, f"[{style}]{word}[/]")
    return table


def _stations(setups: Sequence[Setup]) -> Table:
    """List the stations: how long their set-ups took in their own time, and the head model's hold-out error."""
    table = Table(title="Stations: simulated seconds of each step", title_justify="left", title_style="bold")
    names = list(dict.fromkeys(step.name for setup in setups for step in setup.steps))
    for head in ("seed", "speed", *names, "hold-out um", "trials", "trouble"):
        table.add_column(head, justify="left" if head == "trouble" else "right")
    for setup in sorted(setups, key=lambda s: (not s.by_clock, s.seed)):
        steps = {step.name: f"{step.simulated_s:.0f}" for step in setup.steps}
        rotation = setup.step("rotation")
        holdout = rotation.detail.get("holdout_rms_um") if rotation else None
        table.add_row(
            str(setup.seed),
            "by the clock" if setup.by_clock else f"{setup.speed:g}",
            *[steps.get(name, "") for name in names],
            f"{holdout:.1f}" if isinstance(holdout, int | float) else "",
            str(setup.trials),
            setup.broken or "",
        )
    return table


def _cost(setups: Sequence[Setup]) -> Table:
    """Say what a trial took: processor time of each of the two programs, and time by the clock."""
    table = Table(title="Cost", title_justify="left", title_style="bold")
    heads = ("trial: simulated station, ms", "daemon, ms", "one station by the clock, ms", "set-up: both, ms")
    for head in heads:
        table.add_column(head, justify="right")
    trials = sum(s.trials for s in setups) or math.nan
    fast = [s.setup_ms for s in setups if not s.by_clock and s.setup_ms]
    sums = (sum(s.sim_ms for s in setups), sum(s.daemon_ms for s in setups), 1e3 * sum(s.trials_s for s in setups))
    table.add_row(*[_number(v / trials) for v in sums], _number(sum(fast) / len(fast)) if fast else "-")
    return table


def _worst(bad: Sequence[Trial]) -> Table:
    table = Table(title=f"Missed: {len(bad)}, the worst first", title_justify="left", title_style="bold")
    for head in ("seed", "trial", "point", "theta", "offset", "first", "before", "after", "looks", "answer", "why"):
        table.add_column(head, justify="left" if head in ("point", "answer", "why") else "right")
    for trial in bad[:WORST]:
        table.add_row(
            str(trial.seed), str(trial.index), trial.test_point, f"{trial.theta_deg:.2f}", _way(trial.offset_um),
            _way(trial.first_um), _way(trial.before_um), _way(trial.after_um), str(trial.looks),
            trial.error or trial.outcome, ", ".join(faults_of(trial)),
        )  # fmt: skip
    return table


def _way(way: Way | None) -> str:
    return "-" if way is None else um(math.hypot(*way)).removesuffix(" um")
