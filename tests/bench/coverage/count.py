"""Count of the nets that have bare metal, from pictures of whole layers and a reader of IPC-D-356 of its own."""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from gerbonara import GerberFile
from gerbonara.utils import MM
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from tests.bench.coverage.area import PITCH_MM, Grid, Hit, Picture, drill, hits, painted

LEAST_MM = 0.3
"""Bare metal into which a disc of this diameter goes can be probed."""
SIDES = {"top": ("F_Cu", "F_Mask"), "bottom": ("B_Cu", "B_Mask")}
_PLACE = re.compile(r"X([+-]?\d+)Y([+-]?\d+)")
NOT_NETS = {"", "N/C"}


@dataclass(frozen=True)
class Record:
    """One record of the netlist, mm.

    hole: its diameter, 0 where there is none; pad: longest side; sides: from where it is reached.
    """

    net: str
    name: str
    x: float
    y: float
    hole: float
    pad: float
    sides: frozenset[str]


@dataclass(frozen=True)
class Counted:
    """What a folder was found to hold. room: radius of the largest disc on each pixel's bare metal, mm, by side."""

    grid: Grid
    labels: dict[str, NDArray[np.int32]]
    room: dict[str, NDArray[np.float32]]
    records: list[Record]
    nets: frozenset[str]
    bare_nets: frozenset[str]
    edges: tuple[float, float, float, float]
    """The outline's box: the middle of its line, mm."""

    def from_board(self, side: str, x_um: float, y_um: float) -> tuple[float, float]:
        """Return where a place of a side's board frame lies in the Gerbers, mm."""
        x0, y0, x1, _ = self.edges
        return (x1 - x_um / 1e3 if side == "bottom" else x0 + x_um / 1e3), y0 + y_um / 1e3

    def nets_at(self, side: str, x: float, y: float) -> frozenset[str]:
        """Return the nets whose records lie on the piece of metal at a place, or round it."""
        return self._nets[side].get(int(self.labels[side][self.grid.pixel(x, y)]), frozenset())

    @cached_property
    def _nets(self) -> dict[str, dict[int, frozenset[str]]]:
        found: dict[str, dict[int, frozenset[str]]] = {side: {} for side in SIDES}
        for side, record in itertools.product(SIDES, self.records):
            for label in _labels_about(self, side, record):
                found[side][label] = found[side].get(label, frozenset()) | {record.net}
        return found


def is_net(cut: str, whole: str | None) -> bool:
    """Whether a netlist of fixed columns may mean a net: it keeps the last 14 letters, and spells some slashes out."""
    name = (whole or "").upper()
    return any(n.endswith(cut.upper()) for n in (name, name.replace("/", "{SLASH}")))


def read_netlist(path: Path) -> list[Record]:
    """Read the test records of an IPC-D-356 file."""
    text = path.read_text(errors="replace")
    unit = 0.001 if re.search(r"UNITS\s+CUST 1", text) else 0.00254
    aliases = dict(re.findall(r"^P  (NNAME\d+)\s+(.+?)\s*$", text, re.MULTILINE))
    found = []
    for line in text.splitlines():
        place = _PLACE.search(line)
        if line[:3] not in ("317", "327") or place is None:
            continue
        net = line[3:17].strip()
        sizes = [int(v) * unit for v in re.findall(r"[XY](\d{4})(?!\d)", line[place.end() :])]
        x, y = int(place[1]) * unit, int(place[2]) * unit
        hole = re.search(r"D(\d{4})[PU]", line)
        diameter = int(hole[1]) * unit if hole else 0.0
        layer = re.search(r"A(\d\d)X", line)
        reached = {"00": {"top", "bottom"}, "01": {"top"}}.get(layer[1] if layer else "00", {"bottom"})
        pad = max(sizes, default=0.5)
        found.append(Record(aliases.get(net, net), line[20:31].strip(), x, y, diameter, pad, frozenset(reached)))
    return found


