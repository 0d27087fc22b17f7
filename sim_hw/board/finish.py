"""Finish of a board as it was made: colour of the mask, metal, dirt, and how far layers lie off the copper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sim_hw.plant.knobs import Knobs

MaskColour = Literal["green", "red", "blue", "black", "white"]
Metal = Literal["gold", "hasl"]


@dataclass(frozen=True)
class Finish:
    """What no CAD file tells of a board; the default is what the files say, without a flaw.

    Shifts are um as this side is seen, x right and y up. `oxide` 0..1: how tarnished bare metal is.
    `dirt_per_cm2`: spots of all sizes and levels, of which a picture shows some two square centimetres.
    """

    mask: MaskColour = "green"
    metal: Metal = "gold"
    oxide: float = 0.0
    ink_shift_um: tuple[float, float] = (0.0, 0.0)
    mask_shift_um: tuple[float, float] = (0.0, 0.0)
    dirt_per_cm2: float = 0.0

    @classmethod
    def of(cls, knobs: Knobs) -> Finish:
        """Return the board's finish as the knobs say."""
        return cls(
            mask=knobs.board_mask,
            metal=knobs.board_metal,
            oxide=knobs.board_oxide,
            ink_shift_um=(knobs.board_ink_dx_um, knobs.board_ink_dy_um),
            mask_shift_um=(knobs.board_openings_dx_um, knobs.board_openings_dy_um),
            dirt_per_cm2=knobs.board_dirt_per_cm2,
        )
