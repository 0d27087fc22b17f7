"""Board as the simulated station knows it: pads, parts and round targets of one side, and the layers to draw it from.

CAD coordinates are the Gerbers': mm, y up, seen from the top, whichever side is asked for.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim_hw.board.edge import edge_and_box
from sim_hw.board.files import open_folder
from sim_hw.board.folder import unpacked
from sim_hw.board.full_names import fully_named
from sim_hw.board.loops import loops
from sim_hw.board.nearest import Nearest
from sim_hw.board.netlist import Record, read_netlist
from sim_hw.board.parts import Assembly, Body, assemble
from sim_hw.board.shapes import Round, Shape, rounds, shapes
from sim_hw.board.targets import NAME_PLACE_MM, SAME_PLACE_MM, Target, find_targets
from sim_hw.board.x2_pads import x2_pads

ROBOT_ORIGIN_UM = (60_000.0, 40_000.0)
"""Robot position of the outline's lower left corner (bottom: lower right)."""
SIDES = ("top", "bottom")


@dataclass(frozen=True)
class Layers:
    """What is drawn: polygons in CAD mm."""

    copper: tuple[Shape, ...]
    mask: tuple[Shape, ...]  # openings
    silk: tuple[Shape, ...]
    holes: tuple[Shape, ...]  # visible where the mask is open
    outline: tuple[Shape, ...]
    solder: tuple[Shape, ...] = ()  # on the pads of parts, where the board is assembled
    leads: tuple[Shape, ...] = ()


@dataclass(frozen=True)
class Board:
    """One side of a board."""

    name: str
    side: str
    outline_mm: tuple[float, float, float, float]  # x0, y0, x1, y1 at the centre of the outline's pen
    targets: tuple[Target, ...]
    layers: Layers
    netlist_offset_mm: tuple[float, float]  # added to the netlist's coordinates to get the Gerbers'
    pads: tuple[Record, ...] = ()  # pins and vias of this side, covered by mask or not
    bodies: tuple[Body, ...] = ()  # of parts, where the board is assembled

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the outline."""
        x0, y0, x1, y1 = self.outline_mm
        return (x1 - x0, y1 - y0)

    def nominal_um(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return the robot position in um of a CAD point when the board lies exactly as planned."""
        x0, y0, x1, _ = self.outline_mm
        across_mm = x_mm - x0 if self.side == "top" else x1 - x_mm
        return (ROBOT_ORIGIN_UM[0] + across_mm * 1e3, ROBOT_ORIGIN_UM[1] + (y_mm - y0) * 1e3)

    def target(self, name: str) -> Target:
        """Return the target of that name.

        Raises:
            KeyError: there is none on this side.

        """
        for target in self.targets:
            if target.name == name:
                return target
        raise KeyError(f"no target {name} on the {self.side} side of {self.name}")


def netlist_offset_mm(records: Iterable[Record], hits: Iterable[Round]) -> tuple[float, float]:
    """Estimate what to add to netlist coordinates to get the Gerbers' (their origins often differ).

    Every drilled record is compared with every hit of nearly its diameter; the difference most of them share
    is the offset. Returns (0, 0) when nothing is drilled.
    """
    drilled = [(r.x_mm, r.y_mm, r.hole_mm) for r in records if r.hole_mm]
    drills = [(h.x_mm, h.y_mm, h.diameter_mm) for h in hits]
    if not drilled or not drills:
        return (0.0, 0.0)
    few, all_hits = np.array(drilled[:400]), np.array(drills)
    same = np.abs(few[:, None, 2] - all_hits[None, :, 2]) < 0.01
    differences = (all_hits[None, :, :2] - few[:, None, :2])[same]
    if not len(differences):
        return (0.0, 0.0)
    keys, counts = np.unique(np.round(differences / 0.02).astype(np.int64), axis=0, return_counts=True)
    centre = keys[int(np.argmax(counts))] * 0.02
    near = differences[np.abs(differences - centre).max(axis=1) < 0.03]
    x_mm, y_mm = np.median(near, axis=0)
    return (round(float(x_mm), 4), round(float(y_mm), 4))


