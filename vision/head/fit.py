"""Fit of a head to a rotational record: rows of (theta, x, y) in, a judged model out (thesis 6.2, figure 6.6, eq. 6.8).

At each head angle the robot brings the tip onto one resting control point C and logs the head's position, so
`P(theta) = C - offset(theta)`. All arrays are (N,), um and degrees, one row per angle. Each model is judged by
leaving each row out in turn: its own residuals flatter it. `fit_circle` and `total_error_um` are this room's as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from vision.head.circle import Complex, HeadCircleFit, fit_circle, fit_rotation, planar
from vision.head.fourier import Series, choose_series, fit_series, rms
from vision.head.model import Array, ArrayHead, CircleHead, FourierHead, Head, tip_offsets_um
from vision.head.outliers import Flags, find_sound
from vision.head.record import check_record, largest_gap_deg
from vision.head.total_error import TotalError, total_error_um

__all__ = [
    "HeadCircleFit", "HeadFit", "OrderRow", "TotalError", "fit_circle", "fit_head", "head_positions_um", "order_table",
    "total_error_um",
]  # fmt: skip

Kind = Literal["fourier", "array", "circle"]
Choice = Literal["auto", "fourier", "array", "circle"]
MOST_OUTLIERS = 0.25
LEAST_RADIUS_UM, LEAST_ROUNDNESS = 1.0, 40.0
"""A circle is there when the arm is longer than this, and than so many times what a rigid rotation leaves over (128 for
appendix D)."""
FAINT_UM = 1.0
"""Harmonics above the order together move the tip by less than this (rms); they are dropped."""


@dataclass(frozen=True)
class HeadFit:
    """A fitted head and how far it can be trusted.

    head: the model. order: highest harmonic of a Fourier series, else None. control_um: the control point C; by
    convention the circle's centre, for nothing that is constant in the robot frame can be told from it (of a plain
    circle its own). circle: through the rows used. residuals_um: (N, 2) model minus measured head position, every row.
    used: (N,) False for outliers. rms_um: of the residuals' lengths, rows used. holdout_rms_um, holdout_max_um: of the
    same rows, each left out in turn.
    largest_gap_deg: between neighbouring angles used; the part of a gap in the forbidden band does not count.
    """

    head: Head
    kind: Kind
    order: int | None
    control_um: tuple[float, float]
    circle: HeadCircleFit
    residuals_um: Array
    used: Flags
    rms_um: float
    holdout_rms_um: float
    holdout_max_um: float
    largest_gap_deg: float


@dataclass(frozen=True)
class OrderRow:
    """What a plain least-squares series of one order leaves over: rms, and rms with each row left out, um."""

    order: int
    rms_um: float
    holdout_rms_um: float


@dataclass(frozen=True)
class _Candidate:
    """A head on trial: what is constant, and the lengths of the leave-one-out errors of the rows used."""

    head: Head
    kind: Kind
    order: int | None
    control: complex
    holdout_um: Array


def fit_head(
    theta_deg: ArrayLike,
    x_um: ArrayLike,
    y_um: ArrayLike,
    *,
    model: Choice = "auto",
    max_order: int = 10,
) -> HeadFit:
    """Fit a head to head positions recorded with the tip on one control point.

    "auto" takes the kind with the smallest leave-one-out error. Outliers (up to a quarter of the rows) are named in
    `used` and do not count; of fewer than 16 rows only those off by more than 4 % of the arm can be told. A control
    point that moved for good during the run looks like run-out: touch the first angle again at the end.

    Raises ValueError, with what to do, for fewer than six rows, wrong shapes, numbers that are not finite, an angle
    twice or in the forbidden band, angles in half a turn only, more than a quarter of outliers, or positions that are
    not on a circle (an axis mirrored, the control point moved).
    """
    theta, points = check_record(theta_deg, planar(x_um, y_um))
    if max_order < 1:
        raise ValueError(f"max_order is {max_order}; give at least 1")
    if model not in get_args(Choice):
        raise ValueError(f"model {model!r}; choose one of {', '.join(get_args(Choice))}")
    # The head stands where the tip is not: P = C - offset. In `place` the signs are turned: -P = offset - C.
    place = -(points[:, 0] + 1j * points[:, 1])
    used = find_sound(theta, place, max_order)
    if (share := 1.0 - used.mean()) > MOST_OUTLIERS:
        angles = ", ".join(f"{t:g}" for t in theta[~used][:12])
        raise ValueError(
            f"{share:.0%} of the rows do not fit any smooth head (at {angles} deg); see that the control point "
            "rests and the axes are homed, and record the rotation again"
        )
    t, z = theta[used], place[used]
    _check_circle(t, z)
    fitters: dict[str, Callable[[], _Candidate]] = {
        "circle": lambda: _try_circle(t, z),
        "fourier": lambda: _try_fourier(t, z, max_order),
        "array": lambda: _try_array(t, z),
    }
    tried = [fit() for kind, fit in fitters.items() if model in {"auto", kind}]
    return _judged(min(tried, key=lambda candidate: rms(candidate.holdout_um)), theta, points, used)


def order_table(theta_deg: ArrayLike, x_um: ArrayLike, y_um: ArrayLike, *, max_order: int = 10) -> tuple[OrderRow, ...]:
    """Return what plain series of order 1, 2, .. leave over, as far as the rows can carry them.

    No prior and no outlier search: this is the table to look at, not the model to use. Raises ValueError as `fit_head`.
    """
    theta, points = check_record(theta_deg, planar(x_um, y_um))
    place = points[:, 0] + 1j * points[:, 1]
    carried = (order for order in range(1, max_order + 1) if 2 * order + 1 < len(theta))
    fits = (fit_series(theta, place, order, 0.0) for order in carried)
    return tuple(OrderRow(fit.order, rms(fit.residual), fit.deleted_rms_um) for fit in fits)


def head_positions_um(head: Head, control_um: tuple[float, float], theta_deg: ArrayLike) -> Array:
    """Return where the head stands with the tip on the control point, for angles (N,), shape (N, 2), um."""
    return np.asarray(control_um) - tip_offsets_um(head, theta_deg)


def _judged(best: _Candidate, theta: Array, points: Array, used: Flags) -> HeadFit:
    """Put the result together, with residuals for every row."""
    circle = fit_circle(*points[used].T)
    best = _anchored(best, complex(*circle.centre_um))
    control = (float(best.control.real), float(best.control.imag))
    residuals = head_positions_um(best.head, control, theta) - points
    return HeadFit(
        head=best.head,
        kind=best.kind,
        order=best.order,
        control_um=control,
        circle=circle,
        residuals_um=residuals,
        used=used,
        rms_um=rms(np.hypot(*residuals[used].T)),
        holdout_rms_um=rms(best.holdout_um),
        holdout_max_um=float(best.holdout_um.max()),
        largest_gap_deg=largest_gap_deg(theta[used]),
    )


def _anchored(best: _Candidate, centre: complex) -> _Candidate:
    """Say that the control point is the circle's centre, which two records of one head agree on.

    What a series makes of the forbidden band decides over its own constant, and differs by tens of um from record to
    record; a board aligned by one calibration would then be off by as much in the next.
    """
    aside = centre - best.control
    match best.head:
        case FourierHead() as head:
            return replace(best, head=replace(head, constant_um=aside), control=centre)
        case ArrayHead() as head:
            dx, dy = (tuple(v + c for v in vs) for vs, c in ((head.dx_um, aside.real), (head.dy_um, aside.imag)))
            return replace(best, head=replace(head, dx_um=dx, dy_um=dy), control=centre)
        case _:
            return best


def _check_circle(theta: Array, place: Complex) -> None:
    """Raise ValueError if no rigid rotation is to be seen, with the likely cause."""
    centre, arm = fit_rotation(theta, place)
    left = rms(place - centre - arm * np.exp(1j * np.radians(theta)))
    if abs(arm) > LEAST_RADIUS_UM + LEAST_ROUNDNESS * left:
        return
    other, back = fit_rotation(-theta, place)
    if abs(back) > LEAST_RADIUS_UM + LEAST_ROUNDNESS * rms(place - other - back * np.exp(-1j * np.radians(theta))):
        raise ValueError("the positions go round the wrong way; an axis is mirrored or theta counts clockwise")
    raise ValueError(
        f"no circle is to be seen: a rotation of radius {abs(arm):.0f} um leaves {left:.0f} um rms; see that the "
        "control point rests and the tip really stands on it, and record the rotation again"
    )


def _try_circle(theta: Array, place: Complex) -> _Candidate:
    series = fit_series(theta, place, 1, 1e9)  # so strong a prior leaves the control point and the circle alone
    head, control = _circle_of(theta, place)
    return _Candidate(head, "circle", None, control, np.abs(series.deleted))


def _try_fourier(theta: Array, place: Complex, max_order: int) -> _Candidate:
    series = _trimmed(choose_series(theta, place, max_order), theta, place)
    k = series.order
    head = FourierHead(tuple(complex(c) for i, c in enumerate(series.coefficients) if i != k))
    return _Candidate(head, "fourier", k, -complex(series.coefficients[k]), np.abs(series.deleted))


def _trimmed(series: Series, theta: Array, place: Complex) -> Series:
    """Return the series refitted without the highest harmonics where they move nothing."""
    size = np.abs(series.coefficients) ** 2
    k = series.order
    while k > 1 and math.sqrt(size[: series.order - k + 1].sum() + size[series.order + k :].sum()) < FAINT_UM:
        k -= 1
    return fit_series(theta, place, k, series.strength) if k < series.order else series


def _try_array(theta: Array, place: Complex) -> _Candidate:
    head, control = _array_of(theta, place)
    rows = np.arange(len(theta))
    off = []
    for row in rows:
        other, middle = _array_of(theta[rows != row], place[rows != row])
        x, y = other.tip_offset_um(float(theta[row]))
        off.append(abs(complex(x, y) - middle - place[row]))
    return _Candidate(head, "array", None, control, np.array(off))


def _circle_of(theta: Array, place: Complex) -> tuple[CircleHead, complex]:
    """Return the rigid rotation and the control point."""
    centre, arm = fit_rotation(theta, place)
    return CircleHead(abs(arm), math.degrees(math.atan2(arm.imag, arm.real))), -centre


def _array_of(theta: Array, place: Complex) -> tuple[ArrayHead, complex]:
    """Return the thesis' array, the rows in rising order, and the control point."""
    circle, control = _circle_of(theta, place)
    order = np.argsort(theta)
    offset = tip_offsets_um(circle, theta[order])
    left = place[order] + control - (offset[:, 0] + 1j * offset[:, 1])
    columns = (tuple(float(v) for v in column) for column in (theta[order], left.real, left.imag))
    return ArrayHead(circle, *columns), control
