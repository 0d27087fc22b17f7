"""Plots of a rotation: circle, residuals, linearity, landings, errors, drift (thesis figures 6.6 .. 6.11)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle as Ring

from daemon.storage.calibration_records import TrialLanding
from daemon.tools.report.page import Plot
from daemon.tools.report.rotation_facts import (
    FORBIDDEN_DEG,
    Drift,
    Linearity,
    Rotation,
    allowed_stretches,
    lengths_um,
)
from daemon.tools.report.svg import BAD, BAND, INK, MAIN, MUTED, SECOND, TIMES, WARM, new_figure, to_svg
from vision.geometry import Array

RINGS_UM: Final = (50.0, 100.0, 200.0)
MOST_SHOWN_UM: Final = 300.0
"""A landing farther off is drawn at the edge; one far stray would otherwise shrink all others to a dot."""
MAGNIFIED: Final = (50, 20, 10, 5, 2, 1)
LONGEST_ARROW: Final = 0.55
"""Of the radius."""


def circle_plot(rotation: Rotation) -> Plot:
    """Draw the stops in X-Y, with what the circle and what the model leaves as magnified arrows."""
    figure, (left, right) = new_figure(1, 2, height_in=5.3)
    ideal = rotation.ideal_um(rotation.theta_deg)
    out = (ideal - rotation.centre_um) / rotation.radius_um
    radial = rotation.polar(rotation.theta_deg, rotation.stops_um).radial_um[:, None] * out
    times = _magnification(rotation, radial)
    _stops(left, rotation, radial, WARM, times, "off the circle, radially")
    _stops(right, rotation, rotation.left_um, MAIN, times, "left by the head model")
    longest_um = max(_longest_um(rotation, radial), _longest_um(rotation, rotation.left_um))
    reach = (1.06 * rotation.radius_um + times * longest_um) / 1e3
    for axes in (left, right):
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    x, y = rotation.centre_um
    caption = (
        f"Where the head stood with the tip on the control point, from the circle's centre at X {x:.1f}, Y {y:.1f} um "
        f"(circle: radius {rotation.radius_um:.1f} um, {rotation.record.circle.rms_um:.1f} um rms). Arrows show, "
        "magnified, how far each stop is off the circle (left) and off the head model (right). A perfect head would "
        "leave no arrows on the left."
    )
    return Plot("Circle of the stops", to_svg(figure, "Circle of the stops in X and Y with residual arrows"), caption)


def _longest_um(rotation: Rotation, arrows_um: Array) -> float:
    """Return the longest arrow's length without magnification."""
    return float(np.linalg.norm(arrows_um[rotation.used], axis=1).max())


def _magnification(rotation: Rotation, arrows_um: Array) -> int:
    """Return 50 (fig. 6.10), or less where the arrows would cross the whole circle."""
    longest, room = _longest_um(rotation, arrows_um), LONGEST_ARROW * rotation.radius_um
    return next((m for m in MAGNIFIED if m * longest <= room), MAGNIFIED[-1])


