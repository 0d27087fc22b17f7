"""Panel of all watches: rows of numbers in, findings out. Pure; it is rebuilt from what is kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from daemon.maintenance.catalogue import Spec
from daemon.maintenance.limit_check import Limit
from daemon.maintenance.proportion_test import Share, ShareSettings
from daemon.maintenance.types import Finding, Point
from daemon.maintenance.xmr_chart import Chart, ChartSettings

Watch = Chart | Share | Limit


@dataclass(frozen=True)
class Row:
    """What was measured at one moment: stream -> numbers.

    A chart's stream holds any number of values, a share's is [events, trials], a limit's [figure, warn, serious].
    bases: kind of calibration -> what is in force (its date, the probe's fingerprint); a change restarts watches.
    words: stream -> evidence in words.
    """

    at: str
    touches: int
    job: str = ""
    numbers: Mapping[str, list[float]] = field(default_factory=dict)
    bases: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the part that is kept as JSON."""
        body: dict[str, Any] = {"numbers": dict(self.numbers)}
        if self.bases:
            body["bases"] = dict(self.bases)
        if self.words:
            body["words"] = dict(self.words)
        return body

    @classmethod
    def from_dict(cls, at: str, touches: int, job: str, body: Mapping[str, Any]) -> Self:
        """Return what `to_dict` wrote."""
        return cls(at, touches, job, body["numbers"], body.get("bases", {}), body.get("words", {}))


class Panel:
    """The watches by name."""

    def __init__(self, specs: Mapping[str, Spec]) -> None:
        self.specs = dict(specs)
        self.watches: dict[str, Watch] = {name: _watch(spec) for name, spec in self.specs.items()}
        self._bases: dict[str, str] = {}

    def take(self, row: Row) -> None:
        """Feed one row."""
        if row.bases:
            self._rebase(row.bases)
        for name, values in row.numbers.items():
            watch = self.watches.get(name)
            match watch:
                case Chart():
                    for value in values:
                        watch.feed(Point(value, row.touches, row.at, row.job))
                case Share():
                    watch.feed(int(values[0]), int(values[1]), row.touches, row.at)
                case Limit():
                    words = (row.words[name],) if name in row.words else ()
                    watch.feed(Point(values[0], row.touches, row.at, row.job), values[1], values[2], words)
                case None:
                    pass

    def _rebase(self, bases: Mapping[str, str]) -> None:
        """Restart what was learned on a calibration that is no longer in force."""
        changed = {kind for kind, made in bases.items() if self._bases.get(kind, made) != made}
        changed |= set(self._bases) - set(bases)
        self._bases = dict(bases)
        for name, spec in self.specs.items():
            if changed & set(spec.bases):
                self.watches[name].restart()

    def restart(self, name: str) -> None:
        """Restart one watch: what it found was mended."""
        self.watches[name].restart()

    def findings(self) -> dict[str, Finding]:
        """Return what is wrong at present."""
        return {name: w.finding for name, w in self.watches.items() if w.finding is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return all that was learned, for JSON."""
        return {"bases": dict(self._bases), "watches": {name: watch.to_dict() for name, watch in self.watches.items()}}

    def restore(self, stored: Mapping[str, Any]) -> list[str]:
        """Take over what `to_dict` wrote; return the names of watches that restart because theirs is damaged.

        A watch whose windows were changed in the configuration keeps what it learned.
        """
        damaged = []
        bases, watches = (stored.get(key) if isinstance(stored, Mapping) else None for key in ("bases", "watches"))
        self._bases = dict(bases) if isinstance(bases, Mapping) else {}
        for name, spec in self.specs.items():
            kept = watches.get(name) if isinstance(watches, Mapping) else None
            if kept is None:
                continue
            try:
                self.watches[name] = _restored(spec, kept)
            except (KeyError, TypeError, ValueError, AttributeError):
                damaged.append(name)
        return damaged


def _watch(spec: Spec) -> Watch:
    match spec.settings:
        case ChartSettings():
            return Chart(spec.settings)
        case ShareSettings():
            return Share(spec.settings)
        case _:
            return Limit("beyond its limit")


def _restored(spec: Spec, kept: dict[str, Any]) -> Watch:
    match spec.settings:
        case ChartSettings():
            return Chart.from_dict(spec.settings, kept)
        case ShareSettings():
            return Share.from_dict(spec.settings, kept)
        case _:
            return Limit.from_dict("beyond its limit", kept)
