"""The camera over the board: board plane (flat px) to image (px), in real perspective.

One flat px is the board length that the camera sees as one px across the tilt, at the board's origin (about 12 um), so
a circle of r flat px at the origin has a semi-major axis of r px in the image.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from tests.vision.studio.board_canvas import Points

FRAME_HW = (1200, 1600)
FOCAL_PX = 3746.0
"""Thesis eq. 3.26 with its two view angles the right way round."""
TILT_DEG = (25.0, 33.0)
"""Tilt of the optical axis against the board's normal."""


@dataclass(frozen=True)
class View:
    """A homography of the board plane into the image."""

    matrix: npt.NDArray[np.float64]

    def project(self, points: Points) -> Points:
        """Return (N, 2) px of (N, 2) flat px."""
        return cv2.perspectiveTransform(np.asarray(points, np.float64).reshape(-1, 1, 2), self.matrix).reshape(-1, 2)

    def point(self, x: float, y: float) -> tuple[float, float]:
        """Project one point."""
        x_px, y_px = self.project(np.array([[x, y]]))[0]
        return float(x_px), float(y_px)

    def semi_major(self, x: float, y: float, radius: float) -> float:
        """Return the semi-major axis (px) of the ellipse that a small circle on the board becomes."""
        eps = 0.5
        ends = self.project(np.array([[x - eps, y], [x + eps, y], [x, y - eps], [x, y + eps]]))
        jacobian = np.column_stack((ends[1] - ends[0], ends[3] - ends[2])) / (2 * eps)
        return float(np.linalg.svd(jacobian, compute_uv=False)[0] * radius)


def square_view(anchor_px: tuple[float, float], spin_rad: float) -> View:
    """Look straight down: the board's origin at ``anchor_px``, no foreshortening."""
    cos, sin = np.cos(spin_rad), np.sin(spin_rad)
    return View(np.array([[cos, -sin, anchor_px[0]], [sin, cos, anchor_px[1]], [0.0, 0.0, 1.0]]))


def tilted_view(anchor_px: tuple[float, float], spin_rad: float, tilt_rad: float, azimuth_rad: float) -> View:
    """Look at the board under a tilt; ``azimuth_rad`` turns the direction of foreshortening in the image."""
    height, width = FRAME_HW
    camera = np.array([[FOCAL_PX, 0.0, (width - 1) / 2], [0.0, FOCAL_PX, (height - 1) / 2], [0.0, 0.0, 1.0]])
    turn = _about_z(azimuth_rad) @ _about_x(tilt_rad) @ _about_z(spin_rad)
    ray = np.linalg.solve(camera, np.array([*anchor_px, 1.0]))
    raw = View(camera @ np.column_stack((turn[:, 0], turn[:, 1], FOCAL_PX * ray)))
    return View(raw.matrix @ np.diag([1.0 / raw.semi_major(0.0, 0.0, 1.0)] * 2 + [1.0]))


def random_view(rng: np.random.Generator, anchor_px: tuple[float, float], *, square: bool) -> View:
    """Return a view of any head angle; tilted 25..33 deg unless ``square``."""
    spin, azimuth = rng.uniform(0.0, 2 * np.pi, 2)
    tilt = np.deg2rad(rng.uniform(*TILT_DEG))
    return square_view(anchor_px, spin) if square else tilted_view(anchor_px, spin, tilt, azimuth)


def _about_z(angle_rad: float) -> npt.NDArray[np.float64]:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle_rad: float) -> npt.NDArray[np.float64]:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
