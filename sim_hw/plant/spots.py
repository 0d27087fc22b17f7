"""Coin and brush on the bench beside the control-point card: round and fixed, each near its nominal place.

Where they really lie is drawn from the seed: whoever screwed them on measured their places no better. What is NOT
modelled: an edge that is rounded, a coin that is tilted.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from sim_hw.plant.knobs import Knobs

COIN_UM, BRUSH_UM = (30_000.0, 34_000.0), (30_000.0, 40_000.0)
"""Nominal middles in the robot frame."""
RADIUS_UM = 2_000.0


@dataclass(frozen=True)
class Spot:
    """A round thing on the bench: its middle in the robot frame, its height over the nominal board plane."""

    x_um: float
    y_um: float
    dz_um: float = 0.0

    @classmethod
    def drawn(cls, name: str, nominal_um: tuple[float, float], knobs: Knobs, seed: int) -> Spot:
        """Draw where it lies."""
        rng = random.Random(f"{seed}/{name}")
        shift_um, way = rng.uniform(0.0, knobs.spots_shift_max_um), rng.uniform(0.0, 2.0 * math.pi)
        dz_um = rng.gauss(0.0, 1.0) * knobs.spots_height_sigma_um
        return cls(nominal_um[0] + shift_um * math.cos(way), nominal_um[1] + shift_um * math.sin(way), dz_um)

    def covers(self, place_um: tuple[float, float]) -> bool:
        """Tell whether a place of the robot frame is on it."""
        return math.dist(place_um, (self.x_um, self.y_um)) <= RADIUS_UM


@dataclass(frozen=True)
class Spots:
    """The coin that is on the meter's return, and the brush."""

    coin: Spot
    brush: Spot

    @classmethod
    def drawn(cls, knobs: Knobs, seed: int) -> Spots:
        """Draw both from the seed."""
        return cls(Spot.drawn("coin", COIN_UM, knobs, seed), Spot.drawn("brush", BRUSH_UM, knobs, seed))

    def at(self, place_um: tuple[float, float]) -> Spot | None:
        """Return which of them lies at a place of the robot frame."""
        return next((spot for spot in (self.coin, self.brush) if spot.covers(place_um)), None)
