"""Checks of a rotational record before anything is fitted to it, and how it covers the turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vision.head.model import TURN_DEG, Array

LEAST_ROWS = 6
SAME_ANGLE_DEG = 0.01
FORBIDDEN_DEG = (101.0, 139.0)
"""Head angles the wiring does not allow (thesis 6.2); 100 and 140 are the last that may be recorded."""
USABLE_TO_DEG, USABLE_FROM_DEG = 100.0, 140.0


def check_record(theta_deg: ArrayLike, points_um: Array) -> tuple[Array, Array]:
    """Return angles (N,) in 0..360 and points (N, 2); ValueError that says what to do for a record that is none."""
    theta = np.asarray(theta_deg, dtype=float)
    if theta.shape != (len(points_um),):
        raise ValueError(f"{theta.shape} angles for {len(points_um)} positions; one of each per row")
    if not np.isfinite(theta).all():
        raise ValueError(f"the angle of row {int(np.flatnonzero(~np.isfinite(theta))[0])} is not finite; leave it out")
    if len(theta) < LEAST_ROWS:
        raise ValueError(f"{len(theta)} rows; record at least {LEAST_ROWS} angles, better 22")
    theta = theta % TURN_DEG
    if (twice := _twice(theta)) is not None:
        raise ValueError(f"the angle {twice:g} deg is there twice; leave one of the two rows out")
    low, high = FORBIDDEN_DEG
    if (inside := theta[(theta >= low) & (theta <= high)]).size:
        raise ValueError(f"the angle {inside[0]:g} deg is in the forbidden band {low:g}..{high:g}; leave it out")
    if _gaps(theta).max() >= TURN_DEG / 2:
        raise ValueError("all angles are in less than half a turn; record angles all round")
    return theta, points_um


def largest_gap_deg(theta_deg: Array) -> float:
    """Return the largest gap between neighbouring angles (N,), not counting what of it the head cannot reach."""
    start = np.sort(theta_deg % TURN_DEG)
    gaps = _gaps(theta_deg)
    # The gap over 360 begins at the last angle: the band lies one turn further for it.
    reached = [_overlap(float(a), float(a + gap)) for a, gap in zip(start, gaps, strict=True)]
    return float(np.max(gaps - reached))


def _overlap(begin: float, end: float) -> float:
    """Return how much of begin..end is between the usable angles, in this turn and the next."""
    return sum(
        max(0.0, min(end, USABLE_FROM_DEG + turn) - max(begin, USABLE_TO_DEG + turn)) for turn in (0.0, TURN_DEG)
    )


def _gaps(theta_deg: Array) -> Array:
    """Return the gap after each angle, in rising order, (N,)."""
    rising = np.sort(theta_deg % TURN_DEG)
    return np.diff(np.r_[rising, rising[0] + TURN_DEG])


def _twice(theta_deg: Array) -> float | None:
    """Return the first angle that has another within SAME_ANGLE_DEG, or None."""
    rising, gaps = np.sort(theta_deg % TURN_DEG), _gaps(theta_deg)
    close = np.flatnonzero(gaps < SAME_ANGLE_DEG)
    return float(rising[close[0]]) if close.size else None


def repeatability_um(theta_deg: Array, residuals_um: Array, within_deg: float = 1.5) -> float | None:
    """Estimate the station's repeatability per axis, 1 sigma, um, from residuals (N, 2) of any smooth model.

    Run-out changes little from one degree to the next, so what neighbours differ by is chance: twice its variance.
    Returns None if fewer than six neighbours are within `within_deg`, where this says nothing.
    """
    rising = np.argsort(theta_deg)
    near = np.diff(theta_deg[rising]) <= within_deg
    if near.sum() < LEAST_ROWS:
        return None
    steps = np.diff(residuals_um[rising], axis=0)[near]
    return float(np.sqrt((steps**2).mean() / 2.0))
