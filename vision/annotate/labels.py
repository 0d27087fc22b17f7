"""Label placement: beside what they name, off what is drawn, never on each other while there is another place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Box = tuple[int, int, int, int]
Floats = NDArray[np.float64]
DISTANCES = (4.0, 10.0, 20.0, 34.0, 52.0, 76.0, 104.0, 140.0, 190.0)
"""Distances tried, sheet pixels, and directions tried at each."""
DIRECTIONS = 24
COST_OF_BUSY, COST_OF_OVERLAP, COST_OF_CROSSING = 300.0, 2000.0, 400.0
"""What it costs to lie on drawn lines (all of the label), on another label (at all), or with its line across one."""
GAP = 3


@dataclass(frozen=True, slots=True)
class Spot:
    """Hold what a label names: a place on the sheet and how far round it the label keeps away, sheet pixels."""

    x: float
    y: float
    clear: float


@dataclass(frozen=True, slots=True)
class Label:
    """Hold a line of text, what it names, its colour (BGR) and the size (width, height) of its box."""

    text: str
    spot: Spot
    colour: tuple[int, int, int]
    size: tuple[int, int]


def arrange(labels: Sequence[Label], busy: NDArray[np.uint8]) -> list[tuple[Box, Floats]]:
    """Return a box (x, y, width, height) for each label, and the line (2, 2) from what it names to it.

    busy (H, W): what labels should spare, 0 free .. 255 full. The first labels choose first.
    """
    summed = np.zeros((busy.shape[0] + 1, busy.shape[1] + 1))
    summed[1:, 1:] = np.cumsum(np.cumsum(busy / 255.0, axis=0), axis=1)
    taken: list[Box] = []
    lines: list[Floats] = []
    for label in labels:
        offers = _offers(label, busy.shape[1], busy.shape[0])
        own_lines = _lines(label.spot, offers)
        cost = COST_OF_BUSY * _hidden(offers, summed) + np.hypot(*(own_lines[:, 1] - own_lines[:, 0]).T)
        for box, line in zip(taken, lines, strict=True):
            fixed = np.array([box])
            crossed = _passes(own_lines, fixed) | _passes(line[None], offers)
            cost += COST_OF_OVERLAP * _overlaps(offers, fixed) + COST_OF_CROSSING * crossed
        best = int(np.argmin(cost))
        x, y, width, height = (int(number) for number in offers[best])
        taken.append((x, y, width, height))
        lines.append(own_lines[best])
    return list(zip(taken, lines, strict=True))


def _offers(label: Label, room_x: int, room_y: int) -> NDArray[np.intp]:
    """Return the boxes tried (N, 4), nearest first, all of them on the sheet as far as it is large enough."""
    width, height = label.size
    way = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    reach = label.spot.clear + np.array(DISTANCES)[:, None]
    # The middle goes round on a path as much wider than the circle as the label is wide.
    x = label.spot.x + np.cos(way) * (reach + width / 2.0) - width / 2.0
    y = label.spot.y + np.sin(way) * (reach + height / 2.0) - height / 2.0
    corners = [np.clip(x, 2, max(room_x - width - 2, 2)).ravel(), np.clip(y, 2, max(room_y - height - 2, 2)).ravel()]
    size = [np.full(x.size, width), np.full(x.size, height)]
    return np.stack([*corners, *size], axis=1).astype(np.intp)


def _lines(spot: Spot, boxes: NDArray[np.intp]) -> Floats:
    """Return the line (start, end) from a spot's circle to each box, (N, 2, 2)."""
    at = np.array([spot.x, spot.y])
    near = np.clip(at, boxes[:, :2], boxes[:, :2] + boxes[:, 2:])
    far = np.hypot(*(near - at).T)
    share = np.where(far > 0.0, np.minimum(spot.clear / np.maximum(far, 1e-9), 1.0), 0.0)
    return np.stack([at + share[:, None] * (near - at), near], axis=1)


def _hidden(boxes: NDArray[np.intp], summed: Floats) -> Floats:
    """Return the share of each box that lies on something drawn."""
    x, y, width, height = boxes.T
    x2, y2 = np.minimum(x + width, summed.shape[1] - 1), np.minimum(y + height, summed.shape[0] - 1)
    inside = summed[y2, x2] - summed[y, x2] - summed[y2, x] + summed[y, x]
    return np.asarray(inside / (width * height), dtype=np.float64)


def _overlaps(boxes: NDArray[np.intp], fixed: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which boxes lie on the fixed one, or too near to it."""
    low, high = boxes[:, :2], boxes[:, :2] + boxes[:, 2:]
    other_low, other_high = fixed[:, :2] - GAP, fixed[:, :2] + fixed[:, 2:] + GAP
    return np.asarray(np.all((low < other_high) & (other_low < high), axis=1))


def _passes(lines: Floats, boxes: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which lines (N, 2, 2) run through which boxes (N, 4); one of either stands for N of it."""
    steps = np.linspace(0.0, 1.0, 12)[None, :, None]
    points = lines[:, None, 0] + steps * (lines[:, None, 1] - lines[:, None, 0])
    low, high = boxes[:, None, :2], boxes[:, None, :2] + boxes[:, None, 2:]
    return np.asarray(np.any(np.all((points > low) & (points < high), axis=2), axis=1))
