"""Soft shadow that the probe throws on the board."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.scene.needle import Needle
from sim_hw.scene.optics import Optics

_COARSE = 4
"""Px of the frame per px of the shadow's own image: it is soft anyway."""
_LENGTH_UM = 9_000.0
_STEPS = 40


def shadow(
    optics: Optics,
    needle: Needle,
    gap_um: float,
    azimuth_deg: float,
    lean: float,
    size_px: Sequence[int],
    pressed_um: float = 0.0,
) -> npt.NDArray[np.float32]:
    """Return the light that is left, 0..1, float32 (rows, columns) of a frame of `size_px` (width, height).

    The lamp shines from the side opposite to `azimuth_deg` (counted from the camera's viewing direction) and
    throws a shadow `lean` times as long as the thing is high. `gap_um` is how high the pin's end is over the surface,
    `pressed_um` how far the pin is pushed in.
    """
    turn = math.radians(azimuth_deg)
    c, s = math.cos(turn), math.sin(turn)
    away = needle.away
    direction = np.array([c * away[0] - s * away[1], s * away[0] + c * away[1], 0.0])
    aside = np.array([-direction[1], direction[0], 0.0])
    heights = np.linspace(0.0, _LENGTH_UM, _STEPS)
    radii = needle.radius_um(heights + pressed_um, pressed_um)
    # The surface is that far below the place where a free pin would end.
    below_um = gap_um - pressed_um
    ground = direction * ((heights + gap_um) * lean)[:, None] - np.array([0.0, 0.0, below_um])
    width, height = size_px[0] // _COARSE, size_px[1] // _COARSE
    dark = np.zeros((height, width), dtype=np.float32)
    for k in range(_STEPS - 1):
        # The lamp is not a point: the higher the part, the wider and fainter its shadow.
        blur_um = 60.0 + 0.30 * (heights[k] + gap_um)
        half = np.array([radii[k] + blur_um, radii[k + 1] + blur_um])
        corners = np.stack(
            (
                ground[k] - half[0] * aside,
                ground[k] + half[0] * aside,
                ground[k + 1] + half[1] * aside,
                ground[k + 1] - half[1] * aside,
            )
        )
        strength = 0.8 * radii[k] / (radii[k] + blur_um)
        patch = np.round(optics.project(corners) / _COARSE * 16.0).astype(np.int32)
        layer = np.zeros_like(dark)
        cv2.fillConvexPoly(layer, patch, float(strength), cv2.LINE_AA, 4)
        np.maximum(dark, layer, out=dark)
    light = 1.0 - cv2.GaussianBlur(dark, (0, 0), 2.5)
    return np.asarray(cv2.resize(light, (int(size_px[0]), int(size_px[1]))), dtype=np.float32)
