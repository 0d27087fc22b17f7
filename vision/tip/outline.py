"""Rough outline of a probe nobody has seen before: its direction, its marking, and its edges down to the end.

Only what every such probe has is assumed: two edges at equal distances from one axis, a dark band across it, and a
width that does not grow towards the end. Highlights make probes inside the probe, so the widest good one is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core import Floats, Plane, derivative
from vision.tip.silhouette import Silhouette, caliper_rows
from vision.tip.strip import ProbeStrip, across_slope, edge_maps, middle_profile

HINT_REACH_DEG = 12.0
CYLINDER_HALVES_PX: Floats = np.arange(8.0, 50.1, 1.0)
"""Half widths that are tried, px, and how much they may grow per px towards the barrel: a long taper need not end at
the marking. A growing one has to show so much more (0..1) of its edges than the best straight one."""
FLARES = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1)
FLARED_LEAD = 0.2
HALF_STEP_PX = 0.5
MOST_NARROWING_PX, MOST_GROWTH_PX = 2.0, 0.5
"""From one caliper to the next a probe narrows by no more, and grows by no more, px."""
WIDER_WORTH = 0.03
"""Of two paths along edges the outer one is the outline: so much is a pixel more worth, in rows."""
RIM2_FROM_PX, RIM2_TO_PX = -250, -40
"""Where the marking's lower rim may be, and how long the marking, px."""
MARKING_FROM_PX, MARKING_TO_PX = 15, 90
LEAST_RIM_SLOPE = 4.0
LEAST_PAIRS = 0.4
LOOKED_FOR = (
    f"a needle {2 * CYLINDER_HALVES_PX[0]:.0f} to {2 * CYLINDER_HALVES_PX[-1]:.0f} px wide with a black band across, "
    f"{MARKING_FROM_PX} to {MARKING_TO_PX} px long, that ends {-RIM2_TO_PX} to {-RIM2_FROM_PX} px before it does"
)
"""The shapes that can be taught."""


@dataclass(frozen=True, slots=True)
class RoughOutline:
    """Hold the probe's turn against the strip, its rims' u, and its outline, good to about 2 px."""

    tilt_rad: float
    rim1_u_px: float
    rim2_u_px: float
    outline: Silhouette


@dataclass(frozen=True, slots=True)
class EdgePairs:
    """Hold where a strip has edges that brighten towards +v, and towards -v, 0 or 1."""

    rising: Plane
    falling: Plane
    u_from_px: int
    reach_px: int

    @classmethod
    def of(cls, strip: ProbeStrip, *, by_ratio: bool = False) -> EdgePairs:
        """Return the edges of a strip, of its brightness or of the brightness' logarithm."""
        rising, falling = edge_maps(across_slope(strip, by_ratio=by_ratio), strip.edge_level)
        return cls(rising, falling, strip.u_from_px, strip.reach_px)

    def pairs(self, u_px: Floats, tilt: float, shift_px: float, halves_px: Floats) -> Floats:
        """Return (rows, halves) 0..1: how much both edges are seen `halves_px` beside the line at rows `u_px`.

        halves_px: (halves,), or (rows, halves) where they differ from row to row.
        """
        rows = (np.rint(u_px).astype(np.intp) - self.u_from_px)[:, None]
        inside = (rows >= 0) & (rows < self.rising.shape[0])
        rows = np.clip(rows, 0, self.rising.shape[0] - 1)
        axis = (tilt * u_px + shift_px)[:, None] + self.reach_px
        last = self.rising.shape[1] - 1
        left = np.clip(np.rint(axis - halves_px).astype(np.intp), 0, last)
        right = np.clip(np.rint(axis + halves_px).astype(np.intp), 0, last)
        return np.where(inside, np.minimum(self.rising[rows, left], self.falling[rows, right]), 0.0)


@dataclass(frozen=True, slots=True)
class _Cylinder:
    """Hold the share (0..1) of rows with both edges, and the half widths: `half_px` at `u_px`, growing by `flare`."""

    share: float
    half_px: float
    u_px: float
    flare: float

    def halves_px(self, u_px: Floats) -> Floats:
        """Return the half width at rows `u_px`."""
        return self.half_px - self.flare * (u_px - self.u_px)


def rough_probe(strip: ProbeStrip) -> RoughOutline:
    """Return the probe that ends near u = 0 of a strip laid along its expected direction; ValueError if none does."""
    edges = EdgePairs.of(strip, by_ratio=True)
    best: tuple[float, float, _Cylinder, tuple[float, float]] | None = None
    marked: tuple[float, float] | None = None
    for tilt in np.tan(np.radians(np.arange(-HINT_REACH_DEG, HINT_REACH_DEG + 0.1, 1.0))):
        marking = _marking(strip, float(tilt))
        if marking is None:
            continue
        marked = marked or marking
        cylinder = _cylinder(edges, float(tilt), marking)
        start = float(cylinder.halves_px(np.array(marking[1])))
        taper = float(np.mean(_trace(edges, float(tilt), start, marking)[1])) if cylinder.share > LEAST_PAIRS else 0.0
        if best is None or cylinder.share + taper > best[0]:
            best = cylinder.share + taper, float(tilt), cylinder, marking
    if best is None or best[0] < 2.0 * LEAST_PAIRS:
        raise ValueError(_nothing(marked))
    _, tilt, cylinder, marking = best
    traced, seen = _trace(edges, tilt, float(cylinder.halves_px(np.array(marking[1]))), marking)
    if float(np.mean(seen)) < LEAST_PAIRS:
        raise ValueError(
            f"the needle's two edges are seen along {100 * float(np.mean(seen)):.0f} % only of the "
            f"{-marking[1]:.0f} px from its marking to the given point: click its very end; nothing may cover it"
        )
    u, cylinder_rows = caliper_rows(-marking[1], marking[1] - marking[0])
    halves = np.concatenate([cylinder.halves_px(u[:cylinder_rows]), traced])
    return RoughOutline(float(np.arctan(tilt)), *marking, Silhouette(u, -halves, halves, cylinder_rows))


