"""Surface plane: how high and how level the base, or a board on it, lies, from heights at places (thesis 6.2).

The thesis compares the probe's image at random places of the metal base; what one has to know afterwards is the
height at any place, how sure that is, and whether the base is flat at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.geometry.camera_model import check_points
from vision.geometry.frames import Array

FORMAT = "reprobe-surface-1"
NUMBERS = ("x_um", "y_um", "reference_um", "tilt_x_um_per_mm", "tilt_y_um_per_mm")
LEAST_PLACES, LEAST_TO_LEAVE_ONE = 4, 6
LEAST_ACROSS = 0.05
"""Root mean square spread of the places in the lesser direction, against the greater."""
MOST_TRIPLES, SEED = 4000, 20
CERTAIN = 0.999
"""A place is left out if chance would put it so far off less often than once in a thousand."""
TRIMMED_SIGMA = 0.75
"""What is left of a normal scatter once its largest tenth was set aside, about."""


@dataclass(frozen=True)
class Surface:
    """A plane: `reference_um` high at (x, y), the centre of the places it was fitted to, rising by tilt in um per mm.

    residuals_um: (N,), measured minus plane at every place, those left out too. used: (N,) bool. rms_um and
    flatness_um (peak to valley) are of the used. covariance: (3, 3), of height, tilt_x and tilt_y at the centre.
    """

    x_um: float
    y_um: float
    reference_um: float
    tilt_x_um_per_mm: float
    tilt_y_um_per_mm: float
    residuals_um: Array
    used: NDArray[np.bool_]
    covariance: Array

    def __post_init__(self) -> None:
        """Refuse what is no surface."""
        numbers = (self.x_um, self.y_um, self.reference_um, self.tilt_x_um_per_mm, self.tilt_y_um_per_mm)
        if not all(map(math.isfinite, numbers)):
            raise ValueError("a number is not finite")
        if self.residuals_um.ndim != 1 or self.used.shape != self.residuals_um.shape or not self.used.any():
            raise ValueError("residuals_um and used must pair up, (N,) each, and something must be used")
        if self.covariance.shape != (3, 3) or not np.allclose(self.covariance, self.covariance.T):
            raise ValueError("covariance is not 3x3 and symmetric")
        if not (np.isfinite(self.residuals_um).all() and np.isfinite(self.covariance).all()):
            raise ValueError("a residual or the covariance is not finite")
        if (np.diag(self.covariance) < 0.0).any():
            raise ValueError("the covariance's diagonal is negative")

    @property
    def rms_um(self) -> float:
        """Root mean square residual of the places used."""
        return float(np.sqrt((self.residuals_um[self.used] ** 2).mean()))

    @property
    def flatness_um(self) -> float:
        """Peak to valley of the residuals of the places used."""
        return float(np.ptp(self.residuals_um[self.used]))

    @property
    def tilt_um_per_mm(self) -> float:
        """The steepest rise."""
        return math.hypot(self.tilt_x_um_per_mm, self.tilt_y_um_per_mm)

    def height_um(self, x_um: float, y_um: float) -> float:
        """Return the plane's height at a place."""
        return float(self._lever(x_um, y_um) @ (self.reference_um, self.tilt_x_um_per_mm, self.tilt_y_um_per_mm))

    def sigma_um(self, x_um: float, y_um: float) -> float:
        """Return one sigma of the plane's height at a place; the surface may be off the plane by its flatness."""
        lever = self._lever(x_um, y_um)
        return math.sqrt(max(0.0, float(lever @ self.covariance @ lever)))

    def _lever(self, x_um: float, y_um: float) -> Array:
        return np.array([1.0, (x_um - self.x_um) / 1e3, (y_um - self.y_um) / 1e3])

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists, as for JSON."""
        numbers = {name: float(getattr(self, name)) for name in NUMBERS}
        lists = {"residuals_um": self.residuals_um.tolist(), "used": self.used.tolist()}
        return {"format": FORMAT} | numbers | lists | {"covariance": self.covariance.tolist()}

    @classmethod
    def from_dict(cls, raw: Any) -> Surface:
        """Read a surface back; anything else is a ValueError that says to measure."""
        try:
            if raw["format"] != FORMAT:
                raise ValueError(f"format is {raw['format']!r}, not {FORMAT!r}")
            if not all(isinstance(v, bool) for v in raw["used"]):
                raise ValueError("used is not a list of true and false")
            residuals, covariance = (np.array(raw[name], dtype=float) for name in ("residuals_um", "covariance"))
            used = np.array(raw["used"], dtype=bool)
            x_um, y_um, reference_um, tilt_x, tilt_y = (float(raw[name]) for name in NUMBERS)
            return cls(
                x_um=x_um,
                y_um=y_um,
                reference_um=reference_um,
                tilt_x_um_per_mm=tilt_x,
                tilt_y_um_per_mm=tilt_y,
                residuals_um=residuals,
                used=used,
                covariance=covariance,
            )
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as exc:
            raise ValueError(f"not a surface: {exc}; measure the planarity again") from exc


def fit_plane(places_um: ArrayLike, heights_um: ArrayLike, sigma_um: float | None = None) -> Surface:
    """Fit a plane to heights (N,) measured at places (N, 2), um; least squares after wrong places were left out.

    One place in ten may be wrong by any amount (a chip under the probe, a misread image): of six places or more, a
    tenth, at least one, is left out if it is farther from the plane of the others than chance would put it. `used`
    says which, and their residuals are kept: a hole in the base looks the same. `sigma_um`: one sigma of a measured
    height where it is known; the covariance never claims less than that, nor less than what the residuals show.

    Raises ValueError for another shape, numbers not finite, fewer than four places, or places on a line.
    """
    places, heights = _check(places_um, heights_um, sigma_um)
    centre = places.mean(axis=0)
    design = np.c_[np.ones(len(places)), (places - centre) / 1e3]
    used = _believable(design, heights, sigma_um or 0.0)
    if not _spread_out(design[used, 1:]):
        used = np.ones(len(places), dtype=bool)
    plane = np.linalg.lstsq(design[used], heights[used], rcond=None)[0]
    residuals = np.asarray(heights - design @ plane, dtype=float)
    scatter = math.sqrt(float((residuals[used] ** 2).sum()) / (int(used.sum()) - 3))
    covariance = np.linalg.inv(design[used].T @ design[used]) * max(scatter, sigma_um or 0.0) ** 2
    height, tilt_x, tilt_y = (float(v) for v in plane)
    covariance = (covariance + covariance.T) / 2
    return Surface(
        x_um=float(centre[0]),
        y_um=float(centre[1]),
        reference_um=height,
        tilt_x_um_per_mm=tilt_x,
        tilt_y_um_per_mm=tilt_y,
        residuals_um=residuals,
        used=used,
        covariance=covariance,
    )


def _check(places_um: ArrayLike, heights_um: ArrayLike, sigma_um: float | None) -> tuple[Array, Array]:
    places = check_points(places_um, "places_um", 2)
    try:
        heights = np.asarray(heights_um, dtype=float)
    except (TypeError, ValueError) as exc:
        raise ValueError(f"heights_um must be numbers, shape (N,): {exc}") from exc
    if places.ndim != 2 or heights.shape != (len(places),):
        raise ValueError(f"places_um (N, 2) and heights_um (N,) must pair up, got {places.shape} and {heights.shape}")
    if not np.isfinite(heights).all():
        raise ValueError("heights_um must be finite; leave out the places that were not measured")
    if max(np.abs(places).max(initial=0.0), np.abs(heights).max(initial=0.0)) > 1e9:
        raise ValueError("a place or a height is beyond all bounds (1 km); check the units, they are um")
    if sigma_um is not None and not 0.0 < sigma_um < math.inf:
        raise ValueError(f"sigma_um must be finite and greater than 0, or None if it is not known; got {sigma_um}")
    if len(places) < LEAST_PLACES:
        raise ValueError(f"{len(places)} places; a plane that can be judged needs {LEAST_PLACES} or more, measure more")
    if not _spread_out((places - places.mean(axis=0)) / 1e3):
        raise ValueError("the places lie on a line or on one spot; spread them over both directions")
    return places, heights


def _spread_out(places_mm: Array) -> bool:
    """Whether places (N, 2) span a plane: not on one spot (a micrometre), not on a line."""
    along, across = np.linalg.svd(places_mm - places_mm.mean(axis=0), compute_uv=False)
    return bool(along > 1e-3 and across > LEAST_ACROSS * along)


def _believable(design: Array, heights: Array, sigma_um: float) -> NDArray[np.bool_]:
    """Return (N,) bool, False for the places, a tenth at most, that chance alone would not put where they are."""
    from scipy.special import stdtrit  # noqa: PLC0415  # slow to load, see `vision.warm`

    n = len(design)
    every = np.ones(n, dtype=bool)
    if n < LEAST_TO_LEAVE_ONE:
        return every
    kept_count = n - max(1, n // 10)
    kept = _calmest(design, heights, kept_count)
    inverse = np.linalg.pinv(design[kept].T @ design[kept])
    plane = np.linalg.lstsq(design[kept], heights[kept], rcond=None)[0]
    residuals = np.abs(heights - design @ plane)
    freedom = kept_count - 3
    scatter = max(math.sqrt(float((residuals[kept] ** 2).sum()) / freedom) / TRIMMED_SIGMA, sigma_um, 1e-6)
    predicted = scatter * np.sqrt(1.0 + np.einsum("ni,ij,nj->n", design, inverse, design))
    good = residuals <= float(stdtrit(freedom, CERTAIN)) * predicted
    good[kept] = True
    return np.asarray(good, dtype=bool)


def _calmest(design: Array, heights: Array, count: int) -> NDArray[np.intp]:
    """Return the `count` places nearest to the plane that has so many nearest to it (least trimmed squares)."""
    n = len(design)
    if math.comb(n, 3) <= MOST_TRIPLES:
        triples = np.array(list(combinations(range(n), 3)))
    else:
        rng = np.random.default_rng(SEED)
        triples = np.array([rng.choice(n, 3, replace=False) for _ in range(MOST_TRIPLES)])
    triples = triples[np.abs(np.linalg.det(design[triples])) > 1e-9]
    planes = np.linalg.solve(design[triples], heights[triples][..., None])[..., 0]
    squares = (heights - planes @ design.T) ** 2
    best = np.argsort(squares[np.sort(squares, axis=1)[:, :count].sum(axis=1).argmin()])[:count]
    for _ in range(10):
        plane = np.linalg.lstsq(design[best], heights[best], rcond=None)[0]
        nearer = np.argsort((heights - design @ plane) ** 2, kind="stable")[:count]
        if set(nearer) == set(best):
            break
        best = nearer
    return best
