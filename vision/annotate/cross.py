"""Panel of the control point: the arms that were measured, and where they meet."""

from __future__ import annotations

import numpy as np

from vision.annotate.page import PagePanel, fitting_zoom
from vision.annotate.sheet import ANSWER, FRAME, INK, USED, Sheet, brightened, crop
from vision.control_point import ControlPoint
from vision.core import Bgr, NotFound, check_bgr

MARGIN_PX = 6
LEGEND = ((ANSWER, "centre"), (USED, "arms"), (FRAME, "where the centre may lie"))


def cross_panel(
    white_bgr: Bgr, found: ControlPoint | NotFound, around_px: tuple[float, float], reach_px: float, arm_px: float
) -> PagePanel:
    """Return the panel of a white image that was searched for a control point."""
    half = int(reach_px + arm_px) + MARGIN_PX
    area = round(around_px[0]) - half, round(around_px[1]) - half, 2 * half + 1, 2 * half + 1
    part, how = brightened(crop(check_bgr(white_bgr), area))
    sheet = Sheet(part, area, fitting_zoom(area[2:]))
    sheet.ring(around_px, (reach_px, reach_px), 0.0, FRAME, thing=False)
    if isinstance(found, NotFound):
        sheet.cross(around_px, 5.0, INK, gap_px=1.5)
        sheet.label("looked round here", around_px, INK, clear_px=2.0)
        facts: tuple[str, ...] = (f"no control point: {found.reason}",)
    else:
        _draw_arms(sheet, found, arm_px)
        facts = _facts(found)
    sheet.scale_bar()
    return PagePanel(f"white light{how}", sheet.finish(), facts, LEGEND)


def verdict_on_cross(found: ControlPoint | NotFound) -> str:
    """Say in a sentence where the control point is, or why there is none."""
    if isinstance(found, NotFound):
        return f"No control point ({found.reason}): {found.message}"
    return f"The control point is at ({found.x_px:.2f}, {found.y_px:.2f}) px."


def _draw_arms(sheet: Sheet, found: ControlPoint, arm_px: float) -> None:
    centre = found.x_px, found.y_px
    sheet.cross(centre, 5.0, ANSWER, gap_px=1.0)
    sheet.label("centre", centre, ANSWER, clear_px=2.0)
    for arm in found.arms:
        c, s = float(np.cos(arm.angle_rad)), float(np.sin(arm.angle_rad))
        far = centre[0] + arm_px * c, centre[1] + arm_px * s
        sheet.line((centre[0] + 0.2 * arm_px * c, centre[1] + 0.2 * arm_px * s), far, USED)
        sheet.label(f"{100 * arm.share:.0f} % seen", far, USED, clear_px=1.0)


def _facts(found: ControlPoint) -> tuple[str, ...]:
    angles = ", ".join(f"{np.degrees(arm.angle_rad):.1f}" for arm in found.arms)
    return (
        f"centre ({found.x_px:.2f}, {found.y_px:.2f}) px, 1 sigma {found.sigma_px:.2f} px",
        f"{len(found.arms)} arms, towards {angles} deg",
    )
