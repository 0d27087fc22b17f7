"""Mechanics of one axis: what the carriage does when the motor's field turns.

The rotor follows what the drive demands unless it stalls or stands at a hard stop (then steps are lost and nobody
knows). The carriage follows the rotor with backlash, plus an error drawn new for every stop.
Positions are um or degrees in the machine's own frame, where the home switch's edge is at `home_edge`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace

from sim_hw.plant.motion import Segment, Trajectory

_HISTORY_S = 30.0


@dataclass(frozen=True)
class AxisSpec:
    """What is built: range, switches and gearing of one axis (units: um, or degrees for theta)."""

    name: str
    address: int
    increments_per_unit: float
    negative_limit: float
    positive_limit: float
    home_edge: float
    home_above: bool
    """The home switch is active above its edge (True) or below it (False)."""
    hard_min: float
    hard_max: float


INCREMENTS_PER_REV = 50 * 65536
"""Position unit B5h of an open-loop drive: pole pairs x 65536."""

_ABOVE, _BELOW = True, False

SPECS: tuple[AxisSpec, ...] = (
    AxisSpec(
        name="x",
        address=1,
        increments_per_unit=INCREMENTS_PER_REV / 5000.0,
        negative_limit=-3000.0,
        positive_limit=203_000.0,
        home_edge=0.0,
        home_above=_BELOW,
        hard_min=-5000.0,
        hard_max=205_000.0,
    ),
    AxisSpec(
        name="y",
        address=2,
        increments_per_unit=INCREMENTS_PER_REV / 5000.0,
        negative_limit=-3000.0,
        positive_limit=153_000.0,
        home_edge=0.0,
        home_above=_BELOW,
        hard_min=-5000.0,
        hard_max=155_000.0,
    ),
    AxisSpec(
        name="z",
        address=3,
        increments_per_unit=INCREMENTS_PER_REV / 2000.0,
        negative_limit=-500.0,
        positive_limit=32_000.0,
        home_edge=30_000.0,
        home_above=_ABOVE,
        hard_min=-1000.0,
        hard_max=33_000.0,
    ),
    AxisSpec(
        name="theta",
        address=4,
        increments_per_unit=INCREMENTS_PER_REV / 360.0,
        negative_limit=-221.0,
        positive_limit=101.0,
        home_edge=0.0,
        home_above=_ABOVE,
        hard_min=-222.5,
        hard_max=102.5,
    ),
)


@dataclass(frozen=True)
class _Piece:
    """Rotor motion, with the carriage's place (without its stop error) when the piece begins."""

    rotor: Segment
    carriage0: float
    backlash: float
    error: Segment

    def carriage(self, t_s: float) -> float:
        """Return the carriage's place; the rotor pushes it up at once and down only after the backlash is used up."""
        rotor = self.rotor.position(t_s)
        return min(max(self.carriage0, rotor), rotor + self.backlash)

    def when_at(self, place: float, *, upwards: bool) -> float | None:
        """Return when the carriage passes a place in a direction, or None."""
        t_s = self.rotor.time_at(place if upwards else place - self.backlash)
        first, last = self.carriage0, self.carriage(self.rotor.t1_s)
        passes = first < place <= last if upwards else first >= place > last
        # Rounding may put the place a hair outside the rotor's segment; then it is passed at its end.
        return None if not passes else self.rotor.t1_s if t_s is None else t_s


