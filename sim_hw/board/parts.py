"""Parts of an assembled board: bodies that stand on it, solder on their pads, leads in their holes.

Bodies come from the courtyards where the folder has that layer, else from closed outlines of the fabrication layer;
a part that has none there gets one from the places of its pads. What no file tells, height and grey level, is drawn
from the seed.
What is NOT modelled: shapes other than straight prisms, pins that stick out of a body, parts that are missing.
"""

from __future__ import annotations

import math
import random
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from sim_hw.board.netlist import Record
from sim_hw.board.shapes import Outline, Shape, disc

_NO_BODY = re.compile(r"^(TP|FID|MH|NT|LOGO|H)\d*$|^(JP|SJ|SB)\d+$")
"""Test points, fiducials, mounting holes, net ties; solder jumpers, unless they are drilled (then they are headers)."""
_COURTYARD_MARGIN_MM = 0.25
"""IPC-7351, nominal density: this much of a courtyard lies beyond body and pads."""
_SMALLEST_MM = 0.3
_LEAD_SHARE = 0.65
_HEIGHTS_UM = (
    (re.compile(r"^(R|FB)\d"), (350.0, 650.0)),
    (re.compile(r"^(C|L|D|LED)\d"), (500.0, 1_300.0)),
    (re.compile(r"^(J|P|CN|CON|X|SW|K|F)\d"), (2_000.0, 6_500.0)),
)
_OTHER_HEIGHT_UM = (800.0, 1_800.0)


@dataclass(frozen=True, eq=False)
class Body:
    """A prism on the board: outline in CAD mm, height, grey levels under the white and the red lamp."""

    part: str
    outline_mm: Outline
    height_um: float
    white: int
    red: int

    @property
    def box_mm(self) -> tuple[float, float, float, float]:
        """Return x0, y0, x1, y1."""
        low, high = self.outline_mm.min(axis=0), self.outline_mm.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def inside_mm(self, x_mm: float, y_mm: float) -> float:
        """Return how far a place is inside the outline; below zero outside."""
        outline = (self.outline_mm * 1e3).astype(np.float32)[:, None, :]
        return float(cv2.pointPolygonTest(outline, (x_mm * 1e3, y_mm * 1e3), measureDist=True)) / 1e3


@dataclass(frozen=True)
class Assembly:
    """What is on one side: bodies, polygons of solder, leads seen in holes, and which holes they fill."""

    bodies: tuple[Body, ...] = ()
    solder: tuple[Shape, ...] = ()
    leads: tuple[Shape, ...] = ()
    filled_mm: tuple[tuple[float, float], ...] = ()


def assemble(
    records: Iterable[Record], side: str, drawn: Sequence[Outline], copper: Sequence[Shape], seed: int
) -> Assembly:
    """Return the parts of one side of a board.

    Args:
        records: pins of the whole board, CAD mm; vias are passed by.
        side: `top` or `bottom`.
        drawn: closed outlines of this side's courtyard or fabrication layer; empty where there is none.
        copper: this side's copper, whose flashed pads carry the solder.
        seed: of heights and grey levels.

    """
    parts = _parts(records)
    here = {name: pins for name, pins in parts.items() if _stands_on(pins, side)}
    bodies = _drawn_bodies(here, drawn, seed) if drawn else ()
    named = {body.part for body in bodies}
    bodies += _guessed_bodies({name: pins for name, pins in here.items() if name not in named}, seed)
    drilled = [pin for pins in parts.values() for pin in pins if pin.hole_mm]
    soldered = [pin for pins in here.values() for pin in pins if not pin.hole_mm] + drilled
    leads = tuple(disc(pin.x_mm, pin.y_mm, (pin.hole_mm or 0.0) * _LEAD_SHARE) for pin in drilled)
    filled = tuple((pin.x_mm, pin.y_mm) for pin in drilled)
    return Assembly(bodies, _pads_under(soldered, copper), leads, filled)


class Bodies:
    """The bodies of a side, asked by place."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.all = tuple(bodies)
        self.tallest_um = max((body.height_um for body in bodies), default=0.0)
        self._boxes = np.array([body.box_mm for body in bodies]).reshape(-1, 4)

    def near(self, x_mm: float, y_mm: float, reach_mm: float = 0.0) -> Iterator[Body]:
        """Yield the bodies whose box is within reach of a CAD place."""
        low, high = self._boxes[:, :2] - reach_mm, self._boxes[:, 2:] + reach_mm
        place = np.array((x_mm, y_mm))
        for k in np.flatnonzero(((low <= place) & (place <= high)).all(axis=1)).tolist():
            yield self.all[k]

    def over(self, x_mm: float, y_mm: float) -> Body | None:
        """Return the tallest body over a CAD place, or None."""
        found = [body for body in self.near(x_mm, y_mm) if body.inside_mm(x_mm, y_mm) >= 0.0]
        return max(found, key=lambda body: body.height_um, default=None)


def _parts(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Return the pins of what has a body, by part."""
    found: dict[str, list[Record]] = {}
    for record in records:
        if not record.is_via:
            found.setdefault(record.reference, []).append(record)
    for name in list(found):
        drilled = any(pin.hole_mm for pin in found[name])
        jumper = name.startswith(("JP", "SJ", "SB")) and drilled
        if len({(p.x_mm, p.y_mm) for p in found[name]}) < 2 or (_NO_BODY.match(name) and not jumper):
            del found[name]
    return found


