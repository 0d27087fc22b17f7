"""Whether drills belong to a board: holes on its pads, or clear of its copper, and inside its edge.

The holes of another board lie outside of the edge, cut through tracks, or are plated where there is no copper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from daemon.tools.cad.geometry import Points, inside
from daemon.tools.cad.model import Drill, Shape, Side
from daemon.tools.cad.places import LARGEST_PAD_MM, SAME_PLACE_MM, Places, tree_of

_FEW = 3
"""Fewer holes than this in the wrong place may be anything."""
_NOTED, _REFUSED = 0.1, 0.3
"""Share of the holes that tell something by which a file is told, and refused."""
_RING_MM, _RING_POINTS, _RING_SHARE = 0.03, 16, 0.85
"""A hole has a pad, of whatever shape, if copper lies all round it, this far beyond its rim."""


def check_drills(
    files: Sequence[tuple[str, list[Drill]]], copper: Mapping[Side, Sequence[Shape]], pads: Places,
    outline: Sequence[Shape],
) -> list[str]:  # fmt: skip
    """Return what to tell of each file's holes; raise ValueError for a file of another board."""
    notes = []
    for name, drills in files:
        right, outside, wrong = _sorted_out(_each_once([d for d in drills if d.sides]), copper, pads, outline)
        bad = outside + wrong
        if not bad or bad <= _NOTED * (right + bad):
            continue
        found = [f"{outside} of {len(drills)} lie outside of its edge"] if outside else []
        found += (
            [f"{wrong} of {len(drills)} lie in copper that is no pad, or are plated without a pad"] if wrong else []
        )
        told = f"the holes of {name} do not fit the board: {', '.join(found)}"
        harmless = wrong < _FEW and all(d.plated is False for d in drills)  # tooling holes in a frame
        if bad >= _FEW and bad > _REFUSED * (right + bad) and not harmless:
            raise ValueError(
                f"{told}; it is the drill file of another board, or of another state of this one: "
                f"export it anew, or leave it out: --layer ignored={name}"
            )
        notes.append(f"{told}; compare them")
    return notes


def _each_once(drills: Sequence[Drill]) -> list[Drill]:
    """Return the holes, and of a way that is cut in pieces, such as an arc's chords, the first."""
    before = [None, *drills]
    return [
        d
        for b, d in zip(before, drills, strict=False)
        if b is None or (b.end_x_mm, b.end_y_mm, b.diameter_mm) != (d.x_mm, d.y_mm, d.diameter_mm)
    ]


def _sorted_out(
    drills: Sequence[Drill], copper: Mapping[Side, Sequence[Shape]], pads: Places, outline: Sequence[Shape]
) -> tuple[int, int, int]:
    """Return how many holes have a pad, lie outside of the edge, and lie wrong.

    What is not plated and clear of copper tells nothing, and nothing does a hole in the middle of a plane.
    """
    tree = tree_of(pads)
    if tree is None or not drills:
        return 0, 0, 0
    middles = np.array([_middle(d) for d in drills])
    met = np.asarray(tree.query(middles)[0]) <= SAME_PLACE_MM
    beyond = ~met & ~_within(middles, [s.points_mm for s in outline if s.dark])
    doubtful = ~met & ~beyond
    own, wrong = _by_copper([d for d, doubt in zip(drills, doubtful, strict=True) if doubt], middles[doubtful], copper)
    return int(met.sum()) + own, int(beyond.sum()), wrong


def _by_copper(drills: Sequence[Drill], middles: Places, copper: Mapping[Side, Sequence[Shape]]) -> tuple[int, int]:
    """Return how many holes have a pad of some shape round them, and how many lie wrong."""
    if not drills:
        return 0, 0
    rings = np.concatenate(
        [_ring(float(x), float(y), d.diameter_mm) for d, (x, y) in zip(drills, middles, strict=True)]
    )
    alone, all_round = np.zeros(len(drills)), np.zeros(len(drills))
    for shapes in copper.values():
        small = [s for s in shapes if np.ptp(s.points_mm, axis=0).max() < LARGEST_PAD_MM]
        alone = np.maximum(alone, _share_in(rings, small))
        all_round = np.maximum(all_round, _share_in(rings, shapes))
    plated = np.array([d.plated is True for d in drills])
    own = alone >= _RING_SHARE
    wrong = ~own & (all_round < _RING_SHARE) & ((all_round > 0.0) | plated)
    return int(own.sum()), int(wrong.sum())


def _middle(drill: Drill) -> tuple[float, float]:
    end_x = drill.x_mm if drill.end_x_mm is None else drill.end_x_mm
    end_y = drill.y_mm if drill.end_y_mm is None else drill.end_y_mm
    return (drill.x_mm + end_x) / 2.0, (drill.y_mm + end_y) / 2.0


def _within(places: Places, edges: Sequence[Points]) -> NDArray[np.bool_]:
    """Say which places lie in the box of an edge (what is milled out of it may be drilled); all where there is none."""
    found = np.zeros(len(places), np.bool_) if edges else np.ones(len(places), np.bool_)
    for edge in edges:
        low, high = edge.min(axis=0) - SAME_PLACE_MM, edge.max(axis=0) + SAME_PLACE_MM
        found |= ((places >= low) & (places <= high)).all(axis=1)
    return found


def _ring(x: float, y: float, diameter_mm: float) -> Points:
    turns = np.arange(_RING_POINTS) * (2.0 * np.pi / _RING_POINTS)
    result: Points = np.array((x, y)) + (diameter_mm / 2.0 + _RING_MM) * np.stack((np.cos(turns), np.sin(turns)), 1)
    return result


def _share_in(rings: Points, shapes: Sequence[Shape]) -> NDArray[np.float64]:
    """Return the share of each ring's points that lies in the copper of a layer, in its painting order."""
    found = np.zeros(len(rings), bool)
    for shape in shapes:
        low, high = shape.points_mm.min(axis=0), shape.points_mm.max(axis=0)
        near = np.flatnonzero(((rings >= low) & (rings <= high)).all(axis=1))
        if len(near):
            found[near[inside(rings[near], shape.points_mm)]] = shape.dark
    result: NDArray[np.float64] = found.reshape(-1, _RING_POINTS).mean(axis=1)
    return result
