"""Panel of the red image: what was taken, thrown and left undecided, each with the rule that decided."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np

from vision.annotate.page import PagePanel, fitting_zoom
from vision.annotate.sheet import ANSWER, FRAME, INK, THROWN, UNDECIDED, USED, Colour, Sheet, brightened, crop
from vision.core import Bgr, CircleFit, NotFound, check_bgr, red_signal
from vision.pads import PROBE_MARGIN_PX, Decided, Seen, TestPoint
from vision.tip import Tip, probe_outline

MARGIN_PX, UNSEARCHED_PX = 6, 119
"""Room round the window, and what is shown when there was nothing to look round."""
MOST_LABELS = 16
"""So many objects get a label; the others only their mark, and a count below."""
LEGEND = (
    (ANSWER, "nearest test point"),
    (USED, "other test points"),
    (THROWN, "thrown"),
    (UNDECIDED, "undecided"),
    (FRAME, "window, needle"),
)


def pads_panel(
    red_bgr: Bgr, seen: Seen, around_px: tuple[float, float], needle: Tip | None, zoom: float | None
) -> PagePanel:
    """Return the panel of a red image that was searched round `around_px`, with the probe known or not."""
    x, y, width, height = seen.window_px
    sheet, title = _sheet(red_bgr, (x - MARGIN_PX, y - MARGIN_PX, width + 2 * MARGIN_PX, height + 2 * MARGIN_PX), zoom)
    corners = np.array([(x, y), (x + width - 1, y), (x + width - 1, y + height - 1), (x, y + height - 1)])
    sheet.outline(corners.astype(np.float64), FRAME)
    if needle is not None:
        end = needle.x_px, needle.y_px
        sheet.outline(probe_outline(end, needle.angle_rad, needle.shape, PROBE_MARGIN_PX), FRAME)
    _draw_all(sheet, seen, around_px, "tip" if needle is not None else "looked round here")
    sheet.scale_bar()
    return PagePanel(title, sheet.finish(), _facts(seen, around_px), LEGEND)


def unsearched_panel(red_bgr: Bgr, near_px: tuple[float, float] | None, zoom: float | None) -> PagePanel:
    """Return the panel of a red image that was not searched, since it is not known where to look."""
    image = check_bgr(red_bgr)
    at = near_px or (image.shape[1] / 2.0, image.shape[0] / 2.0)
    half = UNSEARCHED_PX // 2
    sheet, title = _sheet(image, (int(at[0]) - half, int(at[1]) - half, UNSEARCHED_PX, UNSEARCHED_PX), zoom)
    sheet.scale_bar()
    return PagePanel(title, sheet.finish(), ("not searched: there is no tip to look round",), ())


def verdict_on_pads(seen: Seen, around_px: tuple[float, float]) -> str:
    """Say in a sentence what is nearest and how far it is, or why there is nothing."""
    if isinstance(seen.nearest, NotFound):
        return f"No test point ({seen.nearest.reason}): {seen.nearest.message}"
    dx, dy = seen.nearest.x_px - around_px[0], seen.nearest.y_px - around_px[1]
    return (
        f"The nearest test point is a {seen.nearest.kind}, {np.hypot(dx, dy):.2f} px away: x {dx:+.2f}, y {dy:+.2f} px."
    )


def _sheet(image: Bgr, area: tuple[int, int, int, int], zoom: float | None) -> tuple[Sheet, str]:
    """Return the sheet of a piece in the channel that is measured, which people see better than red on black."""
    plane = red_signal(crop(image, area))
    part, how = brightened(np.asarray(cv2.cvtColor(plane, cv2.COLOR_GRAY2BGR), dtype=np.uint8))
    sheet = Sheet(part, area, fitting_zoom((area[2], area[3])) if zoom is None else zoom)
    return sheet, f"red light, its signal in gray{how}"


def _draw_all(sheet: Sheet, seen: Seen, around: tuple[float, float], place: str) -> None:
    """Draw everything that was seen; labels asked for first get the best places."""
    room = MOST_LABELS
    for point in sorted(seen.taken, key=lambda point: point is not seen.nearest):
        _draw_point(sheet, point, ANSWER if point is seen.nearest else USED, labelled=room > 0)
        room -= 1
    sheet.cross(around, 5.0, INK, gap_px=1.0)
    sheet.label(place, around, INK, clear_px=1.5)
    if isinstance(seen.nearest, TestPoint):
        sheet.line(around, (seen.nearest.x_px, seen.nearest.y_px), ANSWER)
    for decided, colour, verdict in ((seen.undecided, UNDECIDED, "undecided: "), (seen.thrown, THROWN, "")):
        for item in decided:
            circle = item.object.circle
            size = "" if circle is None or colour is THROWN else f", r {circle.radius_px:.1f} px"
            _draw_decided(sheet, item, colour, f"{verdict}{words(item.rule)}{size}" if room > 0 else "")
            room -= 1


def _draw_point(sheet: Sheet, point: TestPoint, colour: Colour, *, labelled: bool) -> None:
    _draw_circle(sheet, point.pad_px, point.radius_px, point, colour)
    if point.hole_px is not None:
        _draw_circle(sheet, point.hole_px[:2], point.hole_px[2], point, colour)
    sheet.cross((point.x_px, point.y_px), 2.6, colour, gap_px=0.8)
    if labelled:
        text = f"{words(point.rule)}, r {point.radius_px:.1f} px"
        sheet.label(text, point.pad_px, colour, clear_px=point.radius_px)


def _draw_decided(sheet: Sheet, item: Decided, colour: Colour, text: str) -> None:
    at, circle = (item.object.x_px, item.object.y_px), item.object.circle
    if circle is not None:
        _draw_circle(sheet, at, circle.radius_px, circle, colour)
    sheet.cross(at, 2.0, colour, turn_deg=45.0)
    if text:
        sheet.label(text, at, colour, clear_px=2.0 if circle is None else circle.radius_px)


def _draw_circle(
    sheet: Sheet, at: tuple[float, float], radius_px: float, form: TestPoint | CircleFit, colour: Colour
) -> None:
    """Draw a circle on the board as the ellipse that `form` was measured to be."""
    sheet.ring(at, (radius_px * form.ratio, radius_px), float(np.degrees(form.minor_rad)), colour)


def _facts(seen: Seen, around: tuple[float, float]) -> tuple[str, ...]:
    counts = f"{len(seen.taken)} taken, {len(seen.thrown)} thrown, {len(seen.undecided)} undecided"
    rules = Counter(words(item.rule) for item in (*seen.thrown, *seen.undecided))
    unlabelled = len(seen.taken) + len(seen.thrown) + len(seen.undecided) > MOST_LABELS
    last = [", ".join(f"{count} {rule}" for rule, count in rules.most_common(6))] if unlabelled else []
    if isinstance(seen.nearest, NotFound):
        return (f"no test point: {seen.nearest.reason}", counts, *last)
    point = seen.nearest
    dx, dy = point.x_px - around[0], point.y_px - around[1]
    place = f"({point.x_px:.2f}, {point.y_px:.2f}) px, 1 sigma {point.sigma_px:.2f} px"
    return (
        f"{words(point.rule)} {place}, {100 * point.visible:.0f} % visible",
        f"{np.hypot(dx, dy):.2f} px away: x {dx:+.2f}, y {dy:+.2f} px   {counts}",
        *last,
    )


def words(rule: str) -> str:
    """Return a rule's name as people say it."""
    return rule.replace("_", " ")
