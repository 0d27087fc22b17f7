"""Exact bounds of a share (Clopper and Pearson, Biometrika 26, 1934): one-sided, 95 % sure."""

from __future__ import annotations

from scipy.stats import beta

SURE = 0.95


def at_most(found: int, of: int) -> float:
    """Return the share that is not exceeded, 0..1; of nothing nothing is known."""
    return 1.0 if found >= of else float(beta.ppf(SURE, found + 1, of - found))


def at_least(found: int, of: int) -> float:
    """Return the share that is reached, 0..1."""
    return 0.0 if found <= 0 or of <= 0 else float(beta.ppf(1.0 - SURE, found, of - found + 1))
