"""Places of pads, and the shift between two clouds of places that should be one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from daemon.tools.cad.model import Shape

Places = NDArray[np.float64]
SAME_PLACE_MM = 0.05
"""Netlists round to 2.54 um, old drill files to 25 um; two entries this near are one place."""
_PAIRS = 250_000
LARGEST_PAD_MM = 12.0


def pad_places(shapes: Iterable[Shape]) -> Places:
    """Return where pads are (N, 2), mm: flashes; in a layer that draws its pads, the middles of what is drawn."""
    shapes = list(shapes)
    flashed = [s.place_mm for s in shapes if s.place_mm is not None and s.dark]
    drawn: list[tuple[float, float]] = []
    if len(flashed) < max(10, len(shapes) // 50):
        for shape in shapes:
            if shape.place_mm is None and shape.dark:
                low, high = shape.points_mm.min(axis=0), shape.points_mm.max(axis=0)
                if (high - low).max() < LARGEST_PAD_MM:
                    drawn.append(((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0))
    return distinct(np.array([*flashed, *drawn], float).reshape(-1, 2))


def distinct(places: Places) -> Places:
    """Drop places that are there already, to 10 um."""
    if not len(places):
        return places
    _, index = np.unique(np.round(places * 100.0).astype(np.int64), axis=0, return_index=True)
    return places[np.sort(index)]


def share_met(places: Places, tree: KDTree | None, reach_mm: float = SAME_PLACE_MM) -> float:
    """Return the share of places that have one of the tree's within reach; 0 where there is nothing."""
    if tree is None or not len(places):
        return 0.0
    return float(np.mean(tree.query(places, distance_upper_bound=reach_mm)[0] <= reach_mm))


def tree_of(places: Places) -> KDTree | None:
    """Return a tree for asking, None for no places."""
    return KDTree(places) if len(places) else None


def likely_shifts(groups: Sequence[tuple[Places, Places]], keep: int = 12) -> list[tuple[float, float]]:
    """Return the shifts that carry most of each group's first cloud onto its second, (0, 0) always the first.

    Differences of a sample are counted in cells of 50 um; a peak is the median of its differences, `refined` later.
    """
    differences = [_differences(a, b, max(1, len(groups))) for a, b in groups if len(a) and len(b)]
    if not differences:
        return [(0.0, 0.0)]
    every = np.concatenate(differences)
    cells = np.round(every / SAME_PLACE_MM).astype(np.int64)
    keys = cells[:, 0] * 10_000_019 + cells[:, 1]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.concatenate(([True], np.diff(keys[order]) != 0)))
    counts = np.diff(np.concatenate((starts, [len(keys)])))
    found: list[tuple[float, float]] = [(0.0, 0.0)]
    for k in np.argsort(-counts, kind="stable")[: keep * 4]:
        x, y = (float(v) for v in np.median(every[order[starts[k] : starts[k] + counts[k]]], axis=0))
        if all(max(abs(x - a), abs(y - b)) > 2 * SAME_PLACE_MM for a, b in found):
            found.append((x, y))
        if len(found) > keep:
            break
    return found


def refined(shift: tuple[float, float], groups: Sequence[tuple[Places, Places]]) -> tuple[float, float]:
    """Return the shift as the median over all places that meet."""
    for _ in range(2):
        found = []
        for a, b in groups:
            if len(a) and len(b):
                distance, index = KDTree(b).query(a + shift, distance_upper_bound=2 * SAME_PLACE_MM)
                met = np.isfinite(distance)
                found.append(b[np.asarray(index)[met]] - a[met])
        if not found or not sum(len(f) for f in found):
            return shift
        x, y = np.median(np.concatenate(found), axis=0)
        shift = (float(x), float(y))
    return shift


def _differences(a: Places, b: Places, groups: int) -> Places:
    """Return b - a of a sample of pairs, (M, 2)."""
    count = max(8, _PAIRS // groups // max(len(b), 1))
    if len(a) > count:
        a = a[np.random.default_rng(0).permutation(len(a))[:count]]
    if len(b) > _PAIRS // 8:
        b = b[np.random.default_rng(1).permutation(len(b))[: _PAIRS // 8]]
    result: Places = (b[None] - a[:, None]).reshape(-1, 2)
    return result
