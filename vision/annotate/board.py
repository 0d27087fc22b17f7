"""Panel of the red image with CAD drawn over it: what was confirmed, contradicted, hidden, and the rivals."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.annotate.page import PagePanel, fitting_zoom
from vision.annotate.sheet import ANSWER, FRAME, INK, THROWN, UNDECIDED, USED, Sheet, brightened, crop
from vision.core import Bgr, red_signal
from vision.registration import IndexedSide, NotRegistered, Registration, Target, mark_edges

Array = NDArray[np.float64]
HALF_PX = 330
DOT_PX = 0.5
MOST_RIVALS = 4
LEGEND = (
    (USED, "metal edge of CAD, confirmed"),
    (THROWN, "contradicted"),
    (FRAME, "hidden"),
    (ANSWER, "target"),
    (UNDECIDED, "where a rival has it"),
)


@dataclass(frozen=True, eq=False)
class BoardLook:
    """A red frame that was registered: the side that was looked for, and what came of it.

    about_um: the place looked at, board frame. board_to_px: (3, 3). hidden_px: polygons of what stands before it.
    """

    side: IndexedSide
    about_um: tuple[float, float]
    board_to_px: Array
    answer: Registration | NotRegistered
    target: Target | None
    hidden_px: tuple[Array, ...]


def board_panel(red_bgr: Bgr, look: BoardLook) -> PagePanel:
    """Return the panel of a red image, about the place that was looked at."""
    found = look.answer.best if isinstance(look.answer, NotRegistered) else look.answer
    shift = (0.0, 0.0) if found is None else found.shift_um
    middle = _to_px(look.board_to_px, look.about_um)
    area = (int(middle[0]) - HALF_PX, int(middle[1]) - HALF_PX, 2 * HALF_PX, 2 * HALF_PX)
    plane = red_signal(crop(red_bgr, area))
    part, how = brightened(np.asarray(cv2.cvtColor(plane, cv2.COLOR_GRAY2BGR), dtype=np.uint8))
    sheet = Sheet(part, area, fitting_zoom(area[2:]))
    marks = mark_edges(look.side, red_bgr, look.board_to_px, look.about_um, look.answer, look.hidden_px)
    for points, colour in ((marks.confirmed, USED), (marks.contradicted, THROWN), (marks.hidden, FRAME)):
        for x, y in points:
            sheet.line((float(x) - DOT_PX, float(y)), (float(x) + DOT_PX, float(y)), colour, thickness=2)
    for polygon in look.hidden_px:
        sheet.outline(polygon, FRAME)
    if look.target is not None:
        moved = look.target.outline_um + np.asarray(shift)
        sheet.outline(np.array([_to_px(look.board_to_px, (float(x), float(y))) for x, y in moved]), ANSWER)
    if found is not None:
        sheet.cross(found.target_px, 6.0, ANSWER, gap_px=1.5)
        sheet.label("target" if look.target is not None else "place", found.target_px, ANSWER, clear_px=6.0)
        for rival in found.rivals[:MOST_RIVALS]:
            at = _to_px(look.board_to_px, rival.target_um)
            sheet.cross(at, 5.0, UNDECIDED, turn_deg=45.0)
            sheet.label(f"rival, log odds {rival.log_odds:.0f}", at, UNDECIDED, clear_px=5.0)
    sheet.cross(middle, 3.0, INK, turn_deg=45.0)
    sheet.scale_bar()
    counts = tuple(len(points) for points in (marks.confirmed, marks.contradicted, marks.hidden))
    return PagePanel(f"red light with CAD{how}", sheet.finish(), _facts(found, counts), LEGEND)


def verdict_on_board(look: BoardLook) -> str:
    """Say in a sentence where the board lies, or why that cannot be said."""
    if isinstance(look.answer, NotRegistered):
        return f"Not registered ({look.answer.reason}): {look.answer.message}"
    dx, dy = look.answer.shift_um
    turn = f"turned by {look.answer.turn_deg:+.2f} degrees"
    return f"Registered: the board lies {dx:+.0f}, {dy:+.0f} um off where it was assumed, {turn}."


def _facts(found: Registration | None, counts: tuple[int, ...]) -> tuple[str, ...]:
    edges = f"edges drawn: {counts[0]} confirmed, {counts[1]} contradicted, {counts[2]} hidden"
    if found is None:
        return ("nothing fits: CAD is drawn where the board was assumed", edges)
    place = f"target ({found.target_px[0]:.2f}, {found.target_px[1]:.2f}) px, 1 sigma {found.sigma_px:.2f} px"
    agreed = f"agreement {found.agreement:.2f}, edges near {found.near.confirmed:.2f}, log odds {found.log_odds:.0f}"
    return (f"{place}   {agreed}", edges)


def _to_px(homography: Array, place_um: tuple[float, float]) -> tuple[float, float]:
    x, y, w = homography @ (place_um[0], place_um[1], 1.0)
    return float(x / w), float(y / w)
