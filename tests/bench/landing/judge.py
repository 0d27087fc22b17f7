"""The judge: what the campaigns must reach, what they reached, by the truth alone.

Percentiles are of all trials: a landing that never took place and a correction that ended in an error answer count as
infinitely far off, so "p95 within 20 um" says that 95 % of all corrections are good, not of those that answered.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.bench.landing.trials import Setup, Trial

FIRST_UM, FIRST_P99_UM = 200.0, 80.0
CORRECTED_UM, CORRECTED_P95_UM = 40.0, 20.0
MEDIAN_LOOKS = 2.0
ROTATION_S = 120.0
NOTHING = "nothing measured"
SCATTER_UM = 24.0
"""Three sigma of one stop (8 um). The error before is the truth of where the tip stood, so only the new stop draws."""


@dataclass(frozen=True)
class Verdict:
    """One bound. `reached` is None where nothing was measured that could tell."""

    campaign: str
    bound: str
    measured: str
    reached: bool | None


def percentile(values: Sequence[float], share: float) -> float:
    """Return the smallest of the values below which, itself included, lies at least that share; NaN for none."""
    if not values:
        return math.nan
    return float(np.percentile(np.asarray(values, dtype=float), 100.0 * share, method="inverted_cdf"))


def um(value: float) -> str:
    """Write a length; infinite is what never landed, or what was answered with an error."""
    return f"{value:.1f} um" if math.isfinite(value) else "infinite"


def enlarged(trials: Sequence[Trial], beyond_um: float = 0.0) -> list[Trial]:
    """Return the corrections after which the tip was farther off than before by more than that.

    Every correction is asked, also one that ended in an error answer: what it left behind is where the needle is.
    """
    known = (t for t in trials if t.before_um is not None and t.after_um is not None)
    return [t for t in known if t.after > t.before + beyond_um]


def errors_by_name(trials: Sequence[Trial]) -> dict[str, int]:
    """Count the error answers, most frequent first."""
    return dict(Counter(t.error for t in trials if t.error is not None).most_common())


def faults_of(trial: Trial) -> list[str]:
    """Name the bounds of every single landing that a trial breaks, the worst first."""
    broken = {
        "another net": trial.wrong,
        "enlarged": bool(enlarged([trial], SCATTER_UM)),
        "error answer": trial.error is not None,
        "correction": trial.error is None and trial.after > CORRECTED_UM,
        "first landing": trial.first > FIRST_UM,
    }
    return [name for name, is_so in broken.items() if is_so]


def misses(trials: Sequence[Trial]) -> list[Trial]:
    """Return all trials that break a bound of every single landing, the worst first."""
    order = ("another net", "enlarged", "error answer", "correction", "first landing")
    bad = [
        (order.index(faults[0]), -max(t.first, t.after), t.seed, t.index, t) for t in trials if (faults := faults_of(t))
    ]
    return [t for *_, t in sorted(bad, key=lambda item: item[:4])]


def judge(trials: Sequence[Trial], setups: Sequence[Setup], asked: int) -> list[Verdict]:
    """Hold the campaigns against their bounds; `asked` is the number of trials that should have run."""
    return [*_complete(trials, setups, asked), *_first(trials), *_corrected(trials), *_rotation(setups)]


def passed(verdicts: Sequence[Verdict]) -> bool:
    """Tell whether no bound was missed."""
    return all(verdict.reached is not False for verdict in verdicts)


def _complete(trials: Sequence[Trial], setups: Sequence[Setup], asked: int) -> list[Verdict]:
    """A campaign that lost stations or trials has not shown what it should."""
    broken = [s for s in setups if s.broken is not None]
    return [
        Verdict("all", f"{asked} trials run", f"{len(trials)}", len(trials) >= asked),
        Verdict("all", "every station set up and alive", f"{len(setups) - len(broken)} of {len(setups)}", not broken),
    ]


def _within(values: Sequence[float], limit_um: float) -> tuple[str, bool | None]:
    if not values:
        return NOTHING, None
    bad = sum(v > limit_um for v in values)
    good_percent = math.floor(1e4 * (len(values) - bad) / len(values)) / 100.0  # never 100.00 % with a miss in it
    worst = max((v for v in values if math.isfinite(v)), default=math.inf)
    never = sum(math.isinf(v) for v in values)
    return (
        f"{good_percent:.2f} %, {bad} missed ({never} without landing or good answer; worst other {um(worst)})",
        not bad,
    )


def _share(campaign: str, values: Sequence[float], share: float, limit_um: float) -> Verdict:
    value = percentile(values, share)
    name = f"p{100 * share:.0f} within {limit_um:.0f} um"
    return Verdict(campaign, name, um(value) if values else NOTHING, value <= limit_um if values else None)


def _first(trials: Sequence[Trial]) -> list[Verdict]:
    values = [t.first for t in trials]
    measured, reached = _within(values, FIRST_UM)
    return [
        Verdict("first landing", f"100 % within {FIRST_UM:.0f} um", measured, reached),
        _share("first landing", values, 0.99, FIRST_P99_UM),
    ]


def _corrected(trials: Sequence[Trial]) -> list[Verdict]:
    values = [t.corrected for t in trials]
    measured, reached = _within(values, CORRECTED_UM)
    looks = percentile([float(t.looks) for t in trials], 0.5)
    beyond, any_ = len(enlarged(trials, SCATTER_UM)), len(enlarged(trials))
    name = "correction"
    return [
        Verdict(name, f"100 % within {CORRECTED_UM:.0f} um", measured, reached),
        _share(name, values, 0.95, CORRECTED_P95_UM),
        Verdict(
            name,
            f"median looks {MEDIAN_LOOKS:.0f}",
            f"{looks:.0f}" if trials else NOTHING,
            looks <= MEDIAN_LOOKS if trials else None,
        ),
        Verdict(
            name,
            f"0 that enlarge the error beyond {SCATTER_UM:.0f} um of scatter",
            f"{beyond} ({any_} by any amount)",
            beyond == 0 if trials else None,
        ),
        _on_their_nets(trials),
    ]


def _on_their_nets(trials: Sequence[Trial]) -> Verdict:
    """Where the simulated station told what was under the tip, no success may stand on metal of another net."""
    told = [t for t in trials if t.on is not None]
    wrong = sum(t.wrong for t in told)
    measured = f"{wrong} of {len(told)}" if told else NOTHING
    return Verdict("correction", "0 successes on metal of another net", measured, wrong == 0 if told else None)


def _rotation(setups: Sequence[Setup]) -> list[Verdict]:
    """Time counts on stations by the clock: where time runs fast, the programs' own work seems to take longer."""
    steps = [step for s in setups if s.by_clock and (step := s.step("rotation")) is not None and step.error is None]
    longest_s = max((step.simulated_s for step in steps), default=math.nan)
    measured = f"{longest_s:.0f} s" if steps else NOTHING
    return [Verdict("rotation", f"within {ROTATION_S:.0f} s", measured, longest_s <= ROTATION_S if steps else None)]
