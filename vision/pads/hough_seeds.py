"""Circle proposals (Hough): every edge point votes for the centres it could belong to.

Votes are only seeds; `circle.fit_circle` measures. Unlike whole objects, votes stand a probe across the pad, a trace
leading away from it, a hole in it, and a neighbour that touches it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Edgels, View, quantile

LEAST_VOTE, LEAST_SHARE = 0.22, 0.38
"""Share of a whole contour that must vote for a place before it is looked at, and that must then lie on one circle."""
MOST_PEAKS = 7
"""Places looked at in each band of radii if nothing lies near the tip."""
ZONES = ((0.5, 7), (1.0, 9))
"""Zones round the tip, as shares of the reach, and how many places are looked at until each is done: in a field of vias
the nearest are proposed whatever lies beyond."""
LEAST_BEYOND = 3
"""So many are looked at beyond, whatever lies near: they tell how bright metal is here."""
ROOM_PX = 5.0
"""So far beyond the reach a pad still counts: its hole may lie nearer, and two that are as near are ambiguous."""
NEIGHBOURS = np.ones((5, 5), dtype=np.uint8)
LEAST_POINTS, SMALL_PX = 6, 9.0
"""Fewer edge points make no circle; circles up to this radius are told apart by 3 px, larger ones by 5."""
MOST_RADII, SECOND_SHARE = 2, 0.5
"""A second circle about the same centre shows at least this much of what the first does."""
LEAST_AIM = 0.85
"""An edge points at its circle's centre to this (cosine): noise, blur, and an ellipse of another ratio."""


@dataclass(frozen=True, slots=True)
class Seed:
    """Hold a proposed circle in image pixels (radius semi-major) and the share of its contour that shows."""

    x_px: float
    y_px: float
    radius_px: float
    share: float


def seeds(
    edgels: Edgels,
    shape: tuple[int, int],
    bands_px: Iterable[tuple[float, float]],
    view: View,
    around_px: tuple[float, float] = (0.0, 0.0),
    reach_px: float = 0.0,
) -> list[Seed]:
    """Return bright discs proposed in an image of `shape` (H, W), for each band (least, most radius), best first.

    around_px, reach_px: what lies within that reach of that point is proposed first, the nearest before all, and only
    then the strongest of the rest. Of circles about one centre the outermost comes first: what lies inside of a disc
    belongs to it.
    """
    if edgels.x_px.size < LEAST_POINTS:
        return []
    on_board = _Board(edgels, shape, view, around_px, reach_px)
    groups = [group for band in bands_px for group in on_board.peaks(*band)]
    groups.sort(key=lambda group: -max(seed.share for seed in group))
    return [seed for group in groups for seed in sorted(group, key=lambda seed: -seed.radius_px)]


