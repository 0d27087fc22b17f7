"""Judgement of the fault campaign, by records alone; the definitions are in the folder's README."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from tests.bench.faults.records import Glance, Job, Truth, Violation

SIDEWAYS_UM, SIDEWAYS_DEG = 20.0, 0.1
"""An axis that stands stays within far less."""
ONE_PRESS_S = 0.2
"""Within so much of the station's time a pin cannot be raised, carried aside and pressed again."""
LIT, LIT_AFTER_S = 0.05, 1.0
ARRIVED_UM, LOW_UM = 120.0, 7000.0
"""A stop so near to a place, and so low, is an arrival there: places are 400 um apart, travel is at 12,000 um."""
GENTLE_UM = 500.0
"""A job that is done a second time comes down by several mm at a stroke."""
DARK_FAULTS = ("not_homed", "needle_down")
"""Faults of a start: nothing speaks against switching the lamps off."""


def lost(jobs: Sequence[Job], journal: Mapping[str, Any] | None = None) -> list[Violation]:
    """Find accepted ids that no one gave a result for, or whose row in the journal has none."""
    found = []
    for job in jobs:
        if job.accepted and not job.results:
            found.append(Violation("lost", job.item, f"{job.id} ({job.op}) was accepted and has no result"))
        elif job.accepted and journal is not None and journal.get(job.id) is None:
            found.append(Violation("lost", job.item, f"{job.id} ({job.op}) has no result in the journal"))
    return found


def contradictory(jobs: Sequence[Job]) -> list[Violation]:
    """Find ids of which two results were given that are not the same in every field."""
    found = []
    for job in jobs:
        for source, result in job.results[1:]:
            first_source, first = job.results[0]
            differs = [name for name in first if first[name] != result[name]]
            if differs:
                said = {name: (first[name], result[name]) for name in differs}
                what = f"{job.id} ({job.op}): {first_source} and {source} differ in {said}"
                found.append(Violation("contradictory", job.item, what))
                break
    return found


def arrivals(place: tuple[float, float], stops: Sequence[Truth]) -> int:
    """Count how often the needle came down at a place, robot frame: stops there one after the other are one.

    One that is let down there by small steps, for no look had shown it low down, was sent there no second time.
    """
    count, there, above_um = 0, False, math.inf
    for stop in stops:
        is_beside = math.dist((stop.x_um, stop.y_um), place) <= ARRIVED_UM
        is_there = is_beside and stop.z_um < LOW_UM
        let_down = 0.0 <= above_um - stop.z_um <= GENTLE_UM
        count += is_there and not there and not let_down
        there, above_um = is_there, stop.z_um if is_beside else math.inf
    return count


def moved(jobs: Sequence[Job], stops: Sequence[Truth], offset_um: tuple[float, float]) -> list[Violation]:
    """Find ids that went to their place twice, and undisturbed ones that say they went and did not."""
    found = []
    for job in jobs:
        if job.place_um is None:
            continue
        place = (job.place_um[0] + offset_um[0], job.place_um[1] + offset_um[1])
        times = arrivals(place, stops)
        if times > 1:
            found.append(Violation("doubled", job.item, f"{job.id} came down {times} times at {place} um"))
        if job.undisturbed and not times and any(result["ok"] for _, result in job.results):
            found.append(Violation("contradictory", job.item, f"{job.id} was placed, and never came to {place} um"))
    return found


def stirred(before: Truth, after: Truth) -> bool:
    """Tell whether anything moved between two moments, or still does."""
    return before.moving or after.moving or _aside(before, after) or abs(before.z_um - after.z_um) > SIDEWAYS_UM


def sideways(truths: Sequence[Truth], item: str) -> list[Violation]:
    """Find pairs of moments close together, both pressed, between which the pin was carried aside."""
    close = (pair for pair in pairwise(truths) if pair[1].t_s - pair[0].t_s <= ONE_PRESS_S)
    return _carried(close, lambda _t_s: item)


def sideways_stops(stops: Sequence[Truth], item_at: Callable[[float], str]) -> list[Violation]:
    """Find stops one after the other, both pressed, at different places; `item_at` tells what ran at a time."""
    return _carried(pairwise(stops), item_at)


def _carried(pairs: Iterable[tuple[Truth, Truth]], item_at: Callable[[float], str]) -> list[Violation]:
    return [
        Violation(
            "sideways while pressed", item_at(b.t_s), f"pressed {a.pressed_um:.0f} um from {_where(a)} to {_where(b)}"
        )
        for a, b in pairs
        if a.pressed_um > 0 and b.pressed_um > 0 and not b.slipped and _aside(a, b)
    ]


def pressed_at_rest(glances: Sequence[Glance], item: str) -> list[Violation]:
    """Find a pin that is pressed while no job runs, and the daemon does not say that the needle is not up."""
    found = []
    for glance in glances:
        pressed = min(glance.before.pressed_um, glance.after.pressed_um)
        resting = at_rest(glance.status) and not stirred(glance.before, glance.after)
        if resting and pressed > 0 and not _needle_down(glance.status):
            said = f"{glance.status['state']}, {_fault(glance.status)}, needle {glance.status['needle']['place']}"
            what = f"pressed {pressed:.0f} um at {_where(glance.after)}; status: {said}"
            found.append(Violation("pressed at rest", item, what))
    return found[:1]


def lights_at_rest(glances: Sequence[Glance], item: str) -> list[Violation]:
    """Find a lamp that is on when the station has been idle for a second."""
    since_s: float | None = None
    for glance in glances:
        if not _should_be_dark(glance):
            since_s = None
            continue
        since_s = glance.at_s if since_s is None else since_s
        light = min(glance.before.light, glance.after.light)
        if light > LIT and glance.at_s - since_s >= LIT_AFTER_S:
            rested_s = glance.at_s - since_s
            what = f"a lamp at {light:.2f} after {rested_s:.1f} s of {glance.status['state']}, held: {glance.held}"
            return [Violation("lights on at rest", item, what)]
    return []


def incoherent(glances: Sequence[Glance], item: str) -> list[Violation]:
    """Find a status that contradicts itself: in fault without one, or a fault beside another state."""
    for glance in glances:
        status = glance.status
        ready = status["lifecycle"] == "ready"
        if ready and (status["state"] == "fault") != bool(status["fault"]):
            return [Violation("contradictory", item, f"state {status['state']} with fault {_fault(status)}")]
    return []


def at_rest(status: Mapping[str, Any]) -> bool:
    """Tell whether the daemon is up, and says that nothing runs or waits."""
    quiet = status["running"] is None and not status["queued"]
    return bool(quiet and status["lifecycle"] == "ready" and status["state"] in ("idle", "fault"))


def _should_be_dark(glance: Glance) -> bool:
    state, name = glance.status["state"], _fault(glance.status)
    return at_rest(glance.status) and (state == "idle" or (name in DARK_FAULTS and not glance.held))


def _needle_down(status: Mapping[str, Any]) -> bool:
    told = _fault(status) == "needle_down" or status["needle"]["place"] != "up"
    return bool(status["state"] == "fault" and told)


def _fault(status: Mapping[str, Any]) -> str:
    return str((status["fault"] or {}).get("name", "none"))


def _aside(a: Truth, b: Truth) -> bool:
    return math.dist((a.x_um, a.y_um), (b.x_um, b.y_um)) > SIDEWAYS_UM or abs(a.theta_deg - b.theta_deg) > SIDEWAYS_DEG


def _where(truth: Truth) -> str:
    return f"({truth.x_um:.0f}, {truth.y_um:.0f}, {truth.z_um:.0f}) um at {truth.t_s:.3f} s"
