"""Orthophoto: a plane as seen square on, so that distances in it are linear (thesis 3.3, figures 3.5, 3.7 and 3.8).

The thesis regenerates it "using a 2D rigid transformation" (eq. 3.23). That cannot be: a rigid transformation keeps the
perspective of an oblique view. What removes it is the homography of the plane, `K (r1 r2 r3 z + t)` from eq. 3.24.
Eq. 3.23 is what remains to be found afterwards, when the orthophoto is laid on a board that lies shifted and turned:
`similarity`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.core import Bgr, check_bgr
from vision.geometry.camera_model import Extrinsics, Intrinsics, check_points
from vision.geometry.frames import Array

LONGEST_SIDE_PX, MOST_PIXELS = 32_000, 100_000_000
"""OpenCV's warp takes no longer side than this, and no one looks at more pixels."""


@dataclass(frozen=True)
class Orthophoto:
    """A plane seen square on from the side its z points to: world x right, world y up.

    picture: (H, W, 3) uint8 BGR, black where the camera did not look; seen: (H, W) bool, where it did. Pixel (0, 0)
    shows `origin_um`, the upper left corner of the area asked for.
    """

    picture: Bgr
    seen: NDArray[np.bool_]
    origin_um: tuple[float, float]
    scale_px_per_um: float
    z_um: float

    def to_um(self, points_px: ArrayLike) -> Array:
        """Return where its pixels, (2,) or (N, 2), lie on the plane, um."""
        return np.asarray(self.origin_um + check_points(points_px, "points_px", 2) * (1, -1) / self.scale_px_per_um)

    def to_px(self, points_um: ArrayLike) -> Array:
        """Return its pixels, (2,) or (N, 2), of places on the plane, um."""
        return np.asarray((check_points(points_um, "points_um", 2) - self.origin_um) * (1, -1) * self.scale_px_per_um)


def plane_homography(intrinsics: Intrinsics, extrinsics: Extrinsics, z_um: float = 0.0) -> Array:
    """Return the homography, (3, 3), from (x_um, y_um, 1) on the plane at height z to pixels (eq. 3.24).

    Its scale makes the third coordinate the depth in um.
    """
    m = extrinsics.matrix
    return np.asarray(intrinsics.matrix @ np.column_stack([m[:, 0], m[:, 1], m[:, 2] * z_um + m[:, 3]]))


def make_orthophoto(
    bgr: Any,
    intrinsics: Intrinsics,
    extrinsics: Extrinsics,
    area_um: tuple[float, float, float, float],
    scale_px_per_um: float,
    z_um: float = 0.0,
) -> Orthophoto:
    """Return the plane at height z as it would be seen square on.

    bgr (H, W, 3) uint8. area_um: (x, y, width, height) in the world, (x, y) its corner of least x and y; pixel centres
    lie on its left and upper edge. scale_px_per_um should be no coarser than the camera's own, or fine detail aliases:
    pixels are interpolated (bilinear), not averaged.

    Raises ValueError for another array, an area or scale that is not finite and positive, an image too large, or an
    area that the camera does not see at all or that reaches behind it.
    """
    image = check_bgr(bgr)
    x, y, width, height = area_um
    if not (all(map(math.isfinite, (*area_um, scale_px_per_um, z_um))) and min(width, height, scale_px_per_um) > 0.0):
        raise ValueError(
            f"an area (x, y, width, height) and a scale must be finite and positive: {area_um}, {scale_px_per_um}"
        )
    # The small addition keeps an area of a whole number of pixels whole.
    columns, rows = (int(min(side * scale_px_per_um + 1e-6, 1e9)) + 1 for side in (width, height))
    if max(columns, rows, *image.shape) > LONGEST_SIDE_PX or columns * rows > MOST_PIXELS:
        raise ValueError(f"{columns} x {rows} px are too many; take a smaller area or fewer px per um")
    pitch_um, top_um = 1.0 / scale_px_per_um, y + height
    to_plane = np.array([[pitch_um, 0.0, x], [0.0, -pitch_um, top_um], [0.0, 0.0, 1.0]])
    with np.errstate(over="ignore", invalid="ignore"):
        to_image = plane_homography(intrinsics, extrinsics, z_um) @ to_plane
        corners = to_image @ [[0, columns, 0, columns], [0, 0, rows, rows], [1, 1, 1, 1]]
    # Depth is linear on a plane: what holds at the corners holds within.
    if not (np.isfinite(to_image).all() and (corners[2] > 0.0).all()):
        raise ValueError("the area reaches behind the camera; check the pose and take a smaller area")
    picture = _warp(image, to_image, (columns, rows))
    seen = _warp(np.full(image.shape[:2], 255, dtype=np.uint8), to_image, (columns, rows)) == 255
    if not seen.any():
        raise ValueError("the camera does not see this area; check the pose and the area")
    return Orthophoto(picture, seen, (float(x), float(top_um)), float(scale_px_per_um), float(z_um))


def _warp(plane: NDArray[np.uint8], to_source: Array, size: tuple[int, int]) -> NDArray[np.uint8]:
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(plane, to_source, size, flags=flags), dtype=np.uint8)
