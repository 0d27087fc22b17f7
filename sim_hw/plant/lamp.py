"""Lamp behind a relay contact: delay, bounce, rise and decay."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from sim_hw.plant.knobs import Knobs

_RISE_IN_TAU = math.log(9.0)
"""10..90 % rise time of a first-order lamp in time constants."""
_HISTORY_S = 30.0


@dataclass(frozen=True)
class _Edge:
    """The contact changes at `t_s`, when the lamp's level was `level`."""

    t_s: float
    closed: bool
    level: float
    rise_s: float

    def level_at(self, t_s: float) -> float:
        """Return the level some time after this edge, if nothing else happens."""
        goal = 1.0 if self.closed else 0.0
        if self.rise_s <= 0.0 or self.t_s == -math.inf:
            return goal
        return goal + (self.level - goal) * math.exp(-max(0.0, t_s - self.t_s) * _RISE_IN_TAU / self.rise_s)


class Lamp:
    """Follow one relay contact; level 0..1 at any time since the last half minute."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._edges = [_Edge(-math.inf, closed=False, level=0.0, rise_s=0.0)]

    def switch(self, t_s: float, knobs: Knobs, *, on: bool) -> None:
        """Energise or release the coil at a time; the contact follows after its delay and bounces when it closes."""
        # A coil that is switched again before its contact moved cancels what was pending.
        edges = [edge for edge in self._edges if t_s - _HISTORY_S < edge.t_s <= t_s] or [_last(self._edges, t_s)]
        if edges[-1].closed != on:
            at_s = t_s + knobs.relay_delay_s * self._rng.uniform(0.8, 1.2)
            edges.append(_next(edges[-1], at_s, knobs.lamp_rise_s, closed=on))
            if on and knobs.relay_bounce_s > 0.0:
                opens, closes = sorted(self._rng.uniform(0.0, knobs.relay_bounce_s) for _ in range(2))
                edges.append(_next(edges[-1], at_s + opens, knobs.lamp_rise_s, closed=False))
                edges.append(_next(edges[-1], at_s + closes, knobs.lamp_rise_s, closed=True))
        # Replaced, never changed: a camera's thread may be reading it.
        self._edges = edges

    def level(self, t_s: float) -> float:
        """Return the light level at a time."""
        return _last(self._edges, t_s).level_at(t_s)


def _last(edges: list[_Edge], t_s: float) -> _Edge:
    """Return the edge in force at a time."""
    return next((edge for edge in reversed(edges) if edge.t_s <= t_s), edges[0])


def _next(edge: _Edge, t_s: float, rise_s: float, *, closed: bool) -> _Edge:
    return _Edge(t_s, closed, edge.level_at(t_s), rise_s)
