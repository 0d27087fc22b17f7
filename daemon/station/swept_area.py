"""Area over which a part of the head passes on its way, robot frame. Pure geometry.

Between two places each axis goes by its own ramps: the head may pass anywhere in the box that they span, at any angle
between theirs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from drivers.gantry import Position
from vision.geometry import Array, rotation
from vision.head import Head

STEP_DEG = 2.0
NEEDLE: tuple[tuple[float, float], ...] = ((0.0, 0.0),)


def swept_areas_um(
    places: Sequence[Position], head: Head, corners_um: Iterable[tuple[float, float]] = NEEDLE
) -> list[Array]:
    """Return the convex area (N, 2) of each part of a way, between one place and the next.

    corners_um: of what is carried, about the needle, at head angle 0; as it stands, the needle itself.
    """
    corners = np.array(list(corners_um), dtype=float)
    return [_swept(start, end, head, corners) for start, end in itertools.pairwise(places)]


def _swept(start: Position, end: Position, head: Head, corners: Array) -> Array:
    """Return the area of one part of a way."""
    steps = max(1, math.ceil(abs(end.theta_deg - start.theta_deg) / STEP_DEG))
    angles = np.linspace(start.theta_deg, end.theta_deg, steps + 1).tolist()
    carried = np.vstack([head.tip_offset_um(angle) + corners @ rotation(angle).T for angle in angles])
    if steps > 1 or start.theta_deg != end.theta_deg:
        # Between two angles a corner goes along an arc, which is as far out as this beyond its chord
        half = math.radians(abs(end.theta_deg - start.theta_deg) / steps / 2.0)
        carried = carried / math.cos(half)
    box = np.array(list(itertools.product((start.x_um, end.x_um), (start.y_um, end.y_um))))
    everywhere = (box[:, None] + carried[None]).reshape(-1, 2)
    hull = cv2.convexHull(everywhere.astype(np.float32))
    # Of places that are all the same there is no hull
    return everywhere[:1] if hull is None else np.asarray(hull, dtype=float).reshape(-1, 2)
