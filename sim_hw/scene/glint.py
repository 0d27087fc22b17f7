"""Glints: small highlights that a lamp throws into the lens."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX

Image = npt.NDArray[np.uint8]


def highlight(images: Iterable[Image], centre: npt.NDArray[np.float64], sigma_px: float, strength: float) -> None:
    """Add a soft bright spot to the images."""
    reach = math.ceil(3.0 * sigma_px)
    column, row = round(float(centre[0])), round(float(centre[1]))
    rows = np.arange(max(0, row - reach), min(HEIGHT_PX, row + reach + 1))
    columns = np.arange(max(0, column - reach), min(WIDTH_PX, column + reach + 1))
    if not len(rows) or not len(columns):
        return
    away = (rows[:, None] - centre[1]) ** 2 + (columns[None, :] - centre[0]) ** 2
    bright = strength * np.exp(-away / (2.0 * sigma_px**2))
    for image in images:
        region = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        added = bright if image.ndim == 2 else bright[..., None]
        region[...] = np.clip(region + added, 0.0, 255.0)
