"""Model of the head: tip minus head position, at every angle (thesis 6.2, figure 6.6, appendix D).

Robot frame: right-handed, um, theta counter-clockwise about +Z in degrees. A perfect head moves the tip on a circle; a
real one has run-out (appendix D's: 117 um rms, 363 um at most). Three kinds answer the same question behind one
interface, `Head`: a circle, a Fourier series in theta, and the thesis' own array of residuals. `fit` makes them.

What no record tells: anything constant in the robot frame. It cannot be told from the control point's own place, so
`fit` settles it by convention.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
TURN_DEG = 360.0
LEAST_ROWS = 2


class Head(Protocol):
    """Say where the tip is from the head's position."""

    def tip_offset_um(self, theta_deg: float) -> Array:
        """Return tip minus head position in the robot frame, shape (2,), um; any angle, periodic."""
        ...


@dataclass(frozen=True)
class CircleHead:
    """A perfect head: the tip goes round the axis of rotation on a circle.

    `phase_deg` is the direction of the tip at theta 0. ValueError for a radius that is not positive and finite.
    """

    radius_um: float
    phase_deg: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius_um) and self.radius_um > 0 and math.isfinite(self.phase_deg)):
            raise ValueError(f"a head of radius {self.radius_um} um, phase {self.phase_deg} deg; {_AGAIN}")

    def tip_offset_um(self, theta_deg: float) -> Array:
        """Return tip minus head position in the robot frame, shape (2,), um."""
        return _vector(cmath.rect(self.radius_um, math.radians(theta_deg + self.phase_deg)))


@dataclass(frozen=True)
class FourierHead:
    """A head as a complex Fourier series: `x + iy = sum of c_k exp(i k theta)`, k = -K..-1, 1..K.

    `coefficients_um` holds the 2K complex c_k in that order; k = 1 is the circle. `constant_um` is k = 0, which no
    record can tell from the control point's place: it is a convention (`fit`). ValueError for an odd number of
    coefficients or one that is not finite.
    """

    coefficients_um: tuple[complex, ...]
    constant_um: complex = 0j

    def __post_init__(self) -> None:
        count = len(self.coefficients_um)
        if count == 0 or count % 2 or not all(map(cmath.isfinite, (*self.coefficients_um, self.constant_um))):
            raise ValueError(f"{count} Fourier coefficients: needed are two per harmonic, all finite; {_AGAIN}")

    @property
    def order(self) -> int:
        """The highest harmonic."""
        return len(self.coefficients_um) // 2

    def tip_offset_um(self, theta_deg: float) -> Array:
        """Return tip minus head position in the robot frame, shape (2,), um."""
        turn, order = math.radians(theta_deg % TURN_DEG), self.order
        harmonics = (*range(-order, 0), *range(1, order + 1))
        waves = (c * cmath.rect(1.0, k * turn) for k, c in zip(harmonics, self.coefficients_um, strict=True))
        return _vector(sum(waves, self.constant_um))


@dataclass(frozen=True)
class ArrayHead:
    """The thesis' record: a circle and, per recorded angle, what is left over; linear between the angles.

    theta_deg: N >= 2 angles in 0..360, rising. dx_um, dy_um: N residuals against the circle. Between two angles, across
    the forbidden gap and across 360 the residuals are interpolated linearly; the circle is exact everywhere.
    ValueError for unequal lengths, angles that do not rise, or a number that is not finite.
    """

    circle: CircleHead
    theta_deg: tuple[float, ...]
    dx_um: tuple[float, ...]
    dy_um: tuple[float, ...]

    def __post_init__(self) -> None:
        rows = len(self.theta_deg)
        if rows < LEAST_ROWS or len(self.dx_um) != rows or len(self.dy_um) != rows:
            raise ValueError(f"{rows} angles, {len(self.dx_um)} dx and {len(self.dy_um)} dy; {_AGAIN}")
        if not all(map(math.isfinite, (*self.theta_deg, *self.dx_um, *self.dy_um))):
            raise ValueError(f"the array holds a number that is not finite; {_AGAIN}")
        rising = all(a < b for a, b in zip(self.theta_deg, self.theta_deg[1:], strict=False))
        if not rising or self.theta_deg[0] < 0 or self.theta_deg[-1] >= TURN_DEG:
            raise ValueError(f"the array's angles do not rise from 0 to 360; {_AGAIN}")

    def tip_offset_um(self, theta_deg: float) -> Array:
        """Return tip minus head position in the robot frame, shape (2,), um."""
        left = [np.interp(theta_deg, self.theta_deg, v, period=TURN_DEG) for v in (self.dx_um, self.dy_um)]
        return self.circle.tip_offset_um(theta_deg) + np.array(left)