def count(folder: Path) -> Counted:
    """Count; the folder holds KiCad's names."""
    files = {layer: _one(folder, layer) for pair in SIDES.values() for layer in pair}
    box = np.array([GerberFile.open(files[layer]).bounding_box(MM) for layer in ("F_Cu", "B_Cu")])
    (x0, y0), (x1, y1) = box[:, 0].min(axis=0) - 0.2, box[:, 1].max(axis=0) + 0.2
    grid = Grid(float(x0), float(y0), float(x1), float(y1))
    drills = [h for path in sorted(folder.glob("*.drl")) for h in hits(path)]
    netlist = next(p for p in sorted(folder.iterdir()) if p.suffix in (".ipc", ".d356"))
    records = _at_the_drills(read_netlist(netlist), drills)
    labels, room = {}, {}
    for side, (copper, mask) in SIDES.items():
        bare = painted(files[mask], grid)
        bare &= painted(files[copper], grid)
        drill(bare, grid, drills)
        labels[side], room[side] = _pieces(bare)
    nets = frozenset(r.net for r in records) - NOT_NETS
    counted = Counted(grid, labels, room, records, nets, frozenset(), _edges(_one(folder, "Edge_Cuts")))
    return replace(counted, bare_nets=_bare_nets(counted) & nets)


def _edges(path: Path) -> tuple[float, float, float, float]:
    boxes = []
    for item in GerberFile.open(path).objects:
        (ax, ay), (bx, by) = item.bounding_box(MM)
        pen = item.aperture.equivalent_width(MM) / 2 if getattr(item, "aperture", None) else 0.0
        boxes.append((ax + pen, ay + pen, bx - pen, by - pen))
    found = np.array(boxes)
    (x0, y0), (x1, y1) = found[:, :2].min(axis=0), found[:, 2:].max(axis=0)
    return float(x0), float(y0), float(x1), float(y1)


def _one(folder: Path, layer: str) -> Path:
    return next(p for p in sorted(folder.iterdir()) if f"-{layer}." in p.name)


def _at_the_drills(records: list[Record], drills: list[Hit]) -> list[Record]:
    """Shift the netlist to where most of its holes are drilled."""
    middles = np.array([((h[0] + h[2]) / 2, (h[1] + h[3]) / 2) for h in drills])
    holes = np.array([(r.x, r.y) for r in records if r.hole])
    if not len(holes):
        return records
    votes: defaultdict[tuple[int, int], int] = defaultdict(int)
    for hole in holes[:60]:
        for cell in {tuple(c) for c in np.rint((middles - hole) / 0.05).astype(int).tolist()}:
            votes[cell[0], cell[1]] += 1
    start = np.array(max(votes, key=lambda c: (votes[c], -abs(c[0]) - abs(c[1])))) * 0.05
    away, nearest = KDTree(middles).query(holes + start)
    good = np.asarray(away) < 0.08
    dx, dy = np.median(middles[np.asarray(nearest)[good]] - holes[good], axis=0)
    return [replace(r, x=r.x + float(dx), y=r.y + float(dy)) for r in records]


def _pieces(bare: Picture) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Label the pieces of metal, and measure the room of each pixel."""
    labels, _ = ndimage.label(bare)
    room = (ndimage.distance_transform_edt(bare) - 0.5) * PITCH_MM
    return labels.astype(np.int32), np.maximum(room, 0).astype(np.float32)


def _labels_about(counted: Counted, side: str, record: Record) -> set[int]:
    """Return the pieces of metal at a record's place, or about its hole."""
    if side not in record.sides:
        return set()
    row, column = counted.grid.pixel(record.x, record.y)
    labels = counted.labels[side]
    if labels[row, column]:
        return {int(labels[row, column])}
    if not record.hole:
        return set()
    turns = np.arange(0.0, 2 * np.pi, np.pi / 8)
    radius = record.hole / 2 + 0.05
    ring = [counted.grid.pixel(record.x + radius * np.cos(a), record.y + radius * np.sin(a)) for a in turns]
    found = [int(labels[at]) for at in ring]
    return {label for label in found if label and found.count(label) >= len(found) / 2}


def _bare_nets(counted: Counted) -> frozenset[str]:
    """Return the nets with metal, about one of their records, into which the disc goes."""
    found = set()
    for side in SIDES:
        for record in counted.records:
            pieces = _labels_about(counted, side, record)
            if not pieces or record.net in found:
                continue
            row, column = counted.grid.pixel(record.x, record.y)
            reach = int((record.pad / 2 + 0.1) / PITCH_MM)
            cut = np.s_[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
            mine = np.isin(counted.labels[side][cut], list(pieces))
            if (counted.room[side][cut][mine] >= LEAST_MM / 2 - PITCH_MM / 2).any():
                found.add(record.net)
    return frozenset(found)
