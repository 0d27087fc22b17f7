"""Board as the simulated station knows it: the round targets of one side and the layers to draw it from.

CAD coordinates are the Gerbers': mm, y up, seen from the top, whichever side is asked for.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from sim_hw.board.files import BoardFiles, open_folder
from sim_hw.board.netlist import Record, read_netlist
from sim_hw.board.shapes import Round, Shape, centre_line_box, outline_polygons, rounds, shapes

ROBOT_ORIGIN_UM = (60_000.0, 40_000.0)
"""Robot position of the outline's lower left corner (bottom: lower right)."""
SIDES = ("top", "bottom")

_SAME_PLACE_MM = 0.02
"""Netlists are rounded to 2.54 um, drills to 1 um."""
_NAME_PLACE_MM = 0.05


@dataclass(frozen=True)
class Target:
    """A round of bare copper that a camera sees on this side.

    `kind` is `via`, `site` (a test point), `fiducial` or `pad` (a round pad of a part). `pad_diameter_mm` is what
    the mask leaves visible; `hole_diameter_mm` is None where no hole can be seen.
    """

    name: str
    kind: str
    x_mm: float
    y_mm: float
    pad_diameter_mm: float
    hole_diameter_mm: float | None
    net: str
    probeable: bool


@dataclass(frozen=True)
class Layers:
    """What is drawn: polygons in CAD mm."""

    copper: tuple[Shape, ...]
    mask: tuple[Shape, ...]  # openings
    silk: tuple[Shape, ...]
    holes: tuple[Shape, ...]  # visible where the mask is open
    outline: tuple[Shape, ...]


@dataclass(frozen=True)
class Board:
    """One side of a board."""

    name: str
    side: str
    outline_mm: tuple[float, float, float, float]  # x0, y0, x1, y1 at the centre of the outline's pen
    targets: tuple[Target, ...]
    layers: Layers
    netlist_offset_mm: tuple[float, float]  # added to the netlist's coordinates to get the Gerbers'

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


def _cell(x_mm: float, y_mm: float) -> tuple[int, int]:
    return (round(x_mm / 0.1), round(y_mm / 0.1))


class _Nearest:
    """Find the point nearest to a place, within a tenth of a millimetre."""

    def __init__(self, points_mm: Iterable[tuple[float, float]]) -> None:
        self._points = list(points_mm)
        self._cells: dict[tuple[int, int], list[int]] = {}
        for index, (x, y) in enumerate(self._points):
            self._cells.setdefault(_cell(x, y), []).append(index)

    def within(self, x_mm: float, y_mm: float, reach_mm: float) -> list[int]:
        """Return the indices within `reach_mm`, nearest first."""
        i, j = _cell(x_mm, y_mm)
        near = [k for a in (-1, 0, 1) for b in (-1, 0, 1) for k in self._cells.get((i + a, j + b), ())]
        distances = sorted((math.dist(self._points[k], (x_mm, y_mm)), k) for k in near)
        return [k for distance, k in distances if distance <= reach_mm]


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


class _Openings:
    """The mask's openings, asked pad by pad."""

    def __init__(self, rounds_open: tuple[Round, ...], mask: tuple[Shape, ...]) -> None:
        self._rounds = rounds_open
        self._round_at = _Nearest((o.x_mm, o.y_mm) for o in rounds_open)
        self._mask = [shape for shape in mask if shape.dark]
        self._boxes = np.array([shape.box_mm for shape in self._mask]).reshape(-1, 4)

    def bare_mm(self, pad: Round) -> float:
        """Return the diameter of the pad that the mask leaves bare; 0 where it is covered."""
        concentric = self._round_at.within(pad.x_mm, pad.y_mm, _SAME_PLACE_MM)
        if concentric:
            return min(pad.diameter_mm, max(self._rounds[k].diameter_mm for k in concentric))
        x0, y0, x1, y1 = self._boxes.T
        around = (x0 <= pad.x_mm) & (pad.x_mm <= x1) & (y0 <= pad.y_mm) & (pad.y_mm <= y1)
        for k in np.flatnonzero(around):
            outline = (self._mask[k].outline_mm * 1e3).astype(np.float32)[:, None, :]
            inside_um = cv2.pointPolygonTest(outline, (pad.x_mm * 1e3, pad.y_mm * 1e3), measureDist=True)
            if inside_um >= pad.diameter_mm * 0.4e3:
                return min(pad.diameter_mm, 2e-3 * inside_um)
        return 0.0


def _name_and_kind(record: Record | None, number: int) -> tuple[str, str]:
    if record is None:
        return (f"ROUND{number}", "pad")
    if record.is_via:
        return (f"VIA{number}", "via")
    reference = record.reference
    if reference.startswith("FID"):
        return (reference, "fiducial")
    if reference.startswith("TP"):
        small_hole = record.hole_mm is not None and record.width_mm <= 0.3
        return (reference, "via" if small_hole else "site")
    return (f"{reference}-{record.pin}", "pad")