def load_board(folder: Path | str, side: str = "top", parts_seed: int | None = None) -> Board:
    """Read a folder (or a zip) of Gerber, Excellon and IPC-D-356 files.

    With `parts_seed` the board is assembled, with heights and grey levels of its parts drawn from it; without, bare.

    Raises:
        ValueError: side is neither `top` nor `bottom`, or a needed file is missing or cannot be read.

    """
    if side not in SIDES:
        raise ValueError(f"side {side!r} is neither 'top' nor 'bottom'")
    given = Path(folder).resolve()
    inside, room = unpacked(given)
    try:
        return _loaded(inside, given.stem if room else given.name, side, parts_seed)
    finally:
        if room is not None:
            room.cleanup()


def _loaded(folder: Path, name: str, side: str, parts_seed: int | None) -> Board:
    files = open_folder(folder, side)
    hits = rounds(files.drills) + rounds(files.capped)
    raw = read_netlist(files.netlist) if files.netlist else ()
    dx_mm, dy_mm = netlist_offset_mm(raw, hits)
    told = x2_pads(files.text(f"{side} copper"), 1 if side == "top" else 2)
    if not raw:
        raw = _drilled(told, hits)
    records = fully_named((_shifted(record, dx_mm, dy_mm) for record in raw), told)
    copper, mask = shapes(files.layers[f"{side} copper"]), shapes(files.layers[f"{side} mask"])
    pads_mm = np.array([(record.x_mm, record.y_mm) for record in records] or [(h.x_mm, h.y_mm) for h in hits])
    edge, box_mm = edge_and_box(files.layers.get("outline") or (), pads_mm.reshape(-1, 2), (copper, mask))
    layers = Layers(
        copper=copper,
        mask=mask,
        silk=shapes(files.layers.get(f"{side} silk", [])),
        holes=shapes(files.drills),
        outline=edge,
    )
    bodies: tuple[Body, ...] = ()
    if parts_seed is not None:
        drawn = [*loops(files.layers.get(f"{side} courtyard") or files.layers.get(f"{side} fabrication") or ())]
        parts = assemble(records, side, drawn, layers.copper, parts_seed)
        layers, bodies = _with_parts(layers, parts), parts.bodies
    return Board(
        name=name,
        side=side,
        outline_mm=box_mm,
        targets=find_targets(files, side, records, mask),
        layers=layers,
        netlist_offset_mm=(dx_mm, dy_mm),
        pads=tuple(record for record in records if record.on_side(side)),
        bodies=bodies,
    )


def _drilled(records: Iterable[Record], hits: tuple[Round, ...]) -> tuple[Record, ...]:
    """Return the records with the holes that lie in the middle of their pads."""
    hit_at = Nearest((hit.x_mm, hit.y_mm) for hit in hits)
    found = []
    for record in records:
        near = hit_at.within(record.x_mm, record.y_mm, SAME_PLACE_MM)
        found.append(replace(record, hole_mm=hits[near[0]].diameter_mm) if near else record)
    return tuple(found)


def _with_parts(layers: Layers, parts: Assembly) -> Layers:
    """Return the layers with solder and leads, whose holes are filled."""
    filled = Nearest(parts.filled_mm)

    def open_still(hole: Shape) -> bool:
        x0, y0, x1, y1 = hole.box_mm
        return not filled.within((x0 + x1) / 2.0, (y0 + y1) / 2.0, NAME_PLACE_MM)

    holes = tuple(hole for hole in layers.holes if open_still(hole))
    return replace(layers, holes=holes, solder=parts.solder, leads=parts.leads)


def _shifted(record: Record, dx_mm: float, dy_mm: float) -> Record:
    return replace(record, x_mm=record.x_mm + dx_mm, y_mm=record.y_mm + dy_mm)
