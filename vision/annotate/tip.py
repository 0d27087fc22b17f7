"""Panel of the white image: how the tip was found, or where it was looked for."""

from __future__ import annotations

import numpy as np

from vision.annotate.page import PagePanel, fitting_zoom
from vision.annotate.sheet import ANSWER, FRAME, INK, THROWN, USED, Sheet, brightened, crop
from vision.core import Bgr, NotFound, check_bgr
from vision.tip import ProbeModel, Tip, probe_outline

AREA_PX, TIP_AT_PX = (300, 350), (205, 275)
"""Marking, taper and end, with the end low on the right: the probe comes from the upper left."""
CLOSE_PX, CLOSE_ZOOM = 34, 6
"""The end is shown once more, larger."""
LEGEND = ((ANSWER, "tip"), (USED, "edges, rims"), (FRAME, "bisector"), (THROWN, "where the edges would meet"))


def tip_panel(
    white_bgr: Bgr,
    tip: Tip | NotFound,
    near_px: tuple[float, float] | None = None,
    zoom: float | None = None,
    taught: ProbeModel | None = None,
) -> PagePanel:
    """Return the panel of a white image; near_px, taught: where the tip was expected, for when there is none."""
    image = check_bgr(white_bgr)
    if taught is not None:
        near_px = taught.tip_px
    middle = image.shape[1] / 2.0, image.shape[0] / 2.0
    sheet, title = _sheet(image, (tip.x_px, tip.y_px) if isinstance(tip, Tip) else near_px or middle, zoom)
    if isinstance(tip, NotFound):
        if taught is not None:
            silhouette = probe_outline(taught.tip_px, taught.angle_rad, taught.shape, 0.0)
            sheet.outline(silhouette, FRAME)
            sheet.fill(silhouette)
        if near_px is not None:
            _mark(sheet, near_px, "tip expected here")
        legend = ((FRAME, "needle as it was taught"),) if taught is not None else ()
        return PagePanel(title, sheet.finish(), (f"no tip: {tip.reason}",), legend)
    sheet.inset(_close_up(sheet, tip), f"the end, {CLOSE_ZOOM} times")
    _draw_probe(sheet, tip)
    return PagePanel(title, sheet.finish(), _facts(tip), LEGEND)


def click_panel(white_bgr: Bgr, click_px: tuple[float, float]) -> PagePanel:
    """Return the panel of a white image in which somebody said where the tip is."""
    sheet, title = _sheet(check_bgr(white_bgr), click_px, None)
    _mark(sheet, click_px, "said to be the tip")
    return PagePanel(title, sheet.finish(), (), ())


def _sheet(image: Bgr, tip_px: tuple[float, float], zoom: float | None) -> tuple[Sheet, str]:
    area = int(tip_px[0]) - TIP_AT_PX[0], int(tip_px[1]) - TIP_AT_PX[1], *AREA_PX
    part, how = brightened(crop(image, area))
    sheet = Sheet(part, area, fitting_zoom(AREA_PX) if zoom is None else zoom)
    sheet.scale_bar()
    return sheet, f"white light{how}"


def _mark(sheet: Sheet, at: tuple[float, float], text: str) -> None:
    sheet.cross(at, 8.0, INK, gap_px=3.0)
    sheet.label(text, at, INK, clear_px=8.0)


def verdict_on_tip(tip: Tip | NotFound) -> str:
    """Say in a sentence where the tip is, or why there is none."""
    if isinstance(tip, NotFound):
        return f"No tip ({tip.reason}): {tip.message}"
    return f"The tip is at ({tip.x_px:.2f}, {tip.y_px:.2f}) px."


def _facts(tip: Tip) -> tuple[str, ...]:
    edges = "edges hidden: by its marking" if tip.by_marking else f"edges {100 * tip.edge_support:.0f} %"
    trust = f"template {tip.score:.2f}   {edges}"
    look = f"marking {100 * tip.marking_contrast:.0f} %   sharpness {tip.sharpness:.2f}/px"
    return (
        f"tip ({tip.x_px:.2f}, {tip.y_px:.2f}) px, 1 sigma {tip.sigma_px:.2f} px",
        f"direction {np.degrees(tip.angle_rad):.2f} deg   width {tip.width_px:.1f} px   bend {tip.bend_px:+.1f} px",
        f"{trust}   {look}",
    )


def _draw_probe(sheet: Sheet, tip: Tip) -> None:
    """Draw the fitted probe; labels asked for first get the best places."""
    c, s = float(np.cos(tip.angle_rad)), float(np.sin(tip.angle_rad))
    end = tip.x_px, tip.y_px
    sheet.cross(end, 9.0, ANSWER, gap_px=2.5)
    sheet.label("tip", end, ANSWER, clear_px=3.0)
    sheet.line((end[0] - 330.0 * c, end[1] - 330.0 * s), (end[0] - 3.0 * c, end[1] - 3.0 * s), FRAME)
    for number, rim in enumerate((tip.rim1_px, tip.rim2_px), start=1):
        half = 0.5 * tip.width_px + 4.0
        sheet.line((rim[0] - half * s, rim[1] + half * c), (rim[0] + half * s, rim[1] - half * c), USED)
        sheet.label(f"rim {number}", (rim[0] + half * s, rim[1] - half * c), USED)
    _draw_edges(sheet, tip)
    sheet.cross(tip.intersection_px, 3.0, THROWN, turn_deg=45.0)
    sheet.label("edges would meet", tip.intersection_px, THROWN, clear_px=3.0)
    rim = tip.rim2_px
    sheet.label("bisector", (rim[0] + 45.0 * c, rim[1] + 45.0 * s), FRAME, clear_px=1.0)


def _draw_edges(sheet: Sheet, tip: Tip) -> None:
    """Draw L1 and L2 as far as they were measured, dashed to where they would meet, and the cylinder above."""
    silhouette = probe_outline((tip.x_px, tip.y_px), tip.angle_rad, tip.shape, 0.0)
    sheet.fill(silhouette)
    half = len(silhouette) // 2
    for side in (silhouette[2:half], silhouette[half : 2 * half - 2]):
        sheet.outline(side, USED, closed=False)
    for number, line in enumerate(tip.edges, start=1):
        c, s = float(np.cos(line.angle_rad)), float(np.sin(line.angle_rad))
        far = tip.shape.end_to_rim_px
        sheet.line((line.x_px - far * c, line.y_px - far * s), (line.x_px, line.y_px), USED)
        sheet.dashes((line.x_px, line.y_px), tip.intersection_px, USED)
        sheet.label(f"L{number}", (line.x_px - 0.6 * far * c, line.y_px - 0.6 * far * s), USED)


def _close_up(sheet: Sheet, tip: Tip) -> Bgr:
    """Return the end of the probe alone, with nothing drawn on the very end."""
    x, y = int(np.rint(tip.x_px)) - CLOSE_PX // 2, int(np.rint(tip.y_px)) - CLOSE_PX // 2
    area = x - sheet.x_px, y - sheet.y_px, CLOSE_PX, CLOSE_PX
    close = Sheet(crop(sheet.piece, area), (x, y, CLOSE_PX, CLOSE_PX), CLOSE_ZOOM)
    close.cross((tip.x_px, tip.y_px), 9.0, ANSWER, gap_px=2.0)
    return close.finish()
