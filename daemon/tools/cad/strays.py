"""Pins that a netlist puts beside the middle of a pad: of another state of the board, so their nets are not the pad's.

A record lies where its pad is flashed, or in its hole. One that lies elsewhere on a flashed pad is of a part that has
been moved since: the metal there belongs to another pin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from daemon.tools.cad.geometry import inside
from daemon.tools.cad.model import Pin, Shape, Side
from daemon.tools.cad.netlist_fit import Metal
from daemon.tools.cad.places import SAME_PLACE_MM, tree_of

_FEW, _SHARE = 2, 0.03
"""More strays than this (of all pins) come from another state of the board."""


def without_strays(
    pins: Sequence[Pin], metal: Metal, copper: Mapping[Side, Sequence[Shape]], source: str
) -> tuple[list[Pin], list[str]]:
    """Return the pins that may be where they are said to be, and what to tell; raise ValueError where many are not."""
    strays = [k for side, shapes in copper.items() for k in _on_others_pads(_unmet(pins, metal, side), pins, shapes)]
    if not strays:
        return list(pins), []
    gone = set(strays)
    first = next(pins[k] for k in sorted(gone))
    told = (
        f"{source} puts {len(gone)} of {len(pins)} pins beside the middle of a pad ({first.part or 'VIA'}.{first.pin})"
    )
    if len(gone) > max(_FEW, _SHARE * len(pins)):
        raise ValueError(f"{told}: export netlist and Gerbers from the same state of the board")
    return [p for k, p in enumerate(pins) if k not in gone], [f"{told}: left out; compare the two"]


def _unmet(pins: Sequence[Pin], metal: Metal, side: Side) -> list[int]:
    """Return the pins that can be reached from a side and lie neither at a pad's place there nor in a hole's middle."""
    chosen = [k for k, p in enumerate(pins) if side in p.access]
    tree = tree_of(np.concatenate((metal.holes, metal.pads[side])))
    if tree is None or not chosen:
        return []
    places = np.array([(pins[k].x_mm, pins[k].y_mm) for k in chosen])
    away = np.asarray(tree.query(places)[0])
    return [k for k, d in zip(chosen, away, strict=True) if d > SAME_PLACE_MM]


def _on_others_pads(unmet: Sequence[int], pins: Sequence[Pin], shapes: Sequence[Shape]) -> list[int]:
    """Return those of the pins that lie on a flashed pad."""
    flashed = [s for s in shapes if s.place_mm is not None and s.dark]
    if not unmet or not flashed:
        return []
    lows = np.array([s.points_mm.min(axis=0) for s in flashed])
    highs = np.array([s.points_mm.max(axis=0) for s in flashed])
    return [k for k in unmet if _lies_on(np.array((pins[k].x_mm, pins[k].y_mm)), flashed, lows, highs)]


def _lies_on(
    place: NDArray[np.float64], flashed: Sequence[Shape], lows: NDArray[np.float64], highs: NDArray[np.float64]
) -> bool:
    near = np.flatnonzero(((place >= lows) & (place <= highs)).all(axis=1))
    return any(bool(inside(place[None], flashed[int(i)].points_mm)[0]) for i in near)
