"""Search for the tip in white frames: a tip that was measured a moment ago is carried to where the ground hides it."""

from __future__ import annotations

import asyncio
import time

from drivers.camera import Frame
from vision import KnownTip, NotFound, ProbeModel, Reason, Tip, find_tip

UNUSABLE = frozenset({Reason.TOO_DARK, Reason.SATURATED, Reason.BLURRED, Reason.OUT_OF_FRAME})
"""Reasons of a picture that is no good itself."""
CARRIED_S, MOST_CARRIED = 120.0, 40
"""A tip is carried for so long, and so often, after it was measured: a point that broke off is seen where the ground is
dark, and it makes no contact meanwhile."""


class TipSearch:
    """Finds the tip of one station's needle, and keeps the one that was measured last."""

    def __init__(self) -> None:
        self._known: KnownTip | None = None
        self._until_s = 0.0
        self._carried = 0

    def forget(self) -> None:
        """Hear that the needle may be another one."""
        self._known = None

    async def find(self, white: Frame, model: ProbeModel | None, *, measured: bool = False) -> Tip | NotFound | None:
        """Run TEDA, if a probe has been taught. `measured`: a tip that is only carried will not do."""
        if model is None:
            return None
        tip = await asyncio.to_thread(find_tip, white.pixels, model)
        if isinstance(tip, Tip):
            self._known, self._carried = KnownTip.of(white.pixels, tip, model), 0
            self._until_s = time.monotonic() + CARRIED_S
            return tip
        known = None if measured or tip.reason in UNUSABLE else self._carriable(model)
        carried = None if known is None else await asyncio.to_thread(known.carried_to, white.pixels)
        if carried is None:
            return tip
        self._carried += 1
        return carried

    def _carriable(self, model: ProbeModel) -> KnownTip | None:
        known = self._known
        if known is None or known.model is not model or self._carried >= MOST_CARRIED:
            return None
        return known if time.monotonic() < self._until_s else None