def _accessible(record: Record, side: str) -> bool:
    open_here = record.mask not in ((1, 3) if side == "top" else (2, 3))
    layer = record.access_layer
    return open_here and (layer == 0 or (layer == 1) == (side == "top"))


def _on_side(record: Record, side: str) -> bool:
    return record.access_layer == 0 or (record.access_layer == 1) == (side == "top")


def _targets(files: BoardFiles, side: str, records: tuple[Record, ...], mask: tuple[Shape, ...]) -> tuple[Target, ...]:
    openings = _Openings(rounds(files.layers[f"{side} mask"]), mask)
    hits, capped = rounds(files.drills), rounds(files.capped)
    hit_at, capped_at = (_Nearest((h.x_mm, h.y_mm) for h in group) for group in (hits, capped))
    here = tuple(record for record in records if _on_side(record, side))
    record_at = _Nearest((r.x_mm, r.y_mm) for r in here)
    found: dict[tuple[int, int], Target] = {}
    for pad in sorted(rounds(files.layers[f"{side} copper"]), key=lambda p: (-p.diameter_mm, p.x_mm, p.y_mm)):
        place = (round(pad.x_mm * 100), round(pad.y_mm * 100))
        bare_mm = openings.bare_mm(pad)
        if place in found or bare_mm <= 0.0:
            continue
        drilled = hit_at.within(pad.x_mm, pad.y_mm, _SAME_PLACE_MM)
        hole_mm = max((hits[k].diameter_mm for k in drilled), default=None)
        if hole_mm is not None and hole_mm > bare_mm - 0.02:
            continue  # a bare hole: no copper to touch
        named = [here[k] for k in record_at.within(pad.x_mm, pad.y_mm, _NAME_PLACE_MM)]
        record = min(named, key=lambda r: r.is_via) if named else None
        name, kind = _name_and_kind(record, len(found) + 1)
        if record is None and (drilled or capped_at.within(pad.x_mm, pad.y_mm, _SAME_PLACE_MM)):
            kind = "via" if pad.diameter_mm <= 0.8 else "pad"
        probeable = record is not None and kind != "fiducial" and _accessible(record, side)
        net = record.net if record is not None else ""
        found[place] = Target(
            name=name,
            kind=kind,
            x_mm=round(pad.x_mm, 6),
            y_mm=round(pad.y_mm, 6),
            pad_diameter_mm=round(bare_mm, 6),
            hole_diameter_mm=hole_mm,
            net=net,
            probeable=probeable,
        )
    return _uniquely_named(found.values())


def _uniquely_named(targets: Iterable[Target]) -> tuple[Target, ...]:
    """Tell pads apart that carry the same pin: the second of `U3-7` becomes `U3-7/2`."""
    seen: dict[str, int] = {}
    named: list[Target] = []
    for target in targets:
        count = seen[target.name] = seen.get(target.name, 0) + 1
        named.append(target if count == 1 else replace(target, name=f"{target.name}/{count}"))
    return tuple(named)


def load_board(folder: Path | str, side: str = "top") -> Board:
    """Read a folder of Gerber, Excellon and IPC-D-356 files.

    Raises:
        ValueError: side is neither `top` nor `bottom`, or a needed file is missing or cannot be read.

    """
    if side not in SIDES:
        raise ValueError(f"side {side!r} is neither 'top' nor 'bottom'")
    folder = Path(folder)
    files = open_folder(folder, side)
    hits = rounds(files.drills) + rounds(files.capped)
    raw = read_netlist(files.netlist) if files.netlist else ()
    dx_mm, dy_mm = netlist_offset_mm(raw, hits)
    records = tuple(_shifted(record, dx_mm, dy_mm) for record in raw)
    mask = shapes(files.layers[f"{side} mask"])
    layers = Layers(
        copper=shapes(files.layers[f"{side} copper"]),
        mask=mask,
        silk=shapes(files.layers.get(f"{side} silk", [])),
        holes=shapes(files.drills),
        outline=outline_polygons(files.layers["outline"]),
    )
    return Board(
        name=folder.resolve().name,
        side=side,
        outline_mm=centre_line_box(files.layers["outline"]),
        targets=_targets(files, side, records, mask),
        layers=layers,
        netlist_offset_mm=(dx_mm, dy_mm),
    )


def _shifted(record: Record, dx_mm: float, dy_mm: float) -> Record:
    return replace(record, x_mm=record.x_mm + dx_mm, y_mm=record.y_mm + dy_mm)
