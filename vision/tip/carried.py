"""A tip that was measured a moment ago, found again before a ground that hides its edges.

The needle is the same from look to look, and rides with the camera. Where it stands before a part's body as grey as
its metal, its marking and the light on it still show by how much it has moved in the picture since it was measured
whole; the tip has moved with them. What lies below the marking is compared too: a needle that was bent in between is
none that was measured. A point that broke off in between does not show, so a tip is to be carried for a short while.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vision.core import Gray, check_bgr, despike, gray
from vision.tip.find import Tip
from vision.tip.probe_model import ProbeModel
from vision.tip.template_search import TAUGHT_SCORE, TemplateMatch, end_beside_whole, place, region, search

MOST_TURN_DEG, MOST_ASIDE_PX, MOST_BEND_PX = 0.5, 4.0, 0.5
"""By so much it may seem turned, moved across itself, and bent, the middle of what lies below the marking, since it was
measured; camera and head flex by less."""
ALONG_PX, ACROSS_PX = 0.35, 0.8
"""1-sigma of what is added by carrying it. Across, a lamp that has moved a little moves the streak of light on the
needle: 0.2 px where none has, 1.5 px where one has by three degrees."""


@dataclass(frozen=True, eq=False)
class KnownTip:
    """A tip, the model it was found by, and the part of the picture it was measured in."""

    tip: Tip
    model: ProbeModel
    part: Gray

    @classmethod
    def of(cls, white_bgr: Any, tip: Tip, model: ProbeModel) -> KnownTip:
        """Keep what is needed of a white image (H, W, 3) uint8 BGR in which `tip` was found."""
        x, y, width, height = region(model)
        return cls(tip, model, gray(check_bgr(white_bgr)[y : y + height, x : x + width]))

    def carried_to(self, white_bgr: Any) -> Tip | None:
        """Return the tip in a later white image; None where the needle does not show, or not as it was."""
        x, y, width, height = region(self.model)
        image = check_bgr(white_bgr)
        if x < 0 or y < 0 or x + width > image.shape[1] or y + height > image.shape[0]:
            return None
        then, now = self._then, self._marks(gray(image[y : y + height, x : x + width]))
        if then is None or now is None:
            return None
        (seen, end), (seen_then, end_then) = now, then
        turn_rad, dx, dy = seen.angle_rad - seen_then.angle_rad, seen.x_px - seen_then.x_px, seen.y_px - seen_then.y_px
        aside, bend = self._across(dx, dy), self._across(end[0] - end_then[0], end[1] - end_then[1])
        if abs(np.degrees(turn_rad)) > MOST_TURN_DEG or abs(aside) > MOST_ASIDE_PX or abs(bend) > MOST_BEND_PX:
            return None
        along, across = np.hypot(self.tip.sigma_along_px, ALONG_PX), np.hypot(self.tip.sigma_across_px, ACROSS_PX)
        return replace(
            self.tip.moved(dx, dy),
            angle_rad=self.tip.angle_rad + turn_rad,
            score=seen.score,
            sigma_along_px=float(along),
            sigma_across_px=float(across),
            sigma_px=float(np.sqrt((along**2 + across**2) / 2)),
            by_marking=True,
        )

    @cached_property
    def _then(self) -> tuple[TemplateMatch, tuple[float, float]] | None:
        return self._marks(self.part)

    def _marks(self, part: Gray) -> tuple[TemplateMatch, tuple[float, float]] | None:
        """Return where the needle shows, and where its end does beside it; None where it does not."""
        clean, origin = despike(part), region(self.model)[:2]
        seen = place(clean, self.model, origin, search(clean, self.model, origin)[0])
        if seen.score < TAUGHT_SCORE:
            return None
        turn_deg = round(float(np.degrees(self.tip.angle_rad - self.model.angle_rad)))
        return seen, end_beside_whole(clean, self.model, origin, seen, turn_deg)

    def _across(self, x_px: float, y_px: float) -> float:
        c, s = np.cos(self.tip.angle_rad), np.sin(self.tip.angle_rad)
        return float(y_px * c - x_px * s)
