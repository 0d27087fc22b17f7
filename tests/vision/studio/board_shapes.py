"""Outlines of what is on a board, in flat px: closed polygons (N, 2) with a positive shoelace area."""

from itertools import pairwise

import numpy as np

from tests.vision.studio.board_canvas import Points

GLYPHS: dict[str, list[list[tuple[float, float]]]] = {
    "C": [[(0.6, 0.15), (0.45, 0.0), (0.15, 0.0), (0.0, 0.15), (0.0, 0.85), (0.15, 1.0), (0.45, 1.0), (0.6, 0.85)]],
    "E": [[(0.55, 0.0), (0.0, 0.0), (0.0, 1.0), (0.55, 1.0)], [(0.0, 0.5), (0.45, 0.5)]],
    "J": [[(0.5, 0.0), (0.5, 0.8), (0.35, 1.0), (0.12, 1.0), (0.0, 0.85)]],
    "L": [[(0.0, 0.0), (0.0, 1.0), (0.55, 1.0)]],
    "P": [[(0.0, 1.0), (0.0, 0.0), (0.45, 0.0), (0.6, 0.15), (0.6, 0.4), (0.45, 0.55), (0.0, 0.55)]],
    "R": [
        [(0.0, 1.0), (0.0, 0.0), (0.45, 0.0), (0.6, 0.15), (0.6, 0.4), (0.45, 0.55), (0.0, 0.55)],
        [(0.3, 0.55), (0.6, 1.0)],
    ],
    "T": [[(0.0, 0.0), (0.6, 0.0)], [(0.3, 0.0), (0.3, 1.0)]],
    "U": [[(0.0, 0.0), (0.0, 0.85), (0.15, 1.0), (0.45, 1.0), (0.6, 0.85), (0.6, 0.0)]],
    "0": [
        [
            (0.15, 0.0),
            (0.45, 0.0),
            (0.6, 0.2),
            (0.6, 0.8),
            (0.45, 1.0),
            (0.15, 1.0),
            (0.0, 0.8),
            (0.0, 0.2),
            (0.15, 0.0),
        ]
    ],
    "1": [[(0.1, 0.2), (0.3, 0.0), (0.3, 1.0)], [(0.1, 1.0), (0.5, 1.0)]],
    "2": [[(0.0, 0.15), (0.15, 0.0), (0.45, 0.0), (0.6, 0.15), (0.6, 0.4), (0.0, 1.0), (0.6, 1.0)]],
    "4": [[(0.45, 1.0), (0.45, 0.0), (0.0, 0.65), (0.6, 0.65)]],
    "7": [[(0.0, 0.0), (0.6, 0.0), (0.2, 1.0)]],
}
"""Strokes of a plotter's letters in a box 0.6 wide and 1 high."""


def circle(x: float, y: float, radius: float, *, ragged: float = 0.0, rng: np.random.Generator | None = None) -> Points:
    """Return a circle; ``ragged`` is the rms (flat px) by which etching moved its edge.

    The raggedness has no first or second harmonic: it moves the edge, not the centre.
    """
    angle = np.linspace(0.0, 2 * np.pi, max(96, int(radius * 12)), endpoint=False)
    reach = np.full_like(angle, radius)
    if rng is not None and ragged > 0:
        waves = np.arange(3, 15)
        phase = rng.uniform(0.0, 2 * np.pi, waves.size)
        wobble = np.cos(waves[:, None] * angle + phase[:, None]).sum(axis=0)
        reach += ragged * wobble / np.sqrt(waves.size / 2)
    return np.column_stack((x + reach * np.cos(angle), y + reach * np.sin(angle)))


def bar(start: tuple[float, float], end: tuple[float, float], width: float) -> Points:
    """Return a straight stroke with round ends."""
    along = np.arctan2(end[1] - start[1], end[0] - start[0])
    half = np.linspace(-np.pi / 2, np.pi / 2, 24)
    front = np.column_stack((np.cos(along + half), np.sin(along + half))) * (width / 2) + end
    back = np.column_stack((np.cos(along + np.pi + half), np.sin(along + np.pi + half))) * (width / 2) + start
    return np.vstack((front, back))


def rounded(x: float, y: float, size: tuple[float, float], corner: float, angle_rad: float) -> Points:
    """Return a rectangle of ``size`` (length, width) with corners of radius ``corner`` (half the width: an oval)."""
    corner = min(max(corner, 0.05), min(size) / 2)
    turn = np.linspace(0.0, np.pi / 2, 12)
    ends = [(1, 1, 0.0), (-1, 1, np.pi / 2), (-1, -1, np.pi), (1, -1, 3 * np.pi / 2)]
    ring = np.vstack(
        [
            np.column_stack((np.cos(turn + start), np.sin(turn + start))) * corner
            + (sx * (size[0] / 2 - corner), sy * (size[1] / 2 - corner))
            for sx, sy, start in ends
        ]
    )
    return turned(ring, angle_rad) + np.array([x, y])


def turned(points: Points, angle_rad: float) -> Points:
    """Rotate about the origin."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return points @ np.array([[cos, sin], [-sin, cos]])


def strokes(line: Points, width: float) -> list[Points]:
    """Return the bars of a polyline, one a segment; their round ends make the joints."""
    return [bar(tuple(a), tuple(b), width) for a, b in pairwise(line)]


def lettering(text: str, height: float) -> list[Points]:
    """Return the centre lines of a text, its middle at the origin."""
    lines = [
        np.array(stroke, float) + np.array([0.9 * at, 0.0])
        for at, letter in enumerate(text)
        for stroke in GLYPHS[letter]
    ]
    middle = np.array([(0.9 * (len(text) - 1) + 0.6) / 2, 0.5])
    return [(line - middle) * height for line in lines]


def settled(points: Points, direction_rad: float, keep_out: Points, gap: float) -> tuple[float, float]:
    """Return the shift along ``direction_rad`` that brings ``points`` inwards until ``gap`` short of ``keep_out``.

    ``points`` are (N, 2) round the origin, ``keep_out`` (M, 2). The way in is gone in steps of the free distance, so
    nothing is jumped over.
    """
    step = np.array([np.cos(direction_rad), np.sin(direction_rad)])
    reach = 200.0
    for _ in range(40):
        moved = points + step * reach
        room = np.sqrt(((moved[:, None, :] - keep_out[None, :, :]) ** 2).sum(axis=2)).min() - gap
        if room < 0.05 or reach < room:
            break
        reach -= float(room)
    return float(step[0] * reach), float(step[1] * reach)


def dense(line: Points, pitch: float = 2.0, *, closed: bool = False) -> Points:
    """Return points every ``pitch`` flat px or less along a polyline."""
    ring = np.vstack((line, line[:1])) if closed else line
    pieces = []
    for a, b in pairwise(ring):
        count = int(np.hypot(*(b - a)) / pitch) + 1
        pieces.append(a + np.linspace(0.0, 1.0, count, endpoint=False)[:, None] * (b - a))
    return np.vstack([*pieces, ring[-1:]])
