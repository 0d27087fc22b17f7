"""XmR control chart: whether a number is still what it usually is on this station.

Each `batch` numbers become one point, their median: a few numbers that are quite wrong (a glint, the edge of something
else) do not count. From the first `baseline` numbers is learned what is usual; twice and four times as many refine it,
as long as nothing has moved meanwhile. Scatter comes from the average moving range of single numbers (a slow change
hardly widens it) or, where points scatter more than that explains, from the points themselves: numbers of one board or
one morning hang together, and only the few points say how much. Three runs rules are asked at every point:

    far     one point beyond 5 sigma: something broke
    off     two of three beyond 4 sigma on one side: something moved
    drift   nine in a row beyond 1 sigma on one side, their mean beyond 4 sigma of such a mean: something creeps

They are the Western Electric rules 1 and 2 and Nelson's 8 (one-sided), made stricter: as printed they cry wolf once in
90 points, which over some sixty charts is every day. A baseline knows mean and sigma only so well; the limits are
widened for that by Student's t and by the mean's own error. What all rules together cost in false alarms is measured
by `python -m tests.bench.maintenance`.

A change nobody would act on is none, however significant: beside a rule, a point must be off by `floor`.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, Self

from daemon.maintenance.types import Finding, Point, Severity, WatchState

Side = Literal["both", "high", "low"]
D2: Final = 1.128
"""Mean moving range of two over sigma, for normal numbers."""
D4: Final = 3.267
"""A moving range beyond so many times the mean one comes from an accident and is left out."""
MEDIAN_OVER_MEAN: Final = 1.2533
"""Scatter of a median over that of a mean of as many normal numbers; of few numbers it is less."""
DF_SHARE: Final = 0.62
"""Degrees of freedom that a mean moving range of n numbers is worth, over n - 1."""
FAR, OFF, DRIFT, CREEP = 5.0, 4.0, 1.0, 4.0
OFF_OF, OFF_HITS, DRIFT_RUN = 3, 2, 9
HANG_TOGETHER = 2.0
"""Sigmas of its own error by which the points' scatter must exceed that of single numbers to be taken instead."""
MOVED = 2.5
"""Sigmas by which both halves of the points may differ for the baseline to be refined."""
FULL = 4
"""A point of so many batches is full, whatever it covers: a tester may never report its touches."""
REFINED = (2, 4)
"""Baselines after which what was learned is refined."""
CALM_RUN, CALM_MEAN, CALM_EACH = 6, 0.7, 2.0
"""An alert is over when the mean of so many points, and each, are within so many sigmas."""
KEPT_POINTS = 40


@dataclass(frozen=True, slots=True)
class ChartSettings:
    """How one chart is laid out.

    floor: least change that matters, in the number's unit; floor_share: the same as a share of what is usual (the
    larger counts). serious: times the floor from which it is serious. spread: touches that a point covers at least, for
    numbers that one board has in common; their scatter is always taken from the points.
    """

    baseline: int = 60
    batch: int = 5
    side: Side = "both"
    floor: float = 0.0
    floor_share: float = 0.0
    serious: float = 3.0
    spread: int = 0

    def __post_init__(self) -> None:
        if self.baseline < 2 * self.batch or self.batch < 1:
            raise ValueError(f"a baseline of {self.baseline} is too short for batches of {self.batch}")


@dataclass(frozen=True, slots=True)
class ControlLimits:
    """What was learned. centre, sigma: of points. far, off, drift, creep: the rules' limits in sigmas.

    within: sigma of a point as the scatter of single numbers explains it; freedom: of that, 0 if it never tells all.
    """

    centre: float
    sigma: float
    far: float
    off: float
    drift: float
    creep: float
    within: float
    freedom: float


def learn(values: Sequence[float], points: Sequence[float], batch: int, *, together: bool = False) -> ControlLimits:
    """Return the limits for points, medians of `batch` numbers at least, from single numbers and their points.

    together: the numbers of a point are known to hang together, so that only points tell the scatter.
    """
    ranges = [abs(b - a) for a, b in itertools.pairwise(values)]
    while len(kept := [r for r in ranges if r <= D4 * sum(ranges) / len(ranges)]) < len(ranges):
        ranges = kept
    within = sum(ranges) / len(ranges) / D2 * MEDIAN_OVER_MEAN / math.sqrt(batch)
    return limits_of(points, within, 0.0 if together else max(2.0, DF_SHARE * (len(values) - 1)))


