"""Neighbouring nets: those whose bare metal a needle that ends up beside its point may stand on instead."""

from __future__ import annotations

import math

import numpy as np

from daemon.domain.board import Board, BoardPoint
from daemon.station.outline_distance import near


def neighbour_nets(board: Board, point: BoardPoint, reach_um: float) -> tuple[str, ...]:
    """Return the other nets with bare metal within reach of a point, on its side, in the order of their names."""
    place_um = point.place_um
    others = (one for one in board.points_near(place_um, reach_um) if one.net != point.net)
    return tuple(sorted({one.net for one in others if one.net and _is_near(one, place_um, reach_um)}))


def _is_near(one: BoardPoint, place_um: tuple[float, float], reach_um: float) -> bool:
    if one.diameter_um is not None:
        return math.dist(one.middle_um, place_um) <= reach_um + one.diameter_um / 2
    if math.dist(one.place_um, place_um) <= reach_um:
        return True
    at = np.array([place_um])
    return any(near(at, np.array(flat, dtype=float).reshape(-1, 2), reach_um) for flat in one.metal_um)
