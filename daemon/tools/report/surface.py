"""Page of the surface below the probe."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from daemon.storage.calibration_records import SurfaceRecord
from daemon.tools.report.page import Number, PageVerdict, Plot
from daemon.tools.report.svg import BAD, INK, MAIN, MUTED, SECOND, new_figure, to_svg
from vision.geometry import Array, Surface

SUBJECT: Final = "Surface below the needle"
RAMP: Final = "viridis"
"""Told apart by those who see no red and green, and readable on light and dark alike."""


def verdict(record: SurfaceRecord) -> PageVerdict:
    """Say whether it is planar, as the record decided."""
    what = "planar" if record.planar else "not planar"
    because = (
        f"The surface is {what}: the touches differ by {_spread_um(record):.1f} um in height (limit "
        f"{record.limit_um:.1f} um). {_used(record)} touches are described by a plane to {record.rms_um:.1f} um rms, "
        f"{record.flatness_um:.1f} um from peak to valley."
    )
    return PageVerdict(record.planar, because)


def _spread_um(record: SurfaceRecord) -> float:
    """Return the highest touch minus the lowest: the same height everywhere is what the thesis calls planar."""
    return float(np.ptp(_places(record)[1]))


def _used(record: SurfaceRecord) -> str:
    """Return how many touches the plane was fitted to, of how many."""
    return f"{int(_surface(record).used.sum())} of {len(record.touches)}"


def _places(record: SurfaceRecord) -> tuple[Array, Array]:
    """Return X, Y (N, 2) and heights (N,), um; ValueError if touches and residuals do not belong together."""
    if not record.touches or len(record.touches) != len(record.residuals_um):
        raise ValueError(
            f"{len(record.touches)} touches and {len(record.residuals_um)} residuals do not belong together; "
            "calibrate the surface again"
        )
    at = np.array([(touch.x_um, touch.y_um) for touch in record.touches])
    return at, np.array([touch.height_um for touch in record.touches])


def _surface(record: SurfaceRecord) -> Surface:
    """Return the record's plane; ValueError if it is none or of other touches."""
    surface = Surface.from_dict(record.surface)
    if surface.used.shape != (len(record.touches),):
        raise ValueError(
            f"a plane through {surface.used.size} touches in a record of {len(record.touches)}; "
            "calibrate the surface again"
        )
    return surface


def _plane(record: SurfaceRecord, x_um: Array, y_um: Array) -> Array:
    """Return the fitted heights at places of any shape."""
    surface = _surface(record)
    heights = [surface.height_um(float(x), float(y)) for x, y in zip(x_um.ravel(), y_um.ravel(), strict=True)]
    return np.array(heights).reshape(x_um.shape)


def slopes_um_per_100_mm(record: SurfaceRecord) -> tuple[float, float]:
    """Return how much the plane rises along X and along Y."""
    at, _ = _places(record)
    (x, y), far = at.mean(axis=0), 1e5
    here, along_x, along_y = _plane(record, np.array([x, x + far, x]), np.array([y, y, y + far]))
    return float(along_x - here), float(along_y - here)


def numbers(record: SurfaceRecord) -> tuple[Number, ...]:
    """Return the figures of the table."""
    at, _ = _places(record)
    rise_x, rise_y = slopes_um_per_100_mm(record)
    middle = at.mean(axis=0)
    return (
        Number("highest touch minus lowest", _spread_um(record), "um", limit=f"at most {record.limit_um:.1f} um",
               bad=not record.planar),
        Number("left by the plane, peak to valley", record.flatness_um, "um"),
        Number("left by the plane, rms", record.rms_um, "um"),
        Number("touches used", _used(record)),
        Number("plane's height at the middle of the touches", float(_plane(record, middle[:1], middle[1:])[0]), "um"),
        Number("plane rises along X", rise_x, "um / 100 mm"),
        Number("plane rises along Y", rise_y, "um / 100 mm"),
        Number("looks", float(record.looks), "", 0),
        Number("time taken", record.seconds, "s"),
    )  # fmt: skip


def plots(record: SurfaceRecord, previous: SurfaceRecord | None) -> tuple[Plot, ...]:
    """Return the plots."""
    drawn = [_heights(record), _residuals(record)]
    if previous:
        drawn.append(_drift(record, previous))
    return tuple(drawn)


def _grid(at: Array) -> tuple[Array, Array, Array, Array]:
    """Return a grid over the touches with a margin: X and Y in um, then both in mm."""
    low, high = at.min(axis=0), at.max(axis=0)
    room = np.maximum(0.08 * (high - low), 1000.0)
    x, y = np.meshgrid(*(np.linspace(a - r, b + r, 25) for a, b, r in zip(low, high, room, strict=True)))
    return x, y, x / 1e3, y / 1e3