def limits_of(points: Sequence[float], within: float, freedom: float) -> ControlLimits:
    """Return the limits for points like these; `within` with its `freedom` is what single numbers explain."""
    m, between = len(points), _sd(points)
    together = not freedom or between > within * (1.0 + HANG_TOGETHER / math.sqrt(2.0 * (m - 1)))
    sigma, known = max(within, between), m - 1.0 if together else freedom
    one, run = math.sqrt(1.0 + 1.0 / m), math.sqrt(1.0 / DRIFT_RUN + 1.0 / m)
    far, off, drift = (one * _student(z, known) for z in (FAR, OFF, DRIFT))
    return ControlLimits(sum(points) / m, sigma, far, off, drift, run * _student(CREEP, known), within, freedom)


def _student(z: float, freedom: float) -> float:
    """Return Student's quantile of the same probability as the normal `z`."""
    from scipy.special import ndtr, stdtrit  # noqa: PLC0415  # slow to load, see `vision.warm`

    return -float(stdtrit(freedom, float(ndtr(-z))))


def _sd(values: Sequence[float]) -> float:
    if len(values) < 2:
        return 0.0
    mean = sum(values) / len(values)
    return math.sqrt(sum((v - mean) ** 2 for v in values) / (len(values) - 1))


def _plain(point: Point) -> list[Any]:
    return [point.value, point.touches, point.at, point.job]


