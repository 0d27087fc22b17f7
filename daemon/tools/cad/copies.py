"""Boards of a panel: where each has its origin, and pins carried from one to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from daemon.tools.cad.apertures import turned
from daemon.tools.cad.geometry import inside, shifted
from daemon.tools.cad.model import Copy, Pin, Shape
from daemon.tools.cad.netlist_fit import Fit
from daemon.tools.cad.outline import MOST_PADS, Box, box_of
from daemon.tools.cad.places import Places

NO_EDGES = (
    "the outline does not draw the edges of the panel's boards: the origin of each is the lower left corner of its pads"
)


@dataclass(frozen=True)
class Panel:
    """The copies of a panel, none for a single board. told_for: the copy that the file names; named: that is probed."""

    copies: tuple[Copy, ...] = ()
    told_for: int = 0
    named: int = 0
    note: str | None = None


def panel_of(fit: Fit, pins: Sequence[Pin], outline: Sequence[Shape]) -> Panel:
    """Give each copy the origin of a board file: the lower left corner of its own edge; pins: on the named copy."""
    if not fit.copies:
        return Panel()
    here = fit.copies[fit.named_copy]
    places = np.array([(p.x_mm, p.y_mm) for p in pins])
    low, high = places.min(axis=0), places.max(axis=0)
    box: Box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    edge = _own_edge(fit, places, outline)
    copies = [_by_corner(copy, here, edge or box) for copy in fit.copies]
    return Panel(tuple(copies), fit.named_copy, fit.named_copy, None if edge else NO_EDGES)


def _own_edge(fit: Fit, places: Places, outline: Sequence[Shape]) -> Box | None:
    """Return the box of the edge that holds the named copy and no other."""
    here = fit.copies[fit.named_copy]
    others = [carried(places, here, c) for c in fit.copies if c is not here]
    for edge in (s.points_mm for s in outline if s.dark):
        if inside(places, edge).mean() >= MOST_PADS and not any(inside(o, edge).mean() > 0.0 for o in others):
            return box_of([edge])
    return None


def _by_corner(copy: Copy, here: Copy, box: Box) -> Copy:
    x, y = carried(np.array([box[:2]]), here, copy)[0]
    return Copy(copy.name, round(float(x), 4), round(float(y), 4), copy.turn_deg, round(box[2] - box[0], 4))


def on_copy(panel: Panel, pins: list[Pin], wanted: int, path: Path) -> tuple[Panel, list[Pin]]:
    """Carry the pins to another copy of the panel (numbered from 1); raise ValueError if there is none."""
    count = len(panel.copies)
    if not 1 <= wanted <= max(1, count):
        raise ValueError(
            f"{path} {f'is a panel of {count} copies' if count else 'is one board, no panel'}; no {wanted}"
        )
    if not count or wanted - 1 == panel.named:
        return panel, pins
    here, there = panel.copies[panel.named], panel.copies[wanted - 1]
    places = carried(np.array([(p.x_mm, p.y_mm) for p in pins]), here, there)
    moved = [replace(p, x_mm=float(x), y_mm=float(y)) for p, (x, y) in zip(pins, places, strict=True)]
    return replace(panel, named=wanted - 1), moved


def with_nets_of(pins: Sequence[Pin], every: Sequence[Pin]) -> list[Pin]:
    """Return pins with the nets that a file of all boards of a panel gives them where they lie."""
    nets: dict[tuple[str, str], list[Pin]] = {}
    for pin in every:
        nets.setdefault((pin.part, pin.pin), []).append(pin)
    result = []
    for pin in pins:
        here = min(nets[pin.part, pin.pin], key=lambda p: max(abs(p.x_mm - pin.x_mm), abs(p.y_mm - pin.y_mm)))
        result.append(replace(pin, net=here.net))
    return result


def carried(places_mm: Places, here: Copy, there: Copy) -> Places:
    """Return places (N, 2) of one copy as they lie on another."""
    relative = turned(places_mm - (here.x_mm, here.y_mm), there.turn_deg - here.turn_deg)
    result: Places = shifted(relative, there.x_mm, there.y_mm)
    return result
