"""Proportion test: whether more of the touches need a correction, or more requests fail, than is usual here.

Events are counted in blocks of trials. At each full block the last few blocks (several lengths, so that a jump is found
soon and a creep at all) are compared with everything counted before them. If nothing changed, the events fall into
both in proportion to their trials: given their total, the count in the window is binomial, whatever the share is
(conditional test of two Poisson rates). So what the baseline does not know is in the probability.

Events hang together: a bad board needs many corrections, a spark garbles three answers. How much so is measured in the
baseline (variance over mean of its blocks, and of groups of them, by differences of neighbours) and all counts are
divided by it, as quasi-Poisson regression does; `clump` is the least that is assumed of events too rare to tell. For
events that do not hang together the test is exact.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, Self

from daemon.maintenance.types import Finding, Severity, WatchState

ALPHA: Final = 1e-6
"""Chance of a false alarm at one question. With 100 blocks and six windows all of them together stay below 600 of it
(Boole), and below that in truth, for the questions hang together."""
GROUP: Final = 4
"""Blocks to a group: what lasts longer than a block shows in groups."""
DOUBT: Final = 0.5
"""Sigmas of its own error by which the dispersion is taken larger than it was measured."""
CALM_P: Final = 0.02
"""An alert is over when a middle window is no more unusual than this."""


@dataclass(frozen=True, slots=True)
class ShareSettings:
    """How a share is watched.

    block: trials to a block; windows: lengths in blocks; least, most: trials of the baseline from which the test
    begins, and at which the baseline is complete. times: so many times the usual share at least, absolute: and at
    least this share, else nobody would act. ceiling: a share that is too much whatever was usual. clump: how many
    events come together at least.
    """

    block: int = 100
    windows: tuple[int, ...] = (5, 10, 20, 40, 80, 160)
    least: int = 4000
    most: int = 10_000
    times: float = 1.2
    absolute: float = 0.0
    ceiling: float = 1.0
    serious: float = 2.0
    clump: float = 1.0


@dataclass(frozen=True, slots=True)
class Block:
    """One block: events and trials, and where it ended."""

    events: int
    trials: int
    touches: int
    at: str


@dataclass
class Usual:
    """What is usual: events and trials, and how much they hang together.

    Scale 0 is blocks, 1 is groups of them; of each scale, how many there were, the last one (events, trials), and the
    sum of squared differences of neighbours: a step in the level hardly adds to it, which must not hide behind scatter.
    open: the group begun, and its blocks.
    """

    events: int = 0
    trials: int = 0
    counts: list[int] = field(default_factory=lambda: [0, 0])
    squares: list[float] = field(default_factory=lambda: [0.0, 0.0])
    last: list[list[int]] = field(default_factory=lambda: [[0, 0], [0, 0]])
    open: list[int] = field(default_factory=lambda: [0, 0, 0])

    def add(self, block: Block) -> None:
        """Take a block in."""
        self.events += block.events
        self.trials += block.trials
        self._count(0, block.events, block.trials)
        self.open = [self.open[0] + block.events, self.open[1] + block.trials, self.open[2] + 1]
        if self.open[2] == GROUP:
            self._count(1, self.open[0], self.open[1])
            self.open = [0, 0, 0]

    def _count(self, scale: int, events: int, trials: int) -> None:
        before_events, before_trials = self.last[scale]
        if before_trials:
            differ = events / trials - before_events / before_trials
            self.squares[scale] += differ**2 / (1.0 / trials + 1.0 / before_trials)
        self.last[scale] = [events, trials]
        self.counts[scale] += 1

    def dispersion(self, least: float) -> float:
        """Return variance over mean of the events, the larger of both scales, rather too large; `least` at least."""
        found = least
        for squares, count in zip(self.squares, self.counts, strict=True):
            if self.events and count > GROUP:
                measured = squares / (count - 1) * self.trials / self.events
                found = max(found, measured * (1.0 + DOUBT * math.sqrt(3.0 / (count - 1))))
        return found

    def copy(self) -> Self:
        """Return another of the same."""
        return replace(
            self, counts=list(self.counts), squares=list(self.squares), last=list(self.last), open=list(self.open)
        )


class Share:
    """One share. `feed` counts; `finding` is what is wrong at present."""

    def __init__(self, settings: ShareSettings) -> None:
        self.settings = settings
        self.restart()

    def restart(self) -> None:
        """Forget everything and learn again."""
        self.finding: Finding | None = None
        self._events = self._trials = 0
        self._usual = Usual()
        self._blocks: deque[Block] = deque()

    def feed(self, events: int, trials: int, touches: int, at: str) -> None:
        """Add events among trials. More events than trials are possible: they may be told before their trials."""
        self._events += events
        self._trials += trials
        if self._trials < self.settings.block:
            return
        self._blocks.append(Block(self._events, self._trials, touches, at))
        self._events = self._trials = 0
        if len(self._blocks) > max(self.settings.windows):
            self._retire(self._blocks.popleft())
        self._judge()

    @property
    def dispersion(self) -> float:
        """How much the usual events hang together, as variance over mean; 1 if not at all."""
        return self._usual.dispersion(1.0)

    def _retire(self, old: Block) -> None:
        """Let a block become part of what is usual, unless something is wrong."""
        if self.finding is None and self._usual.trials < self.settings.most:
            self._usual.add(old)

    @property
    def _middle(self) -> int:
        """A length between: soon enough to follow, long enough to trust."""
        return self.settings.windows[len(self.settings.windows) // 2]

    @property
    def standing(self) -> WatchState:
        """How it stands; the figure is of a middle window."""
        events, trials = self._window(self._middle)
        before = self._before(0)
        usual = before.events / before.trials if before.trials else None
        learned = min(1.0, before.trials / self.settings.least)
        high = self._speaks_from(self._middle)
        return WatchState(learned, events / trials if trials else None, usual, None, high)

    def _speaks_from(self, length: int) -> float:
        """Return the share of a window from which the test would speak."""
        _, trials = self._window(length)
        before = self._before(length)
        if not trials or before.trials < self.settings.least:
            return self.settings.ceiling
        at_least = max(self.settings.times * before.events / before.trials, self.settings.absolute)
        low, high = int(at_least * trials), trials
        while high - low > 1:
            events = (low + high) // 2
            low, high = (low, events) if self._chance(events, trials, before) < ALPHA else (events, high)
        return min(self.settings.ceiling, high / trials)

    def _window(self, length: int) -> tuple[int, int]:
        """Return events and trials of the last `length` blocks."""
        last = list(self._blocks)[-length:]
        return sum(b.events for b in last), sum(b.trials for b in last)

    def _before(self, length: int) -> Usual:
        """Return the baseline and, as far as it is open, of all blocks before the last `length`.

        While something is wrong the blocks are not asked: what is wrong must not become what is usual.
        """
        if self.finding is not None or self._usual.trials >= self.settings.most:
            return self._usual
        usual = self._usual.copy()
        for block in list(self._blocks)[: max(0, len(self._blocks) - length)]:
            if usual.trials >= self.settings.most:
                break
            usual.add(block)
        return usual

    def _chance(self, events: int, trials: int, usual: Usual) -> float:
        """Return the chance of so many events or more in so many trials, if they are as usual."""
        share = trials / (trials + usual.trials)
        return _tail(events, events + usual.events, share, usual.dispersion(self.settings.clump))

    def _judge(self) -> None:
        """Compare every window with what came before it."""
        found = self._beyond_ceiling() or self._beyond_usual()
        if found is not None:
            self.finding = found
        elif self.finding is not None and self._calm():
            self.finding = None
            while len(self._blocks) > self._middle:
                self._blocks.popleft()

    def _beyond_ceiling(self) -> Finding | None:
        if self.settings.ceiling >= 1.0:
            return None
        for length in self.settings.windows:
            events, trials = self._window(length)
            if events <= self.settings.ceiling * trials:
                continue
            clump = self._before(length).dispersion(self.settings.clump)
            if _tail(events, trials, self.settings.ceiling, clump) < ALPHA:
                return self._found("more than is ever good", length, None, self.settings.ceiling)
        return None

    def _beyond_usual(self) -> Finding | None:
        for length in self.settings.windows:
            if length > len(self._blocks):
                break
            events, trials = self._window(length)
            if events == 0 or events / trials < self.settings.absolute:
                continue
            before = self._before(length)
            if before.trials < self.settings.least:
                continue
            usual = before.events / before.trials
            if events / trials < self.settings.times * usual:
                continue
            if self._chance(events, trials, before) < ALPHA:
                while self.finding is None and len(self._blocks) > length:
                    self._retire(self._blocks.popleft())
                return self._found("more than usual", length, usual, self._speaks_from(length))
        return None

    def _calm(self) -> bool:
        """Tell whether the share is as usual again, not only less: an alert must not come and go by chance."""
        events, trials = self._window(self._middle)
        before = self._before(max(self.settings.windows))
        if not before.trials:
            return events / max(trials, 1) < self.settings.ceiling / 2
        halfway = (before.events / before.trials + self.finding.figure) / 2.0 if self.finding else 1.0
        return events / max(trials, 1) < halfway and self._chance(events, trials, before) > CALM_P

    def _found(self, rule: str, length: int, usual: float | None, limit: float) -> Finding:
        events, trials = self._window(length)
        blocks = list(self._blocks)[-length:]
        before = self.finding
        severity: Severity = "serious" if events / trials > self.settings.serious * limit else "warning"
        return Finding(
            rule=f"{rule}: {events} in {trials}",
            figure=events / trials,
            usual=usual,
            limit=limit,
            severity=severity,
            since_touches=before.since_touches if before else blocks[0].touches,
            since_at=before.since_at if before else blocks[0].at,
            evidence=tuple(f"{b.events} in {b.trials} until {b.touches} touches ({b.at})" for b in blocks[-10:]),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all it knows, for JSON."""
        return {
            "open": [self._events, self._trials],
            "usual": asdict(self._usual),
            "blocks": [[b.events, b.trials, b.touches, b.at] for b in self._blocks],
            "finding": self.finding.to_dict() if self.finding else None,
        }

    @classmethod
    def from_dict(cls, settings: ShareSettings, stored: dict[str, Any]) -> Self:
        """Return a share as it was kept; KeyError, TypeError or ValueError if it is damaged."""
        share = cls(settings)
        share._events, share._trials = (int(v) for v in stored["open"])
        share._usual = Usual(**stored["usual"])
        share._blocks.extend(Block(*b) for b in stored["blocks"])
        share.finding = Finding.from_dict(stored["finding"]) if stored["finding"] else None
        return share


def _tail(events: int, trials: int, p: float, clump: float) -> float:
    """Return the chance of `events` or more in binomial trials of chance p, where `clump` events come together."""
    from scipy.special import betainc  # noqa: PLC0415  # slow to load, see `vision.warm`

    if events <= 0:
        return 1.0
    return float(betainc(events / clump, max(0, trials - events) / clump + 1.0, p))
