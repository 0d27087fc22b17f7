"""One side of a board in its own frame: the CAD's polygons in um, as seen from that side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from daemon.tools.cad.model import Cad, Drill, Pin, Shape, Side, Use

Points = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""Lowest x and y, highest x and y, um."""


def meeting(boxes: NDArray[np.float64], box: Box) -> NDArray[np.intp]:
    """Return which of many boxes (N, 4) meet one, in their order."""
    b = boxes
    return np.nonzero((b[:, 0] <= box[2]) & (b[:, 2] >= box[0]) & (b[:, 1] <= box[3]) & (b[:, 3] >= box[1]))[0]


@dataclass(frozen=True, slots=True)
class Frame:
    """The board frame of one side: origin at the outline's lower left corner as seen from it, x right, y up."""

    side: Side
    box_mm: Box

    @property
    def size_um(self) -> tuple[float, float]:
        """Width and height of the outline's box."""
        x0, y0, x1, y1 = self.box_mm
        return (x1 - x0) * 1e3, (y1 - y0) * 1e3

    def to_um(self, points_mm: Points) -> Points:
        """Bring points (N, 2) of the Gerbers, mm, into the frame."""
        x0, y0, x1, _ = self.box_mm
        moved = np.asarray(points_mm, dtype=np.float64).reshape(-1, 2) * 1e3
        if self.side == "bottom":
            moved[:, 0] = x1 * 1e3 - moved[:, 0]
        else:
            moved[:, 0] -= x0 * 1e3
        moved[:, 1] -= y0 * 1e3
        return moved

    def place_um(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Bring one place of the Gerbers, mm, into the frame."""
        x, y = self.to_um(np.array([[x_mm, y_mm]]))[0]
        return float(x), float(y)


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """One layer in the frame: polygons in painting order, each with its box and the shape it was read from."""

    polygons: tuple[Points, ...]
    dark: NDArray[np.bool_]
    boxes: NDArray[np.float64]
    shapes: tuple[Shape, ...]

    @classmethod
    def of(cls, shapes: tuple[Shape, ...], frame: Frame) -> Painted:
        """Bring a layer's shapes into the frame."""
        shapes = tuple(s for s in shapes if len(s.points_mm) >= 3)
        if not shapes:
            return cls((), np.empty(0, np.bool_), np.empty((0, 4)), ())
        counts = np.array([len(s.points_mm) for s in shapes])
        points = frame.to_um(np.concatenate([s.points_mm for s in shapes]))
        starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
        low, high = np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)
        polygons = tuple(points[a : a + n] for a, n in zip(starts, counts, strict=True))
        return cls(polygons, np.array([s.dark for s in shapes]), np.hstack((low, high)), shapes)

    def within(self, box: Box) -> NDArray[np.intp]:
        """Return the places, in painting order, of the polygons whose boxes meet `box`."""
        return meeting(self.boxes, box)


@dataclass(frozen=True, slots=True)
class Hole:
    """A hole or slot in the frame, um; `filled`: capped over, so that it is no hole to the eye or the needle."""

    x: float
    y: float
    end_x: float
    end_y: float
    diameter: float
    plated: bool | None
    filled: bool


@dataclass(frozen=True)
class SideCad:
    """All that CAD says of one side, in its frame."""

    cad: Cad
    frame: Frame
    pins: tuple[Pin, ...]

    @property
    def side(self) -> Side:
        """Which side it is."""
        return self.frame.side

    @cached_property
    def copper(self) -> Painted:
        """Copper."""
        return self._layer("copper")

    @cached_property
    def mask(self) -> Painted:
        """Openings of the solder mask."""
        return self._layer("mask")

    @cached_property
    def silk(self) -> Painted:
        """Silkscreen."""
        return self._layer("silk")

    @cached_property
    def paste(self) -> Painted:
        """Where solder paste is printed."""
        return self._layer("paste")

    @cached_property
    def courtyard(self) -> Painted:
        """Room that parts take."""
        return self._layer("courtyard")

    @cached_property
    def fabrication(self) -> Painted:
        """Drawing of the parts' bodies."""
        return self._layer("fabrication")

    @cached_property
    def outline(self) -> Painted:
        """The board's edge, and cut-outs that remove."""
        return Painted.of(self.cad.outline, self.frame)

    @cached_property
    def holes(self) -> tuple[Hole, ...]:
        """Holes and slots that come out on this side; blind and buried vias may not."""
        return tuple(self._hole(d) for d in self.cad.drills if self.side in d.sides)

    @cached_property
    def hole_boxes(self) -> NDArray[np.float64]:
        """Box of each hole, (M, 4)."""
        return np.array([
            (min(h.x, h.end_x) - h.diameter / 2, min(h.y, h.end_y) - h.diameter / 2,
             max(h.x, h.end_x) + h.diameter / 2, max(h.y, h.end_y) + h.diameter / 2) for h in self.holes
        ]).reshape(-1, 4)  # fmt: skip

    @cached_property
    def places(self) -> Points:
        """Where each pin lies, (N, 2) um."""
        return self.frame.to_um(np.array([(p.x_mm, p.y_mm) for p in self.pins]))

    def holes_within(self, box: Box) -> list[Hole]:
        """Return the holes whose boxes meet `box`."""
        return [self.holes[i] for i in meeting(self.hole_boxes, box)]

    def _layer(self, use: Use) -> Painted:
        return Painted.of(self.cad.layers.get((self.side, use), ()), self.frame)

    def _hole(self, drill: Drill) -> Hole:
        x, y = self.frame.place_um(drill.x_mm, drill.y_mm)
        end_x, end_y = x, y
        if drill.end_x_mm is not None and drill.end_y_mm is not None:
            end_x, end_y = self.frame.place_um(drill.end_x_mm, drill.end_y_mm)
        return Hole(x, y, end_x, end_y, drill.diameter_mm * 1e3, drill.plated, drill.capped)
