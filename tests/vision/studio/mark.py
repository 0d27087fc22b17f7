"""White-lit frames of the control point of thesis appendix C: a laser-printed circle with four thin arms.

Drawn as polygons on a fine raster under a tilted camera; a dark wedge of probe and holder hides as many arms as asked.
The truth is the projection of the crossing. Not modelled: toner's gloss, curl of the paper.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from tests.vision.studio.board_canvas import Canvas, Level, Points, coverage, flat
from tests.vision.studio.board_needle import random_needle
from tests.vision.studio.board_shapes import circle
from tests.vision.studio.board_stage import grain
from tests.vision.studio.board_view import FRAME_HW, TILT_DEG, View, tilted_view
from tests.vision.studio.lens import develop

TIP_PX = (430.0, 620.0)
OFFSET_PX = 8.0
HIDDEN = 0.6
"""Share of an arm inside the circle from which on it counts as hidden."""
SEEN = 0.3
"""Share up to which it counts as seen; an arm between the two makes the scene be drawn again."""
DRAWS = 400


@dataclass(frozen=True)
class MarkScene:
    """One white-lit frame (H, W, 3) BGR of the control point and what is true of it, in px."""

    frame: npt.NDArray[np.uint8]
    around_px: tuple[float, float]
    """Where the tip is, within 8 px of the centre."""
    centre_px: tuple[float, float]
    angle_deg: float
    """Head angle: turn of the print in the image before the tilt, clockwise as seen."""
    arm_hidden: tuple[float, float, float, float]
    """Share of each arm, inside the circle, that is hidden."""
    radius_px: float
    arm_width_px: float
    view: View


@dataclass(frozen=True)
class _Print:
    radius: float
    width: float
    reach: float
    """Length of an arm, in radii of the circle."""

    def arm(self, index: int) -> Points:
        """Return points along the middle of one arm, inside the circle."""
        way = index * np.pi / 2
        along = np.linspace(0.0, self.radius, 60)[1:]
        return np.column_stack((along * np.cos(way), along * np.sin(way)))


@dataclass(frozen=True)
class _Wedge:
    outline_px: Points

    def hides(self, points_px: Points) -> float:
        ring = self.outline_px.astype(np.float32).reshape(-1, 1, 2)
        return float(np.mean([cv2.pointPolygonTest(ring, (float(x), float(y)), False) >= 0 for x, y in points_px]))


def mark_scene(seed: int, *, hidden_arms: int = 2, angle_deg: float | None = None, hard: bool = False) -> MarkScene:
    """Draw the control point with ``hidden_arms`` (0, 1 or 2) of its arms behind the probe.

    With one arm hidden or none the probe is narrow; two neighbouring arms are hidden by its broad holder, which then
    stands wherever in the upper left the two arms ask for. ``angle_deg`` fixes the head angle (default: any); the
    narrow probe is then turned as far as the arms ask for. Raises ValueError for another number of arms.
    """
    if hidden_arms not in {0, 1, 2}:
        msg = f"hidden_arms must be 0, 1 or 2, got {hidden_arms}"
        raise ValueError(msg)
    rng = np.random.default_rng(seed)
    paper, toner = rng.uniform(165, 225), rng.uniform(25, 65)
    for _ in range(DRAWS):
        anchor = (TIP_PX[0] + rng.uniform(-40, 40), TIP_PX[1] + rng.uniform(-40, 40))
        turn = np.deg2rad(rng.uniform(0, 360) if angle_deg is None else angle_deg)
        pattern = _Print(rng.uniform(65, 105), rng.uniform(5, 11), rng.choice([1.0, rng.uniform(1.05, 1.35)]))
        azimuth, tilt = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(*TILT_DEG))
        view = tilted_view(anchor, turn - azimuth, tilt, azimuth)
        away, way = OFFSET_PX * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        around = (float(anchor[0] + away * np.cos(way)), float(anchor[1] + away * np.sin(way)))
        wedge = _wedge(rng, _bearings(view, pattern), around, hidden_arms, turn_probe=angle_deg is not None)
        shares = [wedge.hides(view.project(pattern.arm(k))) for k in range(4)]
        if sum(s >= HIDDEN for s in shares) == hidden_arms and sum(s <= SEEN for s in shares) == 4 - hidden_arms:
            break
    else:
        msg = f"no scene with {hidden_arms} hidden arms for angle_deg={angle_deg}; take another angle or seed"
        raise RuntimeError(msg)
    level = _printed(rng, view, pattern, paper, toner, hard=hard)
    _lay(level, wedge, rng)
    frame = develop(
        level,
        gain=rng.uniform(0.75, 1.15),
        blur_px=rng.uniform(0.7, 1.4),
        noise=7.0 if hard else 3.0,
        spikes=rng.uniform(0.001, 0.005) if hard else 0.0,
        rng=rng,
        falloff=rng.uniform(0.0, 0.3),
    )
    radius_px = view.semi_major(0.0, 0.0, pattern.radius)
    hidden = (shares[0], shares[1], shares[2], shares[3])
    turn_deg = float(np.rad2deg(turn))
    return MarkScene(frame, around, view.point(0.0, 0.0), turn_deg, hidden, radius_px, pattern.width, view)


def _bearings(view: View, pattern: _Print) -> npt.NDArray[np.float64]:
    """Return the bearings (rad) of the four arms in the image."""
    ends = view.project(np.array([pattern.arm(k)[-1] for k in range(4)])) - np.array(view.point(0.0, 0.0))
    return np.arctan2(ends[:, 1], ends[:, 0])


def _wedge(
    rng: np.random.Generator,
    bearings: npt.NDArray[np.float64],
    tip_px: tuple[float, float],
    hidden_arms: int,
    *,
    turn_probe: bool,
) -> _Wedge:
    probe = random_needle(rng, tip_px)
    axis = np.deg2rad(probe.angle_deg) + np.pi
    off = (bearings - axis + np.pi) % (2 * np.pi) - np.pi
    nearest = float(off[np.abs(off).argmin()])
    if hidden_arms == 0:
        short = max(np.deg2rad(25) - abs(nearest), 0.0) if turn_probe else 0.0
        turn_deg = float(np.rad2deg(-np.copysign(short, nearest)))
        return _Wedge(replace(probe, angle_deg=probe.angle_deg + turn_deg).outline())
    if hidden_arms == 1:
        middle, spread = axis + (nearest if turn_probe else 0.0), np.deg2rad(rng.uniform(10, 16))
        return _wedge_between(rng, tip_px, middle - spread, middle + spread)
    margin = np.deg2rad(rng.uniform(8, 20, 2))
    return _wedge_between(rng, tip_px, axis + off[off <= 0].max() - margin[0], axis + off[off > 0].min() + margin[1])


def _wedge_between(rng: np.random.Generator, tip_px: tuple[float, float], low: float, high: float) -> _Wedge:
    """Return a wedge with a blunt end of 3..6 px at the tip and sides that run off at two bearings (rad)."""
    middle, end = (low + high) / 2, rng.uniform(1.5, 3.0)
    across = np.array([-np.sin(middle), np.cos(middle)])
    far = 900.0
    sides = [np.array([np.cos(a), np.sin(a)]) for a in (low, middle, high)]
    tip = np.array(tip_px)
    corners = [tip + across * end * k + far * s for k, s in zip((1, 0, -1), sides[::-1], strict=True)]
    return _Wedge(np.array([tip - across * end, tip + across * end, *corners]))


def _printed(rng: np.random.Generator, view: View, pattern: _Print, paper: float, toner: float, *, hard: bool) -> Level:
    canvas = Canvas(view.point(0.0, 0.0), half_px=175, ground=paper)
    ragged = 0.35 if hard else 0.2
    outer = circle(0, 0, pattern.radius + pattern.width / 2, ragged=ragged, rng=rng)
    inner = circle(0, 0, pattern.radius - pattern.width / 2, ragged=ragged, rng=rng)[::-1]
    canvas.paint([view.project(outer), view.project(inner)], flat(toner))
    for index in range(4):
        canvas.paint([view.project(_arm_outline(rng, pattern, index * np.pi / 2, ragged))], flat(toner))
    for _ in range(int(rng.integers(0, 60)) if hard else 0):
        x, y = rng.uniform(-150, 150, 2)
        canvas.paint([view.project(circle(x, y, rng.uniform(0.3, 1.2)))], flat(toner))
    level = np.full(FRAME_HW, paper, np.float32)
    canvas.laid_into(level)
    x0, y0 = canvas.x0_px, canvas.y0_px
    patch = level[y0 : y0 + 350, x0 : x0 + 350]
    patch *= 1.0 + grain(rng, patch.shape, rng.uniform(0.005, 0.03 if hard else 0.015))
    return level


def _arm_outline(rng: np.random.Generator, pattern: _Print, way: float, ragged: float) -> Points:
    """Return one arm with edges as uneven as toner's, each edge straight on the average."""
    along = np.linspace(0.0, pattern.radius * pattern.reach, 40)
    edges = []
    for side in (-1.0, 1.0):
        uneven = rng.normal(0.0, ragged, along.size)
        tilt = np.polyval(np.polyfit(along, uneven, 1), along)
        edges.append(np.column_stack((along, side * pattern.width / 2 + uneven - tilt)))
    ring = np.vstack((edges[0], edges[1][::-1]))
    cos, sin = np.cos(way), np.sin(way)
    return ring @ np.array([[cos, sin], [-sin, cos]])


def _lay(level: Level, wedge: _Wedge, rng: np.random.Generator) -> None:
    """Lay the wedge over the frame: dark metal with a bright streak from the tip outwards."""
    share, x0, y0 = coverage(wedge.outline_px, (level.shape[0], level.shape[1]))
    height, width = share.shape
    y, x = np.mgrid[y0 : y0 + height, x0 : x0 + width]
    tip = wedge.outline_px[:2].mean(axis=0)
    far = wedge.outline_px[2:].mean(axis=0) - tip
    middle = np.arctan2(far[1], far[0]) + rng.uniform(-0.08, 0.08)
    away = np.hypot(x - tip[0], y - tip[1])
    side = (x - tip[0]) * np.sin(middle) - (y - tip[1]) * np.cos(middle)
    metal = rng.uniform(25, 80) + rng.uniform(30, 120) * np.exp(-((side / (1.5 + 0.04 * away)) ** 2))
    under = level[y0 : y0 + height, x0 : x0 + width]
    under += share * (metal.astype(np.float32) - under)
