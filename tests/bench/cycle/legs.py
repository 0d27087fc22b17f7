"""Legs that the drives were sent on, read from the line, and how long their trapezoids take. Pure.

A leg is one axis or several that move together. Of a hop (up, across in one leg or several, down) only the way across
and the difference in height are needed; the rest is a detour: how high it rises and that it comes from one side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tests.bench.cycle.line import READ, Exchange

TARGET, SPEED, CONTROL, POSITION = 0x607A, 0x6081, 0x6040, 0x6064
NEW_SET_POINT = 0x10
Z = "z"


@dataclass(frozen=True)
class AxisFacts:
    """What the configuration says of an axis, in its own unit (um or deg), and how its drive counts speeds."""

    name: str
    increments_per_unit: float
    speed: float
    acceleration: float
    speed_count: float
    """How many units per second one count of 6081h is."""


@dataclass(frozen=True)
class Way:
    """One axis' part of a leg."""

    start: float
    end: float
    speed: float
    acceleration: float

    @property
    def seconds(self) -> float:
        """Return how long it takes from rest to rest."""
        return trapezoid_s(self.end - self.start, self.speed, self.acceleration)


@dataclass(frozen=True)
class Leg:
    """Axes that move together."""

    begun_s: float
    ways: Mapping[str, Way]

    @property
    def seconds(self) -> float:
        """Return how long the slowest of them takes."""
        return max(way.seconds for way in self.ways.values())

    @property
    def upright(self) -> bool:
        """Whether only Z moves."""
        return set(self.ways) == {Z}


def trapezoid_s(distance: float, speed: float, acceleration: float) -> float:
    """Return how long a way takes from rest to rest: two ramps, and what is left at full speed."""
    distance = abs(distance)
    if distance < speed * speed / acceleration:
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


class Follower:
    """Follows the drives from the line's first byte on, so that it knows where a leg begins."""

    def __init__(self, axes: Mapping[int, AxisFacts]) -> None:
        """Take the axes by their slave address."""
        self._axes = axes
        self._at: dict[int, float] = {}
        self._target: dict[int, float] = {}
        self._speed = {slave: axis.speed for slave, axis in axes.items()}
        self._armed = dict.fromkeys(axes, False)
        self.legs: list[Leg] = []

    def follow(self, part: Sequence[Exchange]) -> None:
        """Take what passed next."""
        for exchange in part:
            if exchange.slave in self._axes:
                self._take(exchange)

    def _take(self, exchange: Exchange) -> None:
        slave, access = exchange.slave, exchange.object
        axis = self._axes[slave]
        if exchange.request[1] == READ and len(exchange.reply) >= 13:
            # 6041h, padding, 6061h, 6064h, 60FDh behind slave, function code and length
            self._at[slave] = int.from_bytes(exchange.reply[7:11], "big", signed=True) / axis.increments_per_unit
        if access is None or access.value is None:
            return
        if access.index == POSITION and not access.written:
            self._at[slave] = access.value / axis.increments_per_unit
        elif access.index == TARGET and access.written:
            self._target[slave] = access.value / axis.increments_per_unit
        elif access.index == SPEED and access.written:
            self._speed[slave] = access.value * axis.speed_count
        elif access.index == CONTROL and access.written:
            rises = bool(access.value & NEW_SET_POINT) and not self._armed[slave]
            self._armed[slave] = bool(access.value & NEW_SET_POINT)
            if rises and slave in self._target:
                self._begin(slave, exchange.sent_s)

    def _begin(self, slave: int, begun_s: float) -> None:
        axis, end = self._axes[slave], self._target[slave]
        way = Way(self._at.get(slave, end), end, self._speed[slave], axis.acceleration)
        self._at[slave] = end
        last = self.legs[-1] if self.legs else None
        together = last is not None and begun_s < last.begun_s + last.seconds
        if last is not None and together and axis.name not in last.ways and Z not in (*last.ways, axis.name):
            self.legs[-1] = Leg(last.begun_s, {**last.ways, axis.name: way})
        else:
            self.legs.append(Leg(begun_s, {axis.name: way}))


def needed_s(legs: Sequence[Leg]) -> float:
    """Return how long the moves take that are needed: hops straight across, strokes of Z alone as they are."""
    total_s, place = 0.0, 0
    while place < len(legs):
        across = place + (legs[place].upright and _up(legs[place]) and _goes_across(legs, place + 1))
        if not _goes_across(legs, across):
            total_s += legs[place].seconds
            place += 1
            continue
        end = across
        while _goes_across(legs, end):
            end += 1
        while end < len(legs) and legs[end].upright and not _up(legs[end]):
            end += 1
        total_s += _hop_s(legs[place:end])
        place = end
    return total_s


def _goes_across(legs: Sequence[Leg], place: int) -> bool:
    return place < len(legs) and not legs[place].upright


def _up(leg: Leg) -> bool:
    return leg.ways[Z].end > leg.ways[Z].start


def _hop_s(legs: Sequence[Leg]) -> float:
    """Return how long a hop takes without the hop: all axes straight from first to last place, Z after the others."""
    net: dict[str, Way] = {}
    for leg in legs:
        for name, way in leg.ways.items():
            first = net.get(name, way)
            net[name] = Way(first.start, way.end, max(first.speed, way.speed), way.acceleration)
    across_s = max((way.seconds for name, way in net.items() if name != Z), default=0.0)
    return across_s + (net[Z].seconds if Z in net else 0.0)
