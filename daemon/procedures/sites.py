"""Sites: where on a target's bare metal the needle goes, by this station's own landing errors."""

from __future__ import annotations

import asyncio
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.domain.board import BoardPoint
from daemon.domain.board_layers import as_points
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import StationContext
from daemon.station.board_obstacles import Obstacles, round_outline
from vision.geometry import Array
from vision.registration import Target, free_site

NEAR_UM = 3000.0
"""What lies farther from a target's metal is not in its way."""
LEAST_KNOWN = 0.25
"""Of a target's edge: with less the picture cannot confirm the target, for CAD does not say what it looks like."""
CELL_UM, STEP_UM = 12.0, 40.0


async def sited(context: StationContext, point: BoardPoint) -> BoardPoint:
    """Return the target with the place that has most room for this station's needle; `Fault` where none has enough.

    Round metal is touched in its middle. On a part's pad the needle goes where the import found room free of body and
    solder: what else of the pad is free the board file does not say.
    """
    if not context.by_cad or point.stands_round or not point.metal_um:
        return point
    return await asyncio.to_thread(_sited, context, point)


def _sited(context: StationContext, point: BoardPoint) -> BoardPoint:
    """Find the place; for a worker thread."""
    servo = context.servo
    if point.part is not None:
        if point.room_um is not None and point.room_um < servo.landing_um + servo.tip_radius_um:
            raise _no_room(context, point, point.room_um)
        return point
    metal, holes = _metal(point)
    low, high = np.vstack(metal).min(axis=0) - NEAR_UM, np.vstack(metal).max(axis=0) + NEAR_UM
    obstacles = [*holes, *context.references.sides.obstacles.holes_near(low, high)]
    sites = (free_site(metal, obstacles, um + servo.tip_radius_um) for um in (servo.first_landing_um, servo.landing_um))
    site = next((s for s in sites if s is not None and s.fits), None)
    if site is None:
        best = free_site(metal, obstacles, servo.landing_um)
        raise _no_room(context, point, 0.0 if best is None else best.room_um)
    moved = math.dist((site.x_um, site.y_um), point.middle_um) > 1.0
    middle = point.middle_um if point.diameter_um is not None and moved else None
    return point.model_copy(update={"x_um": site.x_um, "y_um": site.y_um, "centre_um": middle})


def _no_room(context: StationContext, point: BoardPoint, room_um: float) -> Fault:
    servo = context.servo
    needed_um = servo.landing_um + servo.tip_radius_um
    return Fault(
        FaultCode.UNKNOWN_TEST_POINT,
        f"{point.name} leaves the needle {room_um:.0f} um of free metal on each side, and this station needs "
        f"{needed_um:.0f}: its landing error of {servo.landing_um:.0f} and the needle's radius",
        advice="touch another point of its net",
        test_point=point.name,
        room_um=round(room_um, 1),
        needed_um=needed_um,
    )


def target_of(point: BoardPoint) -> Target | None:
    """Return the target as registration wants it; None where the board file does not know its metal."""
    if point.metal_um:
        metal, _ = _metal(point)
        outline = min(
            metal, key=lambda corners: -cv2.pointPolygonTest(_contour(corners), point.place_um, measureDist=True)
        )
        return Target(point.x_um, point.y_um, outline)
    if point.diameter_um is None:
        return None
    return Target(point.x_um, point.y_um, round_outline(*point.middle_um, point.diameter_um))


def looks_known(target: Target, obstacles: Obstacles) -> bool:
    """Whether CAD says what a target's edge looks like; a part or solder on it may look like anything."""
    edge = _along(target.outline_um)
    free = np.ones(len(edge), dtype=bool)
    for cover in obstacles.covers_near(edge.min(axis=0) - CELL_UM, edge.max(axis=0) + CELL_UM):
        low, high, contour = cover.min(axis=0) - CELL_UM, cover.max(axis=0) + CELL_UM, _contour(cover)
        for i in np.flatnonzero(free & (edge >= low).all(axis=1) & (edge <= high).all(axis=1)):
            x, y = (float(v) for v in edge[i])
            free[i] = cv2.pointPolygonTest(contour, (x, y), measureDist=True) < -CELL_UM
    return float(np.mean(free)) >= LEAST_KNOWN


def _along(outline: Array) -> Array:
    """Return points along a closed outline, no two farther apart than a step."""
    ends = np.roll(outline, -1, axis=0)
    pieces = [
        np.linspace(a, b, max(1, math.ceil(math.dist(a, b) / STEP_UM)), endpoint=False)
        for a, b in zip(outline, ends, strict=True)
    ]
    return np.vstack(pieces)


def extent_um(point: BoardPoint) -> float:
    """Return the longest way across a target's metal."""
    target = target_of(point)
    return 0.0 if target is None else float(np.ptp(target.outline_um, axis=0).max())


def _contour(corners: Array) -> NDArray[np.float32]:
    return np.asarray(corners, dtype=np.float32).reshape(-1, 1, 2)


def _metal(point: BoardPoint) -> tuple[list[Array], list[Array]]:
    """Return the outlines of the metal, and of the holes in it: what lies within another outline."""
    outlines = [as_points(outline) for outline in point.metal_um]
    inner = [
        any(
            other is not one and cv2.pointPolygonTest(_contour(other), tuple(map(float, one[0])), measureDist=False) > 0
            for other in outlines
        )
        for one in outlines
    ]
    metal = [one for one, within in zip(outlines, inner, strict=True) if not within]
    return metal, [one for one, within in zip(outlines, inner, strict=True) if within]
