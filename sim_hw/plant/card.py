"""Control-point card: where it lies, a laser print on white paper, fixed to the bench beside the board.

What is NOT modelled: a card that is tilted or curls, and the step of its edge.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim_hw.plant.knobs import Knobs
from sim_hw.plant.pose import chosen

CARD_CENTRE_UM = (30_000.0, 22_000.0)
"""Nominal centre of the print in the robot frame: reached at every head angle, and far from the board."""
CARD_SIDE_UM = 11_000.0
"""Side of the square paper, whose middle is the centre of the print."""


@dataclass(frozen=True)
class CardPose:
    """Where the card really lies: shift, rotation about its centre (+ is CCW), height over the nominal board plane."""

    dx_um: float = 0.0
    dy_um: float = 0.0
    rotation_deg: float = 0.0
    dz_um: float = 0.0

    @classmethod
    def drawn(cls, knobs: Knobs, seed: int) -> CardPose:
        """Draw a pose from the seed; knobs that are set replace what was drawn."""
        rng = random.Random(f"{seed}/card")
        shift_um = rng.uniform(0.0, knobs.card_shift_max_um)
        direction = rng.uniform(0.0, 2.0 * math.pi)
        rotation_deg = rng.uniform(-1.0, 1.0) * knobs.card_rotation_max_deg
        dz_um = rng.gauss(0.0, 1.0) * knobs.card_height_sigma_um
        return cls(
            dx_um=chosen(knobs.card_dx_um, shift_um * math.cos(direction)),
            dy_um=chosen(knobs.card_dy_um, shift_um * math.sin(direction)),
            rotation_deg=chosen(knobs.card_rotation_deg, rotation_deg),
            dz_um=chosen(knobs.card_dz_um, dz_um),
        )

    @property
    def centre_um(self) -> tuple[float, float]:
        """Return the centre of the print in the robot frame: the control point."""
        return CARD_CENTRE_UM[0] + self.dx_um, CARD_CENTRE_UM[1] + self.dy_um

    def covers(self, place_um: tuple[float, float]) -> bool:
        """Tell whether a place of the robot frame lies on the paper."""
        x_um, y_um = place_um[0] - self.centre_um[0], place_um[1] - self.centre_um[1]
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        return max(abs(c * x_um + s * y_um), abs(c * y_um - s * x_um)) <= CARD_SIDE_UM / 2.0

    def plane(self) -> npt.NDArray[np.float64]:
        """Return the (3, 3) map from card mm (u right, v up, from the centre) to the robot, um."""
        c, s = 1e3 * math.cos(math.radians(self.rotation_deg)), 1e3 * math.sin(math.radians(self.rotation_deg))
        x_um, y_um = self.centre_um
        return np.array([[c, -s, x_um], [s, c, y_um], [0.0, 0.0, self.dz_um]])
