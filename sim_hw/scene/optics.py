"""Pinhole camera that rides on the head, and where things of the robot frame fall in its image.

Head frame: origin at the end of the probe, axes parallel to the robot's while theta is 0, um, z up.
Camera frame: x right, y down, z along the optical axis. Pixel centres at integers.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]

WIDTH_PX = 1600
HEIGHT_PX = 1200
FOCAL_PX = 5000.0
TILT_DEG = 30.0
PITCH_UM = 12.0
"""One pixel at the tip, across the view."""
TIP_PX = (428.0, 620.0)
NEEDLE_DIRECTION = (119.0 / 260.74, 232.0 / 260.74)
"""In the image, downwards along the needle to its end."""


class Pose(Protocol):
    """Where the board lies, as the plant tells it: shift and rotation about the outline's centre, height, tilt."""

    @property
    def dx_um(self) -> float: ...  # noqa: D102  # the names say it
    @property
    def dy_um(self) -> float: ...  # noqa: D102
    @property
    def rotation_deg(self) -> float: ...  # noqa: D102
    @property
    def dz_um(self) -> float: ...  # noqa: D102
    @property
    def tilt_x_um_per_mm(self) -> float: ...  # noqa: D102
    @property
    def tilt_y_um_per_mm(self) -> float: ...  # noqa: D102


class Head(Protocol):
    """What an image depends on: the tip, the head's angle, how high both are, the lights."""

    @property
    def theta_deg(self) -> float: ...  # noqa: D102
    @property
    def tip_x_um(self) -> float: ...  # noqa: D102
    @property
    def tip_y_um(self) -> float: ...  # noqa: D102
    @property
    def tip_z_um(self) -> float: ...  # noqa: D102
    @property
    def tip_height_um(self) -> float: ...  # noqa: D102
    @property
    def pressed_um(self) -> float: ...  # noqa: D102
    @property
    def white(self) -> float: ...  # noqa: D102
    @property
    def red(self) -> float: ...  # noqa: D102
    @property
    def moving(self) -> bool: ...  # noqa: D102


@dataclass(frozen=True)
class Stand:
    """Where camera and probe stand: the free probe's end in the robot frame (um), head angle, shift of the image."""

    tip_um: tuple[float, float, float]
    theta_deg: float
    shift_px: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Optics:
    """Intrinsics (3, 3), rotation head -> camera (3, 3) and the tip in the camera frame (3,), um."""

    intrinsics: Matrix
    rotation: Matrix
    tip_um: Matrix

    def project(self, points_um: npt.ArrayLike) -> Matrix:
        """Project points (N, 3) of the head frame to pixels (N, 2)."""
        camera = np.atleast_2d(np.asarray(points_um, dtype=np.float64)) @ self.rotation.T + self.tip_um
        homogeneous = camera @ self.intrinsics.T
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])

    def homography(self, plane: Matrix, stand: Stand) -> Matrix:
        """Return the map (3, 3) from plane coordinates to pixels.

        `plane` (3, 3) takes homogeneous plane coordinates (u, v, 1) to the robot frame in um.
        """
        c, s = math.cos(math.radians(stand.theta_deg)), math.sin(math.radians(stand.theta_deg))
        to_head = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        last = np.array([0.0, 0.0, 1.0])
        relative = plane - np.outer(stand.tip_um, last)
        camera = self.rotation @ to_head @ relative + np.outer(self.tip_um, last)
        shift = np.array([[1.0, 0.0, stand.shift_px[0]], [0.0, 1.0, stand.shift_px[1]], [0.0, 0.0, 1.0]])
        return np.asarray(shift @ (self.intrinsics @ camera))


def _vanishing_px(centre_px: Matrix) -> Matrix:
    """Return where all verticals meet: on the needle's line, tan(tilt) away from the principal point."""
    tip, along = np.array(TIP_PX), np.array(NEEDLE_DIRECTION)
    reach_px = FOCAL_PX * math.tan(math.radians(TILT_DEG))
    from_centre = tip - centre_px
    b = float(from_centre @ along)
    distance = -b + math.sqrt(b * b - float(from_centre @ from_centre) + reach_px**2)
    return np.asarray(tip + distance * along)


def make_optics() -> Optics:
    """Solve for the camera in which the needle ends at `TIP_PX` and runs along `NEEDLE_DIRECTION`."""
    centre_px = np.array([(WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0])
    intrinsics = np.array([[FOCAL_PX, 0.0, centre_px[0]], [0.0, FOCAL_PX, centre_px[1]], [0.0, 0.0, 1.0]])
    down = _vanishing_px(centre_px) - centre_px
    down /= np.linalg.norm(down)  # image direction of the world's down, seen from the principal point
    tilt = math.radians(TILT_DEG)
    # The camera stands so that image right is about +x of the head and image up about +y.
    away = np.array([-down[0], down[1], 0.0])
    axis = math.sin(tilt) * away - math.cos(tilt) * np.array([0.0, 0.0, 1.0])
    far = math.cos(tilt) * away + math.sin(tilt) * np.array([0.0, 0.0, 1.0])
    first = -far
    second = np.cross(axis, first)
    right = down[0] * first - down[1] * second
    below = down[1] * first + down[0] * second
    rotation = np.stack((right, below, axis))
    ray = np.array([(TIP_PX[0] - centre_px[0]) / FOCAL_PX, (TIP_PX[1] - centre_px[1]) / FOCAL_PX, 1.0])
    return Optics(intrinsics, rotation, ray * FOCAL_PX * PITCH_UM)


def board_plane(origin_um: tuple[float, float], size_mm: tuple[float, float], pose: Pose) -> Matrix:
    """Return the (3, 3) map from nominal board mm (u right, v up, from the outline's corner) to the robot, um."""
    centre_um = np.array([origin_um[0] + size_mm[0] * 500.0, origin_um[1] + size_mm[1] * 500.0])
    c, s = math.cos(math.radians(pose.rotation_deg)), math.sin(math.radians(pose.rotation_deg))
    turn = np.array([[c, -s], [s, c]])
    across = turn * 1e3
    start = turn @ (np.array(origin_um) - centre_um) + centre_um + np.array([pose.dx_um, pose.dy_um])
    tilt = np.array([pose.tilt_x_um_per_mm, pose.tilt_y_um_per_mm]) / 1e3
    plane = np.zeros((3, 3))
    plane[:2, :2] = across
    plane[:2, 2] = start
    plane[2, :2] = tilt @ across
    plane[2, 2] = pose.dz_um + float(tilt @ (start - centre_um))
    return plane
