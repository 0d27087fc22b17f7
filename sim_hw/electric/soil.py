"""Soil: films on pads, and what sticks to the needle's end.

Each pad draws one number from the seed, and its shares decide what that number means; so a share turned up adds soiled
pads and changes no other one. Sources: films of contacts are log-normal with a long tail, break with force, and frit
under a voltage (Holm, Electric Contacts). All figures are guesses until a real station gives its own.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

SITE_UM = 60.0
"""A film that was broken is broken this far around."""
_OXIDE_OHM_N, _STUBBORN_OHM_N, _FLUX_OHM_N = (60.0, 1.3), (2e5, 1.5), (1e9, 0.5)
"""Median of film resistance times force, and sigma of its logarithm."""
_OXIDE_BREAK_N, _STUBBORN_BREAK_N = 0.6, 1.6
"""A press of this force breaks a film with a chance of 63 %."""
_OXIDE_FRIT_V, _STUBBORN_FRIT_V = (2.0, 0.5), (60.0, 0.5)
_DEBRIS_OHM_N = (3e4, 1.5)
_DEBRIS_FALLS_OFF = 0.05
"""At each touch."""
_BRUSHED_OFF = 0.9
"""At each touch of the brush."""


@dataclass(frozen=True)
class SoilShares:
    """Shares, 0..1."""

    oxide: float = 0.0
    """Pads with a film that a press or two breaks."""
    stubborn: float = 0.0
    """Pads with a film that hardly breaks, or with a pool of flux."""
    debris: float = 0.0
    """Touches that leave something on the needle."""


@dataclass(frozen=True)
class Film:
    """What covers a pad. `angle_rad`: a pool of flux covers the half of the pad in this direction, and only that."""

    kind: str
    ohm_n: float = 0.0
    break_n: float = math.inf
    frit_v: float = math.inf
    angle_rad: float | None = None

    def covers(self, from_centre_um: tuple[float, float]) -> bool:
        """Tell whether the film is at a place of its pad."""
        if self.kind == "clean":
            return False
        if self.angle_rad is None:
            return True
        x_um, y_um = from_centre_um
        return x_um * math.cos(self.angle_rad) + y_um * math.sin(self.angle_rad) > -15.0

    def breaks_at(self, force_n: float) -> float:
        """Return the chance that one press breaks it."""
        return -math.expm1(-((force_n / self.break_n) ** 2))


CLEAN = Film("clean")


class Soil:
    """Films of one board in the nest and what is on the needle; both change with every press."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._board = ""
        self._broken: dict[str, list[tuple[float, float]]] = {}
        self._tries: dict[str, int] = {}
        self._touches = 0
        self.debris_ohm_n = 0.0
        """Film resistance of what sticks to the needle, times force; 0: nothing."""

    def lay_board(self, board: str) -> None:
        """Begin with another board: its films are whole. The needle keeps what is on it."""
        self._board = board
        self._broken.clear()
        self._tries.clear()

    def film(self, pad: str, shares: SoilShares) -> Film:
        """Return what covers a pad."""
        rng = self._rng("pad", pad)
        drawn, kind, log_ohm, log_v, angle = (
            rng.random(),
            rng.random(),
            rng.gauss(0, 1),
            rng.gauss(0, 1),
            rng.random(),
        )
        if drawn < shares.stubborn:
            if kind < 0.5:
                return Film("flux", _spread(_FLUX_OHM_N, log_ohm), angle_rad=2.0 * math.pi * angle)
            frit_v = _spread(_STUBBORN_FRIT_V, log_v)
            return Film("stubborn", _spread(_STUBBORN_OHM_N, log_ohm), _STUBBORN_BREAK_N, frit_v)
        if drawn < shares.stubborn + shares.oxide:
            return Film("oxide", _spread(_OXIDE_OHM_N, log_ohm), _OXIDE_BREAK_N, _spread(_OXIDE_FRIT_V, log_v))
        return CLEAN

    def whole_film(self, pad: str, from_centre_um: tuple[float, float], shares: SoilShares) -> Film:
        """Return the film under the needle: none where it was broken before."""
        film = self.film(pad, shares)
        broken = any(math.dist(site, from_centre_um) <= SITE_UM for site in self._broken.get(pad, ()))
        return CLEAN if broken or not film.covers(from_centre_um) else film

    def press(self, pad: str, from_centre_um: tuple[float, float], force_n: float, shares: SoilShares) -> Film:
        """Press once; return the film that is left."""
        film = self.whole_film(pad, from_centre_um, shares)
        tries = self._tries[pad] = self._tries.get(pad, 0) + 1
        if film is CLEAN or self._rng("press", pad, tries).random() >= film.breaks_at(force_n):
            return film
        self._broken.setdefault(pad, []).append(from_centre_um)
        return CLEAN

    def apply_voltage(self, pad: str, from_centre_um: tuple[float, float], volts: float, shares: SoilShares) -> bool:
        """Put a voltage across the film under the needle; tell whether that broke it."""
        film = self.whole_film(pad, from_centre_um, shares)
        if film is CLEAN or volts < film.frit_v:
            return False
        self._broken.setdefault(pad, []).append(from_centre_um)
        return True

    def touch(self, shares: SoilShares) -> None:
        """Come down on something once: debris may stick to the needle, or fall off it."""
        self._touches += 1
        rng = self._rng("touch", self._touches)
        sticks, falls, log_ohm = rng.random(), rng.random(), rng.gauss(0, 1)
        if self.debris_ohm_n and falls < _DEBRIS_FALLS_OFF:
            self.debris_ohm_n = 0.0
        if sticks < shares.debris:
            self.debris_ohm_n = max(self.debris_ohm_n, _spread(_DEBRIS_OHM_N, log_ohm))

    def brush(self) -> None:
        """Come down on the brush once."""
        self._touches += 1
        if self._rng("brush", self._touches).random() < _BRUSHED_OFF:
            self.debris_ohm_n = 0.0

    def _rng(self, *purpose: object) -> random.Random:
        return random.Random("/".join(map(str, (self._seed, "soil", self._board, *purpose))))


def _spread(median_sigma: tuple[float, float], drawn: float) -> float:
    median, sigma = median_sigma
    return median * math.exp(sigma * drawn)
