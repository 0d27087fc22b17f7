"""Whole layers as pictures: gerbonara reads, a scan line of this module's own fills by the even-odd rule."""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from gerbonara import GerberFile
from gerbonara import graphic_primitives as gp
from gerbonara.utils import MM
from numpy.typing import NDArray

PITCH_MM = 0.02
Picture = NDArray[np.bool_]
_HIT = re.compile(r"X(-?\d*\.?\d+)Y(-?\d*\.?\d+)(?:G85X(-?\d*\.?\d+)Y(-?\d*\.?\d+))?")
Hit = tuple[float, float, float, float, float]
"""x, y, end x, end y, diameter; mm."""


class Grid:
    """Pixels over a box; the pixel (row, column) has its middle at the box' corner plus half a pitch and so on."""

    def __init__(self, x0: float, y0: float, x1: float, y1: float) -> None:
        self.x0, self.y0 = x0, y0
        self.shape = int(np.ceil((y1 - y0) / PITCH_MM)), int(np.ceil((x1 - x0) / PITCH_MM))

    def rows_columns(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return fractional (column, row) of points in mm; pixel middles are whole."""
        return (points - (self.x0, self.y0)) / PITCH_MM - 0.5

    def pixel(self, x: float, y: float) -> tuple[int, int]:
        """Return row and column of a place, kept inside."""
        column, row = np.rint(self.rows_columns(np.array((x, y)))).astype(int)
        return int(np.clip(row, 0, self.shape[0] - 1)), int(np.clip(column, 0, self.shape[1] - 1))

    def fill(self, picture: Picture, polygon: NDArray[np.float64], *, dark: bool) -> None:
        """Set or clear the pixels whose middles lie inside of a polygon."""
        at = self.rows_columns(polygon)
        low = np.clip(np.floor(at.min(axis=0)).astype(int), 0, (self.shape[1], self.shape[0]))
        high = np.clip(np.ceil(at.max(axis=0)).astype(int) + 1, 0, (self.shape[1], self.shape[0]))
        columns, rows = high - low
        if columns <= 0 or rows <= 0:
            return
        inside = _scan(at - low, int(rows), int(columns))
        picture[low[1] : high[1], low[0] : high[0]][inside] = dark


def _scan(at: NDArray[np.float64], rows: int, columns: int) -> Picture:
    """Fill by the even-odd rule: every edge toggles what lies right of it in the rows that it crosses."""
    a, b = at, np.roll(at, -1, axis=0)
    flip = a[:, 1] > b[:, 1]
    a, b = np.where(flip[:, None], b, a), np.where(flip[:, None], a, b)
    first = np.clip(np.ceil(a[:, 1]), 0, rows).astype(int)
    last = np.clip(np.ceil(b[:, 1]), 0, rows).astype(int)
    counts = last - first
    edge = np.repeat(np.arange(len(a)), counts)
    if not len(edge):
        return np.zeros((rows, columns), np.bool_)
    row = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    slope = (b[edge, 0] - a[edge, 0]) / (b[edge, 1] - a[edge, 1])
    crossing = np.ceil(a[edge, 0] + (row - a[edge, 1]) * slope).astype(int)
    toggles = np.zeros((rows, columns + 1), np.uint8)
    np.add.at(toggles, (row, np.clip(crossing, 0, columns)), 1)
    inside: Picture = (np.add.accumulate(toggles, axis=1, dtype=np.uint8)[:, :-1] & 1).astype(np.bool_)
    return inside


def _outlines(primitive: Any) -> Iterator[NDArray[np.float64]]:
    """Flatten a primitive: arcs in steps of at most 5 degrees."""
    if isinstance(primitive, gp.Circle):
        yield _arc((primitive.x, primitive.y), primitive.r, 0.0, 2 * math.pi)
    elif isinstance(primitive, gp.Line):
        yield _stroke((primitive.x1, primitive.y1), (primitive.x2, primitive.y2), primitive.width)
    elif isinstance(primitive, gp.Arc):
        ends = (primitive.x1, primitive.y1), (primitive.x2, primitive.y2)
        points = _between(*ends, (primitive.cx, primitive.cy), clockwise=primitive.clockwise)
        for a, b in itertools.pairwise(points):
            yield _stroke((a[0], a[1]), (b[0], b[1]), primitive.width)
    elif isinstance(primitive, gp.Rectangle):  # gerbonara's own outline of it is not turned
        c, s = math.cos(primitive.rotation), math.sin(primitive.rotation)
        half = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))) * (primitive.w / 2, primitive.h / 2)
        yield half @ np.array(((c, s), (-s, c))) + (primitive.x, primitive.y)
    elif primitive.outline:
        pieces = [
            np.array([a]) if clockwise is None else _between(a, b, centre, clockwise=clockwise)[:-1]
            for a, b, (clockwise, centre) in primitive.segments
        ]
        yield np.concatenate(pieces)


def _arc(centre: tuple[float, float], radius: float, start: float, sweep: float) -> NDArray[np.float64]:
    angles = start + np.linspace(0.0, sweep, max(2, math.ceil(abs(sweep) / math.radians(5.0)) + 1))
    points: NDArray[np.float64] = np.array(centre) + radius * np.column_stack((np.cos(angles), np.sin(angles)))
    return points


def _between(
    a: tuple[float, float], b: tuple[float, float], centre: tuple[float, float], *, clockwise: bool
) -> NDArray[np.float64]:
    start = math.atan2(a[1] - centre[1], a[0] - centre[0])
    sweep = (math.atan2(b[1] - centre[1], b[0] - centre[0]) - start) % (2 * math.pi) or 2 * math.pi
    return _arc(centre, math.dist(a, centre), start, sweep - 2 * math.pi if clockwise else sweep)


def _stroke(a: tuple[float, float], b: tuple[float, float], width: float) -> NDArray[np.float64]:
    along = math.atan2(b[1] - a[1], b[0] - a[0])
    ends = _arc(b, width / 2, along - math.pi / 2, math.pi), _arc(a, width / 2, along + math.pi / 2, math.pi)
    return np.concatenate(ends)


def painted(path: Path, grid: Grid) -> Picture:
    """Paint one Gerber file."""
    picture = np.zeros(grid.shape, np.bool_)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for item in GerberFile.open(path).objects:
            for primitive in item.to_primitives(MM):
                for outline in _outlines(primitive):
                    grid.fill(picture, outline, dark=bool(primitive.polarity_dark))
    return picture


def hits(path: Path) -> list[Hit]:
    """Read an Excellon file with decimal points, metric or inch."""
    tools: dict[str, float] = {}
    found: list[Hit] = []
    diameter, unit, routed = 0.0, 1.0, None
    for line in path.read_text(errors="replace").splitlines():
        if line.startswith("INCH"):
            unit = 25.4
        if tool := re.match(r"T0*(\d+)C([\d.]+)", line):
            tools[tool[1]] = float(tool[2]) * unit
        elif tool := re.match(r"T0*(\d+)$", line):
            diameter = tools.get(tool[1], 0.0)
        elif hit := _HIT.search(line):
            x, y = float(hit[1]) * unit, float(hit[2]) * unit
            end = (float(hit[3]) * unit, float(hit[4]) * unit) if hit[3] else (x, y)
            if line.startswith("G00"):
                routed = x, y
            elif line.startswith("G01") and routed is not None:
                found.append((*routed, x, y, diameter))
                routed = x, y
            else:
                found.append((x, y, *end, diameter))
    return found


def drill(picture: Picture, grid: Grid, found: list[Hit]) -> None:
    """Clear holes and slots: every pixel nearer to the slot's line than half of its width."""
    for ax, ay, bx, by, diameter in found:
        half = diameter / 2
        low = np.array(grid.pixel(min(ax, bx) - half, min(ay, by) - half)) - 1
        high = np.array(grid.pixel(max(ax, bx) + half, max(ay, by) + half)) + 2
        low = np.maximum(low, 0)
        rows, columns = np.mgrid[low[0] : high[0], low[1] : high[1]]
        x = grid.x0 + (columns + 0.5) * PITCH_MM
        y = grid.y0 + (rows + 0.5) * PITCH_MM
        along = np.array((bx - ax, by - ay))
        t = np.clip(((x - ax) * along[0] + (y - ay) * along[1]) / max(float(along @ along), 1e-12), 0.0, 1.0)
        near = np.hypot(x - ax - t * along[0], y - ay - t * along[1]) < half
        cut = picture[low[0] : high[0], low[1] : high[1]]
        cut[near[: cut.shape[0], : cut.shape[1]]] = False