def tip_offsets_um(head: Head, theta_deg: ArrayLike) -> Array:
    """Return tip minus head position for many angles (N,), shape (N, 2), um."""
    angles = np.atleast_1d(np.asarray(theta_deg, dtype=float))
    return np.array([head.tip_offset_um(float(theta)) for theta in angles]).reshape(-1, 2)


def head_to_dict(head: Head) -> dict[str, Any]:
    """Return a head as plain numbers, lists and names for JSON; ValueError for a kind that has no such form."""
    match head:
        case CircleHead():
            return {"kind": "circle", **_circle_dict(head)}
        case FourierHead():
            pairs = [[c.real, c.imag] for c in (head.constant_um, *head.coefficients_um)]
            return {"kind": "fourier", "constant_um": pairs[0], "coefficients_um": pairs[1:]}
        case ArrayHead():
            columns = {"theta_deg": head.theta_deg, "dx_um": head.dx_um, "dy_um": head.dy_um}
            return {"kind": "array", **_circle_dict(head.circle), **{name: list(v) for name, v in columns.items()}}
    raise ValueError(f"a {type(head).__name__} cannot be stored; give a circle, a Fourier series or an array")


def head_from_dict(raw: Any) -> Head:
    """Read a head back; ValueError that says to calibrate the rotation again for anything else."""
    try:
        match raw["kind"]:
            case "circle":
                return _circle(raw)
            case "fourier":
                terms = [complex(*_numbers(pair, 2)) for pair in (raw["constant_um"], *raw["coefficients_um"])]
                return FourierHead(tuple(terms[1:]), terms[0])
            case "array":
                return ArrayHead(_circle(raw), *(_numbers(raw[name]) for name in ("theta_deg", "dx_um", "dy_um")))
            case kind:
                raise ValueError(f"its kind is {kind!r}; {_AGAIN}")
    except KeyError as exc:
        raise ValueError(f"not a head: {exc} is missing; {_AGAIN}") from exc
    except (TypeError, ValueError, OverflowError) as exc:
        raise ValueError(f"not a head: {exc}" + ("" if _AGAIN in str(exc) else f"; {_AGAIN}")) from exc


_AGAIN = "calibrate the rotation again"


def _vector(place: complex) -> Array:
    """Return a complex place as x and y."""
    return np.array([place.real, place.imag])


def _circle(raw: Any) -> CircleHead:
    return CircleHead(*_numbers((raw["radius_um"], raw["phase_deg"])))


def _circle_dict(circle: CircleHead) -> dict[str, float]:
    return {"radius_um": circle.radius_um, "phase_deg": circle.phase_deg}


def _numbers(values: Iterable[Any], count: int | None = None) -> tuple[float, ...]:
    """Return numbers as floats; ValueError for text, booleans and a wrong count (JSON is not asked to guess)."""
    listed = tuple(values)
    if count is not None and len(listed) != count:
        raise ValueError(f"{len(listed)} numbers where {count} belong")
    for value in listed:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f"{value!r} is not a number")  # noqa: TRY004 (what is read is wrong, not the call)
    return tuple(float(value) for value in listed)
