"""The station's camera once more, written out without the code under test."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_hw.scene.optics import Head

Point = npt.NDArray[np.float64]


def pinhole_px(head: Head, place_um: tuple[float, float, float]) -> Point:
    """Project a place of the robot frame (z above the nominal board): angles and lengths from the description."""
    tip, direction = np.array([428.0, 620.0]), np.array([119.0, 232.0]) / np.hypot(119.0, 232.0)
    centre, focal, tilt = np.array([799.5, 599.5]), 5000.0, np.radians(30.0)
    # all verticals meet below the picture, on the needle's line, focal * tan(tilt) from the principal point
    steps = np.linspace(0.0, 6000.0, 600_001)
    away = np.hypot(*(tip[:, None] + direction[:, None] * steps - centre[:, None])) - focal * np.tan(tilt)
    nadir = tip + direction * steps[int(np.argmin(np.abs(away)))]
    down = (nadir - centre) / np.linalg.norm(nadir - centre)
    bearing = np.arctan2(-down[1], down[0])  # the camera looks from this side, y up
    eye = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    axis = -np.sin(tilt) * eye - np.cos(tilt) * np.array([0.0, 0.0, 1.0])
    far = -np.cos(tilt) * eye + np.sin(tilt) * np.array([0.0, 0.0, 1.0])
    side = np.cross(axis, far)
    c, s = np.cos(np.radians(-head.theta_deg)), np.sin(np.radians(-head.theta_deg))
    dx, dy = place_um[0] - head.tip_x_um, place_um[1] - head.tip_y_um
    place = np.array([c * dx - s * dy, s * dx + c * dy, place_um[2] - head.tip_z_um])
    ray = np.array([*(tip - centre) / focal, 1.0]) * 60_000.0
    up, right = -down, np.array([down[1], -down[0]])  # image directions of `far` and `side`
    u, v, depth = ray[:2] @ right + place @ side, ray[:2] @ up + place @ far, ray[2] + place @ axis
    return centre + focal * (u * right + v * up) / depth
