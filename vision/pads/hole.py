"""Hole in a pad: dark, round, near the middle; and what only looks like one."""

from __future__ import annotations

import numpy as np

from vision.core import CircleFit, Contour, Edgels, components, fit_circle, quantile
from vision.pads.patch import Patch
from vision.pads.window import Window

HOLE_DEPTH = 0.30
"""A hole is darker than its pad by at least this share of the pad's contrast."""
HOLE_LEAST, HOLE_LARGEST, HOLE_WANDER = 0.12, 0.62, 0.32
"""A hole's radius as a share of its pad's, and how far a drill wanders; marks are smaller or lie anywhere."""
HOLE_WITH_EDGE_PX, HOLE_VISIBLE, HOLE_COVERAGE = 3.6, 0.45, 0.55
"""Holes at least this large have a rim to lie on, visible for this share, of which this share shows an edge."""
DRILL_SHARE, DRILL_SLACK_PX = 0.35, 1.2
"""A first idea of a hole meets CAD's radius within this share, but at least this many px."""
RING_SHARE, RING_LIKENESS = 0.44, 0.08
"""A ring's inside is wider than this share of it and as bright as the board to this share of its step."""
DIP_RADIUS_PX, DIP_SHARE = 10.0, 0.12
"""Of pads smaller than this the middle may be a hole though it is not dark: duller than the ring by this share."""


def find_hole(
    window: Window, edgels: Edgels, circle: CircleFit, patch: Patch, step: float, level: float
) -> Contour | None:
    """Return a first idea of the dark hole inside a circle, or None where none is seen, or where CAD knows of none."""
    if window.hole_radius_px == 0.0:
        return None
    # Nearer the rim than this the blur alone is dark.
    inner = 1.0 - 1.2 / circle.radius_px
    seen = patch.free & ~window.maybe_hidden[patch.box]
    dark = seen & (patch.rho < inner) & (patch.level < level - max(HOLE_DEPTH * step, 15.0))
    for region in components(dark.astype(np.uint8), 3):
        rows, columns = np.nonzero(region.mask)
        x, y = patch.x_px + region.box[0] + float(np.mean(columns)), patch.y_px + region.box[1] + float(np.mean(rows))
        radius = float(np.sqrt(region.area_px / np.pi / circle.ratio))
        idea = Contour(x, y, max(radius, 1.0))
        if radius >= HOLE_WITH_EDGE_PX:
            # A probe may stand before part of it: the hole is where a circle lies on its edge.
            rim = _hole_rim(window, edgels, idea)
            if rim is None:
                continue
            idea = rim
        elif max(region.box[2:]) > 3.0 * radius + 1.0:
            continue
        off_centre = float(np.hypot(idea.x_px - circle.x_px, idea.y_px - circle.y_px)) / circle.radius_px
        sized = HOLE_LEAST < idea.radius_px / circle.radius_px < HOLE_LARGEST and _as_drilled(window, idea)
        if sized and off_centre < HOLE_WANDER:
            return idea
    return _dip(circle, patch, step) if circle.radius_px < DIP_RADIUS_PX else None


def is_ring(circle: CircleFit, patch: Patch, hole: Contour | None, floor: float, step: float) -> bool:
    """Tell whether a wide hole shows the board itself. A drilled one is mostly darker, or shows what lies below."""
    if hole is None or circle.radius_px < DIP_RADIUS_PX or hole.radius_px < RING_SHARE * circle.radius_px:
        return False
    within = patch.free & (patch.distance_px(hole.x_px, hole.y_px) < 0.7 * hole.radius_px)
    return bool(within.any()) and abs(quantile(patch.level[within]) - floor) < RING_LIKENESS * step


def _as_drilled(window: Window, idea: Contour) -> bool:
    """Tell whether a dark place is as large as the hole CAD knows of; a probe's dent mostly is not."""
    known = window.hole_radius_px
    return known is None or abs(idea.radius_px - known) < max(DRILL_SHARE * known, DRILL_SLACK_PX)


def _hole_rim(window: Window, edgels: Edgels, idea: Contour) -> Contour | None:
    """Return the circle on the edge of a dark region, if there is one."""
    rim = fit_circle(
        edgels,
        idea,
        window.view,
        shape=window.shape,
        reach_px=max(2.0, 0.5 * idea.radius_px),
        bright_inside=False,
        hidden=window.hidden,
        maybe_hidden=window.maybe_hidden,
    )
    if rim is None or rim.coverage < HOLE_COVERAGE or rim.visible < HOLE_VISIBLE:
        return None
    return rim.contour


def _dip(circle: CircleFit, patch: Patch, step: float) -> Contour | None:
    """Return a hole too small for its blur to be dark: the middle of a small pad, duller than the ring round it.

    A small pad without a hole is brightest in its middle.
    """
    middle_part, ring = patch.free & (patch.rho < 0.45), patch.free & (patch.rho > 0.4) & (patch.rho < 0.75)
    if np.count_nonzero(middle_part) < 5 or np.count_nonzero(ring) < 8:
        return None
    crest = quantile(patch.level[ring], 0.7)
    depth = np.where(middle_part, np.clip(crest - patch.level, 0.0, None), 0.0)
    if float(depth[middle_part].mean()) < DIP_SHARE * step:
        return None
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    total = float(depth.sum())
    x, y = float((depth * columns).sum()) / total, float((depth * rows).sum()) / total
    return Contour(patch.x_px + x, patch.y_px + y, 0.4 * circle.radius_px)