def _nothing(marked: tuple[float, float] | None) -> str:
    """Say what was not found of the shapes that can be taught."""
    if marked is None:
        return (
            f"no black marking is seen before the given point; looked for was {LOOKED_FOR}: click the very end of the "
            "needle under white light, and see that the marking is fresh"
        )
    return (
        f"a dark band {marked[1] - marked[0]:.0f} px long is seen {-marked[1]:.0f} px before the given point, but no "
        f"needle round it; looked for was {LOOKED_FOR}: click the very end of the needle, in the middle of its width"
    )


def _marking(strip: ProbeStrip, tilt: float) -> tuple[float, float] | None:
    """Return the coarse u of the upper and lower rim along a tilted line: a fall and, below it, a rise."""
    slope = derivative(middle_profile(strip, (0.0, tilt), 4)[None, :], 2.5)[0]
    u = np.arange(slope.size) + strip.u_from_px
    rise = np.where((u > RIM2_FROM_PX) & (u < RIM2_TO_PX), slope, 0.0)
    tops = (rise[1:-1] > rise[:-2]) & (rise[1:-1] >= rise[2:]) & (rise[1:-1] > LEAST_RIM_SLOPE)
    best_score, best = LEAST_RIM_SLOPE, None
    for at2 in np.flatnonzero(tops) + 1:
        at1 = at2 - np.arange(MARKING_FROM_PX, MARKING_TO_PX + 1)
        at1 = at1[at1 >= 0]
        if at1.size == 0:
            continue
        pick = at1[int(np.argmin(slope[at1]))]
        score = float(min(rise[at2], -slope[pick]))
        if score > best_score:
            best_score, best = score, (float(u[pick]), float(u[at2]))
    return best


def _cylinder(edges: EdgePairs, tilt: float, marking: tuple[float, float]) -> _Cylinder:
    """Return the cylinder above the marking, the widest good one; one that grows only when a straight one is not."""
    u, cylinder_rows = caliper_rows(-marking[1], marking[1] - marking[0])
    u = u[:cylinder_rows]
    centre = float(np.mean(u))
    straight, *flared = (_widest(edges, tilt, u, centre, flare) for flare in FLARES)
    best = max(flared, key=lambda one: one.share)
    return best if best.share > straight.share + FLARED_LEAD else straight


def _widest(edges: EdgePairs, tilt: float, u_px: Floats, centre_u_px: float, flare: float) -> _Cylinder:
    """Return the widest good cylinder of one flare."""
    halves = CYLINDER_HALVES_PX - flare * (u_px - centre_u_px)[:, None]
    shifts = (-3.0, -1.5, 0.0, 1.5, 3.0)
    shares = np.max([edges.pairs(u_px, tilt, shift, halves).mean(axis=0) for shift in shifts], axis=0)
    widest = int(np.flatnonzero(shares >= 0.85 * shares.max())[-1])
    near = slice(max(widest - 2, 0), widest + 1)
    pick = near.start + int(np.argmax(shares[near]))
    return _Cylinder(float(shares[pick]), float(CYLINDER_HALVES_PX[pick]), centre_u_px, flare)


def _trace(edges: EdgePairs, tilt: float, half_px: float, marking: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return (half widths, how much both edges are seen there) at the taper's rows: the path with the most edge.

    The path starts at the cylinder's width and never widens, and is found for all widths at once, row by row.
    """
    u, cylinder_rows = caliper_rows(-marking[1], marking[1] - marking[0])
    u = u[cylinder_rows:]
    halves = np.arange(1.5, half_px + 2.1, HALF_STEP_PX)
    seen = np.max([edges.pairs(u, tilt, shift, halves) for shift in (-1.5, 0.0, 1.5)], axis=0)
    steps = np.arange(-round(MOST_GROWTH_PX / HALF_STEP_PX), round(MOST_NARROWING_PX / HALF_STEP_PX) + 1)
    worth = seen + WIDER_WORTH * halves
    total = np.where(halves > 0.55 * half_px, worth[0], -1e3)
    came: list[NDArray[np.intp]] = []
    for row in worth[1:]:
        origin = np.arange(halves.size)[:, None] + steps
        reach = np.where((origin >= 0) & (origin < halves.size), total[np.clip(origin, 0, halves.size - 1)], -1e3)
        pick = np.argmax(reach, axis=1)
        came.append(origin[np.arange(halves.size), pick])
        total = reach[np.arange(halves.size), pick] + row
    path = [int(np.argmax(total))]
    for back in reversed(came):
        path.append(int(back[path[-1]]))
    order = np.array(path[::-1])
    return halves[order], seen[np.arange(u.size), order]
