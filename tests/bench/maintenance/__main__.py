"""Measure maintenance: false alarms of healthy stations, delays until degradations are found.

    python -m tests.bench.maintenance [--seeds 200] [--planted 10] [--touches 10000] [--charts 2000]

Prints three tables and judges nothing; with the defaults it takes about a quarter of an hour on one core. The first is
what each kind of watch costs in false alarms by itself, without the floors that keep small changes silent, on numbers
that are as the charts assume them and on numbers that are not; the second runs whole stations, each of which gets
another probe and other calibrations on its way; the third plants one degradation in each of some stations.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
from collections import Counter
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from daemon.maintenance.proportion_test import Share, ShareSettings
from daemon.maintenance.types import Point
from daemon.maintenance.xmr_chart import Chart, ChartSettings
from tests.bench.maintenance.histories import BASELINE, BATCH, ONSET, delays, healthy
from tests.bench.maintenance.wrong import PLANTED

CONFIDENCE = 0.95
FIRST_PLANTED = 1000
WITHIN = 20_000
TOUCHES_A_NUMBER = 20
Draw = Callable[[int, np.random.Generator], NDArray[np.float64]]


def normal(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw independent normal numbers (n,): what an XmR chart assumes."""
    return rng.standard_normal(n)


def tailed(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw numbers (n,) of which many are far out: Student's t of 3 degrees of freedom."""
    return rng.standard_t(3.0, n)


def wandering(share: float) -> Draw:
    """Return a draw of numbers each of which keeps a share of the one before: AR(1)."""

    def draw(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        noise = rng.standard_normal(n)
        return np.array(list(itertools.accumulate(noise, lambda before, new: share * before + new)))

    return draw


def on_boards(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw numbers (n,) six of which share what their board adds, as large as their own scatter."""
    return np.repeat(rng.standard_normal(-(-n // 6)), 6)[:n] + rng.standard_normal(n)


def chart_alarm(settings: ChartSettings, values: NDArray[np.float64]) -> str | None:
    """Run one chart over numbers; return the rule by which it cried wolf, None if it did not."""
    chart = Chart(settings)
    for k, value in enumerate(values):
        chart.feed(Point(float(value), k * TOUCHES_A_NUMBER, ""))
        if chart.finding is not None:
            return chart.finding.rule
    return None


def share_alarm(settings: ShareSettings, shares: NDArray[np.float64], rng: np.random.Generator) -> str | None:
    """Run one share over blocks of these shares; return the rule by which it cried wolf, None if it did not."""
    watch = Share(settings)
    for events in rng.binomial(settings.block, shares):
        watch.feed(int(events), settings.block, 0, "")
        if watch.finding is not None:
            return watch.finding.rule.split(":")[0]
    return None


def most(hits: int, of: int) -> float:
    """Return the share that `hits` in `of` do not exclude (Clopper-Pearson, one-sided)."""
    return 1.0 if hits == of else float(beta.ppf(CONFIDENCE, hits + 1, of - hits))


def rates(charts: int) -> None:
    """Print the false alarms of each kind of watch in 10,000 touches."""
    rng = np.random.default_rng(20261)
    plain, board = ChartSettings(BASELINE, BATCH), ChartSettings(BASELINE, BATCH, spread=100)
    of_corrections: list[tuple[str, ChartSettings, Draw]] = [
        ("chart, normal numbers", plain, normal),
        ("chart, Student's t of 3", plain, tailed),
        ("chart, AR(1) of 0.3", plain, wandering(0.3)),
        ("chart, AR(1) of 0.7", plain, wandering(0.7)),
        ("chart of placement, normal numbers", board, normal),
        ("chart of placement, boards", board, on_boards),
    ]
    kinds: list[tuple[str, Callable[[], str | None]]] = [
        (name, partial(lambda settings, draw: chart_alarm(settings, draw(500, rng)), settings, draw))
        for name, settings, draw in of_corrections
    ]
    steady, shares = np.full(100, 0.05), ShareSettings(times=1.0, clump=4.0)
    kinds += [
        ("share, steady 5 %", lambda: share_alarm(shares, steady, rng)),
        ("share, 5 % in boards", lambda: share_alarm(shares, np.minimum(rng.gamma(2.0, 0.025, 100), 1.0), rng)),
    ]
    print(f"false alarms in 10,000 touches, without floors, {charts} of each")
    for name, run in kinds:
        rules = Counter(rule for rule in (run() for _ in range(charts)) if rule is not None)
        hits = sum(rules.values())
        said = ", ".join(f"{n} x {rule}" for rule, n in rules.items())
        print(f"  {name:36} {hits:4} of {charts}, below {100 * most(hits, charts):.2f} % (95 %)  {said}", flush=True)


def stations(seeds: int, touches: int) -> None:
    """Print the false alarms of whole stations."""
    found = [healthy(seed, touches) for seed in range(seeds)]
    bad = sum(bool(alerts) for alerts in found)
    print(f"\nhealthy stations: {bad} of {seeds} raised an alert in {touches} touches, below "
          f"{100 * most(bad, seeds):.1f} % (95 %)")  # fmt: skip
    for name, n in Counter(name for alerts in found for name in alerts).items():
        print(f"  {name}: {n}")


def degradations(of: int) -> None:
    """Print how soon each degradation is found."""
    print(f"\ntouches until a degradation is found, that begins after {ONSET} good ones; {of} stations each")
    print(f"  {'':12} {'found':>8} {'least':>6} {'median':>6} {'most':>6}  what, and by which alerts")
    for name, degradation in PLANTED.items():
        results = delays(name, range(FIRST_PLANTED, FIRST_PLANTED + of), WITHIN)
        waits = sorted(r.delay for r in results if r.delay is not None)
        by = ", ".join(f"{alert} {n}" for alert, n in Counter(r.by for r in results if r.by).most_common())
        row = f"{waits[0]:6} {statistics.median(waits):6.0f} {waits[-1]:6}" if waits else " " * 20
        print(f"  {name:12} {len(waits):3} of {len(results):2} {row}  {degradation.what}: {by}", flush=True)
        if again := sum(r.again for r in results):
            print(f"  {'':12} went and came again {again} times")
        if elsewhere := Counter(alert for r in results for alert in r.wrong):
            print(f"  {'':12} also raised: {', '.join(f'{alert} {n}' for alert, n in elsewhere.items())}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--planted", type=int, default=10)
    parser.add_argument("--touches", type=int, default=10_000)
    parser.add_argument("--charts", type=int, default=2000)
    given = parser.parse_args()
    rates(given.charts)
    stations(given.seeds, given.touches)
    degradations(given.planted)


if __name__ == "__main__":
    main()
