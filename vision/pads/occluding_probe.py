"""Unknown probe in a red image of which only the tip is known: two edges that spread from it (thesis 5.3, eq. 5.7).

A probe over a pad hides part of it. The daemon knows the probe from the white image; here it is enough that two
straight edges begin beside the tip and spread upwards about where a probe is. Where they do, what lies between them is
the probe; where they do not, there is none in this image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.core import Edgels, robust_fit

Floats = NDArray[np.float64]
LEAST_POINTS = 16
MOST_ALONG = 0.45
"""An edge runs along the probe to this (cosine between its slope and the probe's direction)."""
NEAREST_PX, FARTHEST_PX = 4.0, 46.0
"""How far behind the tip edges are looked for, px."""
HALF_END_PX = np.array([1.5, 2.25, 3.0, 3.75])
"""A probe's half width at the tip, how it widens (half the taper), and how it may be turned, rad."""
TAPER = np.array([0.10, 0.12, 0.14, 0.16, 0.18])
TURN = np.arange(-0.10, 0.101, 0.02)
NEAR_PX = 1.1
LEAST_EACH, LEAST_BOTH = 0.25, 1.0
"""Share of the length along which each edge must show, and both together."""
LEAST_TAPER = 0.05
"""Two lines that hardly spread are the edges of the streak."""
LEAST_STREAK = 0.8
"""Share of the length along which a streak must show when the edges do not."""
LEAST_SLOPE = 3.0
"""Edges weaker than those of pads are asked here: dim metal before a dark board, levels per px."""


@dataclass(frozen=True, slots=True)
class SeenProbe:
    """Hold what a red image shows of the probe: its outline (4, 2) px, and whether both edges were seen.

    When only a streak of light along it was seen, the outline is where it may be, whatever its taper and turn.
    """

    outline_px: Floats
    certain: bool


def find_probe(edgels: Edgels, tip_px: tuple[float, float], direction_rad: float, margin_px: float) -> SeenProbe | None:
    """Find a probe that ends at `tip_px`, its outline grown by `margin_px`; None where none shows.

    direction_rad: about where the probe points, good to a few degrees.
    """
    c, s = float(np.cos(direction_rad)), float(np.sin(direction_rad))
    dx, dy = edgels.x_px - tip_px[0], edgels.y_px - tip_px[1]
    behind, beside = -(dx * c + dy * s), dy * c - dx * s
    widest = HALF_END_PX[-1] + (TAPER[-1] + TURN[-1]) * behind + NEAR_PX
    across = np.abs(edgels.toward_x * c + edgels.toward_y * s) < MOST_ALONG
    near = across & (behind > NEAREST_PX) & (behind < FARTHEST_PX) & (np.abs(beside) < widest)
    behind, beside = behind[near], beside[near]
    if behind.size < LEAST_POINTS:
        return None

    def outline(half_end: float, taper: float, turn: float) -> Floats:
        far = 3.0 * FARTHEST_PX
        along = np.array([margin_px, -far, -far, margin_px])
        wide = half_end + margin_px
        off = np.array([wide, wide + far * taper, -wide - far * taper, -wide]) - along * turn
        return np.stack([tip_px[0] + along * c - off * s, tip_px[1] + along * s + off * c], axis=1)

    (end, taper, turn), shown = _wedge(behind, beside)
    if min(shown) >= LEAST_EACH and sum(shown) >= LEAST_BOTH and taper > LEAST_TAPER:
        return SeenProbe(outline(end, taper, turn), certain=True)
    if _streak(behind, beside) < LEAST_STREAK:
        return None
    return SeenProbe(outline(float(HALF_END_PX[-1]), float(TAPER.mean() + TURN[-1] / 2.0), 0.0), certain=False)


def _wedge(behind: NDArray[np.float32], beside: NDArray[np.float32]) -> tuple[tuple[float, float, float], list[float]]:
    """Return the (half end, taper, turn) whose two edges show best, and the share of each that does."""
    turned = beside - TURN[:, None] * behind
    half = HALF_END_PX[:, None, None] + TAPER[None, :, None] * behind
    # (ends, tapers, turns, points): how far each point lies off each outline.
    near = np.abs(np.abs(turned)[None, None] - half[:, :, None]) < NEAR_PX
    right = turned > 0.0
    # The streak of light along the metal is one strong straight line: what counts is that both edges show.
    score = np.count_nonzero(near & right, axis=3) * np.count_nonzero(near & ~right, axis=3)
    end, taper, turn = np.unravel_index(int(np.argmax(score)), score.shape)
    on_edge, side = near[end, taper, turn], np.where(right[turn], 1.0, -1.0)
    shown = [_share(behind[on_edge & (side == which)]) for which in (1.0, -1.0)]
    if min(shown) < LEAST_EACH:
        return (0.0, 0.0, 0.0), shown
    # side * beside = end + taper * behind + turn * side * behind
    u, way = behind[on_edge], side[on_edge]
    fit = robust_fit(
        np.stack([np.ones_like(u), u, way * u], axis=1).astype(np.float64), way * beside[on_edge], rounds=3
    )
    return (float(fit.parameters[0]), float(fit.parameters[1]), float(fit.parameters[2])), shown


def _streak(behind: NDArray[np.float32], beside: NDArray[np.float32]) -> float:
    """Return along which share of the length the best straight line from beside the tip shows."""
    start, slant = np.arange(-3.0, 3.1, 1.0)[:, None, None], np.arange(-0.24, 0.241, 0.02)[None, :, None]
    near = np.abs(beside - start - slant * behind) < NEAR_PX
    best = np.unravel_index(int(np.argmax(np.count_nonzero(near, axis=2))), near.shape[:2])
    return _share(behind[near[best]])


def _share(behind: NDArray[np.float32]) -> float:
    """Return along which share of the length looked at edge points lie."""
    rows = np.unique(np.floor(behind / 2.0)).size
    return 2.0 * rows / (FARTHEST_PX - NEAREST_PX)
