"""Round targets of a side: bare rounds of copper that a camera sees, with the names the netlist gives them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from sim_hw.board.files import BoardFiles
from sim_hw.board.nearest import Nearest
from sim_hw.board.netlist import Record
from sim_hw.board.shapes import Round, Shape, rounds

SAME_PLACE_MM = 0.02
"""Netlists are rounded to 2.54 um, drills to 1 um."""
NAME_PLACE_MM = 0.05


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


class _Openings:
    """The mask's openings, asked pad by pad."""

    def __init__(self, rounds_open: tuple[Round, ...], mask: tuple[Shape, ...]) -> None:
        self._rounds = rounds_open
        self._round_at = Nearest((o.x_mm, o.y_mm) for o in rounds_open)
        self._mask = [shape for shape in mask if shape.dark]
        self._boxes = np.array([shape.box_mm for shape in self._mask]).reshape(-1, 4)

    def bare_mm(self, pad: Round) -> float:
        """Return the diameter of the pad that the mask leaves bare; 0 where it is covered."""
        concentric = self._round_at.within(pad.x_mm, pad.y_mm, SAME_PLACE_MM)
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


def find_targets(
    files: BoardFiles, side: str, records: tuple[Record, ...], mask: tuple[Shape, ...]
) -> tuple[Target, ...]:
    """Return the round targets of a side, each with a name of its own."""
    openings = _Openings(rounds(files.layers[f"{side} mask"]), mask)
    hits, capped = rounds(files.drills), rounds(files.capped)
    hit_at, capped_at = (Nearest((h.x_mm, h.y_mm) for h in group) for group in (hits, capped))
    here = tuple(record for record in records if record.on_side(side))
    record_at = Nearest((r.x_mm, r.y_mm) for r in here)
    found: dict[tuple[int, int], Target] = {}
    for pad in sorted(rounds(files.layers[f"{side} copper"]), key=lambda p: (-p.diameter_mm, p.x_mm, p.y_mm)):
        place = (round(pad.x_mm * 100), round(pad.y_mm * 100))
        bare_mm = openings.bare_mm(pad)
        if place in found or bare_mm <= 0.0:
            continue
        drilled = hit_at.within(pad.x_mm, pad.y_mm, SAME_PLACE_MM)
        hole_mm = max((hits[k].diameter_mm for k in drilled), default=None)
        if hole_mm is not None and hole_mm > bare_mm - 0.02:
            continue  # a bare hole: no copper to touch
        named = [here[k] for k in record_at.within(pad.x_mm, pad.y_mm, NAME_PLACE_MM)]
        record = min(named, key=lambda r: r.is_via) if named else None
        name, kind = _name_and_kind(record, len(found) + 1)
        if record is None and (drilled or capped_at.within(pad.x_mm, pad.y_mm, SAME_PLACE_MM)):
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
