"""Press: what is true while the needle is down, and the resistance of its contact.

R = pin + k / sqrt(F) + film / F (Holm, Electric Contacts: constriction and film). All constants are guesses until a
real station gives its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from sim_hw.board.board import Board
from sim_hw.electric.circuit import Place
from sim_hw.electric.contact import Footing, Patch
from sim_hw.electric.soil import CLEAN, Film
from sim_hw.electric.trace import Point

LEAST_SHARE = 0.3
"""Of the needle's end that has to stand on metal."""
PIN_OHM, CONSTRICTION = 0.02, 0.01
"""Of the pin, and of the contact: ohm times the root of N."""
_LEAST_N = 1e-3


@dataclass
class Press:
    """One stay of the needle on a surface: since when, on what, with which films between."""

    began: Point
    speed_um_s: float
    footing: Footing
    cad_mm: tuple[float, float]
    made_s: float
    """Since when the contact is steady."""
    strokes: int = 0
    most_n: float = 0.0
    films: dict[str, Film] = field(default_factory=dict)
    dented: bool = False

    @property
    def held(self) -> tuple[Patch, ...]:
        """Return the pieces of metal that carry the needle."""
        return self.footing.held_by(LEAST_SHARE)

    def film_ohm_n(self) -> float:
        """Return the least film of the metals held, ohm times N; inf: on no metal."""
        return min((self._film(patch).ohm_n for patch in self.held), default=math.inf)

    def ohms(self, force_n: float, debris_ohm_n: float, share: float = 1.0) -> float:
        """Return the resistance of the pin and the contact, of which a share of the force is on one of its wires."""
        force_n = max(force_n * share, _LEAST_N)
        return PIN_OHM + CONSTRICTION / math.sqrt(force_n) + (self.film_ohm_n() + debris_ohm_n) / force_n

    def places(self) -> tuple[Place, ...]:
        """Return the places of nets that are joined to the needle; of two, one under the thicker film is not.

        All of a pad is one place, its middle: a break is between pads.
        """
        least = self.film_ohm_n()
        held = (patch for patch in self.held if self._film(patch).ohm_n <= least)
        return tuple(Place(patch.net, *(patch.centre_mm or self.cad_mm)) for patch in held)

    def offset_um(self, patch: Patch) -> tuple[float, float]:
        """Return where on its pad the needle stands, from the pad's middle."""
        if patch.centre_mm is None:
            return 0.0, 0.0
        return (self.cad_mm[0] - patch.centre_mm[0]) * 1e3, (self.cad_mm[1] - patch.centre_mm[1]) * 1e3

    def where(self, board: Board) -> dict[str, object]:
        """Return for the log what the needle stands on, and the round target and the pad that are nearest."""
        targets = [(self._away_um(target.x_mm, target.y_mm), target.name) for target in board.targets]
        pads = [(self._away_um(pad.x_mm, pad.y_mm), pad.name, pad.net) for pad in board.pads]
        error_um, target = min(targets, default=(None, None))
        pad_error_um, pin, net = min(pads, default=(None, None, None))
        return {
            "cad_mm": list(self.cad_mm),
            "material": self.footing.material,
            "metal_share": self.footing.metal_share,
            "nets": sorted({patch.net or "" for patch in self.held}),
            "pad": self.held[0].pad if self.held else None,
            "target": target,
            "error_um": error_um,
            "nearest_pad": {"pin": pin, "net": net, "error_um": pad_error_um},
        }

    def contact(self, force_n: float, debris_ohm_n: float) -> dict[str, object]:
        """Return for the log what the contact is worth."""
        if not self.held:
            return {"contact": False, "film": None, "film_ohm": None, "debris_ohm": None, "ohms": None}
        return {
            "contact": True,
            "film": min((self._film(patch) for patch in self.held), key=lambda film: film.ohm_n).kind,
            "film_ohm": self.film_ohm_n() / force_n,
            "debris_ohm": debris_ohm_n / force_n,
            "ohms": self.ohms(force_n, debris_ohm_n),
        }

    def _film(self, patch: Patch) -> Film:
        return self.films.get(patch.key or "", CLEAN)

    def _away_um(self, x_mm: float, y_mm: float) -> float:
        return math.dist(self.cad_mm, (x_mm, y_mm)) * 1e3
