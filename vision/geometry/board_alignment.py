"""Board alignment: CAD coordinates to robot coordinates, from three or more fiducials (thesis eq. 3.23, 6.10).

A least-squares similarity through all fiducials. Its scale should be 1, and what it leaves at each fiducial should be
no more than the axes and the camera scatter; whatever else is found is told as what it most likely is: the board's
other side, two fiducials mistaken for each other, another unit, one wrong fiducial, another place in the fixture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike

from vision.geometry.camera_model import check_points
from vision.geometry.frames import Array, Rigid2
from vision.geometry.similarity import Similarity2, fit_similarity

LEAST_FIDUCIALS = 3
LEAST_BASELINE_RESIDUALS = 100.0
"""The farthest two fiducials are so many of the largest residuals apart, or more: else a turn is mere scatter."""
LEAST_ACROSS, LEAST_ACROSS_RESIDUALS = 0.05, 10.0
"""Root mean square spread in the lesser direction, against the greater and against the largest residual."""
FARTHEST_UM = 1e9
"""No coordinate is beyond this, a kilometre: what is farther off is no place, and its squares may overflow."""
MOST_PERMUTED = 5
"""Of up to so many fiducials every order is tried; of more, every exchange of two."""


@dataclass(frozen=True)
class Alignment:
    """How the board lies.

    pose takes board um to robot um. residuals_um: (N, 2), where each fiducial was seen minus where the pose puts it,
    robot frame. rms_um: root mean square of their lengths. scatter_um: one sigma of a fiducial's coordinate.
    centre_um: (2,), the fiducials' centre on the board. spread_um: root of the sum of squares of their distances from
    it.
    """

    pose: Similarity2
    names: tuple[str, ...]
    residuals_um: Array
    rms_um: float
    scatter_um: float
    centre_um: tuple[float, float]
    spread_um: float

    def sigma_um(self, place_um: tuple[float, float]) -> float:
        """Return the root mean square distance by which the pose may put a place of the board wrong.

        It grows with the way from the fiducials' centre; it is a planar figure, as `Correction.sigma_um`.
        """
        lever = math.dist(place_um, self.centre_um) / self.spread_um
        return self.scatter_um * math.sqrt(2.0 * (1.0 / len(self.names) + lever**2))


@dataclass(frozen=True)
class _Limits:
    """What an alignment has to keep."""

    residual_um: float
    scale_error: float

    def keeps(self, pose: Similarity2, board_um: Array, robot_um: Array) -> bool:
        """Whether a fit leaves little enough at a scale near enough to 1."""
        return self.keeps_scale(pose) and bool((_lengths(pose, board_um, robot_um) <= self.residual_um).all())

    def keeps_scale(self, pose: Similarity2) -> bool:
        return abs(pose.scale - 1.0) <= self.scale_error


def align(
    board_um: ArrayLike,
    robot_um: ArrayLike,
    *,
    names: Sequence[str],
    max_residual_um: float = 40.0,
    max_scale_error: float = 0.002,
    nominal: Rigid2 | None = None,
    max_shift_um: float = math.inf,
    max_turn_deg: float = math.inf,
    least_scatter_um: float = 0.0,
) -> Alignment:
    """Find how the board lies from where its fiducials are in CAD (N, 2) and where the camera found them (N, 2).

    `nominal`: where the fixture should put the board; the fiducials' centre may be off by `max_shift_um` and the board
    turned by `max_turn_deg` from it. `least_scatter_um`: one sigma of a fiducial's coordinate as the station knows it;
    three fiducials leave two numbers to judge by, so `sigma_um` takes no less than this.

    Raises ValueError, naming what is wrong and what to do, for: fewer than three fiducials; fiducials on a line or too
    near together; a board seen from its other side; fiducials exchanged (named); a scale that is not 1; a residual too
    large (naming the fiducial); a place too far from the nominal one.
    """
    board, robot = _check_pairs(board_um, robot_um, names)
    if not (max_residual_um > 0.0 and max_scale_error > 0.0 and 0.0 <= least_scatter_um < math.inf):
        raise ValueError("max_residual_um and max_scale_error must be greater than 0, least_scatter_um not negative")
    require_span(board, max_residual_um)
    limits = _Limits(max_residual_um, max_scale_error)
    pose = fit_similarity(board, robot)
    if not limits.keeps(pose, board, robot):
        raise ValueError(_why_not(board, robot, names, limits))
    _check_nominal(pose, board, nominal, max_shift_um, max_turn_deg)
    residuals = robot - pose.apply(board)
    centre = board.mean(axis=0)
    scatter = math.sqrt(float((residuals**2).sum()) / (2 * len(board) - 4))
    return Alignment(
        pose=pose,
        names=tuple(names),
        residuals_um=residuals,
        rms_um=pose.rms,
        scatter_um=max(scatter, least_scatter_um),
        centre_um=(float(centre[0]), float(centre[1])),
        spread_um=float(np.linalg.norm(board - centre)),
    )


def _check_pairs(board_um: ArrayLike, robot_um: ArrayLike, names: Sequence[str]) -> tuple[Array, Array]:
    board, robot = check_points(board_um, "board_um", 2), check_points(robot_um, "robot_um", 2)
    if board.ndim != 2 or board.shape != robot.shape or len(names) != len(board):
        raise ValueError(
            f"board_um, robot_um and names must pair up, (N, 2), (N, 2) and N: {board.shape}, {robot.shape} and "
            f"{len(names)}"
        )
    if len(set(names)) != len(names):
        raise ValueError("a fiducial is named twice; give each one its own name")
    if len(board) < LEAST_FIDUCIALS:
        raise ValueError(f"{len(board)} fiducials; an alignment needs {LEAST_FIDUCIALS} or more, find another one")
    if max(np.abs(board).max(), np.abs(robot).max()) > FARTHEST_UM:
        raise ValueError("a fiducial lies beyond all bounds; check the unit of the board file, or find it again")
    return board, robot


def require_span(board: Array, max_residual_um: float) -> None:
    """Raise ValueError for places (N, 2), um, from which the turn, or the side, cannot be told."""
    baseline = max(math.dist(a, b) for a, b in combinations(board, 2))
    if baseline < LEAST_BASELINE_RESIDUALS * max_residual_um:
        raise ValueError(
            f"the fiducials lie within {baseline / 1e3:.2f} mm, too near together for residuals of {max_residual_um:g} "
            f"um; choose some at least {LEAST_BASELINE_RESIDUALS * max_residual_um / 1e3:g} mm apart"
        )
    along, across = np.linalg.svd(board - board.mean(axis=0), compute_uv=False) / math.sqrt(len(board))
    if across < max(LEAST_ACROSS * along, LEAST_ACROSS_RESIDUALS * max_residual_um):
        raise ValueError("the fiducials lie on a line, so the board's side cannot be told; add one beside that line")


def _check_nominal(
    pose: Similarity2, board: Array, nominal: Rigid2 | None, max_shift_um: float, max_turn_deg: float
) -> None:
    if nominal is None:
        return
    turn = (pose.theta_deg - nominal.theta_deg + 180.0) % 360.0 - 180.0
    if not abs(turn) <= max_turn_deg:
        raise ValueError(
            f"the board is turned by {turn:.2f} deg from its nominal place (limit {max_turn_deg:g} deg); "
            "check how it lies in the fixture, and the names of the fiducials"
        )
    centre = board.mean(axis=0)
    shift = math.dist(pose.apply(centre), nominal.apply(centre))
    if not shift <= max_shift_um:
        raise ValueError(
            f"the board is shifted by {shift:.0f} um from its nominal place (limit {max_shift_um:g} um); "
            "check how it lies in the fixture, and its place in the configuration"
        )


def _why_not(board: Array, robot: Array, names: Sequence[str], limits: _Limits) -> str:
    """Say what most likely is wrong with pairs that no similarity of scale 1 explains."""
    reasons = []
    if limits.keeps(fit_similarity(board * (-1.0, 1.0), robot), board * (-1.0, 1.0), robot):
        reasons.append("the board lies with its other side up, or the board file is of the other side")
    order = _explaining_order(board, robot, limits)
    if order:
        reasons.append(_mixed_up(order, names))
    if reasons:
        return f"the fiducials do not fit the board: {'; or '.join(reasons)}; put that right and find them again"
    pose = fit_similarity(board, robot)
    lengths = _lengths(pose, board, robot)
    if not limits.keeps_scale(pose) and (lengths <= limits.residual_um).all():
        return (
            f"the board is {pose.scale:.5f} times as large as its file says (limit {1 - limits.scale_error:g} to "
            f"{1 + limits.scale_error:g}); check the unit of the board file and the steps per mm of the axes"
        )
    return _one_wrong(board, robot, names, limits, lengths)


def _explaining_order(board: Array, robot: Array, limits: _Limits) -> tuple[int, ...]:
    """Return the order of fiducials with the fewest exchanged that fits; empty if there is none."""
    fits = []
    for order in _orders(len(board)):
        pose = fit_similarity(board[list(order)], robot)
        if limits.keeps(pose, board[list(order)], robot):
            fits.append((sum(i != k for i, k in enumerate(order)), pose.rms, order))
    return min(fits)[2] if fits else ()


def _orders(n: int) -> Iterator[tuple[int, ...]]:
    """Yield every order but the given one, or every exchange of two where there are too many."""
    if n <= MOST_PERMUTED:
        yield from (order for order in permutations(range(n)) if order != tuple(range(n)))
        return
    for i, k in combinations(range(n), 2):
        yield tuple(k if j == i else i if j == k else j for j in range(n))


def _mixed_up(order: tuple[int, ...], names: Sequence[str]) -> str:
    moved = [i for i, k in enumerate(order) if i != k]
    if len(moved) == 2:
        return f"{names[moved[0]]} and {names[moved[1]]} are swapped"
    return f"{', '.join(names[i] for i in moved)} are really {', '.join(names[order[i]] for i in moved)}"


def _one_wrong(board: Array, robot: Array, names: Sequence[str], limits: _Limits, lengths: Array) -> str:
    """Name the fiducial without which the others agree, as far as that can be told."""
    worst = int(lengths.argmax())
    told = f"{names[worst]} is left {lengths[worst]:.0f} um off (limit {limits.residual_um:g} um)"
    if len(board) == LEAST_FIDUCIALS:
        return f"{told}; which of three fiducials is wrong cannot be told, so find a fourth, or all of them again"
    suspects = []
    for k in range(len(board)):
        others = np.arange(len(board)) != k
        pose = fit_similarity(board[others], robot[others])
        if limits.keeps(pose, board[others], robot[others]):
            suspects.append((pose.rms, k, float(_lengths(pose, board, robot)[k])))
    if not suspects:
        return f"{told}, and no single one is to blame; check that this is the right board, and find all of them again"
    _, wrong, off = min(suspects)
    also = [names[k] for _, k, _ in sorted(suspects)[1:]]
    doubt = f" (or it is {' or '.join(also)})" if also else ""
    return f"{names[wrong]} is {off:.0f} um from where the others put it{doubt}; find it again or leave it out"


def _lengths(pose: Similarity2, board: Array, robot: Array) -> Array:
    """Return how far (N,) each fiducial is from where the pose puts it."""
    return np.asarray(np.linalg.norm(robot - pose.apply(board), axis=1))
