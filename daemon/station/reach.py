"""Reach of the head over a board: which points the configured ranges leave out, with the room of every approach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.config.model import Config
from daemon.config.sections.devices import AxisSection
from daemon.domain.board import Board, BoardPoint
from vision.geometry import Array

HEAD_ANGLES_DEG = np.arange(0.0, 360.0, 5.0)


def out_of_reach(config: Config, board: Board) -> list[str]:
    """Say why no head angle brings the tip over test points or vias, those of one reason together; nominal board.

    A part's pads and pins are not asked for: one at the board's edge may well lie beyond, and is refused when named.
    """
    named = tuple(point for point in board.test_points() if point.kind in ("via", "site"))
    together: dict[str, list[str]] = {}
    for name, why in beyond_reach(config, named).items():
        together.setdefault(why, []).append(name)
    return [f"{_points(names)} {why}" for why, names in together.items()]


def _points(names: list[str]) -> str:
    if len(names) == 1:
        return f"test point {names[0]} is"
    return f"{len(names)} test points ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''}) are"


def beyond_reach(config: Config, points: tuple[BoardPoint, ...]) -> dict[str, str]:
    """Return name -> why for each of the points that no head angle brings the tip over; the board nominally placed.

    X, Y and theta come to every target from below: what lies nearer to a lower end than the approach is out of reach.
    """
    gantry = config.gantry
    offsets_um = _tip_offsets_um(config)
    problems: dict[str, str] = {}
    for point in points:
        along_x, along_y = _along(config, point, offsets_um)
        if not (along_x & along_y).any():
            which = " and ".join(name for name, good in (("x", along_x), ("y", along_y)) if not good.any()) or "x or y"
            problems[point.name] = (
                f"out of reach at every head angle: {which} would leave its range, of which "
                f"the lowest {gantry.approach_um:g} um are room for the approach (gantry.approach_um)"
            )
    return problems


def in_reach_at_all_angles(config: Config, points: tuple[BoardPoint, ...]) -> tuple[BoardPoint, ...]:
    """Return the points over which every head angle brings the tip; the board nominally placed."""
    offsets_um = _tip_offsets_um(config)
    return tuple(p for p in points if all(along.all() for along in _along(config, p, offsets_um)))


def _tip_offsets_um(config: Config) -> Array:
    """Return where the tip is from the head's axis at each head angle that theta may take, (N, 2)."""
    theta = config.axes.theta
    turned = np.where(theta.maximum >= HEAD_ANGLES_DEG, HEAD_ANGLES_DEG, HEAD_ANGLES_DEG - 360.0)
    angles = turned[_inside(theta, turned, config.gantry.approach_deg)]
    return np.array([config.head.model().tip_offset_um(float(angle % 360.0)) for angle in angles]).reshape(-1, 2)


def _along(config: Config, point: BoardPoint, offsets_um: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell for each of the tip's offsets whether X, and whether Y, can put it over the point."""
    head_um = config.board.pose().apply((point.x_um, point.y_um)) - offsets_um
    axes, room_um = config.axes, config.gantry.approach_um
    return _inside(axes.x, head_um[:, 0], room_um), _inside(axes.y, head_um[:, 1], room_um)


def outside_the_axes(config: Config, board: Board) -> list[tuple[str, str]]:
    """Return path and words where the board's outline, as it nominally lies, reaches beyond X or Y."""
    corners = [(x, y) for x in (0.0, board.width_um) for y in (0.0, board.height_um)]
    placed = np.array([config.board.pose().apply(corner) for corner in corners])
    odd: list[tuple[str, str]] = []
    for name, axis, along in (("x", config.axes.x, placed[:, 0]), ("y", config.axes.y, placed[:, 1])):
        first, last = float(along.min()), float(along.max())
        if first < axis.minimum or last > axis.maximum:
            where = f"the board lies at {first:.0f}..{last:.0f} um, axes.{name} goes from {axis.minimum:g} to"
            odd.append((f"axes.{name}", f"{where} {axis.maximum:g} um: see board.origin_{name}_um and the axis' range"))
    return odd


def on_the_board(config: Config, board: Board) -> list[tuple[str, str]]:
    """Return path and words for each place beside the board that lies within its outline, as it nominally lies."""
    odd = []
    for table in ("control_point", "reference", "brush"):
        section = getattr(config, table)
        if section is None:
            continue
        x_um, y_um = config.board.pose().inverse().apply(section.place_um)
        if 0.0 < x_um < board.width_um and 0.0 < y_um < board.height_um:
            said = f"it lies on the board, {x_um:.0f}, {y_um:.0f} um from its corner, and belongs beside it"
            odd.append((f"{table}.x_um", f"{said}: put in its own place, or see board.origin_x_um and origin_y_um"))
    return odd


def _inside(axis: AxisSection, place: Array, room: float) -> NDArray[np.bool_]:
    return (place >= axis.minimum + room) & (place <= axis.maximum)
