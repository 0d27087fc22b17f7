"""Conditions of the station: what its configuration and its board say of what is measured."""

from __future__ import annotations

from daemon.config.model import Config
from daemon.domain.board import Board
from daemon.storage.calibration_conditions import Conditions


def conditions_of(config: Config, board: Board) -> Conditions:
    """Return what calibrations made now are measured for."""
    return Conditions(
        touch_z_um=config.gantry.touch_z_um,
        origin_x_um=config.board.origin_x_um,
        origin_y_um=config.board.origin_y_um,
        rotation_deg=config.board.rotation_deg,
        board=board.name,
        side=board.side,
        board_revision=board.revision,
    )
