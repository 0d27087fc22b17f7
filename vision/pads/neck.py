"""Neck of a circle: how wide is what goes on beyond it, be it a trace, a stroke that ends there, a pad that touches."""

from __future__ import annotations

import numpy as np

from vision.core import CircleFit
from vision.pads.window import Flags, Window

NECK_RINGS, NECK_RAYS, NECK_BESIDE = (1.15, 1.25, 1.35, 1.45), 72, 3
"""Where is looked for what goes on beyond a circle: on these rings, in radii, along so many rays."""


def neck_width(window: Window, circle: CircleFit, threshold: float) -> float:
    """Return the width of the widest thing above `threshold` just beyond a circle, over the circle's diameter."""
    angles = np.arange(NECK_RAYS, dtype=np.float64)[:, None] * (2.0 * np.pi / NECK_RAYS)
    xs, ys = window.view.to_image(circle.x_px, circle.y_px, np.array(NECK_RINGS) * circle.contour.radius_px, angles)
    rows = np.clip(np.rint(ys).astype(np.intp), 0, window.shape[0] - 1)
    columns = np.clip(np.rint(xs).astype(np.intp), 0, window.shape[1] - 1)
    hidden = window.hidden[rows, columns] | window.maybe_hidden[rows, columns]
    bright = (window.smooth[rows, columns] > threshold) & ~window.hidden[rows, columns]
    if not bright.any():
        return 0.0
    # Whatever goes on does so on every ring; the narrowest of its widths tells a touching pad from a stroke.
    return min(
        _widest(_behind(on_ring, unseen)) * ring
        for on_ring, unseen, ring in zip(bright.T, hidden.T, NECK_RINGS, strict=True)
    )


def _behind(bright: Flags, hidden: Flags) -> Flags:
    """Return a ring's bright rays with those that hide between two bright ones, or beside one: it goes on there."""
    if not hidden.any() or hidden.all():
        return bright
    start = int(np.argmin(hidden))
    bright, hidden = np.roll(bright, -start), np.roll(hidden, -start)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], hidden, [False]]).astype(np.int8)))
    filled = bright.copy()
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        beside = (*range(first - NECK_BESIDE, first), *range(after, after + NECK_BESIDE))
        filled[first:after] |= np.take(bright, beside, mode="wrap").any()
    return filled


def _widest(bright: Flags) -> float:
    """Return the half width of the longest run round a ring of radius 1: 1 where it spans half of the ring or more."""
    if bright.all():
        return 1.0
    # Twice round, so that every run is whole once; a run is as long as often its bits survive a shift upon themselves.
    bits = int.from_bytes(np.packbits(np.concatenate([bright, bright])).tobytes(), "big")
    longest = 0
    while bits:
        bits &= bits << 1
        longest += 1
    return float(np.sin(min(np.pi * longest / bright.size, np.pi / 2.0)))
