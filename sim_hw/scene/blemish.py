"""Blemishes of a board: domed tin and solder, tarnish, dirt, dents of the needle.

Each changes the planes (uint8, blue, green, red under white; red under red) of one tile; all of it is seeded and
continues over the borders of tiles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

Plane = npt.NDArray[np.uint8]
Field = npt.NDArray[np.float32]
Index = npt.NDArray[np.intp]

DOME_REACH_UM = 200.0
"""From the edge of the metal inwards the dome rises over this way, then it is nearly level."""
_EDGE_SLOPE = 0.5
_ROUGHNESS = 0.07
_SHINE = 0.13
"""Spread of the slopes that throw a lamp into the lens."""
_TOWARDS_LAMP = {"white": (0.10, -0.07), "red": (-0.09, -0.10)}
_TARNISH = (0.60, 0.50, 0.32, 0.38)
"""How much fully tarnished metal loses of each plane."""
_SPOT_UM = (15.0, 420.0)
_CELL = 16
"""Texels. Domes are worked out in boxes of whole cells; rows of any other length might be rounded otherwise."""
_CLOSE_CELLS = 5
"""Metal within so many cells shares a box: boxes that overlap by their margins would cost twice."""
_MARGIN_CELLS = 3
"""Around a box: a dome's reach (34 texels), its smoothing (10) and slope (1) are less than that."""


@dataclass(frozen=True)
class Spot:
    """A speck of dirt: centre in texels, polygon about it in texels, grey level, how opaque it is."""

    box: tuple[float, float, float, float]
    outline: npt.NDArray[np.float32]
    level: int
    opacity: float


class Box(NamedTuple):
    """Rows y0 to y1 and columns x0 to x1, the last ones excluded."""

    y0: int
    y1: int
    x0: int
    x1: int


def lay_tin(
    planes: Sequence[Plane], metal: Plane | None, noise: tuple[Field, Field], texel_um: float, border: int
) -> None:
    """Lay on the planes how much brighter or darker domed metal looks under each lamp.

    `metal` is 255 where there is some, padded by `border`, and a multiple of the cell wide. Most of a tile has none, so
    that all is done in boxes about the metal, and at its texels alone.
    """
    if metal is None or not metal.any():
        return
    size = planes[0].shape[0]
    left = metal[border:-border, border:-border].copy()
    for box in _metal_boxes(metal):
        wide = _grown(box, metal.shape[0])
        rows, columns = (np.clip(np.array(ends) - border, 0, size).tolist() for ends in (box[:2], box[2:]))
        here = left[slice(*rows), slice(*columns)]
        y, x = np.nonzero(here)
        here[...] = 0  # boxes may overlap: nothing is domed twice
        if len(y):
            y, x = y + rows[0], x + columns[0]
            slopes = _dome(
                metal[wide[0] : wide[1], wide[2] : wide[3]], texel_um, (y + border - wide[0], x + border - wide[2])
            )
            _shine(planes, y * size + x, slopes, noise)


def _metal_boxes(metal: Plane) -> list[Box]:
    """Return boxes of whole cells that hold all metal: one about what lies close together."""
    cells = metal.shape[0] // _CELL
    some = (cv2.resize(metal, (cells, cells), interpolation=cv2.INTER_AREA) > 0).astype(np.uint8)
    near = cv2.dilate(some, np.ones((_CLOSE_CELLS, _CLOSE_CELLS), dtype=np.uint8))
    _, labels = cv2.connectedComponents(near, connectivity=8)
    labels = np.where(some > 0, labels, 0)
    boxes = []
    for label in np.unique(labels[labels > 0]).tolist():
        rows, columns = np.nonzero(labels == label)
        ends = (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1)
        boxes.append(Box(*(int(end) * _CELL for end in ends)))
    return boxes


def _grown(box: Box, size: int) -> Box:
    margin = _MARGIN_CELLS * _CELL
    return Box(max(0, box.y0 - margin), min(size, box.y1 + margin), max(0, box.x0 - margin), min(size, box.x1 + margin))


