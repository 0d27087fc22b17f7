"""Page of a map from image to robot."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from daemon.storage.calibration_records import MapRecord
from daemon.tools.report.page import Number, PageVerdict, Plot
from daemon.tools.report.svg import BAD, INK, MAIN, MUTED, SECOND, TIMES, new_figure, to_svg
from vision.geometry import Array, PoseMap, jacobian, rotation

SUBJECT: Final = "Map from image to robot"
MAGNIFIED: Final = (100, 50, 20, 10, 5, 2, 1)
GRID: Final = 11


@dataclass(frozen=True)
class Mapped:
    """A record with its map, and what follows from both."""

    record: MapRecord
    pose_map: PoseMap

    @classmethod
    def of(cls, record: MapRecord) -> Mapped:
        """Read the map; ValueError if the record holds none, or no sightings."""
        if not record.sightings:
            raise ValueError("the map was made of no sightings; calibrate the map again")
        return cls(record, PoseMap.from_json(json.dumps(record.pose_map)))

    @property
    def seen_px(self) -> Array:
        """Pixels of the mark, (N, 2)."""
        return np.array([seen.target_px for seen in self.record.sightings])

    @property
    def below_px(self) -> Array:
        """Pixel of the place below the tip, (2,)."""
        return np.add(self.record.tip_px, self.pose_map.below_px())

    def residuals_um(self) -> Array:
        """Return what the map leaves at each sighting, head frame, (N, 2).

        The mark's own place is unknown and differs between head angles by the run-out: it is taken out, as in the fit.
        """
        seen = self.record.sightings
        mapped = self.pose_map.to_head_um(self.seen_px)
        left = np.array([m - rotation(-s.theta_deg) @ (-s.x_um, -s.y_um) for m, s in zip(mapped, seen, strict=True)])
        theta = np.array([round(s.theta_deg, 3) for s in seen])
        for angle in np.unique(theta):
            left[theta == angle] -= np.median(left[theta == angle], axis=0)
        return left

    def scales_um_per_px(self) -> tuple[float, float]:
        """Return the worth of a pixel below the tip, across the view and along it."""
        along, across = np.linalg.svd(jacobian(self.pose_map.homography, self.below_px), compute_uv=False)
        return float(across), float(along)

    def view_deg(self) -> float:
        """Return how obliquely the place below the tip is seen: 0 is straight from above."""
        across, along = self.scales_um_per_px()
        return math.degrees(math.acos(min(1.0, across / along)))

    def region_px(self) -> Array:
        """Return the outline of the region the map holds in, (N, 2) px."""
        turn = np.linspace(0.0, 2 * math.pi, 181)
        ring = self.pose_map.radius_um * np.column_stack([np.cos(turn), np.sin(turn)])
        return self.pose_map.to_px(ring, self.record.tip_px, 0.0)


@dataclass(frozen=True)
class MapDrift:
    """Where two maps differ: pixels (N, 2) on a grid, and how far apart they put them, (N, 2) um.

    radius_um: of the region in which both were fitted; what one of them extrapolates is no drift.
    """

    at_px: Array
    apart_um: Array
    radius_um: float

    @property
    def rms_um(self) -> float:
        """Root mean square of the distances."""
        return float(np.sqrt((self.apart_um**2).sum(axis=1).mean()))

    @property
    def max_um(self) -> float:
        """The largest distance."""
        return float(np.linalg.norm(self.apart_um, axis=1).max())


def drift(now: Mapped, before: Mapped) -> MapDrift:
    """Compare two maps at the same pixels from the tip, each with its own tip, over the region of both."""
    radius_um = min(now.pose_map.radius_um, before.pose_map.radius_um)
    line = np.linspace(-1.0, 1.0, GRID)
    grid = np.array([(x, y) for x in line for y in line if math.hypot(x, y) <= 1.0]) * radius_um
    at_px = now.pose_map.to_px(grid, now.record.tip_px, 0.0)
    from_tip = at_px - now.record.tip_px
    new = now.pose_map.from_tip_um(at_px, now.record.tip_px, 0.0)
    old = before.pose_map.from_tip_um(from_tip + before.record.tip_px, before.record.tip_px, 0.0)
    return MapDrift(at_px, new - old, radius_um)


def verdict(record: MapRecord) -> PageVerdict:
    """Judge by what the fit left, by the limit that the calibration judged by."""
    left, limit_um = Mapped.of(record).pose_map.residual_um, record.limits.residual_um
    seen = f"{len(record.sightings)} sightings of {record.mark}"
    because = f"{seen} leave {left:.1f} um rms (limit {limit_um:.0f} um)."
    return PageVerdict(left <= limit_um, because)


def numbers(record: MapRecord) -> tuple[Number, ...]:
    """Return the figures of the table."""
    mapped = Mapped.of(record)
    pose_map, (across, along) = mapped.pose_map, mapped.scales_um_per_px()
    limit_um = record.limits.residual_um
    return (
        Number("mark", record.mark),
        Number("sightings", float(len(record.sightings)), "", 0),
        Number("left by the fit, rms", pose_map.residual_um, "um", limit=f"at most {limit_um:.0f} um",
               bad=pose_map.residual_um > limit_um),
        Number("left by the fit, largest", float(np.linalg.norm(mapped.residuals_um(), axis=1).max()), "um"),
        Number("a pixel across the view", across, "um", 3),
        Number("a pixel along the view", along, "um", 3),
        Number("view from the vertical", mapped.view_deg(), "deg", 2),
        Number("region's radius", pose_map.radius_um, "um", 0),
        Number("tip in the picture, x", record.tip_px[0], "px", 2),
        Number("tip in the picture, y", record.tip_px[1], "px", 2),
        Number("below the tip, x from it", pose_map.below_tip_px[0], "px", 2),
        Number("below the tip, y from it", pose_map.below_tip_px[1], "px", 2),
        Number("hover above the touching plane", pose_map.hover_um, "um", 0),
        Number("head angle", record.theta_deg, "deg", 2),
        Number("looks", float(record.looks), "", 0),
        Number("time taken", record.seconds, "s"),
    )  # fmt: skip


def since(record: MapRecord, previous: MapRecord) -> str:
    """Say how far the map moved."""
    found = drift(Mapped.of(record), Mapped.of(previous))
    return f"the map puts places {found.rms_um:.1f} um rms, {found.max_um:.1f} um at most, from where they were."


def plots(record: MapRecord, previous: MapRecord | None) -> tuple[Plot, ...]:
    """Return the plots."""
    mapped = Mapped.of(record)
    drawn = (_sightings(mapped),)
    return (*drawn, _drift(mapped, drift(mapped, Mapped.of(previous)))) if previous else drawn


def _picture(axes: Axes, mapped: Mapped) -> None:
    """Lay out axes as the picture lies, with the region, the tip and the place below it."""
    region = mapped.region_px()
    axes.plot(*region.T, color=MUTED, linewidth=1, label=f"region, {mapped.pose_map.radius_um:.0f} um")
    axes.plot(*mapped.record.tip_px, "v", color=BAD, markersize=7, label="tip")
    axes.plot(*mapped.below_px, "+", color=INK, markersize=10, markeredgewidth=1.6, label="place below the tip")
    axes.set(aspect="equal", xlabel="x, px", ylabel="y (down), px")
    axes.margins(0.16)


def _arrows(axes: Axes, mapped: Mapped, at_px: Array, away_um: Array, colour: str, radius_um: float) -> int:
    """Draw um vectors of the head frame at pixels as the camera would see them; return the magnification.

    The longest is at most a third of `radius_um`, unless it is so long by itself.
    """
    longest = float(np.linalg.norm(away_um, axis=1).max())
    times = next((m for m in MAGNIFIED if m * longest <= 0.35 * radius_um), MAGNIFIED[-1])
    steps = [np.linalg.solve(jacobian(mapped.pose_map.homography, p), a) for p, a in zip(at_px, away_um, strict=True)]
    axes.quiver(*at_px.T, *(times * np.array(steps)).T, color=colour, angles="xy", scale_units="xy", scale=1.0,
                width=0.0028)  # fmt: skip
    return times


def _sightings(mapped: Mapped) -> Plot:
    figure, (axes, table) = new_figure(1, 2, height_in=5.4, ratios=(2.2, 1.0))
    _picture(axes, mapped)
    left = mapped.residuals_um()
    times = _arrows(axes, mapped, mapped.seen_px, left, MAIN, mapped.pose_map.radius_um)
    axes.plot(*mapped.seen_px.T, "o", color=SECOND, markersize=3.5, label="mark seen")
    axes.invert_yaxis()
    axes.set_title(f"residuals {TIMES}{times}")
    lengths = np.sort(np.linalg.norm(left, axis=1))
    table.plot(lengths, 100 * np.arange(1, lengths.size + 1) / lengths.size, color=MAIN, drawstyle="steps-post")
    limit_um = mapped.record.limits.residual_um
    table.axvline(limit_um, color=BAD, linestyle="--", linewidth=1, label=f"limit of the rms, {limit_um:.0f} um")
    table.axvline(
        mapped.pose_map.residual_um, color=INK, linewidth=1, label=f"rms, {mapped.pose_map.residual_um:.1f} um"
    )
    table.set(xlabel="residual, um", ylabel="sightings within it, %", xlim=(0, None), ylim=(0, 101))
    handles, labels = _both(axes, table)
    figure.legend(handles, labels, loc="outside lower center", ncols=6)
    caption = (
        "Where the resting mark was seen, as the picture lies (y down), as if the tip were always at its pixel of the "
        f"map. Arrows: what the map leaves there, magnified {times} times."
    )
    return Plot("Sightings", to_svg(figure, "Sightings in the picture with residual arrows"), caption)


def _drift(mapped: Mapped, found: MapDrift) -> Plot:
    figure, (axes,) = new_figure(height_in=5.0)
    _picture(axes, mapped)
    times = _arrows(axes, mapped, found.at_px, found.apart_um, SECOND, found.radius_um)
    axes.invert_yaxis()
    axes.set_title(f"new minus previous {TIMES}{times}")
    handles, labels = _both(axes)
    figure.legend(handles, labels, loc="outside right center")
    caption = (
        "By how much the new map puts a place, at the same pixels from the tip, elsewhere than the previous one: "
        f"{found.rms_um:.1f} um rms, {found.max_um:.1f} um at most, within {found.radius_um:.0f} um, where both were "
        f"fitted. Arrows magnified {times} times."
    )
    return Plot(
        "Drift since the previous calibration", to_svg(figure, "Difference of the maps over the region"), caption
    )


def _both(*many: Axes) -> tuple[list[Artist], list[str]]:
    """Collect the legend entries of several axes."""
    handles: list[Artist] = []
    labels: list[str] = []
    for axes in many:
        found = axes.get_legend_handles_labels()
        handles.extend(found[0])
        labels.extend(found[1])
    return handles, labels
