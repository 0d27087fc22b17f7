"""Bodies of parts as the camera sees them: prisms on the board, leaning in the oblique view.

What is NOT modelled: their shadows, legs and end caps, and what a lens blurs of tall ones.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import ROBOT_ORIGIN_UM, Board
from sim_hw.board.parts import Body
from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX, Matrix, Optics, Pose, Stand, board_plane

Image = npt.NDArray[np.uint8]

_SHIFT = 4
"""Fractional bits of polygon corners."""
_SIDE_SHADE = (0.30, 0.62)
"""How much darker the flanks are than the top, by the way they face."""


@dataclass(frozen=True)
class _Seen:
    """A body in the picture: corners (N, 2) px of its foot and its top, and how far beyond the needle it stands, um."""

    body: Body
    foot: Matrix
    top: Matrix
    depth: float
    in_front: bool


class BodyArtist:
    """Draw the bodies of one board side, the farthest first."""

    def __init__(self, optics: Optics, board: Board) -> None:
        self._optics = optics
        self._size_mm = board.size_mm
        self._bodies = [(body, _as_seen(board, body)) for body in board.bodies]
        view = optics.rotation.T @ optics.tip_um
        self._away = np.array([view[0], view[1]]) / np.hypot(view[0], view[1])

    def draw(self, image: Image, stand: Stand, pose: Pose) -> Image | None:
        """Draw on (1200, 1600, 4); return where the needle is hidden (255), or None if it is not."""
        front: Image | None = None
        plane = board_plane(ROBOT_ORIGIN_UM, self._size_mm, pose)
        for seen in sorted(self._in_view(plane, stand), key=lambda s: -s.depth):
            _draw_body(image, seen)
            if seen.in_front:
                if front is None:
                    front = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.uint8)
                for polygon in _silhouette(seen):
                    cv2.fillPoly(front, [_fixed(polygon)], 255, cv2.LINE_8, _SHIFT)
        return front

    def _in_view(self, plane: Matrix, stand: Stand) -> Iterable[_Seen]:
        turn = np.deg2rad(stand.theta_deg)
        c, s = np.cos(turn), np.sin(turn)
        away = np.array([c * self._away[0] - s * self._away[1], s * self._away[0] + c * self._away[1]])
        foot_map = self._optics.homography(plane, stand)
        for body, outline in self._bodies:
            foot = _mapped(foot_map, outline)
            if not _within(foot):
                continue
            raised = plane.copy()
            raised[2, 2] += body.height_um
            top = _mapped(self._optics.homography(raised, stand), outline)
            along = (np.column_stack((outline, np.ones(len(outline)))) @ plane.T)[:, :2] - stand.tip_um[:2]
            depths = along @ away
            yield _Seen(body, foot, top, float(depths.mean()), bool(depths.max() < 0.0))


def _as_seen(board: Board, body: Body) -> Matrix:
    """Return the outline in board mm as this side is seen (u right, v up, from the outline's corner)."""
    x0, y0, x1, _ = board.outline_mm
    u = body.outline_mm[:, 0] - x0 if board.side == "top" else x1 - body.outline_mm[:, 0]
    return np.column_stack((u, body.outline_mm[:, 1] - y0))


def _mapped(homography: Matrix, points: Matrix) -> Matrix:
    return np.asarray(cv2.perspectiveTransform(points[None], homography)[0])


def _within(corners: Matrix) -> bool:
    """Tell whether a body that stands there may show in the picture; a tall one leans in by some hundred pixels."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool(high[0] > -400 and high[1] > -400 and low[0] < WIDTH_PX + 400 and low[1] < HEIGHT_PX + 400)


def _fixed(corners: Matrix) -> npt.NDArray[np.int32]:
    return np.round(corners * (1 << _SHIFT)).astype(np.int32)


def _flanks(seen: _Seen) -> list[tuple[Matrix, float]]:
    """Return the side faces, the farthest first, with how much the light falls on each (0..1)."""
    foot, top = seen.foot, seen.top
    count, faces = len(foot), []
    lean = (top - foot).mean(axis=0)
    for k in range(count):
        n = (k + 1) % count
        edge = foot[n] - foot[k]
        length = float(np.hypot(*edge)) or 1.0
        facing = 0.5 + 0.5 * float(edge[0]) / length
        near = float((foot[k] + foot[n]) @ lean)
        faces.append((near, np.stack((foot[k], foot[n], top[n], top[k])), facing))
    faces.sort(key=lambda face: -face[0])
    return [(corners, facing) for _, corners, facing in faces]


def _silhouette(seen: _Seen) -> list[Matrix]:
    return [seen.top, *(corners for corners, _ in _flanks(seen))]


def _draw_body(image: Image, seen: _Seen) -> None:
    body = seen.body
    for corners, facing in _flanks(seen):
        shade = _SIDE_SHADE[0] + (_SIDE_SHADE[1] - _SIDE_SHADE[0]) * facing
        cv2.fillConvexPoly(image, _fixed(corners), _level(body, shade), cv2.LINE_AA, _SHIFT)
    cv2.fillPoly(image, [_fixed(seen.top)], _level(body, 1.0), cv2.LINE_AA, _SHIFT)
    _print_on(image, seen)


def _level(body: Body, share: float) -> tuple[float, float, float, float]:
    white, red = share * body.white, share * body.red
    return (white, white, white, red)


def _print_on(image: Image, seen: _Seen) -> None:
    """Draw a few strokes as of a marking on the top, where it is large enough to carry one."""
    low, high = seen.top.min(axis=0), seen.top.max(axis=0)
    if float((high - low).min()) < 90.0 or not seen.body.part:
        return
    rng = random.Random(f"print/{seen.body.part}")
    middle = seen.top.mean(axis=0)
    along = seen.top[1] - seen.top[0]
    side = seen.top[-1] - seen.top[0]
    colour = tuple(min(255.0, level + 70.0) for level in _level(seen.body, 1.0))
    for row in (-0.12, 0.12):
        for column in np.linspace(-0.28, 0.28, 7).tolist():
            start = middle + (column + rng.uniform(-0.02, 0.02)) * along + row * side
            stroke = start + rng.uniform(-0.05, 0.05) * along + rng.uniform(0.04, 0.09) * side
            cv2.polylines(
                image,
                [_fixed(np.stack((start, stroke)))],
                isClosed=False,
                color=colour,
                thickness=2,
                lineType=cv2.LINE_AA,
                shift=_SHIFT,
            )


def cut_out(above: Image, below: Image, front: Image) -> None:
    """Put back what was seen before (`below`) wherever `front` is set."""
    cv2.copyTo(below, front, above)
