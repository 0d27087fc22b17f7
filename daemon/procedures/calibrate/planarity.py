"""Planarity check (thesis 6.2, end): touch places all over the board, fit the plane, give a verdict."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from math import dist, inf

import numpy as np

from daemon.domain.board import Board, BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.domain.surface_points import LEAST_PLACES, SurfacePoints, surface_points
from daemon.jobs.context import JobContext, Outcome, StationContext
from daemon.procedures.board_in_nest import require_board
from daemon.procedures.calibrate.commit import Began, keep
from daemon.procedures.calibrate.spread import (
    EASILY_UM,
    SURE_WITHIN_UM,
    corners_um,
    plane_sigma_um,
    require_spread,
    sigma_of,
)
from daemon.procedures.head_angle import other_views
from daemon.procedures.move_sequence import MoveSequence
from daemon.procedures.surface_touch import Push, SurfaceSearch, heights_um
from daemon.station.kinematics import EXTRAPOLATED_UM, beyond_um
from daemon.storage.calibration_records import SurfaceRecord, Touch
from daemon.wire.operations.jobs import Calibrate
from drivers.errors import EnvelopeViolation
from drivers.gantry import Position
from vision.geometry import Array, Surface, fit_plane

PLANAR_WITHIN_UM = 50.0
"""Two pixels of the tip's place: the thesis' measure of the same height, on its camera."""
MAX_RMS_UM = 25.0
"""Heights that are farther from any plane are not described by one."""
DRAWS = 50
"""So often places are drawn before the best spread of them is taken; the last draw is the farthest apart."""
COVERING, MORE_PADS = 10, 5
"""So many draws, the last ones, go for the board's corners, and so many of them with two thirds of pads: of six places
three pads leave a corner of a large board out."""
BELIEVED_UM = 0.95 * EXTRAPOLATED_UM
"""A little less far is a plane drawn for: where the board really lies the places are not quite these."""
FAR_UM = 10_000.0
"""A plane is believed no farther beyond what was touched."""


async def measure_surface(job: JobContext, context: StationContext, request: Calibrate) -> Outcome:
    """Touch test points of the board, fit the plane they lie in and keep it; if they lie in none the old one stays."""
    press_um = context.gantry.press_um
    if press_um <= 0.0:
        raise Fault(
            FaultCode.NOT_CALIBRATED,
            "the configuration allows no pressing",
            advice="set gantry.press_um to what the pin takes, say 200, and repeat",
        )
    context.calibrations.require_probe()
    pose_map = context.require_map()
    await context.station.require_homed(job)
    board = context.board
    # Of a board that was exchanged, or whose alignment was refused, nobody knows what lies below a place.
    await require_board(context, None)
    points = await _allowed_places(job, context, request)
    sigma_um = require_spread(points, board, context.gantry.surface_range_um)
    places = [context.geometry.position_over(point.place_um, request.theta_deg) for point in points]
    sequence, pushes = MoveSequence(job, context), []
    search = SurfaceSearch(sequence, pose_map)
    for place in places:
        context.station.check(replace(place, z_um=context.gantry.free_z_um))
        context.station.check(replace(place, z_um=context.gantry.touch_z_um - press_um))
    job.fire(Event.ACCEPTED)
    began = Began.now(job)
    for n, (point, place) in enumerate(zip(points, places, strict=True)):
        job.progress(n, len(places), f"touching {point.name}")
        pushes.append(await _press(context, search, point, place))
    # No look tells a push of some um, such as a few lost steps of Z would leave behind just above the board
    await sequence.go(replace(pushes[-1].place, z_um=context.gantry.safe_z_um))
    heights = heights_um(pushes, pose_map, press_um, context.gantry.touch_z_um)
    where = np.array([context.geometry.tip_um(push.place) for push in pushes])
    surface = _plane(where, np.array(heights))
    record = _record(surface, where, heights, began.facts(job, context))
    kept = await keep(job, context, record)
    return Outcome("calibrated", detail=_told(record) | {"sigma_um": round(sigma_um, 1)} | kept)


async def _press(context: StationContext, search: SurfaceSearch, point: BoardPoint, place: Position) -> Push:
    """Touch a place; where the needle is not seen before its ground, with the head turned before another one."""
    try:
        return await search.press(place)
    except Fault as fault:
        if fault.kind is not FaultCode.TIP_NOT_FOUND:
            raise
        unseen = fault
    for other in other_views(context, lambda deg: context.geometry.position_over(point.place_um, deg), place):
        try:
            return await search.press(other)
        except Fault as fault:
            if fault.kind is not FaultCode.TIP_NOT_FOUND:
                raise
    raise unseen


async def _allowed_places(job: JobContext, context: StationContext, request: Calibrate) -> list[BoardPoint]:
    """Choose places within reach of which no person forbade any to the needle; for one that was others are drawn.

    Where too few are within reach the check that follows says what is not.
    """
    board, seed = context.board, request.id
    whole = _roomy(context, surface_points(board))
    offered = whole.only(lambda point: _in_reach(context, point, request.theta_deg))
    if offered.number < LEAST_PLACES:
        offered = whole
    while True:
        points = choose_places(offered, board, request.places, seed)
        marks = [await job.mark_of(board.name, board.side, point.name) for point in points]
        forbidden = {mark.point for mark in marks if mark is not None and mark.forbids}
        if not forbidden:
            return points
        offered = offered.without(forbidden)


def _roomy(context: StationContext, offered: SurfacePoints) -> SurfacePoints:
    """Leave out metal of parts that the needle may miss; beside a flat point the board is hardly less high."""
    needed_um = context.servo.landing_um + context.servo.tip_radius_um
    roomy = offered.only(lambda point: point.room_um is None or point.room_um >= needed_um)
    return roomy._replace(flat=offered.flat)


def _in_reach(context: StationContext, point: BoardPoint, theta_deg: float) -> bool:
    place = context.geometry.position_over(point.place_um, theta_deg)
    try:
        context.station.check(replace(place, z_um=context.gantry.free_z_um))
    except EnvelopeViolation:
        return False
    return True


def choose_places(offered: SurfacePoints, board: Board, count: int, seed: str) -> list[BoardPoint]:
    """Choose test points at random, every job others; pads are made to be touched, the board between them is not.

    Where flat ones are far away, or so few or so placed that they span no plane, pads of parts stand in for them:
    solder on a pad is some ten um high, and a plane that goes on beyond all touches, or beside them, is off by more.
    Where these do not span one either, pins do. What nothing spans is left to the check that follows.
    """
    flat, pads, pins = offered
    chance = random.Random(seed)  # noqa: S311  # a repeatable choice, not a secret
    far = any(_away_um(pad, flat) > FAR_UM for pad in pads)
    ladder = [*([] if far else [()]), *([pads] if pads else []), *([(*pads, *pins)] if pins else [])]
    chosen: list[BoardPoint] = []
    for stand_in in ladder:
        chosen = _best_draw(chance, flat, stand_in, (*flat, *pads, *pins), board, count)
        if sigma_of(chosen, board) <= SURE_WITHIN_UM:
            break
    return chosen


def _best_draw(
    chance: random.Random,
    flat: Sequence[BoardPoint],
    stand_in: Sequence[BoardPoint],
    wanted: Sequence[BoardPoint],
    board: Board,
    count: int,
) -> list[BoardPoint]:
    """Return the best of some choices; all there are, where they are too few to choose from.

    A choice that happens to lie in a row is drawn again, and so is one that leaves points so far out that nobody would
    touch them by it.
    """
    if len(flat) + len(stand_in) <= count:
        return [*flat, *stand_in]
    everywhere = np.array([point.place_um for point in (*flat, *stand_in)])
    wanted_um = np.array([point.place_um for point in wanted])
    at_um = corners_um(everywhere.min(axis=0), everywhere.max(axis=0))
    best, best_by = list[BoardPoint](), (True, 0, inf)
    for draw in range(DRAWS):
        left = DRAWS - draw
        if left in (COVERING, MORE_PADS) and stand_in and best_by[:2] == (False, 0):
            break  # as many flat points as may be: solder is higher
        few = count // 3 if left <= MORE_PADS else count // 2
        points = _drawn(chance, flat, stand_in, count, few=few, covering=left <= COVERING, apart=left == 1)
        touched = np.array([point.place_um for point in points])
        left_out = int((beyond_um(wanted_um, touched) > BELIEVED_UM).sum())
        sigma_um, unsure = plane_sigma_um(touched, at_um), sigma_of(points, board) > SURE_WITHIN_UM
        by = unsure, left_out, sigma_um
        if not best or by < best_by:
            best, best_by = points, by
        if not unsure and not left_out and sigma_um <= EASILY_UM:
            break
    return best


def _drawn(
    chance: random.Random,
    flat: Sequence[BoardPoint],
    pads: Sequence[BoardPoint],
    count: int,
    *,
    few: int,
    covering: bool,
    apart: bool,
) -> list[BoardPoint]:
    """Draw so many points by chance; with pads, `few` are flat ones.

    covering: pads as far out as there are any. apart: without pads, the first one by chance, the others far off.
    """
    if pads:
        points = chance.sample(flat, min(len(flat), max(few, count - len(pads))))
        points += _farthest_beyond(pads, points, count - len(points)) if covering else []
        return points + _far_apart(chance.sample(pads, len(pads)), points, count - len(points))
    if not apart:
        return chance.sample(flat, count)
    return _far_apart(chance.sample(flat, len(flat)), (), count)


def _farthest_beyond(pads: Sequence[BoardPoint], points: Sequence[BoardPoint], count: int) -> list[BoardPoint]:
    """Return at most so many pads, each the one that lies farthest beyond all before it; none where none lies far."""
    found: list[BoardPoint] = []
    places = np.array([pad.place_um for pad in pads])
    while len(found) < count:
        touched = np.array([point.place_um for point in (*points, *found)])
        beyond = beyond_um(places, touched) if len(touched) else np.full(len(pads), inf)
        if float(beyond.max()) <= BELIEVED_UM:
            break
        found.append(pads[int(beyond.argmax())])
    return found


def _far_apart(pads: Sequence[BoardPoint], points: Sequence[BoardPoint], count: int) -> list[BoardPoint]:
    """Return at most so many pads, each the farthest from all before it and from the points."""
    found: list[BoardPoint] = []
    away_um = {pad.name: _away_um(pad, points) for pad in pads}
    for _ in range(min(count, len(pads))):
        best = max(pads, key=lambda pad: away_um[pad.name])
        found.append(best)
        away_um = {pad.name: min(away_um[pad.name], dist(pad.place_um, best.place_um)) for pad in pads}
    return found


def _away_um(pad: BoardPoint, points: Sequence[BoardPoint]) -> float:
    return min((dist(pad.place_um, point.place_um) for point in points), default=inf)


def _plane(places: Array, heights: Array) -> Surface:
    """Fit the plane, or say why there is none."""
    try:
        surface = fit_plane(places, heights, sigma_um=None)
    except ValueError as exc:
        raise Fault(FaultCode.CALIBRATION_FAILED, f"the surface is no plane: {exc}") from exc
    if surface.rms_um > MAX_RMS_UM:
        raise Fault(
            FaultCode.CALIBRATION_FAILED,
            f"the touched places lie {surface.rms_um:.0f} um off any plane; {MAX_RMS_UM:.0f} um are allowed",
            advice="see whether the board lies flat in its nest and nothing lies below it",
            heights_um=[round(float(h), 1) for h in heights],
        )
    return surface


def _record(surface: Surface, places: Array, heights: list[float], facts: dict[str, object]) -> SurfaceRecord:
    unflat_um = max(heights) - min(heights)
    return SurfaceRecord(
        **facts,  # type: ignore[arg-type]  # checked by the model
        touches=tuple(
            Touch(x_um=float(x), y_um=float(y), height_um=h) for (x, y), h in zip(places, heights, strict=True)
        ),
        residuals_um=tuple(float(r) for r in surface.residuals_um),
        surface=surface.to_dict(),
        flatness_um=surface.flatness_um,
        rms_um=surface.rms_um,
        limit_um=PLANAR_WITHIN_UM,
        planar=unflat_um <= PLANAR_WITHIN_UM,
        max_rms_um=MAX_RMS_UM,
    )


def _told(record: SurfaceRecord) -> dict[str, object]:
    heights = [touch.height_um for touch in record.touches]
    return {
        "what": "surface",
        "places": len(heights),
        "height_um": round(float(np.mean(heights)), 1),
        "spread_um": round(max(heights) - min(heights), 1),
        "rms_um": round(record.rms_um, 1),
        "planar": record.planar,
        "limit_um": record.limit_um,
    }
