"""Propose circles: every edge pixel votes for the centres it could belong to.

Votes are only seeds; `circle.fit_circle` measures. The picture must have been flattened first, so that circles on the
board are circles here. Unlike whole objects, votes stand a needle across the pad, a trace leading away from it, a hole
in it, and a neighbour that touches it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.image import Gray

# Share of a whole contour that must vote for a seed.
LEAST_SHARE = 0.28
MOST_SEEDS = 12
# Slope of an edge worth a vote, levels per px (after smoothing by 1 px).
LEAST_SLOPE = 6.0


@dataclass(frozen=True, slots=True)
class Seed:
    """Hold a proposed circle in flattened pixels and the share of its contour that voted for it."""

    x_px: float
    y_px: float
    radius_px: float
    share: float


def radii(least_px: float, most_px: float) -> tuple[float, ...]:
    """Return trial radii from least to most, each about 10 % above the last."""
    count = max(int(np.ceil(np.log(most_px / least_px) / 0.10)), 1) + 1
    return tuple(float(radius) for radius in np.geomspace(least_px, most_px, count))


def seeds(flat: Gray, trial_px: tuple[float, ...], hidden: NDArray[np.uint8] | None = None) -> list[Seed]:
    """Return bright discs proposed in a flattened picture (H, W), best first; non-zero `hidden` pixels do not vote."""
    smooth = cv2.GaussianBlur(flat, (0, 0), 1.0)
    slope_x = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125), dtype=np.float32)
    slope_y = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125), dtype=np.float32)
    size = np.asarray(cv2.magnitude(slope_x, slope_y), dtype=np.float32)
    ridge = np.asarray(cv2.dilate(size, np.ones((3, 3), dtype=np.uint8)), dtype=np.float32)
    chosen = (size > LEAST_SLOPE) & (size > 0.8 * ridge)
    if hidden is not None:
        chosen &= hidden == 0
    rows, columns = np.nonzero(chosen)
    if rows.size < 8:
        return []
    toward_x, toward_y = slope_x[rows, columns] / size[rows, columns], slope_y[rows, columns] / size[rows, columns]
    votes = _count(flat.shape, rows, columns, toward_x, toward_y, np.array(trial_px, dtype=np.float32))
    return _peaks(votes, trial_px)


def _count(
    shape: tuple[int, ...],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    toward_x: NDArray[np.float32],
    toward_y: NDArray[np.float32],
    trial_px: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return votes (R, H, W) as shares of each radius' whole contour, gathered over 3x3 px."""
    height, width = shape[0], shape[1]
    x = np.rint(columns + trial_px[:, None] * toward_x).astype(np.int32)
    y = np.rint(rows + trial_px[:, None] * toward_y).astype(np.int32)
    layer = np.broadcast_to(np.arange(trial_px.size, dtype=np.int32)[:, None], x.shape)
    good = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    cell = (layer[good] * height + y[good]) * width + x[good]
    counted = np.bincount(cell, minlength=trial_px.size * height * width).astype(np.float32)
    votes = counted.reshape(trial_px.size, height, width)
    for index, radius in enumerate(trial_px):
        spread = 3 if radius < 12 else 5
        # An edge votes with about 1.4 pixels across its ridge.
        scale = spread * spread / (1.4 * 2.0 * np.pi * float(radius))
        votes[index] = cv2.blur(votes[index], (spread, spread)) * scale
    return votes


def _peaks(votes: NDArray[np.float32], trial_px: tuple[float, ...]) -> list[Seed]:
    """Return the strongest places, each taking its neighbourhood (half its radius) out of the vote at all radii."""
    best = votes.max(axis=0)
    found: list[Seed] = []
    while len(found) < MOST_SEEDS:
        y, x = divmod(int(np.argmax(best)), best.shape[1])
        share = float(best[y, x])
        if share < LEAST_SHARE:
            break
        radius = trial_px[int(np.argmax(votes[:, y, x]))]
        found.append(Seed(float(x), float(y), radius, share))
        cv2.circle(best, (x, y), max(int(0.5 * radius), 2), (0.0,), -1)
    return found
