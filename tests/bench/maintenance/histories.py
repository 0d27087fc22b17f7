"""Run histories through the panel: which alerts a healthy station raises, and how soon a degradation is found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from daemon.maintenance.catalogue import chosen
from daemon.maintenance.panel import Panel
from tests.bench.maintenance.model import StationModel
from tests.bench.maintenance.wrong import PLANTED, Planted, Wrong

BASELINE, BATCH = 60, 5
ONSET = 6000
"""Touches of a healthy station before something begins to go wrong."""
AFTER = 4000
SERVICE = 3300
"""Touches after which a healthy station gets another probe; twice that, other calibrations."""


def new_panel() -> Panel:
    """Return the watches of a station with one line, as configured by default."""
    return Panel(chosen(["main"], off=(), baseline=BASELINE, batch=BATCH))


def healthy(seed: int, touches: int) -> dict[str, int]:
    """Return name -> touches at which it was found, of everything a healthy station raises: none, if all is well."""
    station, panel = StationModel(seed, SERVICE), new_panel()
    found: dict[str, int] = {}
    while station.touches < touches:
        for row in station.rows(Wrong()):
            panel.take(row)
        for name in panel.findings():
            found.setdefault(name, station.touches)
    return found


@dataclass(frozen=True)
class Found:
    """How one planted degradation was found: touches since it began, by which alert; None if it was not."""

    delay: int | None
    by: str
    wrong: dict[str, int]
    """Alerts that were raised before, or that point elsewhere: name -> touches since it began."""
    again: int = 0
    """How often the alert went and came again in the `AFTER` touches after it was found, though nothing was mended."""


def planted(degradation: Planted, seed: int, within: int) -> Found:
    """Let one thing go wrong after `ONSET` touches and wait for the right alert."""
    station, panel = StationModel(seed), new_panel()
    elsewhere: dict[str, int] = {}
    while (since := station.touches - ONSET) < within:
        for row in station.rows(degradation.course(since) if since >= 0 else Wrong()):
            panel.take(row)
        now = station.touches - ONSET
        for name in panel.findings():
            if now > 0 and name in degradation.right:
                return Found(now, name, elsewhere, _again(station, panel, degradation, name))
            elsewhere.setdefault(name, now)
    return Found(None, "", elsewhere)


def _again(station: StationModel, panel: Panel, degradation: Planted, name: str) -> int:
    """Go on with what is wrong; return how often its alert is raised again."""
    raised, stands, until = 0, True, station.touches + AFTER
    while station.touches < until:
        for row in station.rows(degradation.course(station.touches - ONSET)):
            panel.take(row)
        now = name in panel.findings()
        raised, stands = raised + (now and not stands), now
    return raised


def mended(degradation: Planted, seed: int, touches: int) -> tuple[set[str], dict[str, int]]:
    """Let one thing go wrong, then change the probe and calibrate everything, and go on.

    Returns what stood before, and what was found after: name -> touches since then.
    """
    station, panel = StationModel(seed, ONSET + 2000), new_panel()
    stood: set[str] = set()
    after: dict[str, int] = {}
    while (since := station.touches - ONSET - 2000) < touches:
        wrong = degradation.course(since + 2000) if -2000 <= since < 0 else Wrong()
        for row in station.rows(wrong):
            panel.take(row)
        if station.touches <= ONSET + 2000:
            stood = set(panel.findings())
        elif station.touches > ONSET + 2000 + 20:  # with the first row after it
            for name in panel.findings():
                after.setdefault(name, station.touches - ONSET - 2000)
    return stood, after


def delays(name: str, seeds: range, within: int) -> list[Found]:
    """Return how a degradation was found with each seed."""
    return list(map(partial(_one, name, within), seeds))


def _one(name: str, within: int, seed: int) -> Found:
    return planted(PLANTED[name], seed, within)
