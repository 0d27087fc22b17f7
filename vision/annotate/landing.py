"""Picture of a landing for a layman: the pad's outline, where the needle would come down, and what is left between.

The camera looks from the side and the needle hovers: in the picture its end lies beside the place below it, and that
place is what counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.annotate.page import PagePanel
from vision.annotate.sheet import ANSWER, INK, THROWN, USED, Sheet, crop
from vision.core import Bgr

LEAST_HALF_PX, ROOM_PX = 70.0, 28.0
"""Half of the picture's side at least, and what is shown round what has to be in it."""
SIDE = 640.0
"""Of the picture on the page, about."""
DISC_PX = 2.6
"""The place below the needle is drawn as a disc of this radius, and wider where the needle's end is."""


@dataclass(frozen=True, eq=False)
class Landing:
    """Where the needle would come down, as a look showed it, px.

    tip_px: the needle's end; below_px: the place below it on the board. target_px: where it should come down;
    outline_px: (N, 2), of the target's bare metal, None where that is not known. off_um: between both places.
    """

    tip_px: tuple[float, float]
    below_px: tuple[float, float]
    target_px: tuple[float, float]
    outline_px: NDArray[np.float64] | None
    off_um: float

    @property
    def on_metal(self) -> bool | None:
        """Whether the place below the needle lies within the metal's outline; None where that is not known."""
        if self.outline_px is None:
            return None
        outline = self.outline_px.astype(np.float32)[:, None, :]
        return cv2.pointPolygonTest(outline, self.below_px, measureDist=False) >= 0


def landing_panel(bgr: Bgr, landing: Landing) -> PagePanel:
    """Return the panel of an image, about the target and the needle's end."""
    shown = [landing.tip_px, landing.below_px, landing.target_px]
    corners = np.array(shown if landing.outline_px is None else [*shown, *landing.outline_px])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = int(max(LEAST_HALF_PX, float((high - low).max()) / 2 + ROOM_PX))
    middle = (low + high) / 2
    area = (int(middle[0]) - half, int(middle[1]) - half, 2 * half, 2 * half)
    sheet = Sheet(crop(bgr, area), area, max(1.0, SIDE / (2 * half)))
    colour = USED if landing.on_metal is not False else THROWN
    if landing.outline_px is not None:
        sheet.outline(landing.outline_px, ANSWER)
    sheet.cross(landing.target_px, 5.0, ANSWER, gap_px=1.5)
    sheet.dashes(landing.tip_px, landing.below_px, INK)
    if np.hypot(*np.subtract(landing.target_px, landing.below_px)) > DISC_PX:
        sheet.line(landing.below_px, landing.target_px, colour, thickness=2)
    sheet.ring(landing.below_px, (DISC_PX, DISC_PX), 0.0, colour)
    sheet.ring(landing.below_px, (2 * DISC_PX, 2 * DISC_PX), 0.0, colour)
    sheet.label(f"comes down here, {landing.off_um:.0f} um off", landing.below_px, colour, clear_px=3 * DISC_PX)
    sheet.label("pad" if landing.outline_px is not None else "target", landing.target_px, ANSWER, clear_px=14.0)
    where = {True: "on the pad's metal", False: "off the pad's metal", None: "its metal is not known"}[landing.on_metal]
    legend = ((ANSWER, "pad, as it lies"), (colour, "place below the needle"), (INK, "from the needle's end down"))
    return PagePanel("white light", sheet.finish(), (f"{landing.off_um:.1f} um from the target, {where}",), legend)


def verdict_on_landing(landing: Landing) -> str:
    """Say in a sentence whether the needle would meet the pad."""
    off = f"{landing.off_um:.0f} um from where it should"
    if landing.on_metal is None:
        return f"The needle would come down {off}."
    return f"The needle {'meets' if landing.on_metal else 'misses'} the pad: it comes down {off}."
