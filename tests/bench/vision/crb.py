"""How well a round thing can be placed at all: the Cramer-Rao bound for white Gaussian pixel noise.

F = (1/noise^2) sum over pixels of (dI/dp)(dI/dp)^T and Cov >= F^-1 (Gatherer, Stanford CSL-TR-93-560, 1993). On an edge
of contrast A blurred by a Gaussian of s px, each px of contour carries A^2 / (2 sqrt(pi) s noise^2) about its place
along its normal; a whole circle of radius R gives sd(x) = sd(y) = (noise/A) sqrt(2 s / (sqrt(pi) R)).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Floats = NDArray[np.float64]
# A pixel integrates over its square: its variance adds to the lens'. Rounding to whole levels adds the same in noise.
BOX_VARIANCE = 1.0 / 12.0


@dataclass(frozen=True)
class Disc:
    """An ellipse on plain ground with an optional hole; every field is a parameter that may be unknown.

    radius_px is semi-major, ratio minor over major, minor_rad the minor axis' direction; the hole has the same form.
    """

    x: float
    y: float
    radius_px: float
    level: float
    ground: float
    ratio: float = 1.0
    minor_rad: float = 0.0
    hole_x: float = 0.0
    hole_y: float = 0.0
    hole_px: float = 0.0
    hole_level: float = 0.0
    blur_px: float = 1.0


PAD = ("x", "y", "radius_px", "level", "ground")
FORM = ("ratio", "minor_rad")
HOLE = ("hole_x", "hole_y", "hole_px", "hole_level")


def disc_sigma_px(noise: float, contrast: float, blur_px: float, radius_px: float) -> float:
    """Return the least 1-sigma of each coordinate of a circle's centre, its whole contour seen, px."""
    return noise / contrast * float(np.sqrt(2.0 * blur_px / (np.sqrt(np.pi) * radius_px)))


def annulus_sigma_px(noise: float, blur_px: float, edges: tuple[tuple[float, float], ...]) -> float:
    """Return the same for concentric circles given as (radius_px, contrast): their informations add up."""
    information = sum(np.sqrt(np.pi) * radius * contrast**2 for radius, contrast in edges) / (2.0 * blur_px * noise**2)
    return float(1.0 / np.sqrt(information))


def picture(disc: Disc, x: Floats, y: Floats) -> Floats:
    """Return the noiseless levels at points x, y (N,) of a Gaussian-blurred disc (edges far wider apart than blur)."""
    inside = _cover(disc, disc.x, disc.y, disc.radius_px, x, y)
    level = disc.ground + (disc.level - disc.ground) * inside
    if disc.hole_px > 0:
        hole = _cover(disc, disc.hole_x, disc.hole_y, disc.hole_px, x, y)
        level = level + (disc.hole_level - disc.level) * hole
    return level


def _cover(disc: Disc, at_x: float, at_y: float, radius: float, x: Floats, y: Floats) -> Floats:
    c, s = np.cos(disc.minor_rad), np.sin(disc.minor_rad)
    u, v = ((x - at_x) * c + (y - at_y) * s) / disc.ratio, (y - at_y) * c - (x - at_x) * s
    rho = np.hypot(u, v) + 1e-9
    slope = np.hypot(u / disc.ratio, v) / rho
    return np.asarray(ndtr((radius - rho) / slope / disc.blur_px), dtype=np.float64)


def covariance(disc: Disc, noise: float, free: tuple[str, ...]) -> Floats:
    """Return the least covariance of the `free` parameters (in their order) from all pixels about the disc."""
    reach = int(np.ceil(disc.radius_px + 6.0 * disc.blur_px))
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    x, y = columns.ravel() + np.rint(disc.x), rows.ravel() + np.rint(disc.y)
    known = dict(zip((field.name for field in fields(disc)), astuple(disc), strict=True))
    slopes = []
    for name in free:
        step = 1e-4 * max(abs(known[name]), 1.0)
        more, less = replace(disc, **{name: known[name] + step}), replace(disc, **{name: known[name] - step})
        slopes.append((picture(more, x, y) - picture(less, x, y)) / (2.0 * step))
    design = np.stack(slopes, axis=1)
    return np.asarray(np.linalg.inv(design.T @ design) * noise**2, dtype=np.float64)


def bound_px(disc: Disc, noise: float, lens_blur_px: float) -> float:
    """Return the 2-D rms bound of the target: the hole's centre if there is one, else the disc's.

    Everything is unknown but the lens: place, size, form, levels and the hole. The pixel's square and the rounding to
    whole levels are counted in.
    """
    blurred = replace(disc, blur_px=float(np.sqrt(lens_blur_px**2 + BOX_VARIANCE)))
    free = (*PAD, *FORM, *HOLE) if disc.hole_px > 0 else (*PAD, *FORM)
    cov = covariance(blurred, float(np.sqrt(noise**2 + BOX_VARIANCE)), free)
    at = free.index("hole_x") if disc.hole_px > 0 else 0
    return float(np.sqrt(cov[at, at] + cov[at + 1, at + 1]))
