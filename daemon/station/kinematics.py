"""Kinematics: where the tip on the head, the board in the robot and the surface below are, as far as is known.

What has been calibrated replaces what the configuration guesses, the moment it is stored.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from daemon.config.model import Config
from daemon.domain.board import Board
from daemon.storage.calibration_store import Calibrations
from drivers.gantry import Position
from vision.geometry import Array, rotation
from vision.head import Head


class Geometry:
    """Answer where to go and what to expect there; moves nothing."""

    def __init__(self, config: Config, board: Board, calibrations: Calibrations) -> None:
        self._board, self._calibrations, self._work_z_um = board, calibrations, config.gantry.work_z_um
        self._nominal_head = config.head.model()
        self._nominal_pose = config.board.pose()

    @property
    def head(self) -> Head:
        """The calibrated head, else the configuration's circle."""
        return self._calibrations.head or self._nominal_head

    # --- the board --------------------------------------------------------------------------------------------

    def nominal_um(self, board_um: ArrayLike) -> Array:
        """Return robot coordinates of places of the board, (2,) or (N, 2), as the configuration has it lie."""
        return self._nominal_pose.apply(board_um)

    def board_to_robot_um(self, board_um: ArrayLike) -> Array:
        """Return robot coordinates of places of the board, (2,) or (N, 2): as aligned, else nominal."""
        seen = self._calibrations.alignment(self._board)
        if seen is None:
            return self._nominal_pose.apply(board_um)
        turned = seen.scale * np.asarray(board_um, dtype=float) @ rotation(seen.theta_deg).T
        return np.add(turned, (seen.tx_um, seen.ty_um))

    # --- the head ---------------------------------------------------------------------------------------------

    def position_over(self, board_um: tuple[float, float], theta_deg: float) -> Position:
        """Return the head position that puts the tip over a place of the board, at working height."""
        return self.position_at(self.board_to_robot_um(board_um), theta_deg)

    def position_at(self, robot_um: ArrayLike, theta_deg: float) -> Position:
        """Return the head position that puts the tip over a place of the robot frame, at working height."""
        hx, hy = np.asarray(robot_um, dtype=float) - self.head.tip_offset_um(theta_deg)
        return Position(float(hx), float(hy), self._work_z_um, theta_deg)

    def tip_um(self, position: Position) -> Array:
        """Return where the tip is, (2,), robot frame."""
        at: Array = np.array((position.x_um, position.y_um)) + self.head.tip_offset_um(position.theta_deg)
        return at

    def from_tip_um(self, board_um: tuple[float, float], position: Position) -> Array:
        """Return a place of the board relative to the tip, (2,), robot frame."""
        away: Array = self.board_to_robot_um(board_um) - self.tip_um(position)
        return away

    # --- the surface ------------------------------------------------------------------------------------------

    def height_um(self, robot_um: ArrayLike) -> float:
        """Return the surface's height above the nominal touching plane at a place; 0 where it was never measured."""
        surface = self._calibrations.surface
        x_um, y_um = np.asarray(robot_um, dtype=float)
        return surface.height_um(float(x_um), float(y_um)) if surface is not None else 0.0

    def height_below_um(self, position: Position) -> float:
        """Return the surface's height below the tip, um above the nominal touching plane."""
        return self.height_um(self.tip_um(position))