class _Board:
    """The edge points laid flat on the board, where circles are circles."""

    def __init__(
        self, edgels: Edgels, shape: tuple[int, int], view: View, around_px: tuple[float, float], reach_px: float
    ) -> None:
        linear = view.flattening().astype(np.float32)
        corners = np.array([[0, shape[1], 0, shape[1]], [0, 0, shape[0], shape[0]]], dtype=np.float32)
        spread = linear @ corners
        self.origin = spread.min(axis=1)
        extent = np.ceil(spread.max(axis=1) - self.origin).astype(np.intp) + 1
        self.width, self.height = int(extent[0]), int(extent[1])
        self.unflattening = view.unflattening()
        self.places = linear @ np.stack([edgels.x_px, edgels.y_px]) - self.origin[:, None]
        # Slopes turn by the inverse transposed; the stretch is symmetric.
        aims = self.unflattening.astype(np.float32) @ np.stack([edgels.toward_x, edgels.toward_y])
        self.aims = aims / np.hypot(aims[0], aims[1])
        self.middle = linear @ np.array(around_px, dtype=np.float32) - self.origin
        self.reach = (reach_px + ROOM_PX) / view.ratio

    def peaks(self, least_px: float, most_px: float) -> list[list[Seed]]:
        """Return the places most edge points aim at, each with its one or two circles."""
        votes = self._vote(least_px, most_px)
        found: list[list[Seed]] = []
        asked = 0
        tops = self._near_tops(votes)
        for until, places in tops:
            for y, x in places:
                if asked == until:
                    break
                if votes[y, x] >= LEAST_VOTE:
                    asked += 1
                    found += self._ended(votes, x, y, least_px, most_px)
        for _ in range(max(MOST_PEAKS - asked, LEAST_BEYOND)):
            y, x = divmod(int(np.argmax(votes)), self.width)
            if votes[y, x] < LEAST_VOTE:
                break
            found += self._ended(votes, x, y, least_px, most_px)
        return found

    def _near_tops(self, votes: NDArray[np.float32]) -> list[tuple[int, list[list[int]]]]:
        """Return for each zone until how many places are asked there, and its places (row, column), most votes first.

        A place has the most votes among its neighbours: the slope of another, cut off by the zone's border, is none.
        """
        rows, columns = np.nonzero((votes >= LEAST_VOTE) & (votes >= cv2.dilate(votes, NEIGHBOURS)))
        order = np.argsort(-votes[rows, columns], kind="stable")
        rows, columns = rows[order], columns[order]
        away = np.hypot(columns - self.middle[0], rows - self.middle[1])
        zones = [(until, away < share * self.reach) for share, until in ZONES]
        return [(until, np.stack([rows[near], columns[near]], axis=1).tolist()) for until, near in zones]

    def _ended(self, votes: NDArray[np.float32], x: int, y: int, least_px: float, most_px: float) -> list[list[Seed]]:
        """Return the circles about a place, and take the votes round it away."""
        shown = [item for item in self._radii(float(x), float(y), least_px, most_px) if item[1] >= LEAST_SHARE]
        # A found circle's neighbourhood points at it too; pads that touch are two radii apart.
        done = 0.7 * max(radius for radius, _ in shown) if shown else 0.35 * least_px
        cv2.circle(votes, (x, y), max(int(done), 2), (0.0,), -1)
        at = self.unflattening @ (np.array([x, y]) + self.origin)
        return [[Seed(float(at[0]), float(at[1]), radius, share) for radius, share in shown]] if shown else []

    def _vote(self, least_px: float, most_px: float) -> NDArray[np.float32]:
        """Return (H, W) shares of a contour that point at each place from between the two radii."""
        trial = np.linspace(least_px, most_px, max(int(most_px - least_px), 1) + 1, dtype=np.float32)[:, None]
        x = np.rint(self.places[0] + trial * self.aims[0]).astype(np.int32)
        y = np.rint(self.places[1] + trial * self.aims[1]).astype(np.int32)
        weight = np.broadcast_to(1.0 / (2.0 * np.pi * trial), x.shape)
        good = (x >= 0) & (y >= 0) & (x < self.width) & (y < self.height)
        cell = y[good] * self.width + x[good]
        counted = np.bincount(cell, weights=weight[good], minlength=self.width * self.height)
        votes = counted.reshape(self.height, self.width).astype(np.float32)
        # Votes scatter more the larger the circle: its ellipse is not quite the view's. Each ray crosses the whole box.
        spread = 2 * int(1.0 + 0.08 * 0.5 * (least_px + most_px)) + 1
        return np.asarray(cv2.blur(votes, (spread, spread), borderType=cv2.BORDER_CONSTANT), np.float32) * spread

    def _radii(self, x: float, y: float, least_px: float, most_px: float) -> list[tuple[float, float]]:
        """Return up to two (radius, share of it that shows) of circles about a place: a ring may lie round a disc."""
        dx, dy = self.places[0] - x, self.places[1] - y
        radius = np.hypot(dx, dy)
        good = (radius > least_px - 1.0) & (radius < most_px + 1.0)
        dx, dy, radius = dx[good], dy[good], radius[good]
        aimed = -(dx * self.aims[0][good] + dy * self.aims[1][good]) > LEAST_AIM * radius
        dx, dy, radius = dx[aimed], dy[aimed], radius[aimed]
        if radius.size < LEAST_POINTS:
            return []
        counted = np.bincount(radius.astype(np.intp), weights=1.0 / radius, minlength=3)
        shown = np.convolve(counted, np.ones(5 if least_px > SMALL_PX else 3), mode="same")
        angle = np.arctan2(dy, dx)
        found: list[tuple[float, float]] = []
        best = int(np.argmax(shown))
        level = float(shown[best])
        while len(found) < MOST_RADII and shown[best] > SECOND_SHARE * level:
            centre = best + 0.5
            near = np.abs(radius - centre) < 1.5 + 0.06 * centre
            sectors = min(max(int(2.5 * centre), 12), 48)
            seen = np.unique(np.floor(angle[near] * (sectors / (2.0 * np.pi)))).size
            found.append((quantile(radius[near]) if seen else centre, min(seen / sectors, 1.0)))
            shown[max(int(0.8 * best) - 1, 0) : int(1.25 * best) + 2] = 0.0
            best = int(np.argmax(shown))
        return found
