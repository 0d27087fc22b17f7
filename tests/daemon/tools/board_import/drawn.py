"""Boards drawn by the tests: copper, openings, holes and pins put together without any file. mm, seen from the top."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.domain.board import Board, BoardPoint
from daemon.tools.board_import import boards_of
from daemon.tools.cad.model import Cad, Drill, Pin, Shape, Side, Use

WIDTH_MM, HEIGHT_MM = 40.0, 30.0
BOTH: frozenset[Side] = frozenset({"top", "bottom"})
TOP: frozenset[Side] = frozenset({"top"})
Points = NDArray[np.float64]


def rectangle(x: float, y: float, w: float, h: float, turn_deg: float = 0.0) -> Points:
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    half = np.array(((-w, -h), (w, -h), (w, h), (-w, h))) / 2
    corners: Points = half @ np.array(((c, s), (-s, c))) + (x, y)
    return corners


def disc(x: float, y: float, d: float, corners: int = 90) -> Points:
    turns = np.arange(corners) * (2 * np.pi / corners)
    points: Points = np.array((x, y)) + d / 2 * np.column_stack((np.cos(turns), np.sin(turns)))
    return points


def flash(x: float, y: float, d: float) -> Shape:
    return Shape(disc(x, y, d), flashed=True, round_mm=(x, y, d))


@dataclass
class Drawing:
    """Shapes and pins as they are added."""

    layers: dict[tuple[Side, Use], list[Shape]] = field(
        default_factory=lambda: {(s, u): [] for s in ("top", "bottom") for u in ("copper", "mask")}
    )
    drills: list[Drill] = field(default_factory=list)
    pins: list[Pin] = field(default_factory=list)

    def paint(self, use: Use, *shapes: Shape | Points, side: Side = "top") -> None:
        made = [s if isinstance(s, Shape) else Shape(s) for s in shapes]
        self.layers.setdefault((side, use), []).extend(made)

    def pin(self, part: str, pin: str, net: str, x: float, y: float, **more: Any) -> None:
        facts: dict[str, Any] = {"is_via": not part, "hole_mm": None, "access": TOP, "covered": frozenset()} | more
        self.pins.append(Pin(part, pin, net, x, y, **facts))

    def pad(self, part: str, pin: str, net: str, x: float, y: float, w: float, h: float, turn_deg: float = 0.0) -> None:
        """Draw a rectangle of the top with an opening 0.05 mm wider all round."""
        self.paint("copper", Shape(rectangle(x, y, w, h, turn_deg), flashed=True))
        self.paint("mask", rectangle(x, y, w + 0.1, h + 0.1, turn_deg))
        self.pin(part, pin, net, x, y)

    def ring(self, part: str, pin: str, net: str, x: float, y: float, d: float, hole: float) -> None:
        """Draw a drilled round pad, open on both sides."""
        for side in BOTH:
            self.paint("copper", flash(x, y, d), side=side)
            self.paint("mask", flash(x, y, d + 0.1), side=side)
        self.drills.append(Drill(x, y, hole, plated=True))
        self.pin(part, pin, net, x, y, hole_mm=hole, access=BOTH)

    def round(self, part: str, pin: str, net: str, x: float, y: float, d: float, opening: float | None = None) -> None:
        self.paint("copper", flash(x, y, d))
        self.paint("mask", flash(x, y, opening or d + 0.1))
        if part:
            self.pin(part, pin, net, x, y)

    def cad(self) -> Cad:
        edge = Shape(rectangle(WIDTH_MM / 2, HEIGHT_MM / 2, WIDTH_MM, HEIGHT_MM))
        return Cad(
            name="drawn", folder=Path(), layers={k: tuple(v) for k, v in self.layers.items()},
            drills=tuple(self.drills), outline=(edge,), box_mm=(0.0, 0.0, WIDTH_MM, HEIGHT_MM), pins=tuple(self.pins),
        )  # fmt: skip

    def board(self, side: Side = "top", *, bare: bool = False) -> Board:
        return boards_of(self.cad(), bare=bare)[side]

    def points(
        self, names: Sequence[str] | None = None, side: Side = "top", *, bare: bool = False
    ) -> dict[str, BoardPoint]:
        return {p.name: p for p in self.board(side, bare=bare).points if names is None or p.name in names}


def mm(point: BoardPoint) -> tuple[float, float]:
    return point.x_um / 1e3, point.y_um / 1e3
