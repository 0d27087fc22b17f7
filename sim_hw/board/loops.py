"""Closed loops of pen strokes: what courtyard and fabrication layers draw round their parts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from gerbonara import graphic_objects as go
from gerbonara.utils import MM

from sim_hw.board.shapes import Outline, shapes

_END_MM = 0.002
"""Ends of strokes nearer than this are joined."""
_CHORD_DEG = 10.0

_End = tuple[int, int]


def loops(objects: Iterable[Any]) -> tuple[Outline, ...]:
    """Return the closed polygons (N, 2) in mm that lines and arcs of a layer make; regions are loops already."""
    strokes: list[Outline] = []
    whole: list[Outline] = []
    for item in objects:
        if isinstance(item, go.Line):
            ends = ((item.x1, item.y1), (item.x2, item.y2))
            strokes.append(np.array([[float(MM(v, item.unit)) for v in end] for end in ends]))
        elif isinstance(item, go.Arc):
            strokes.append(_chords(item))
        elif isinstance(item, go.Region):
            whole += [shape.outline_mm for shape in shapes([item]) if shape.dark]
    return (*whole, *_chained(strokes))


def _chords(item: Any) -> Outline:
    x1, y1, x2, y2 = (float(MM(v, item.unit)) for v in (item.x1, item.y1, item.x2, item.y2))
    cx, cy = x1 + float(MM(item.cx, item.unit)), y1 + float(MM(item.cy, item.unit))
    start, end = math.atan2(y1 - cy, x1 - cx), math.atan2(y2 - cy, x2 - cx)
    sweep = (end - start) % (2.0 * math.pi) or 2.0 * math.pi
    if item.clockwise:
        sweep -= 2.0 * math.pi
        sweep = sweep or -2.0 * math.pi
    count = max(2, math.ceil(abs(math.degrees(sweep)) / _CHORD_DEG) + 1)
    angles = start + np.linspace(0.0, sweep, count)
    radius = math.hypot(x1 - cx, y1 - cy)
    return np.column_stack((cx + radius * np.cos(angles), cy + radius * np.sin(angles)))


def _key(point: Outline) -> _End:
    return round(float(point[0]) / _END_MM), round(float(point[1]) / _END_MM)


def _chained(strokes: list[Outline]) -> list[Outline]:
    """Join strokes end to end; what does not close is no loop."""
    at: dict[_End, list[int]] = {}
    for k, stroke in enumerate(strokes):
        for end in (_key(stroke[0]), _key(stroke[-1])):
            at.setdefault(end, []).append(k)
    used, found = set[int](), []
    for first, stroke in enumerate(strokes):
        if first in used:
            continue
        used.add(first)
        chain, start, here = [stroke], _key(stroke[0]), _key(stroke[-1])
        while here != start:
            following = next((k for k in at[here] if k not in used), None)
            if following is None:
                break
            used.add(following)
            piece = strokes[following]
            piece = piece if _key(piece[0]) == here else piece[::-1]
            chain.append(piece)
            here = _key(piece[-1])
        if here == start and (len(chain) > 2 or len(stroke) > 3):
            found.append(np.concatenate([piece[:-1] for piece in chain]))
    return found