def _stops(axes: Axes, rotation: Rotation, arrows_um: Array, colour: str, times: int, what: str) -> None:
    """Draw circle, stops and arrows, in mm from the centre."""
    at, away = (rotation.stops_um - rotation.centre_um) / 1e3, arrows_um * times / 1e3
    radius_mm = rotation.radius_um / 1e3
    axes.add_patch(Ring((0.0, 0.0), radius_mm, fill=False, color=MUTED, linewidth=0.9))
    used = rotation.used
    axes.quiver(*at[used].T, *away[used].T, color=colour, angles="xy", scale_units="xy", scale=1.0, width=0.0032)
    axes.plot(*at[used].T, ".", color=INK, markersize=3, label="measured stop")
    if not used.all():
        axes.plot(*at[~used].T, "x", color=BAD, markersize=7, label="stop left out")
    axes.set(aspect="equal", xlabel="X from the centre, mm",
             ylabel="Y from the centre, mm", title=f"{what}, {TIMES}{times}")  # fmt: skip
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def residual_plot(rotation: Rotation) -> Plot:
    """Draw the deviations over theta, the model's course through them, and what it leaves."""
    figure, rows = new_figure(3, 1, height_in=7.6, sharex=True)
    seen, left = rotation.polar(rotation.theta_deg, rotation.stops_um), rotation.polar_left()
    curves = [(theta, rotation.polar(theta, rotation.modelled_um(theta))) for theta in allowed_stretches()]
    panels = (("radial_um", "radial, um", "from the circle, outwards"),
              ("tangential_um", "tangential, um", "from the circle, ahead in the sense of turning"))  # fmt: skip
    for axes, (name, label, title) in zip(rows[:2], panels, strict=True):
        values = getattr(seen, name)
        _dots(axes, rotation, values, SECOND, "measured stop")
        for k, (theta, curve) in enumerate(curves):
            axes.plot(theta, getattr(curve, name), color=MAIN, label="head model" if k == 0 else None)
        axes.set(ylabel=label, title=title)
    _dots(rows[2], rotation, left.radial_um, WARM, "radial")
    _dots(rows[2], rotation, left.tangential_um, SECOND, "tangential")
    rows[2].set(ylabel="residual, um", title="left by the head model", xlabel="head angle θ, deg")
    shown = ((seen.radial_um,), (seen.tangential_um,), (left.radial_um, left.tangential_um))
    for axes, values in zip(rows, shown, strict=True):
        _scale_to_used(axes, rotation, values)
        _band(axes)
        axes.legend(loc="upper right", ncols=4)
    caption = (
        f"A rigid rotation leaves {rotation.rigid_rms_um:.1f} um rms, the circle alone "
        f"{rotation.record.circle.rms_um:.1f} um rms radially, the head model {rotation.record.rms_um:.1f} um rms. "
        "Shaded: angles the head may not take."
    )
    return Plot("Residuals over θ", to_svg(figure, "Radial and tangential residuals over the head angle"), caption)


def _dots(axes: Axes, rotation: Rotation, values: Array, colour: str, label: str) -> None:
    """Draw values at the stops, those left out as red crosses."""
    used = rotation.used
    axes.plot(rotation.theta_deg[used], values[used], "o", color=colour, markersize=3.4, label=label)
    if not used.all():
        taken = {text for text in axes.get_legend_handles_labels()[1] if text == "left out"}
        axes.plot(rotation.theta_deg[~used], values[~used], "x", color=BAD, markersize=7,
                  label=None if taken else "left out")  # fmt: skip


def _scale_to_used(axes: Axes, rotation: Rotation, values: Sequence[Array]) -> None:
    """Scale by the stops that were used, with room for the legend; a far one left out is an arrow at the edge."""
    inside = np.concatenate([v[rotation.used] for v in values])
    low, high = float(min(inside.min(), 0.0)), float(max(inside.max(), 0.0))
    size = max(high - low, 1.0)
    low, high = low - 0.2 * size, high + 0.4 * size
    axes.set_ylim(low, high)
    for v in values:
        for k in np.flatnonzero(~rotation.used & ((v < low) | (v > high))):
            up = v[k] > high
            at = (rotation.theta_deg[k], (high - 0.06 * size) if up else (low + 0.06 * size))
            axes.plot(*at, "^" if up else "v", color=BAD)
            axes.annotate(f"left out: {v[k]:+.0f} um", at, xytext=(7, 0), va="center", textcoords="offset points",
                          fontsize=8.5, color=BAD)  # fmt: skip


def _band(axes: Axes) -> None:
    """Shade the forbidden angles and lay the axis from 0 to 360."""
    axes.axvspan(*FORBIDDEN_DEG, color=BAND, linewidth=0, zorder=0)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=1)
    axes.set(xlim=(-4, 364), xticks=range(0, 361, 30))


