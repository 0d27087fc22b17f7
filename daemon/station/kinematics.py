"""Kinematics: where the tip on the head, the board in the robot and the surface below are, as far as is known.

What has been calibrated replaces what the configuration guesses, the moment it is stored. Height follows the surface
that was measured for this board. Where none was, the head stays above the highest surface that is possible.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from daemon.config.model import Config
from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.station.board_trust import BoardTrust
from daemon.station.outline_distance import near
from daemon.station.raised_pads import RaisedPads
from daemon.storage.calibration_records import SurfaceRecord
from daemon.storage.calibration_store import Calibrations
from drivers.gantry import Position
from vision.geometry import Array, rotation
from vision.head import Head

EXTRAPOLATED_UM = 10_000.0
"""Farther than this from the touched places a surface counts as not measured."""
TRUSTED_UM = 100.0
"""A measured surface is nowhere higher than its plane by more than this."""
PAD_UM = 3_000.0
"""Within this of its middle the reference pad, or the brush, is what the needle meets."""
_TURNS = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
_DIRECTIONS = np.array((np.cos(_TURNS), np.sin(_TURNS)))


def beyond_um(places_um: ArrayLike, touched_um: Array) -> Array:
    """Return how far places (..., 2) lie beyond all touches (N, 2), um: in the direction in which each is farthest."""
    reach_um = (touched_um @ _DIRECTIONS).max(axis=0)
    beyond: Array = (np.asarray(places_um, dtype=float) @ _DIRECTIONS - reach_um).max(axis=-1)
    return beyond


class Geometry:
    """Answer where to go and what to expect there; moves nothing."""

    def __init__(
        self, config: Config, board: Board, calibrations: Calibrations, trust: BoardTrust | None = None
    ) -> None:
        """Take what tells whether the board in the nest is the one that was measured; None: nothing does."""
        self._trust = trust or BoardTrust()
        self._board, self._calibrations, self._gantry = board, calibrations, config.gantry
        pads = (pad for pad in (config.reference, config.brush) if pad is not None)
        self._pads = [(np.array(pad.place_um), pad.z_um) for pad in pads if pad.z_um is not None]
        self._raised = RaisedPads(board)
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

    def robot_to_board_um(self, robot_um: ArrayLike) -> Array:
        """Return places of the board, (2,) or (N, 2), by robot coordinates: as aligned, else nominal."""
        origin, along_x, along_y = self.board_to_robot_um([(0.0, 0.0), (1e4, 0.0), (0.0, 1e4)])
        axes = np.array((along_x - origin, along_y - origin)) / 1e4
        board: Array = (np.asarray(robot_um, dtype=float) - origin) @ np.linalg.inv(axes)
        return board

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
        record = self._surface_of_this_board()
        if isinstance(record, Fault):
            return None
        touched = np.array([(touch.x_um, touch.y_um) for touch in record.touches])
        return self.height_um(robot_um) if float(beyond_um(robot_um, touched)) <= EXTRAPOLATED_UM else None

    def require_surface(self) -> None:
        """Raise `Fault` where this board's height is known nowhere."""
        record = self._surface_of_this_board()
        if isinstance(record, Fault):
            raise record

    def unmeasured(self, point: str) -> Fault:
        """Return why the height at a point is not known: that of the whole board is not, or the point lies too far."""
        record = self._surface_of_this_board()
        if isinstance(record, Fault):
            return record
        return Fault(FaultCode.SURFACE_UNKNOWN, f"the surface of this board was not measured at {point}")

    def _surface_of_this_board(self) -> SurfaceRecord | Fault:
        """Return the surface that was measured of the board in the nest, or why there is none."""
        record = self._calibrations.records.get("surface")
        if not isinstance(record, SurfaceRecord) or self._calibrations.surface is None:
            return Fault(FaultCode.SURFACE_UNKNOWN)
        in_force, laid_in = self._calibrations.in_force, self._calibrations.alignment(self._board)
        if in_force.void is not None:
            return Fault(
                FaultCode.SURFACE_UNKNOWN,
                f"no board has been aligned since the surface was measured: {in_force.void.why}",
                advice="`align` the board in the nest, then `calibrate surface`",
            )
        if laid_in is not None and record.made_at < laid_in.made_at:
            measured_at, aligned_at = record.made_at[:19], laid_in.made_at[:19]
            return Fault(
                FaultCode.SURFACE_UNKNOWN,
                f"the surface was measured at {measured_at} UTC, before this board was aligned at {aligned_at}: "
                "it may be that of another board",
            )
        return record

    def stands_um(self, robot_um: ArrayLike) -> float:
        """Return how high a pad about a place stands above the board's surface; 0 where none is known to."""
        return 0.0 if self._raised.is_flat else self._raised.stands_um(self.robot_to_board_um(robot_um))

    def stands_unknown(self, robot_um: ArrayLike) -> bool:
        """Whether a soldered pad is about a place of which nobody has told how high it stands."""
        return not self._raised.is_flat and self._raised.is_unknown(self.robot_to_board_um(robot_um))

    def look_z_um(self, robot_um: ArrayLike) -> float:
        """Return Z for a look at a place: as far from what the needle may meet as the map was made, or free of all."""
        height_um, stands_um = self.measured_um(robot_um), self.stands_um(robot_um)
        if height_um is None:
            return max(self._gantry.work_z_um, self._gantry.free_z_um) + stands_um
        return self._gantry.work_z_um + height_um + stands_um

    def up_z_um(self, position: Position) -> float:
        """Return Z from which on the needle counts as up; where nothing is known by the lower one of both guesses.

        Over the reference pad or the brush it is as far above them, but no higher than looks are taken there.
        """
        tip_um = self.tip_um(position)
        height_um = self.measured_um(tip_um)
        if height_um is None:
            height_um = min(0.0, max(self.height_um(tip_um), -self._gantry.surface_range_um))
        up_um = self._gantry.work_z_um + height_um + self.stands_um(tip_um)
        pad_z_um = self._pad_z_um(tip_um)
        if pad_z_um is None:
            return up_um
        hover_um = self._gantry.work_z_um - self._gantry.touch_z_um
        return max(up_um, min(pad_z_um + hover_um, self.look_z_um(tip_um)))

    def surface_z_um(self, position: Position) -> float:
        """Return Z at which the needle meets the surface below it, as far as is known."""
        tip_um = self.tip_um(position)
        pad_z_um = self._pad_z_um(tip_um)
        if pad_z_um is not None:
            return pad_z_um
        return self._gantry.touch_z_um + (self.measured_um(tip_um) or 0.0) + self.stands_um(tip_um)

    def _pad_z_um(self, tip_um: Array) -> float | None:
        """Return Z at which the needle meets the reference pad or the brush below it; None where neither is told."""
        below = (z_um for place_um, z_um in self._pads if np.hypot(*(tip_um - place_um)) <= PAD_UM)
        return next(below, None)

    def highest_pad_z_um(self, area_um: Array, reach_um: float) -> float:
        """Return Z of the highest of reference pad and brush within `reach_um` of a convex area (N, 2); -inf: none.

        One whose height is not told counts as no higher than the board.
        """
        near_it = (z_um for place_um, z_um in self._pads if near(area_um, place_um[None], reach_um + PAD_UM))
        return max(near_it, default=-math.inf)

    def slow_z_um(self, position: Position) -> float:
        """Return Z below which the needle may meet the surface on its way down to `position`."""
        tip_um = self.tip_um(position)
        stands_um = self.stands_um(tip_um)
        height_um = self.measured_um(tip_um) if self._trust.holds else None
        if height_um is None or self.stands_unknown(tip_um):
            return self._gantry.highest_surface_um + stands_um
        return self._gantry.touch_z_um + height_um + stands_um + TRUSTED_UM
