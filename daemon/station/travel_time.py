"""Travel times of the head between places, by the speeds and accelerations of its axes. Pure.

They follow the longest way that the gantry takes (`drivers.gantry.path`): up to the safe height, across with the
one-sided approach of each axis, down again. Each axis runs a trapezoid; the axes of a leg start together, and the
slowest counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon.config.model import Config
from daemon.config.sections.devices import AxisSection
from drivers.gantry import Approach, Position
from drivers.gantry.contract import axis_theta_deg
from vision.geometry import Array

SAME_UM, SAME_DEG = 0.5, 0.01
"""Nearer than this an axis stays where it is."""


def trapezoid_s(way: Array, speed: float, acceleration: float) -> Array:
    """Return how long an axis takes for each way, s: up to speed and down again, or a triangle where it is short."""
    way = np.abs(way)
    short = 2.0 * np.sqrt(way / acceleration)
    long = way / speed + speed / acceleration
    return np.where(way < speed**2 / acceleration, short, long)


class TravelTimes:
    """Times between places of the head; theta of a place may be a head angle or the axis' own coordinate."""

    def __init__(self, config: Config, places: Sequence[Position], approach: Approach | None = None) -> None:
        """Take the places, of which the times are asked by number; `approach`: None for the configured one."""
        gantry, axes = config.gantry, config.axes
        thetas = [axis_theta_deg(place.theta_deg) for place in places]
        before = approach or Approach(gantry.approach_um, gantry.approach_um, gantry.approach_deg)
        self._axes: tuple[tuple[AxisSection, Array, float, float], ...] = (
            (axes.x, np.array([place.x_um for place in places]), before.x_um, SAME_UM),
            (axes.y, np.array([place.y_um for place in places]), before.y_um, SAME_UM),
            (axes.theta, np.array(thetas), before.theta_deg, SAME_DEG),
        )
        rise_um = max(0.0, gantry.safe_z_um - gantry.work_z_um)
        rise_s = trapezoid_s(np.array(rise_um), axes.z.speed, axes.z.acceleration)
        self._up_and_down_s = 2.0 * float(rise_s) + gantry.settle_ms / 1e3

    def between(self, starts: Array, ends: Array) -> Array:
        """Return the times from each of `starts` to each of `ends`, both numbers of places, (S, E), s."""
        return self._pairs(np.asarray(starts)[:, None], np.asarray(ends)[None, :])

    def along(self, order: Sequence[int]) -> float:
        """Return the time of a way through places in this order, s."""
        way = np.asarray(order, dtype=int)
        return float(self._pairs(way[:-1], way[1:]).sum())

    def _pairs(self, starts: Array, ends: Array) -> Array:
        """Return the times from starts to ends, s; both broadcast to one shape."""
        aside_s, final_s = np.zeros((2, *np.broadcast_shapes(starts.shape, ends.shape)))
        for axis, at, approach, same in self._axes:
            here, to = at[starts], at[ends]
            stays = np.abs(to - here) <= same
            before = to - approach
            turns = (here > before) & ~stays & (approach > 0)
            way = np.where(turns, approach, to - here)
            out_s = trapezoid_s(np.where(turns, before - here, 0.0), axis.speed, axis.acceleration)
            in_s = trapezoid_s(np.where(stays, 0.0, way), axis.speed, axis.acceleration)
            aside_s, final_s = np.maximum(aside_s, out_s), np.maximum(final_s, in_s)
        lateral_s = aside_s + final_s
        return np.where(lateral_s > 0.0, lateral_s + self._up_and_down_s, 0.0)
