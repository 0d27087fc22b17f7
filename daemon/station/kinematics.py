"""Kinematics: where the tip on the head, the board in the robot and the surface below are, as far as is known.

What has been calibrated replaces what the configuration guesses, the moment it is stored. Height follows the surface
that was measured for this board. Where none was, the head stays above the highest surface that is possible.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from daemon.config.model import Config
from daemon.domain.board import Board
from daemon.storage.calibration_records import SurfaceRecord
from daemon.storage.calibration_store import Calibrations
from drivers.gantry import Position
from vision.geometry import Array, rotation
from vision.head import Head

EXTRAPOLATED_UM = 10_000.0
"""Farther than this from the touched places a surface counts as not measured."""
TRUSTED_UM = 100.0
"""A measured surface is nowhere higher than its plane by more than this."""
_TURNS = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
_DIRECTIONS = np.array((np.cos(_TURNS), np.sin(_TURNS)))


class Geometry:
    """Answer where to go and what to expect there; moves nothing."""

    def __init__(self, config: Config, board: Board, calibrations: Calibrations) -> None:
        self._board, self._calibrations, self._gantry = board, calibrations, config.gantry
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
        """Return the head position that puts the tip over a place of the board, at the height of looks there."""
        return self.position_at(self.board_to_robot_um(board_um), theta_deg)

    def position_at(self, robot_um: ArrayLike, theta_deg: float) -> Position:
        """Return the head position that puts the tip over a place of the robot frame, at the height of looks there."""
        hx, hy = np.asarray(robot_um, dtype=float) - self.head.tip_offset_um(theta_deg)
        return Position(float(hx), float(hy), self.look_z_um(robot_um), theta_deg)

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
        """Return how much nearer to the head the surface below the tip is than a nominal one is at working height, um.

        It is what a map made at working height is to be told of the surface, wherever Z is.
        """
        return self.height_um(self.tip_um(position)) - (position.z_um - self._gantry.work_z_um)

    def measured_um(self, robot_um: ArrayLike) -> float | None:
        """Return the height of this board's surface at a place; None where it was not measured.

        A surface older than the board's alignment was measured on the board before, and so was any while a board lies
        there that has not been aligned.
        """
        record = self._calibrations.records.get("surface")
        if not isinstance(record, SurfaceRecord) or self._calibrations.surface is None:
            return None
        in_force, laid_in = self._calibrations.in_force, self._calibrations.alignment(self._board)
        if in_force.void is not None or (laid_in is not None and record.made_at < laid_in.made_at):
            return None
        touched = np.array([(touch.x_um, touch.y_um) for touch in record.touches])
        # In the direction in which the place is farthest beyond all touches
        beyond_um = float(((np.asarray(robot_um, dtype=float) - touched) @ _DIRECTIONS).min(axis=0).max())
        return self.height_um(robot_um) if beyond_um <= EXTRAPOLATED_UM else None

    def look_z_um(self, robot_um: ArrayLike) -> float:
        """Return Z for a look at a place: as far from the surface as the map was made, or free of any possible one."""
        height_um = self.measured_um(robot_um)
        if height_um is None:
            return max(self._gantry.work_z_um, self._gantry.free_z_um)
        return self._gantry.work_z_um + height_um

    def up_z_um(self, position: Position) -> float:
        """Return the least Z at which the needle is up: of looks over a place, nominal where nothing is measured."""
        return self._gantry.work_z_um + (self.measured_um(self.tip_um(position)) or 0.0)

    def surface_z_um(self, position: Position) -> float:
        """Return Z at which the needle meets the surface below it, nominal where nothing is measured."""
        return self._gantry.touch_z_um + (self.measured_um(self.tip_um(position)) or 0.0)

    def slow_z_um(self, position: Position) -> float:
        """Return Z below which the needle may meet the surface on its way down to `position`."""
        height_um = self.measured_um(self.tip_um(position))
        if height_um is None:
            return self._gantry.highest_surface_um
        return self._gantry.touch_z_um + height_um + TRUSTED_UM
