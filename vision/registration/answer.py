"""Answers of registration: where the board and the target are, or why that cannot be said."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.registration.drawing import LayerShifts


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """The place to touch, board frame, and the outline (N, 2) of its bare metal, um."""

    x_um: float
    y_um: float
    outline_um: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Edges:
    """Metal edges by the picture: share confirmed, share contradicted, and how many cells of edge were seen at all.

    hidden: share of the edge that the needle or the frame's border hides. soldered: pads with solder are among them.
    """

    confirmed: float
    contradicted: float
    cells: int
    hidden: float
    soldered: bool = False


@dataclass(frozen=True, slots=True)
class Rival:
    """Another place where the board may lie: its shift, where the target would be, and what speaks against it.

    log_odds: natural, of the winner against this one by the picture alone; at most 400.
    """

    shift_um: tuple[float, float]
    target_um: tuple[float, float]
    log_odds: float


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Where the board lies, and the target.

    shift_um, turn_deg: of the board at the target's nominal place, against the frame that was assumed.
    target_um, target_px: where the target is, in that frame and in the picture; sigma_um, sigma_px: along the worse
    direction; covariance_um2: (2, 2). off_rest_um: the target's own metal against the rest of the board.
    agreement: share of what CAD has or the picture shows that is as expected; metal_seen: share of CAD's metal that is
    bright. assembled: parts are near. near, at_target: metal edges; the latter is None where no target was asked for.
    log_odds: of the winner against the nearest rival. levels: grey by material's name, those that were seen.
    """

    shift_um: tuple[float, float]
    turn_deg: float
    target_um: tuple[float, float]
    target_px: tuple[float, float]
    covariance_um2: NDArray[np.float64]
    sigma_um: float
    sigma_px: float
    off_rest_um: tuple[float, float]
    agreement: float
    metal_seen: float
    near: Edges
    at_target: Edges | None
    log_odds: float
    rivals: tuple[Rival, ...]
    levels: dict[str, float]
    shifts: LayerShifts
    assembled: bool = False


class Refusal(StrEnum):
    """Why there is no registration. The strings are stable: journals and messages carry them."""

    FRAME_UNUSABLE = "frame_unusable"
    AMBIGUOUS = "ambiguous"
    WRONG_PLACE = "wrong_place"
    BOARD_TURNED = "board_turned"
    WRONG_SIDE = "wrong_side"
    NO_BOARD = "no_board"
    NOT_THIS_BOARD = "not_this_board"
    TARGET_NOT_CONFIRMED = "target_not_confirmed"


@dataclass(frozen=True, slots=True, eq=False)
class NotRegistered:
    """No registration. Falsy. `message`: the measured fact and what to do; `best`: what came nearest, for pictures."""

    reason: Refusal
    message: str
    best: Registration | None = None

    def __bool__(self) -> Literal[False]:
        """Say that nothing was registered."""
        return False
