"""Order of points that takes the least time: nearest neighbour, then 2-opt and moved segments. Pure.

The way begins where the head is and ends anywhere. Times need not be the same there and back, for the axes come to
every place from one side. What is found is never longer than what was given. Angles come out grouped because turning
takes long.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daemon.station.travel_time import TravelTimes
from vision.geometry import Array

WINDOW = 400
"""So many places are improved at once; of more, overlapping windows are: the work grows with the places alone."""
SWEEPS = 40
LONGEST_SEGMENT = 3
LEAST_S = 1e-9


def shortest_order(times: TravelTimes, given: Sequence[int], start: int) -> list[int]:
    """Return the places of `given` in the order of the shortest way from `start` that was found; no longer than given.

    500 places take about a second of the processor: not for the event loop.
    """
    before = [start, *given]
    ways = [np.array(before), _nearest_neighbour(times, before)]
    improved = [_improved(times, way) for way in ways]
    best = min([*improved, np.array(before)], key=lambda way: times.along(way.tolist()))
    return [int(place) for place in best[1:]]


def _nearest_neighbour(times: TravelTimes, places: list[int]) -> Array:
    """Return the way that always goes to the nearest place left; of equally near ones to the first given."""
    left = np.array(places[1:])
    way = [places[0]]
    while left.size:
        nearest = int(np.argmin(times.between(np.array([way[-1]]), left)[0]))
        way.append(int(left[nearest]))
        left = np.delete(left, nearest)
    return np.array(way)


def _improved(times: TravelTimes, way: Array) -> Array:
    """Improve a way window by window; the first place stays, and the last of each window but the last."""
    way = way.copy()
    for begin in range(0, max(1, len(way) - WINDOW // 2), WINDOW // 2):
        places = way[begin : begin + WINDOW]
        open_end = begin + WINDOW >= len(way)
        cost = times.between(places, places)
        way[begin : begin + WINDOW] = places[_Window(cost, open_end=open_end).best()]
    return way


class _Window:
    """A stretch of a way whose first place stays, and whose last one stays too unless its end is open."""

    def __init__(self, cost: Array, *, open_end: bool) -> None:
        self._n = len(cost)
        self._open = open_end
        # Behind an open end lies a place that costs nothing to reach.
        self._cost = np.zeros((self._n + open_end, self._n + open_end))
        self._cost[: self._n, : self._n] = cost
        self._path = np.arange(len(self._cost))

    def best(self) -> NDArray[np.intp]:
        """Return the order of the places, by their numbers, when nothing more makes it shorter."""
        for _ in range(SWEEPS):
            if not (self._reversals() | self._moves()):
                break
        return self._path[: self._n] if self._open else self._path

    def _reversals(self) -> bool:
        """Turn stretches round where that is shorter (2-opt)."""
        found = False
        last = len(self._path) - 1
        for i in range(1, last - 1):
            path, cost = self._path, self._cost
            there = np.concatenate(([0.0], np.cumsum(cost[path[:-1], path[1:]])))
            back = np.concatenate(([0.0], np.cumsum(cost[path[1:], path[:-1]])))
            j = np.arange(i + 1, last)
            now = cost[path[i - 1], path[i]] + there[j] - there[i] + cost[path[j], path[j + 1]]
            turned = cost[path[i - 1], path[j]] + back[j] - back[i] + cost[path[i], path[j + 1]]
            gain = now - turned
            if gain.size and gain.max() > LEAST_S:
                end = int(j[int(np.argmax(gain))])
                path[i : end + 1] = path[i : end + 1][::-1]
                found = True
        return found

    def _moves(self) -> bool:
        """Move short stretches to where they are on the way (or-opt)."""
        found = False
        for length in range(1, LONGEST_SEGMENT + 1):
            for i in range(1, len(self._path) - length):
                found |= self._move(i, length)
        return found

    def _move(self, i: int, length: int) -> bool:
        path, cost = self._path, self._cost
        first, end = path[i], path[i + length - 1]
        rest = np.delete(path, np.arange(i, i + length))
        saved = cost[path[i - 1], first] + cost[end, path[i + length]] - cost[path[i - 1], path[i + length]]
        added = cost[rest[:-1], first] + cost[end, rest[1:]] - cost[rest[:-1], rest[1:]]
        at = int(np.argmin(added))
        if saved - added[at] <= LEAST_S:
            return False
        self._path = np.concatenate((rest[: at + 1], path[i : i + length], rest[at + 1 :]))
        return True