class Chart:
    """One stream's chart. `feed` numbers; `finding` is what is wrong at present, None if nothing is."""

    def __init__(self, settings: ChartSettings) -> None:
        self.settings = settings
        self.restart()

    def restart(self) -> None:
        """Forget everything and learn again: after a calibration, or when something was mended."""
        self.finding: Finding | None = None
        self.limits: ControlLimits | None = None
        self._learning: list[float] = []
        self._learned: list[float] = []
        self._batch: list[Point] = []
        self._points: deque[Point] = deque(maxlen=KEPT_POINTS)

    def feed(self, point: Point) -> None:
        """Take one number."""
        if not math.isfinite(point.value):
            return
        if self.limits is None:
            self._learning.append(point.value)
        self._batch.append(point)
        if self._is_point():
            value = statistics.median(p.value for p in self._batch)
            last = self._batch[-1]
            self._batch = []
            if self.limits is None:
                self._learn(value)
                return
            self._points.append(Point(value, last.touches, last.at, last.job))
            self._judge(self.limits)
            self._refine(self.limits, value)

    def _is_point(self) -> bool:
        """Tell whether what was gathered is enough for a point."""
        n, batch = len(self._batch), self.settings.batch
        return n >= batch and (
            n >= FULL * batch or self._batch[-1].touches - self._batch[0].touches >= self.settings.spread
        )

    def _learn(self, value: float) -> None:
        """Take a point of the baseline; when they are enough, learn what is usual."""
        self._learned.append(value)
        if len(self._learned) >= self.settings.baseline // self.settings.batch:
            batch, together = self.settings.batch, self.settings.spread > 0
            self.limits = learn(self._learning, self._learned, batch, together=together)
            self._learning = []

    def _refine(self, limits: ControlLimits, value: float) -> None:
        """Learn from a point, too, while the baseline is young: unless something is wrong, or has moved."""
        first = self.settings.baseline // self.settings.batch
        if self.finding is not None or len(self._learned) >= first * REFINED[-1]:
            return
        self._learned.append(value)
        m = len(self._learned)
        if m not in {first * times for times in REFINED}:
            return
        newer, older = self._learned[m // 2 :], self._learned[: m // 2]
        moved = abs(sum(newer) / len(newer) - sum(older) / len(older))
        if moved <= MOVED * limits.sigma * math.sqrt(1.0 / len(newer) + 1.0 / len(older)):
            self.limits = limits_of(self._learned, limits.within, limits.freedom)

    @property
    def floor(self) -> float:
        """Least change that matters here."""
        usual = abs(self.limits.centre) if self.limits else 0.0
        return max(self.settings.floor, self.settings.floor_share * usual)

    @property
    def standing(self) -> WatchState:
        """How it stands."""
        limits = self.limits
        if limits is None:
            batch = self.settings.batch
            needed, open_ = self.settings.baseline // batch * batch, min(len(self._batch), batch - 1)
            return WatchState(min(1.0, (len(self._learned) * batch + open_) / needed), None, None, None, None)
        allowed = max(limits.off * limits.sigma, self.floor)
        figure = self._points[-1].value if self._points else None
        low = None if self.settings.side == "high" else limits.centre - allowed
        high = None if self.settings.side == "low" else limits.centre + allowed
        return WatchState(1.0, figure, limits.centre, low, high)

    # --- rules ------------------------------------------------------------------------------------------------

    def _judge(self, limits: ControlLimits) -> None:
        """Ask the rules at the newest point."""
        off = [p.value - limits.centre for p in self._points]
        found = self._broken(off, limits)
        if found is not None:
            self.finding = self._found(off, limits, *found)
        elif self.finding is not None and self._is_calm(off[-CALM_RUN:], limits.sigma):
            self.finding = None

    def _is_calm(self, off: list[float], sigma: float) -> bool:
        """Tell whether the last points are as usual, not only less wrong: an alert must not come and go by chance."""
        mean_within, each_within = max(CALM_MEAN * sigma, self.floor / 2), max(CALM_EACH * sigma, self.floor)
        near = all(abs(d) <= each_within for d in off)
        return len(off) == CALM_RUN and near and abs(sum(off)) / CALM_RUN <= mean_within

    def _broken(self, off: list[float], limits: ControlLimits) -> tuple[str, int, float] | None:
        """Return the rule that is broken, on which side (+1, -1) and its limit; None if none is."""
        for side in (1, -1):
            if self.settings.side == ("low" if side > 0 else "high"):
                continue
            away = [side * d for d in off]
            if away[-1] < self.floor:
                continue
            far, near = limits.far * limits.sigma, limits.off * limits.sigma
            drift, creep = limits.drift * limits.sigma, limits.creep * limits.sigma
            if away[-1] > far:
                return "one point far off", side, far
            if sum(d > near for d in away[-OFF_OF:]) >= OFF_HITS and away[-1] > near:
                return f"{OFF_HITS} of {OFF_OF} points off", side, near
            run = away[-DRIFT_RUN:]
            if len(run) == DRIFT_RUN and min(run) > drift and sum(run) / DRIFT_RUN >= max(creep, self.floor):
                return f"{DRIFT_RUN} points in a row on one side", side, max(drift, creep)
        return None

    def _found(self, off: list[float], limits: ControlLimits, rule: str, side: int, beyond: float) -> Finding:
        """Put a finding together; it goes on from where the one before began."""
        began = len(off)
        while began > 0 and side * off[began - 1] > 0.5 * limits.sigma:
            began -= 1
        first = self._points[min(began, len(off) - 1)]
        before = self.finding
        severity: Severity = "serious" if abs(off[-1]) >= self.settings.serious * self.floor > 0 else "warning"
        tail = list(self._points)[-DRIFT_RUN:]
        return Finding(
            rule=rule,
            figure=self._points[-1].value,
            usual=limits.centre,
            limit=limits.centre + side * max(beyond, self.floor),
            severity=severity,
            since_touches=before.since_touches if before else first.touches,
            since_at=before.since_at if before else first.at,
            evidence=tuple(f"{p.value:.4g} after {p.touches} touches ({p.job or p.at})" for p in tail),
        )

    # --- keeping ----------------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Return all it knows, for JSON."""
        return {
            "learning": list(self._learning),
            "learned": list(self._learned),
            "limits": asdict(self.limits) if self.limits else None,
            "batch": [_plain(p) for p in self._batch],
            "points": [_plain(p) for p in self._points],
            "finding": self.finding.to_dict() if self.finding else None,
        }

    @classmethod
    def from_dict(cls, settings: ChartSettings, stored: dict[str, Any]) -> Self:
        """Return a chart as it was kept; KeyError, TypeError or ValueError if it is damaged."""
        chart = cls(settings)
        chart._learning = [float(v) for v in stored["learning"]]
        chart._learned = [float(v) for v in stored["learned"]]
        chart.limits = ControlLimits(**stored["limits"]) if stored["limits"] else None
        chart._batch = [Point(*p) for p in stored["batch"]]
        chart._points.extend(Point(*p) for p in stored["points"])
        chart.finding = Finding.from_dict(stored["finding"]) if stored["finding"] else None
        return chart
