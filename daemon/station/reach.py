"""Reach of the head over a board: which points the configured ranges leave out, with the room of every approach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.config.model import AxisSection, Config
from daemon.domain.board import Board
from vision.geometry import Array

HEAD_ANGLES_DEG = np.arange(0.0, 360.0, 5.0)


def out_of_reach(config: Config, board: Board) -> list[str]:
    """Say for each test point that no head angle brings the tip over why not; the board nominally placed.

    X, Y and theta come to every target from below: what lies nearer to a lower end than the approach is out of reach.
    """
    gantry, axes = config.gantry, config.axes
    turned = np.where(axes.theta.maximum >= HEAD_ANGLES_DEG, HEAD_ANGLES_DEG, HEAD_ANGLES_DEG - 360.0)
    angles = turned[_inside(axes.theta, turned, gantry.approach_deg)]
    offsets_um = np.array([config.head.model().tip_offset_um(float(angle % 360.0)) for angle in angles]).reshape(-1, 2)
    problems: list[str] = []
    for point in board.test_points():
        head_um = config.board.pose().apply((point.x_um, point.y_um)) - offsets_um
        along_x = _inside(axes.x, head_um[:, 0], gantry.approach_um)
        along_y = _inside(axes.y, head_um[:, 1], gantry.approach_um)
        if not (along_x & along_y).any():
            which = " and ".join(name for name, good in (("x", along_x), ("y", along_y)) if not good.any()) or "x or y"
            problems.append(
                f"test point {point.name} is out of reach at every head angle: {which} would leave its range, of which "
                f"the lowest {gantry.approach_um:g} um are room for the approach (gantry.approach_um)"
            )
    return problems


def _inside(axis: AxisSection, place: Array, room: float) -> NDArray[np.bool_]:
    return (place >= axis.minimum + room) & (place <= axis.maximum)
