"""Floor of the nest while no board lies in it: grey metal, ground in one direction, below where a board would be."""

from __future__ import annotations

import cv2
import numpy as np

from sim_hw.board.board import ROBOT_ORIGIN_UM, Board
from sim_hw.plant.pose import NEST_DEPTH_UM
from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX, Matrix, Optics, Pose, Stand, board_plane
from sim_hw.scene.texture import TILE, Image, periodic_noise

_TEXEL_MM = 0.024
_GREY = (58, 60, 61, 44)


class EmptyNest:
    """Draw the floor."""

    def __init__(self, optics: Optics, seed: int) -> None:
        self._optics = optics
        rng = np.random.default_rng((seed, 31))
        slow, grain = periodic_noise(rng, 120.0), periodic_noise(rng, 1.2)
        ground = cv2.blur(np.tile(grain, (1, 3)), (61, 1))[:, TILE : 2 * TILE]
        look = 1.0 + 0.05 * slow + 0.35 * ground
        self._tile: Image = np.clip(np.round(look[..., None] * np.array(_GREY)), 0, 255).astype(np.uint8)

    def look(self, stand: Stand, pose: Pose, board: Board) -> Image:
        """Return what is seen (1200, 1600, 4)."""
        plane: Matrix = board_plane(ROBOT_ORIGIN_UM, board.size_mm, pose).copy()
        plane[2, 2] -= NEST_DEPTH_UM
        from_texel = np.diag([_TEXEL_MM, _TEXEL_MM, 1.0])
        return np.asarray(
            cv2.warpPerspective(
                self._tile,
                self._optics.homography(plane, stand) @ from_texel,
                (WIDTH_PX, HEIGHT_PX),
                flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_WRAP,
            ),
            dtype=np.uint8,
        )
