"""Boards of the bench: what the artist draws, what vision is told of it, and every patch of bare metal as a target.

Two readers: the artist draws what the simulated station reads, vision is told what the daemon's board import reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from daemon.domain.board import Board
from daemon.procedures.sites import looks_known, target_of
from daemon.station.board_obstacles import Obstacles
from daemon.tools.board_import import Options, import_boards
from daemon.tools.cad import Side as CadSide
from sim_hw.board import board as artist
from vision.registration import SideLayers, Target
from vision.registration.drawing import LayerShifts, Material, draw_labels, index_side

DEMO = Path(artist.__file__).parents[1] / "demo_board"
SHARED = Path(__file__).parents[4] / "shared" / "boards"
TEXEL_UM = 20.0
PARTS_SEED = 5
SMALLEST_UM, LARGEST_UM = 300.0, 8000.0


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a board. targets: middle and outline of each patch of bare metal, board frame."""

    name: str
    side: str
    drawn: artist.Board
    layers: SideLayers
    targets: tuple[Target, ...]

    @property
    def size_um(self) -> tuple[float, float]:
        """Width and height of the outline."""
        return self.drawn.size_mm[0] * 1e3, self.drawn.size_mm[1] * 1e3


def folder_of(name: str) -> Path:
    """Return where a board's files are: the demonstration board, or one beside the project."""
    return DEMO if name == "demo" else SHARED / name


def known_boards() -> list[str]:
    """Return the boards there are here."""
    beside = sorted(p.name for p in SHARED.iterdir() if p.is_dir()) if SHARED.is_dir() else []
    return ["demo", *(name for name in beside if name != "eagle-ipc-only")]


@lru_cache(maxsize=8)
def load_side(name: str, side: str) -> Side:
    """Read one side of a board."""
    drawn = artist.load_board(folder_of(name), side)
    layers = _imported(name)[_side(side)].side_layers(_side(side))
    if layers is None:
        raise ValueError(f"the import of {name} has no layers")
    return Side(name, side, drawn, layers, metal_targets(layers, drawn.size_mm))


@lru_cache(maxsize=8)
def load_fitted(name: str, side: str) -> Side:
    """Read one side of a board with its parts: what stands there is drawn as the simulated station does.

    targets: what the import offers and whose edge is to be seen beside solder and bodies.
    """
    drawn = artist.load_board(folder_of(name), side, PARTS_SEED)
    board = _imported(name, bare=False)[_side(side)]
    layers = board.side_layers(_side(side))
    if layers is None:
        raise ValueError(f"the import of {name} has no layers")
    offered = [target_of(point) for point in board.points if point.probeable]
    obstacles = Obstacles(layers)
    targets = tuple(target for target in offered if target is not None and looks_known(target, obstacles))
    return Side(name, side, drawn, layers, targets)


@lru_cache(maxsize=4)
def _imported(name: str, *, bare: bool = True) -> dict[CadSide, Board]:
    return import_boards(folder_of(name), "top", Options(bare=bare))


def _side(side: str) -> CadSide:
    return "top" if side == "top" else "bottom"


def metal_targets(layers: SideLayers, size_mm: tuple[float, float]) -> tuple[Target, ...]:
    """Return every connected patch of bare metal that is neither tiny nor a plane."""
    texels = int(max(size_mm) * 1e3 / TEXEL_UM) + 100
    corner = (-50 * TEXEL_UM, -50 * TEXEL_UM)
    labels = draw_labels(index_side(layers), corner, TEXEL_UM, texels, LayerShifts())
    metal = (labels == Material.METAL).astype(np.uint8)
    contours, _ = cv2.findContours(metal, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        _, _, width, height = cv2.boundingRect(contour)
        if min(width, height) * TEXEL_UM < SMALLEST_UM or max(width, height) * TEXEL_UM > LARGEST_UM:
            continue
        outline = (contour[:, 0, :].astype(np.float64) + 0.5) * TEXEL_UM + corner
        low, high = outline.min(axis=0), outline.max(axis=0)
        found.append(Target(float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, outline))
    return tuple(found)