class Axis:
    """Hold the motion of one axis: the past half minute and what is already ordered."""

    def __init__(self, spec: AxisSpec, start: float, rng: random.Random) -> None:
        self.spec = spec
        self._rng = rng
        self._pieces = [_resting(0.0, start, start, 0.0, 0.0)]

    def rotor(self, t_s: float) -> float:
        """Return the rotor's place at a time."""
        return self._at(t_s).rotor.position(t_s)

    def carriage(self, t_s: float) -> float:
        """Return the carriage's place at a time without the error of the stop: what the switches see."""
        return self._at(t_s).carriage(t_s)

    def position(self, t_s: float) -> float:
        """Return the true position at a time."""
        piece = self._at(t_s)
        return piece.carriage(t_s) + piece.error.position(t_s)

    def moving(self, t_s: float) -> bool:
        """Tell whether the rotor turns at a time."""
        return self._at(t_s).rotor.velocity(t_s) != 0.0 or t_s < self._pieces[-1].rotor.t0_s

    @property
    def rest_s(self) -> float:
        """Return the time from which the axis rests, as far as is ordered."""
        return self._pieces[-1].rotor.t0_s

    def follow(
        self,
        demand: Trajectory,
        *,
        backlash: float = 0.0,
        sigma: float = 0.0,
        stalled: bool = False,
        beside: float = 0.0,
    ) -> None:
        """Turn with the field from the demand's start on, by the demand's displacement.

        Args:
            demand: what the drive orders; it replaces whatever was ordered for later.
            backlash: play of the nut, units.
            sigma: spread of the error drawn for this stop, units.
            stalled: the field turns and the rotor does not.
            beside: how far beside its place this stop ends, units.

        """
        t_s = demand.start_s
        now = self._at(t_s)
        rotor, carriage, error = now.rotor.position(t_s), now.carriage(t_s), now.error.position(t_s)
        segments = [] if stalled else list(_within(demand, rotor, self.spec.hard_min, self.spec.hard_max))
        goal = self._rng.gauss(0.0, 1.0) * sigma + beside if segments else error
        end_s = segments[-1].t1_s if segments else t_s
        drift = _ramp(t_s, end_s, error, goal)
        pieces = self._until(t_s)
        for segment in segments:
            piece = _Piece(segment, carriage, backlash, drift)
            pieces.append(piece)
            rotor, carriage = segment.position(segment.t1_s), piece.carriage(segment.t1_s)
        self._pieces = [*pieces, _resting(end_s, rotor, carriage, backlash, goal)]

    def slip(self, t_s: float, distance: float) -> None:
        """Stop at once and come to rest `distance` away, but never beyond a hard stop: steps are lost."""
        now = self._at(t_s)
        rotor, carriage, error = now.rotor.position(t_s), now.carriage(t_s), now.error.position(t_s)
        distance = min(max(carriage + distance, self.spec.hard_min), self.spec.hard_max) - carriage
        self._pieces = [*self._until(t_s), _resting(t_s, rotor + distance, carriage + distance, now.backlash, error)]

    def next_crossing(self, place: float, after_s: float, *, upwards: bool) -> float | None:
        """Return the first time after `after_s` at which the carriage is going to pass a place, or None."""
        pieces = self._pieces
        # The past half minute may hold a thousand pieces, and what is asked for is among the last.
        first = len(pieces)
        while first and pieces[first - 1].rotor.t1_s >= after_s:
            first -= 1
        for piece in pieces[first:]:
            t_s = piece.when_at(place, upwards=upwards)
            if t_s is not None and t_s > after_s:
                return t_s
        return None

    def _at(self, t_s: float) -> _Piece:
        for piece in reversed(self._pieces):
            if piece.rotor.t0_s <= t_s:
                return piece
        return self._pieces[0]

    def _until(self, t_s: float) -> list[_Piece]:
        """Return what happened before a time, without what is too old to be asked for.

        The list of pieces is replaced, never changed: a camera's thread may be reading it.
        """
        kept = [piece for piece in self._pieces if piece.rotor.t0_s < t_s and piece.rotor.t1_s > t_s - _HISTORY_S]
        if kept:
            last = kept[-1]
            rest_s = min(last.rotor.t1_s, t_s) - last.rotor.t0_s
            kept[-1] = replace(last, rotor=replace(last.rotor, duration_s=rest_s))
        return kept


def _resting(t_s: float, rotor: float, carriage: float, backlash: float, error: float) -> _Piece:
    return _Piece(Segment(t_s, math.inf, rotor, 0.0, 0.0), carriage, backlash, Segment(t_s, math.inf, error, 0.0, 0.0))


def _ramp(t0_s: float, t1_s: float, first: float, last: float) -> Segment:
    duration_s = t1_s - t0_s
    return Segment(t0_s, duration_s, first, (last - first) / duration_s if duration_s > 0.0 else 0.0, 0.0)


def _within(demand: Trajectory, rotor: float, low: float, high: float) -> Iterator[Segment]:
    """Yield the demand's segments as rotor motion, up to the first hard stop; beyond it steps are lost."""
    for segment in demand.shifted(rotor - demand.position(demand.start_s)).segments:
        stop = high if segment.position(segment.t1_s) > high else low
        if low <= segment.position(segment.t1_s) <= high:
            yield segment
            continue
        hit_s = segment.time_at(stop)
        if hit_s is not None and hit_s > segment.t0_s:
            yield replace(segment, duration_s=hit_s - segment.t0_s)
        return
