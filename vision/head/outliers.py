"""Outliers of a rotational record: a slipped axis, a control point mistaken, a digit mistyped.

Forward search: rows are put aside, the worst by leave-one-out first, until a core is left that no outlier can have
bent; then they come back one by one, the best first, as long as the series through the others explains them. A row
counts by its studentised residual, so that one beside a wide gap is not blamed for the gap.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vision.head.circle import Complex, fit_rotation
from vision.head.fourier import Series, choose_series
from vision.head.model import Array

Flags = NDArray[np.bool_]
CORE_SHARE = 0.7
"""Part of the rows that is taken to be sound; more than a quarter of outliers is refused anyway."""
LEAST_CORE = 5
BATCHES = 12
REACH = 5.0
"""Studentised residuals beyond this are outliers: 4 in a million of planar Gaussian ones."""
FEW_ROWS = 6.0
"""Rows at which the reach is doubled."""
LEAST_FOR_SEARCH = 16
"""With fewer rows a sharp bend of a sound head and an outlier look alike (searching doubles the
error at 12 rows of appendix D), so only what is off from the circle altogether is named."""
MOST_DOUBT = 15.0
"""A wide gap excuses a residual up to four times the usual, not without end."""
CIRCLE_ROUNDS = 20
CIRCLE_REACH, MOST_RUN_OUT = 12.0, 0.04
"""A head may deviate from its circle by this many sigmas of its own run-out, and by this share of its arm anyway;
appendix D's deviates by 0.025 of its arm."""
FLOOR_UM = 12.0
"""No record is believed to be better than this (1 sigma per axis): nothing below 60 um is called an outlier."""


def find_sound(theta_deg: Array, place: Complex, max_order: int) -> Flags:
    """Return (N,) True for the rows that agree with one smooth head, False for outliers."""
    near = _near_circle(theta_deg, place)
    if len(place) < LEAST_FOR_SEARCH:
        return near
    rows, core = len(place), max(LEAST_CORE, math.ceil(CORE_SHARE * len(place)))
    batch = max(1, (rows - core) // BATCHES)
    sound = near.copy()
    while sound.sum() > core:
        series = choose_series(theta_deg[sound], place[sound], max_order)
        worst = np.argsort(_studentised(series))[-min(batch, int(sound.sum()) - core) :]
        sound[np.flatnonzero(sound)[worst]] = False
    while (outside := np.flatnonzero(near & ~sound)).size:
        series = choose_series(theta_deg[sound], place[sound], max_order)
        doubt = np.minimum(series.doubt(theta_deg[outside]), MOST_DOUBT)
        off = np.abs(place[outside] - series.at(theta_deg[outside])) / np.sqrt(1.0 + doubt)
        good = off <= REACH * _few(rows) * _sigma_um(_studentised(series), rows)
        if not good.any():
            break
        sound[outside[np.argsort(off)[: min(batch, int(good.sum()))]]] = True
    return sound


def _near_circle(theta_deg: Array, place: Complex) -> Flags:
    """Return (N,) False for the rows that are off even from a perfect head's circle, which outliers do not bend."""
    weight = np.ones(len(place))
    for _ in range(CIRCLE_ROUNDS):  # least absolute distances, by weights
        centre, arm = fit_rotation(theta_deg, place, weight)
        off = np.abs(place - centre - arm * np.exp(1j * np.radians(theta_deg)))
        weight = 1.0 / np.maximum(off, FLOOR_UM)
    return np.asarray(off <= max(CIRCLE_REACH * _sigma_um(off, len(place)), MOST_RUN_OUT * abs(arm)))


def _few(rows: int) -> float:
    """Return how much wider to reach at few rows, where the spread itself is badly known."""
    return 1.0 + FEW_ROWS / rows


def _studentised(series: Series) -> Array:
    """Return the residuals' lengths as they would be without their own pull, (N,)."""
    return np.asarray(np.abs(series.residual) / np.sqrt(1.0 - series.leverage))


def _sigma_um(lengths: Array, rows: int) -> float:
    """Estimate one axis' sigma from the median length of the rows kept, which are the best of all `rows`."""
    share = 0.5 * len(lengths) / rows
    return max(FLOOR_UM, float(np.median(lengths)) / math.sqrt(-2.0 * math.log(1.0 - share)))