def _level_axes(axes: Axes) -> None:
    axes.set(xlabel="X, mm", ylabel="Y, mm", aspect="equal")
    axes.margins(0.0)


def _contours(axes: Axes, xyz: tuple[Array, Array, Array], label: str) -> None:
    """Draw contours; a field without any slope has none, and says so."""
    if float(np.ptp(xyz[2])) < 0.01:
        axes.set_title(f"{label}: {float(xyz[2].mean()):.1f} um everywhere")
        return
    lines = axes.contour(*xyz, levels=9, colors=MUTED, linewidths=0.9)
    axes.clabel(lines, fmt="%g", fontsize=8, colors=INK)


def _heights(record: SurfaceRecord) -> Plot:
    at, heights = _places(record)
    used, left = _surface(record).used, np.array(record.residuals_um)
    figure, (axes, bars) = new_figure(1, 2, height_in=5.0, ratios=(2.6, 1.0))
    x, y, x_mm, y_mm = _grid(at)
    _contours(axes, (x_mm, y_mm, _plane(record, x, y)), "plane")
    x_at, y_at = at.T / 1e3
    low, high = float(heights[used].min()), float(heights[used].max())
    dots = axes.scatter(x_at, y_at, c=heights, cmap=RAMP, s=70, edgecolors=INK, linewidths=0.7, zorder=3, vmin=low,
                        vmax=high)  # fmt: skip
    if not used.all():
        axes.plot(x_at[~used], y_at[~used], "x", color=BAD, markersize=13, zorder=4, label="left out of the fit")
        figure.legend(loc="outside lower left")
    figure.colorbar(dots, ax=axes, label="height above the nominal touching plane, um")
    _level_axes(axes)
    bars.hist(left[used], bins=min(15, max(5, left.size // 2)), color=MAIN, rwidth=0.92)
    bars.set(ylabel="touches", xlabel="height minus plane, um", title="residuals")
    bars.yaxis.set_major_locator(MaxNLocator(integer=True))
    caption = (
        "Heights where the needle touched (dots) and the fitted plane (contour lines, um); beside them, how far the "
        "touches that were used are off the plane."
    )
    return Plot("Heights", to_svg(figure, "Heights over X and Y with the plane's contours"), caption)


def _residuals(record: SurfaceRecord) -> Plot:
    left, used = np.array(record.residuals_um), _surface(record).used
    figure, (stems,) = new_figure(height_in=3.2)
    number = np.arange(1, left.size + 1)
    stems.axhline(0.0, color=MUTED, linewidth=0.8)
    stems.vlines(number, 0.0, left, color=SECOND, linewidth=1.6)
    stems.plot(number, left, "o", color=SECOND)
    if not used.all():
        stems.plot(number[~used], left[~used], "x", color=BAD, markersize=11, label="left out of the fit")
        stems.legend(loc="best")
    stems.xaxis.set_major_locator(MaxNLocator(integer=True))
    stems.set(xlabel="touch, in order", ylabel="height minus plane, um")
    caption = (
        f"What the plane leaves: {record.rms_um:.1f} um rms. A steady rise or fall from touch to touch is drift of the "
        "needle or of Z, not the surface."
    )
    return Plot("Residuals", to_svg(figure, "Residuals of the plane in the order of the touches"), caption)


def since(record: SurfaceRecord, previous: SurfaceRecord) -> str:
    """Say how far the plane moved."""
    x, y, _, _ = _grid(_places(record)[0])
    return f"the plane moved by {_said(_plane(record, x, y) - _plane(previous, x, y))}."


def _said(apart_um: Array) -> str:
    """Say a difference of two planes over the area in figures."""
    most = float(np.abs(apart_um).max())
    return f"{float(apart_um.mean()):+.1f} um on average, {most:.1f} um at most over the area"


def _drift(record: SurfaceRecord, previous: SurfaceRecord) -> Plot:
    at, _ = _places(record)
    figure, (axes,) = new_figure(height_in=4.6)
    x, y, x_mm, y_mm = _grid(at)
    apart = _plane(record, x, y) - _plane(previous, x, y)
    _contours(axes, (x_mm, y_mm, apart), "new minus previous, um")
    axes.plot(*(at / 1e3).T, "o", color=SECOND)
    _level_axes(axes)
    caption = f"New plane minus previous (contour lines, um; dots: touches): {_said(apart)}."
    return Plot("Drift since the previous calibration", to_svg(figure, "Difference of the planes"), caption)
