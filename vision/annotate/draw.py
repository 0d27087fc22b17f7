"""Pages for a process engineer: what was seen, on a magnified copy, with the verdict in words and a key of the colours.

Each function returns a page: (H, W, 3) uint8 BGR.
"""

from __future__ import annotations

from typing import NamedTuple

from vision.annotate.board import BoardLook, board_panel, verdict_on_board
from vision.annotate.cross import cross_panel, verdict_on_cross
from vision.annotate.landing import Landing, landing_panel, verdict_on_landing
from vision.annotate.pads import pads_panel, unsearched_panel, verdict_on_pads
from vision.annotate.page import PagePanel, page
from vision.annotate.tip import click_panel, tip_panel, verdict_on_tip
from vision.control_point import ControlPoint
from vision.core import Bgr, NotFound
from vision.pads import Seen
from vision.tip import ProbeModel, Tip


class Searched(NamedTuple):
    """Hold what was seen in a red image, and the point (x, y) px it was looked for round."""

    seen: Seen
    around_px: tuple[float, float]


def draw_tip(
    white_bgr: Bgr,
    tip: Tip | NotFound,
    near_px: tuple[float, float] | None = None,
    zoom: float | None = None,
    *,
    taught: ProbeModel | None = None,
) -> Bgr:
    """Return a page on how the tip was found (or why not): edges, bisector, rims, end, and the numbers.

    When there is no tip, the probe is drawn as it was `taught`, or else the place `near_px` is shown (default: the
    image's middle). zoom: default, as large as fits.
    """
    return page(verdict_on_tip(tip), [tip_panel(white_bgr, tip, near_px, zoom, taught)], good=bool(tip))


def draw_untaught(white_bgr: Bgr, click_px: tuple[float, float], problem: str) -> Bgr:
    """Return a page on a probe that could not be taught: where its end was said to be, and the problem in words."""
    return page(f"Not taught: {problem}", [click_panel(white_bgr, click_px)], good=False)


def draw_test_points(
    red_bgr: Bgr, seen: Seen, tip_px: tuple[float, float], zoom: float | None = None, *, needle: Tip | None = None
) -> Bgr:
    """Return a page on what was taken, thrown and left undecided round `tip_px`, each with the rule that decided.

    needle: as it was given to `find_test_points`. zoom: default, as large as fits.
    """
    panel = pads_panel(red_bgr, seen, tip_px, needle, zoom)
    return page(verdict_on_pads(seen, tip_px), [panel], good=bool(seen))


def draw_look(
    white_bgr: Bgr, tip: Tip | NotFound, red_bgr: Bgr, searched: Searched | None, taught: ProbeModel | None = None
) -> Bgr:
    """Return a page with both images of a look side by side.

    searched: None when the red image was not searched, for want of a tip. taught: the probe that was looked for.
    """
    panels: list[PagePanel] = [tip_panel(white_bgr, tip, taught=taught)]
    if searched is None:
        panels.append(unsearched_panel(red_bgr, None if taught is None else taught.tip_px, None))
        return page(verdict_on_tip(tip), panels, good=False)
    panels.append(pads_panel(red_bgr, *searched, tip if isinstance(tip, Tip) else None, None))
    verdicts = [verdict_on_pads(*searched)] if tip else [verdict_on_tip(tip), verdict_on_pads(*searched)]
    return page(" ".join(verdicts), panels, good=bool(tip) and bool(searched.seen))


def draw_board(red_bgr: Bgr, look: BoardLook) -> Bgr:
    """Return a page with CAD over the red image: what was confirmed, contradicted and hidden, and the rivals."""
    return page(verdict_on_board(look), [board_panel(red_bgr, look)], good=bool(look.answer))


def draw_landing(white_bgr: Bgr, landing: Landing) -> Bgr:
    """Return a page on where the needle would come down: the pad's outline, the place below it, what is left."""
    return page(verdict_on_landing(landing), [landing_panel(white_bgr, landing)], good=landing.on_metal is not False)


def draw_control_point(white_bgr: Bgr, found: ControlPoint | NotFound, around_px: tuple[float, float],
                       reach_px: float = 60.0, arm_px: float = 60.0) -> Bgr:  # fmt: skip
    """Return a page on where the arms of a control point run and meet, or where it was looked for."""
    panel = cross_panel(white_bgr, found, around_px, reach_px, arm_px)
    return page(verdict_on_cross(found), [panel], good=bool(found))
