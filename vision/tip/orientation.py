"""Orientation of the taper: its edges are looked for at every turn about the marking, not only straight ahead."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vision.core import Plane
from vision.tip.edges import ProbeAxis
from vision.tip.silhouette import Silhouette
from vision.tip.strip import ProbeStrip

TURNS_DEG = np.arange(-15.0, 15.01, 0.5)
SHIFTS_PX = np.arange(-4.0, 4.1, 1.0)
"""The place a probe gives way need not be the marking's rim: the turned taper may start this far aside."""
STRAIGHT_DEG, STRAIGHT_PX = 1.0, 1.0


@dataclass(frozen=True, slots=True)
class Turn:
    """Hold the share (0..1) of rows with both edges of the taper straight ahead, and at the best turn elsewhere.

    edges: the share of edges seen straight ahead, whether or not the other edge of the row is.
    """

    straight: float
    edges: float
    turned: float
    turn_deg: float


def taper_turn(strip: ProbeStrip, slope: Plane, outline: Silhouette, axis: ProbeAxis, pivot_u_px: float) -> Turn:
    """Return how much of the taper shows where the axis points and how much elsewhere, edges of either sign counting.

    A bent probe shows its taper elsewhere; a busy background hides it without showing one elsewhere.
    """
    own = outline.on_taper
    u = outline.u_px[own]
    rows = np.rint(u).astype(np.intp) - strip.u_from_px
    size = np.abs(slope[rows])
    steepest = (size >= cv2.dilate(size, np.ones((1, 5), np.uint8))) & (size > 0.7 * strip.edge_level)
    seen = cv2.dilate(steepest.astype(np.float32), np.ones((1, 3), np.uint8))
    centre = axis.a_px + axis.b * u + np.tan(np.radians(TURNS_DEG))[:, None, None] * (u - pivot_u_px)
    centre = centre + SHIFTS_PX[:, None] + strip.reach_px
    last, index = seen.shape[1] - 1, np.arange(u.size)
    wider = axis.taper_wider_px
    left = seen[index, np.clip(np.rint(centre + outline.left_px[own] - wider).astype(np.intp), 0, last)]
    right = seen[index, np.clip(np.rint(centre + outline.right_px[own] + wider).astype(np.intp), 0, last)]
    if outline.dim_side:
        left = right = right if outline.dim_side < 0 else left
    pairs, edges = np.mean(np.minimum(left, right), axis=2), np.mean(left + right, axis=2) / 2.0
    ahead = (np.abs(TURNS_DEG) <= STRAIGHT_DEG)[:, None] & (np.abs(SHIFTS_PX) <= STRAIGHT_PX)
    aside = (np.abs(TURNS_DEG) > 2.0 * STRAIGHT_DEG)[:, None] & np.ones(SHIFTS_PX.size, dtype=bool)
    best = int(np.argmax(np.where(aside, pairs, -1.0)))
    turn = float(TURNS_DEG[best // SHIFTS_PX.size])
    return Turn(float(np.max(pairs[ahead])), float(np.max(edges[ahead])), float(pairs.flat[best]), turn)
