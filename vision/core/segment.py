"""Segmentation: brightness classes (Otsu, two or more) and connected objects."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core.image import Gray

BINS = 32
"""Grey levels are counted in this many bins: fine enough for thresholds, small enough to search exhaustively."""
BIN_LEVELS = 256 // BINS


@dataclass(frozen=True, slots=True)
class Component:
    """Hold one connected region: its area, bounding box (x, y, width, height) and mask of the box (uint8 0/1)."""

    area_px: int
    box: tuple[int, int, int, int]
    mask: NDArray[np.uint8]


def otsu(plane: Gray) -> int:
    """Return the grey level that best parts `plane` in two: pixels above it are the bright class."""
    return multi_otsu(plane, 2)[0]


def multi_otsu(plane: Gray, classes: int, keep: NDArray[np.bool_] | None = None) -> tuple[int, ...]:
    """Return the `classes` - 1 rising thresholds with the largest between-class variance (Otsu, many classes).

    plane: (H, W) uint8. keep: (H, W) bool, pixels to count (default all). A pixel belongs to the class above a
    threshold when it is greater than it. Found exactly by dynamic programming over `BINS` bins.
    """
    if classes < 2:
        raise ValueError(f"classes must be 2 or more, got {classes}")
    values = plane if keep is None else plane[keep]
    count = np.bincount(values.ravel() // BIN_LEVELS, minlength=BINS).astype(np.float64)
    weight = np.concatenate([[0.0], np.cumsum(count)])
    moment = np.concatenate([[0.0], np.cumsum(count * np.arange(BINS))])
    class_weight = weight[None, :] - weight[:, None]
    class_moment = moment[None, :] - moment[:, None]
    # gain[i, j]: what a class of bins i..j-1 adds to the between-class variance; -inf where j <= i.
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where(class_weight > 0, class_moment**2 / class_weight, 0.0)
    gain[np.tril_indices(BINS + 1)] = -np.inf
    best = gain[0]
    cuts: list[NDArray[np.intp]] = []
    for _ in range(classes - 1):
        total = best[:, None] + gain
        cuts.append(np.argmax(total, axis=0))
        best = total.max(axis=0)
    ends = BINS
    thresholds: list[int] = []
    for cut in reversed(cuts):
        ends = int(cut[ends])
        thresholds.append(max(ends * BIN_LEVELS - 1, 0))
    return tuple(reversed(thresholds))


def components(mask: NDArray[np.uint8], least_area_px: int = 1) -> list[Component]:
    """Return the 8-connected regions of a 0/1 mask with at least `least_area_px` pixels, largest first."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found: list[Component] = []
    for label in range(1, stats.shape[0]):
        x, y, width, height, area = (int(number) for number in stats[label])
        if area >= least_area_px:
            part = (labels[y : y + height, x : x + width] == label).astype(np.uint8)
            found.append(Component(area, (x, y, width, height), part))
    return sorted(found, key=lambda region: -region.area_px)