def linearity_plot(facts: Linearity) -> Plot:
    """Draw distances in the picture against distances of the head, and what a straight line leaves."""
    figure, (left, right) = new_figure(1, 2, height_in=3.9)
    where = f"θ = {facts.theta_deg:g}°" if facts.theta_deg is not None else "all angles"
    if len(facts.others_px):
        left.plot(facts.others_px, facts.others_um, ".", color=MUTED, alpha=0.6, markersize=4, label="other angles")
    left.plot(facts.image_px, facts.robot_um, "o", color=SECOND, label=where)
    end = float(facts.image_px.max()) * 1.05
    left.plot((0, end), (0, end * facts.um_per_px), color=MAIN, label=f"{facts.um_per_px:.2f} um per px")
    left.set(xlabel="distance in the picture |d_im|, px", ylabel="distance of the head |d_w|, um", title=where,
             xlim=(0, None), ylim=(0, None))  # fmt: skip
    left.legend(loc="upper left")
    right.axhline(0.0, color=MAIN)
    right.vlines(facts.image_px, 0, facts.residual_um, color=SECOND, linewidth=1)
    right.plot(facts.image_px, facts.residual_um, "o", color=SECOND)
    right.set(xlabel="distance in the picture |d_im|, px", ylabel="residual, um", title="left by the straight line",
              xlim=(0, None))  # fmt: skip
    rms = float(np.sqrt((facts.residual_um**2).mean()))
    caption = (
        f"{len(facts.image_px)} moves from the sighting nearest to the stop; the line leaves {rms:.1f} um rms. "
        "The camera looks obliquely: a pixel along the view is worth more um than one across it, which a single slope "
        "cannot show and the pose map does."
    )
    return Plot("Linearity of the map", to_svg(figure, f"Image distance against robot distance, {where}"), caption)


def landing_plot(before: Sequence[TrialLanding], after: Sequence[TrialLanding]) -> Plot:
    """Draw where the tip landed by calculation alone, before and after, on one scale."""
    figure, (left, right) = new_figure(1, 2, height_in=5.4)
    farthest = max([1.15 * RINGS_UM[-1], *(float(a.max()) for a in map(lengths_um, (before, after)) if a.size)])
    reach = min(1.06 * farthest, MOST_SHOWN_UM)
    _target(left, before, reach, WARM, "before, by the model then in force")
    _target(right, after, reach, MAIN, "after, by the new model")
    caption = (
        "Where the tip was from the control point after one jump, without looking. Before: at the stops. After: at "
        f"angles that were not fitted, looked at afterwards. Rings at {', '.join(f'{r:.0f}' for r in RINGS_UM)} um."
    )
    return Plot("First landings", to_svg(figure, "Landings before and after, with rings"), caption)


def share_within(landings: Sequence[TrialLanding], limit_um: float) -> str:
    """Return how many landings are within a distance, in words and percent."""
    lengths = lengths_um(landings)
    if not lengths.size:
        return "none tried"
    good = int((lengths <= limit_um).sum())
    return f"{good} of {lengths.size} within {limit_um:.0f} um ({100 * good / lengths.size:.1f} %)"


def _target(axes: Axes, landings: Sequence[TrialLanding], reach_um: float, colour: str, title: str) -> None:
    """Draw one target; landings beyond its edge are put on the edge as triangles and counted."""
    for ring in RINGS_UM:
        axes.add_patch(Ring((0, 0), ring, fill=False, color=BAD if ring == RINGS_UM[-1] else MUTED, linewidth=1.0))
        axes.annotate(f"{ring:.0f}", (0, ring), xytext=(2, 1), textcoords="offset points", fontsize=8, color=MUTED)
    at = np.array([(landing.dx_um, landing.dy_um) for landing in landings]).reshape(-1, 2)
    far = np.abs(at).max(axis=1, initial=0.0) > reach_um
    axes.plot(*at[~far].T, "o", color=colour, markersize=4, alpha=0.8)
    if far.any():
        edge = at[far] / np.abs(at[far]).max(axis=1)[:, None] * reach_um
        axes.plot(*edge.T, "^", color=BAD, clip_on=False, label=f"{int(far.sum())} farther off than shown")
        axes.legend(loc="lower left")
    axes.set(xlim=(-reach_um, reach_um), ylim=(-reach_um, reach_um), aspect="equal", xlabel="ΔX, um", ylabel="ΔY, um",
             title=f"{title}\n{share_within(landings, RINGS_UM[-1])}")  # fmt: skip


