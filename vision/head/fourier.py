"""Fourier series in theta fitted to recorded places, with its leave-one-out errors in closed form.

`place(theta) = sum of c_k exp(i k theta)`, k = -K..K, fitted by least squares with a mild prior: seen from the turning
head the run-out (`place exp(-i theta)`, harmonic k - 1) is smooth, so a harmonic is held back by |k - 1|^3; the
control point (k = 0) and the circle (k = 1) are free. How strongly is chosen by leave-one-out. On appendix D this
predicts better than picking an order, from 12 to 48 angles, and as well from there on (`tests/bench/head.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vision.head.circle import Complex
from vision.head.model import Array

ROUGHNESS_POWER = 3
STRENGTHS = 10.0 ** np.arange(-11.0, 1.01, 0.25)
"""Weights of the prior that are tried: from a plain fit to (nearly) a perfect circle."""
LEAST_FREEDOM = 1e-4
"""A row with less left to itself than this share is interpolated, and its leave-one-out error is 0 / 0."""
EQUAL_UM = 0.01
"""Leave-one-out errors nearer than this are equal, and the smoother series is taken."""


@dataclass(frozen=True)
class Series:
    """A fitted series: coefficients (2K+1,) for k = -K..K, um; residual (N,), measured minus fitted, um.

    leverage: (N,) share of each row in its own fit, 0..1. deleted: (N,) the residual if the row had been left out
    (PRESS; exact for a given strength). spread: (2K+1, 2K+1), the coefficients' covariance for unit noise.
    """

    coefficients: Complex
    strength: float
    residual: Complex
    leverage: Array
    spread: Complex

    @property
    def order(self) -> int:
        """The highest harmonic."""
        return len(self.coefficients) // 2

    @property
    def deleted(self) -> Complex:
        """Leave-one-out residuals, (N,)."""
        return np.asarray(self.residual / (1.0 - self.leverage))

    @property
    def deleted_rms_um(self) -> float:
        """Root mean square of the leave-one-out residuals."""
        return rms(self.deleted)

    def at(self, theta_deg: Array) -> Complex:
        """Return the places at angles (N,)."""
        return np.asarray(waves(theta_deg, self.order) @ self.coefficients)

    def doubt(self, theta_deg: Array) -> Array:
        """Return the variance of the fitted place for unit noise, at angles (N,)."""
        design = waves(theta_deg, self.order)
        return np.asarray(np.einsum("ij,jk,ik->i", design, self.spread, design.conj()).real)


def rms(values: Complex | Array) -> float:
    """Return the root mean square of lengths."""
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


def waves(theta_deg: Array, order: int) -> Complex:
    """Return exp(i k theta) for k = -order..order, shape (N, 2 order + 1)."""
    return np.asarray(np.exp(1j * np.radians(theta_deg)[:, None] * np.arange(-order, order + 1)))


def fit_series(theta_deg: Array, place: Complex, order: int, strength: float) -> Series:
    """Fit a series of one order with one strength of the prior (0: plain least squares)."""
    design = waves(theta_deg, order)
    middle = place.mean()  # the constant is free: taking it out first saves digits
    gram = design.conj().T @ design + len(place) * strength * np.diag(_roughness(order))
    inverse = np.linalg.pinv(gram, hermitian=True)
    hat = inverse @ design.conj().T
    coefficients = hat @ (place - middle)
    residual = place - middle - design @ coefficients
    coefficients[order] += middle
    leverage = np.einsum("ij,ji->i", design, hat).real
    return Series(coefficients, strength, residual, leverage, np.asarray(inverse))


def choose_series(theta_deg: Array, place: Complex, max_order: int) -> Series:
    """Fit up to `max_order` with the strength that leave-one-out likes best; needs at least three rows."""
    tried = [fit_series(theta_deg, place, max_order, float(strength)) for strength in STRENGTHS]
    sound = [series for series in tried if series.leverage.max() < 1.0 - LEAST_FREEDOM] or tried[-1:]
    best = min(series.deleted_rms_um for series in sound)
    return next(series for series in reversed(sound) if series.deleted_rms_um <= best + EQUAL_UM)


def _roughness(order: int) -> Array:
    """Return each harmonic's penalty; none for the control point and the circle."""
    k = np.arange(-order, order + 1)
    return np.where((k == 0) | (k == 1), 0.0, np.abs(k - 1.0) ** (2 * ROUGHNESS_POWER))
