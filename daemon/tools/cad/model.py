"""What a folder of CAD files says, before anything is decided about it.

mm in the Gerbers' coordinates, y up, seen from the top whichever side is meant; the netlist is already shifted there.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Side = Literal["top", "bottom"]
Use = Literal["copper", "mask", "silk", "paste", "courtyard", "fabrication"]

_NO_NET = frozenset({"", "N/C", "NC", "NO_NET", "NONET"})


def is_no_net(name: str) -> bool:
    """Whether a net's name is what files write where a pad belongs to no net."""
    return name.upper() in _NO_NET


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A filled polygon in painting order: `points_mm` (N, 2); `dark` adds, otherwise it removes.

    part, pin, net: what the file itself says of it (X2 attributes .P, .N, .C); None where it says nothing.
    round_mm: (x, y, diameter) of a flashed round.
    place_mm: where a pad was flashed, its aperture's own origin; None for lines and regions.
    item: counts the drawn objects of the file; a pad of several polygons has one number.
    function: X2 aperture function (`SMDPad`, `ComponentPad`, `ViaPad`, `TestPad`, `FiducialPad`, `Conductor`, ...).
    """

    points_mm: NDArray[np.float64]
    dark: bool = True
    part: str | None = None
    pin: str | None = None
    net: str | None = None
    flashed: bool = False
    round_mm: tuple[float, float, float] | None = None
    place_mm: tuple[float, float] | None = None
    item: int = 0
    function: str | None = None


@dataclass(frozen=True, slots=True)
class Drill:
    """A hole, or a slot to (end_x_mm, end_y_mm).

    plated: None where the files do not say. capped: filled over. sides: where it comes out; a blind via on one side,
    a buried one on none.
    """

    x_mm: float
    y_mm: float
    diameter_mm: float
    end_x_mm: float | None = None
    end_y_mm: float | None = None
    plated: bool | None = None
    capped: bool = False
    sides: frozenset[Side] = frozenset(("top", "bottom"))


@dataclass(frozen=True, slots=True)
class Pin:
    """What the netlist (or what stands for one) says of one pad.

    part, pin: "" for a via. width_mm, height_mm: of the pad where known (height 0: round).
    access, covered: sides from which it can be reached, and on which solder mask covers it.
    """

    part: str
    pin: str
    net: str
    x_mm: float
    y_mm: float
    is_via: bool
    hole_mm: float | None
    access: frozenset[Side]
    covered: frozenset[Side]
    width_mm: float | None = None
    height_mm: float | None = None
    feature: Literal["pad", "test_point", "fiducial", "via"] | None = None


@dataclass(frozen=True, slots=True)
class Copy:
    """One board of a panel, upright and then turned about its lower left corner, which lies at x, y."""

    name: str
    x_mm: float
    y_mm: float
    turn_deg: float
    width_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Cad:
    """All that was read. layers: shapes by side and use, as painted; outline: closed polygons, cut-outs not dark.

    roles: file (as named in the folder) -> what it was taken for. notes: sentences for people: what was left out,
    guessed or made up, and what to do about it. sources: file -> sha256. broken: layers that could not be read -> why.
    """

    name: str
    folder: Path
    layers: dict[tuple[Side, Use], tuple[Shape, ...]]
    drills: tuple[Drill, ...]
    outline: tuple[Shape, ...]
    box_mm: tuple[float, float, float, float]
    pins: tuple[Pin, ...]
    netlist_shift_mm: tuple[float, float] = (0.0, 0.0)
    copies: tuple[Copy, ...] = ()
    named_copy: int = 0
    roles: dict[str, str] | None = None
    notes: tuple[str, ...] = ()
    sources: dict[str, str] | None = None
    broken: dict[tuple[Side, Use], str] | None = None
