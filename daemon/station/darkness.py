"""Darkness check: with both lamps off, the picture shows whether a lamp is on all the same.

A relay reads its coils back, not its contacts: one that is welded shut says off and shines. The needle rides with
camera and lamps, so that under a lamp something in the picture is bright wherever the head stands.
"""

from __future__ import annotations

import asyncio
import time

import numpy as np

from daemon.station.devices import Hardware
from drivers.camera.contract import Pixels
from drivers.deadline import Deadline
from drivers.errors import LightError

STEP_PX = 4
"""Every so many rows and columns tell as much as the whole picture."""
BRIGHT_PERCENTILE = 99.8
"""So few pixels are left out: hot ones. A needle's end is more."""


def bright_level(pixels: Pixels) -> float:
    """Return how bright the bright parts of a picture (H, W, 3) uint8 are in their strongest channel, 0..255."""
    return float(np.percentile(pixels[::STEP_PX, ::STEP_PX].max(axis=2), BRIGHT_PERCENTILE))


async def require_dark(hardware: Hardware, limit_level: float, deadline: Deadline) -> None:
    """Take a picture, the lamps being off; raise LightError if it is lit, CameraError if there is none."""
    frame = await hardware.camera.frame_after(time.monotonic() + hardware.lights.settle_s, deadline)
    level = await asyncio.to_thread(bright_level, frame.pixels)
    if limit_level and level > limit_level:
        text = f"both lamps are switched off, but the picture is lit: {level:.0f} of 255, at most {limit_level:.0f}"
        advice = "Look whether a ring shines: its relay contact sticks. If none does, close the hood: light comes in."
        raise LightError(text, device="lights", advice=advice)
