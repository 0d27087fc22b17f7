"""Sprung pin: its force against how far it is pushed in.

Force is preload and rate times push (data sheets of spring probes); friction adds on the way in and takes away on the
way out. At the end of its travel, or with a plunger that sticks, the pin is a stiff rod. What is NOT modelled: a board
that gives way, a tip that walks aside.
"""

from __future__ import annotations

from dataclasses import dataclass

STIFF_N_PER_MM = 50.0
"""Of the pin as a rod, with what holds it. A guess."""


@dataclass(frozen=True)
class Pin:
    """A pin as it was bought: N, N/mm, um."""

    preload_n: float
    rate_n_per_mm: float
    travel_um: float
    friction_n: float = 0.02

    def force_n(self, push_um: float, *, inwards: bool, stuck: bool) -> float:
        """Return the force on what it stands on; 0 where it does not touch."""
        if push_um <= 0.0:
            return 0.0
        if stuck:
            return STIFF_N_PER_MM * push_um * 1e-3
        sprung_um = min(push_um, self.travel_um)
        spring_n = self.preload_n + self.rate_n_per_mm * sprung_um * 1e-3
        rod_n = STIFF_N_PER_MM * (push_um - sprung_um) * 1e-3
        return max(0.0, spring_n + (self.friction_n if inwards else -self.friction_n)) + rod_n