def _stands_on(pins: Sequence[Record], side: str) -> bool:
    """Tell whether a part stands on a side: where its surface pads are; on top when all its pins are drilled."""
    flat = [pin for pin in pins if not pin.hole_mm]
    if not flat:
        return side == "top"
    return (flat[0].access_layer == 1) == (side == "top")


def _drawn_bodies(parts: dict[str, list[Record]], drawn: Sequence[Outline], seed: int) -> tuple[Body, ...]:
    """Give each part the largest of the outlines that hold most of its pins, drawn in by the courtyard's margin."""
    boxes = np.array([[*o.min(axis=0), *o.max(axis=0)] for o in drawn])
    owners: dict[int, Counter[str]] = {}
    for name, pins in parts.items():
        for pin in pins:
            inside = (boxes[:, 0] <= pin.x_mm) & (pin.x_mm <= boxes[:, 2])
            inside &= (boxes[:, 1] <= pin.y_mm) & (pin.y_mm <= boxes[:, 3])
            for k in np.flatnonzero(inside).tolist():
                owners.setdefault(k, Counter())[name] += 1
    best: dict[str, int] = {}
    area = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    for k, counts in owners.items():
        name, count = counts.most_common(1)[0]
        if 2 * count >= len(parts[name]) and (name not in best or area[k] > area[best[name]]):
            best[name] = k
    found = [_body(name, _drawn_in(drawn[k]), seed) for name, k in sorted(best.items())]
    return tuple(body for body in found if body is not None)


def _drawn_in(outline_mm: Outline) -> Outline:
    low, high = outline_mm.min(axis=0), outline_mm.max(axis=0)
    size = high - low
    share = np.clip((size - 2 * _COURTYARD_MARGIN_MM) / np.maximum(size, 1e-6), 0.5, 1.0)
    return np.asarray((outline_mm - (low + high) / 2.0) * share + (low + high) / 2.0)


def _guessed_bodies(parts: dict[str, list[Record]], seed: int) -> tuple[Body, ...]:
    """Lay a rectangle over each part's pads: over drilled pins and beyond, between the rows of surface pads."""
    found = []
    for name, pins in sorted(parts.items()):
        places = np.unique(np.array([(pin.x_mm, pin.y_mm) for pin in pins]), axis=0)
        (cx, cy), (width, height), turn_deg = cv2.minAreaRect((places * 1e3).astype(np.float32))
        width, height = width / 1e3, height / 1e3
        if all(pin.hole_mm for pin in pins):
            width, height = width + 2.0, height + 2.0
        elif len(places) == 2:
            width, height = max(width, 0.5 * height), max(height, 0.5 * width)
        else:
            width, height = max(0.75 * width, width - 0.8), max(0.75 * height, height - 0.8)
        box = cv2.boxPoints(((cx, cy), (max(width, _SMALLEST_MM) * 1e3, max(height, _SMALLEST_MM) * 1e3), turn_deg))
        found.append(_body(name, np.asarray(box, dtype=np.float64) / 1e3, seed))
    return tuple(body for body in found if body is not None)


def _body(name: str, outline_mm: Outline, seed: int) -> Body | None:
    size = outline_mm.max(axis=0) - outline_mm.min(axis=0)
    if float(size.min()) < _SMALLEST_MM / 2.0:
        return None
    rng = random.Random(f"{seed}/part/{name}")
    low_um, high_um = next((range_ for pattern, range_ in _HEIGHTS_UM if pattern.match(name)), _OTHER_HEIGHT_UM)
    white = rng.randint(22, 190)
    return Body(name, outline_mm, rng.uniform(low_um, high_um), white, round(white * rng.uniform(0.6, 1.0)))


def _pads_under(pins: Sequence[Record], copper: Sequence[Shape]) -> tuple[Shape, ...]:
    """Return the smallest copper polygons that lie about the pins: their pads, without tracks and pours."""
    if not pins:
        return ()
    boxes = np.array([shape.box_mm for shape in copper]).reshape(-1, 4)
    area = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2.0
    dark = np.array([shape.dark for shape in copper])
    found = []
    for pin in pins:
        reach_mm = 0.05 + 0.3 * max(pin.width_mm, pin.height_mm)
        about = np.flatnonzero(dark & (np.abs(middle - (pin.x_mm, pin.y_mm)).max(axis=1) <= reach_mm))
        if len(about):
            found.append(copper[int(about[np.argmax(area[about])])])
        elif pin.width_mm:
            found.append(disc(pin.x_mm, pin.y_mm, math.sqrt(pin.width_mm * (pin.height_mm or pin.width_mm))))
    return tuple(found)