def _dome(metal: Plane, texel_um: float, at: tuple[Index, Index]) -> tuple[Field, Field]:
    """Return how the surface slopes, across and down, at places of a window of the metal."""
    texels = cv2.distanceTransform(metal, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # Some builds of OpenCV round roots by where the rows lie in memory; all of these are roots of whole numbers.
    depth = np.sqrt(np.rint(texels * texels)) * np.float32(texel_um)
    level = cv2.GaussianBlur(np.minimum(depth, DOME_REACH_UM), (0, 0), 2.5)
    slope_x = cv2.Sobel(level, cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)[at]
    slope_y = cv2.Sobel(level, cv2.CV_32F, 0, 1, ksize=3, scale=1.0 / 8.0)[at]
    steep = _EDGE_SLOPE * (1.0 - level[at] / DOME_REACH_UM) / texel_um
    return slope_x * steep, slope_y * steep


def _shine(planes: Sequence[Plane], at: Index, slopes: tuple[Field, Field], noise: tuple[Field, Field]) -> None:
    """Multiply the planes, at those texels counted row by row, by how much of each lamp is thrown into the lens."""
    across, down = (slope + _ROUGHNESS * field.reshape(-1)[at] for slope, field in zip(slopes, noise, strict=True))
    for lamp, lit in (("white", planes[:3]), ("red", planes[3:])):
        towards_x, towards_y = _TOWARDS_LAMP[lamp]
        away = (across - towards_x) ** 2 + (down - towards_y) ** 2
        gain = (0.5 + 0.85 * np.exp(-away / (2.0 * _SHINE**2))).astype(np.float32)
        for plane in lit:
            flat = plane.reshape(-1)
            flat[at] = _times(flat[None, at], gain[None])  # rows: OpenCV takes a short array for a colour


def tarnished(planes: Sequence[Plane], metal: Plane, noise: Field, oxide: float) -> list[Plane]:
    """Return the planes with bare metal (`metal` not 0) darkened, in patches."""
    patches = np.where(metal > 0, oxide * np.clip(0.8 + 0.35 * noise, 0.25, 1.25), 0.0).astype(np.float32)
    return [
        _times(plane, np.maximum(1.0 - loss * patches, 0.05).astype(np.float32))
        for plane, loss in zip(planes, _TARNISH, strict=True)
    ]


def _times(plane: Plane, gain: Field) -> Plane:
    return np.asarray(cv2.multiply(plane, gain, dtype=cv2.CV_8U), dtype=np.uint8)


def dirt(size: tuple[float, float], texel_um: float, per_cm2: float, seed: int) -> list[Spot]:
    """Return the specks on a board of that size (columns, rows of texels)."""
    rng = np.random.default_rng((seed, 23))
    area_cm2 = size[0] * size[1] * (texel_um * 1e-4) ** 2
    angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    spots = []
    for _ in range(round(per_cm2 * area_cm2)):
        centre = rng.uniform((0.0, 0.0), size)
        radius = math.exp(rng.uniform(*np.log(_SPOT_UM))) / texel_um
        ragged = 1.0 + sum(rng.normal(0.0, 0.14) * np.cos(k * angles + rng.uniform(0.0, 6.3)) for k in (1, 2, 3, 5))
        long, turn = rng.uniform(0.6, 1.6), rng.uniform(0.0, math.pi)
        x, y = radius * ragged * long * np.cos(angles), radius * ragged / long * np.sin(angles)
        outline = np.column_stack((x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)))
        placed = (outline + centre).astype(np.float32)
        low, high = placed.min(axis=0), placed.max(axis=0)
        box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        spots.append(Spot(box, placed, int(rng.integers(6, 225)), float(rng.uniform(0.45, 1.0))))
    return spots


def lay_spot(planes: Sequence[Plane], spot: Spot, left: int, top: int) -> None:
    """Paint a speck on the planes of the tile at (left, top)."""
    cover = np.zeros(planes[0].shape, dtype=np.uint8)
    fixed = np.round((spot.outline - (left + 0.5, top + 0.5)) * 16.0).astype(np.int32)
    cv2.fillPoly(cover, [fixed], round(255 * spot.opacity), cv2.LINE_AA, 4)
    _blend(planes, cover, (spot.level,) * 3 + (round(0.8 * spot.level),))


def lay_dent(planes: Sequence[Plane], centre: tuple[float, float], radius: float) -> None:
    """Paint a dent on the planes of a tile; centre and radius in its texels: a dark pit with a bright lip."""
    x, y = (round(value * 16.0) for value in centre)
    for share, shift, strength, level in ((1.25, 0.18, 110, 235), (1.0, 0.0, 190, 48), (0.45, 0.1, 120, 20)):
        cover = np.zeros(planes[0].shape, dtype=np.uint8)
        off = round(shift * radius * 16.0)
        cv2.circle(cover, (x + off, y - off), round(share * radius * 16.0), strength, -1, cv2.LINE_AA, 4)
        _blend(planes, cover, (level,) * len(planes))


def _blend(planes: Sequence[Plane], cover: Plane, colour: tuple[int, ...]) -> None:
    rows, columns = np.flatnonzero(cover.any(axis=1)), np.flatnonzero(cover.any(axis=0))
    if not len(rows):
        return
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    share = cover[box].astype(np.float32) / 255.0
    for plane, level in zip(planes, colour, strict=True):
        plane[box] = np.round(plane[box] + (level - plane[box].astype(np.float32)) * share).astype(np.uint8)