def error_plot(rotation: Rotation) -> Plot:
    """Draw which share of fit residuals and landings is within a distance, with the hold-out error marked."""
    record = rotation.record
    figure, (axes,) = new_figure(height_in=3.7)
    parts = (("left by the fit", np.linalg.norm(rotation.left_um[rotation.used], axis=1), SECOND),
             ("landings before", lengths_um(record.before), WARM),
             ("landings after", lengths_um(record.after), MAIN))  # fmt: skip
    for label, lengths, colour in parts:
        if lengths.size:
            ordered = np.r_[0.0, np.sort(lengths)]
            axes.plot(ordered, np.linspace(0, 100, ordered.size), color=colour, drawstyle="steps-post",
                      label=f"{label}, at most {lengths.max():.1f} um")  # fmt: skip
    axes.axvline(record.holdout_rms_um, color=INK, linestyle="--", linewidth=1.1,
                 label=f"hold-out, rms {record.holdout_rms_um:.1f} um")  # fmt: skip
    axes.axvline(record.holdout_max_um, color=INK, linestyle=":", linewidth=1.3,
                 label=f"hold-out, largest {record.holdout_max_um:.1f} um")  # fmt: skip
    farthest = max([record.holdout_max_um, *(float(lengths.max()) for _, lengths, _ in parts if lengths.size)])
    axes.set(xlabel="distance, um", ylabel="share within it, %", xlim=(0, min(1.04 * farthest, MOST_SHOWN_UM)),
             ylim=(0, 101))  # fmt: skip
    axes.legend(loc="lower right")
    caption = (
        "Hold-out: stops predicted by a model that was fitted without them; what to expect at an angle that was never "
        f"measured. It is {record.holdout_rms_um:.1f} um rms and {record.holdout_max_um:.1f} um at most, where the fit "
        f"itself leaves {record.rms_um:.1f} um rms."
    )
    return Plot("Hold-out error", to_svg(figure, "Share of residuals and landings within a distance"), caption)


def drift_plot(drift: Drift) -> Plot:
    """Draw the difference of two models over theta."""
    figure, (axes,) = new_figure(height_in=3.5)
    for k, (theta, radial, tangential, length) in enumerate(drift.stretches):
        first = k == 0
        axes.plot(theta, length, color=INK, linewidth=2, label="distance" if first else None)
        axes.plot(theta, radial, color=WARM, label="outwards" if first else None)
        axes.plot(theta, tangential, color=SECOND, label="ahead in the sense of turning" if first else None)
    _band(axes)
    low, high = axes.get_ylim()
    axes.set(ylim=(low, high + 0.16 * (high - low)), xlabel="head angle θ, deg", ylabel="new minus previous, um")
    axes.legend(loc="upper right", ncols=3)
    dx, dy = drift.centre_um
    caption = (
        f"How far the new model puts the tip from where the previous one had it: {drift.rms_um:.1f} um rms, "
        f"{drift.max_um:.1f} um at most. Radius {drift.radius_um:+.1f} um, direction {drift.phase_deg:+.3f} deg. "
        f"The circle's centre moved by ({dx:+.1f}, {dy:+.1f}) um: the control point lies elsewhere or the axes have "
        "shifted; that is not the head."
    )
    svg = to_svg(figure, "Difference of the models over the head angle")
    return Plot("Drift since the previous calibration", svg, caption)
