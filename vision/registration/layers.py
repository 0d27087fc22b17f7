"""What CAD says of one side of a board, as polygons: the input of registration.

Everything is um in the board frame of that side: origin at the outline's lower left corner as seen from the side, x
right, y up. Painting order counts: a later polygon covers or removes what earlier ones drew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """A filled polygon: `points_um` (N, 2) float64; `dark` adds, otherwise it removes."""

    points_um: NDArray[np.float64]
    dark: bool = True


@dataclass(frozen=True, slots=True)
class Hole:
    """A drilled hole, or a slot from (x_um, y_um) to (end_x_um, end_y_um); `covered`: mask or a cap hides it."""

    x_um: float
    y_um: float
    diameter_um: float
    end_x_um: float | None = None
    end_y_um: float | None = None
    plated: bool = True
    covered: bool = False


@dataclass(frozen=True, slots=True)
class SideLayers:
    """One side of a board. Bare metal is copper seen through an opening, less the holes.

    openings: of the solder mask; ink: silkscreen; outline: closed polygons of the board's edge, cut-outs with
    `dark=False`; bodies: outlines of parts, whose look nobody knows; soldered: what carries solder or a lead, where it
    lies on bare metal.
    """

    copper: tuple[Polygon, ...]
    openings: tuple[Polygon, ...]
    ink: tuple[Polygon, ...]
    holes: tuple[Hole, ...]
    outline: tuple[Polygon, ...]
    bodies: tuple[Polygon, ...] = ()
    soldered: tuple[Polygon, ...] = ()
