"""Pins from what was read: netlist records, X2 attributes of the copper."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from daemon.tools.cad.geometry import Points
from daemon.tools.cad.ipc356 import Netlist, Record
from daemon.tools.cad.model import Drill, Pin, Shape, Side, is_no_net
from daemon.tools.cad.panel_cut import one_board
from daemon.tools.cad.places import SAME_PLACE_MM

BOTH: frozenset[Side] = frozenset({"top", "bottom"})
TOP: frozenset[Side] = frozenset({"top"})
BOTTOM: frozenset[Side] = frozenset({"bottom"})
NONE: frozenset[Side] = frozenset()
_COVERED = {None: NONE, 0: NONE, 1: TOP, 2: BOTTOM, 3: BOTH}
_FEATURES: dict[str, Literal["test_point", "fiducial", "via"]] = {
    "TestPad": "test_point",
    "FiducialPad": "fiducial",
    "ViaPad": "via",
}


def pins_of_netlist(netlist: Netlist) -> list[Pin]:
    """Return the netlist's records as pins, in its own origin."""
    bottom = netlist.bottom_layer
    return [_pin(r, bottom) for r in netlist.records]


def _pin(r: Record, bottom: int) -> Pin:
    access = BOTH if r.access == 0 else TOP if r.access == 1 else BOTTOM if r.access >= bottom else NONE
    via = not r.reference
    return Pin(
        part=r.reference, pin=r.pin, net=r.net, x_mm=r.x_mm, y_mm=r.y_mm, is_via=via, hole_mm=r.hole_mm or None,
        access=access, covered=_COVERED[r.mask], width_mm=r.width_mm or None, height_mm=r.height_mm,
        feature="via" if via else None,
    )  # fmt: skip


def moved(pins: Iterable[Pin], shift_mm: tuple[float, float], scale: float) -> list[Pin]:
    """Return the pins in the layers' coordinates."""
    return [replace(p, x_mm=p.x_mm * scale + shift_mm[0], y_mm=p.y_mm * scale + shift_mm[1]) for p in pins]


def pins_of_copper(copper: dict[Side, Sequence[Shape]], drills: Sequence[Drill]) -> list[Pin]:
    """Return the pins that X2 attributes of the copper name (.P, .N, .C), of a panel those of one board.

    Empty where the files carry none. Raise `NotCutError` for a panel whose boards cannot be told from each other.
    """
    found: dict[tuple[str, str, str, int, int], Pin] = {}
    tree = KDTree([(d.x_mm, d.y_mm) for d in drills]) if drills else None
    for side, shapes in copper.items():
        for shape in named_pads(shapes):
            x, y = shape.place_mm or middle(shape)
            part, pin, net = shape.part or "", shape.pin or "", net_name(shape.net)
            key = (part, pin, net, round(x * 50), round(y * 50))
            here = frozenset({side})
            if key in found:
                found[key] = replace(found[key], access=found[key].access | here)
                continue
            near = tree.query_ball_point((x, y), SAME_PLACE_MM) if tree is not None else []
            low, high = shape.points_mm.min(axis=0), shape.points_mm.max(axis=0)
            found[key] = Pin(
                part=part, pin=pin, net=net, x_mm=x, y_mm=y, is_via=not part,
                hole_mm=drills[near[0]].diameter_mm if near else None, access=here, covered=NONE,
                width_mm=float(high[0] - low[0]), height_mm=0.0 if shape.round_mm else float(high[1] - low[1]),
                feature=_feature(shape),
            )  # fmt: skip
    return one_board(list(found.values()), _named_boxes(copper), "the copper's X2 attributes name")


def _named_boxes(copper: dict[Side, Sequence[Shape]]) -> Points:
    """Return the boxes (N, 4) of the copper that belongs to a part or a net, mm."""
    found = [s.points_mm for shapes in copper.values() for s in shapes if s.dark and (s.part or s.net)]
    return np.array([(*p.min(axis=0), *p.max(axis=0)) for p in found]).reshape(-1, 4)


def named_pads(shapes: Sequence[Shape]) -> Iterable[Shape]:
    """Yield one dark shape of each pad that has a name: a pin, or a via with a net."""
    last = None
    for shape in shapes:
        pad = shape.flashed or shape.pin is not None
        named = shape.pin is not None or (shape.part is None and shape.net and shape.function == "ViaPad")
        if pad and shape.dark and named and shape.item != last:
            last = shape.item
            yield shape


def _feature(shape: Shape) -> Literal["pad", "test_point", "fiducial", "via"]:
    return _FEATURES.get(shape.function or "", "pad")


def middle(shape: Shape) -> tuple[float, float]:
    """Return the middle of a shape's box."""
    low, high = shape.points_mm.min(axis=0), shape.points_mm.max(axis=0)
    return float(low[0] + high[0]) / 2.0, float(low[1] + high[1]) / 2.0


def net_name(net: str | None) -> str:
    """Return a net's name as the copper says it, "" for none."""
    name = unescaped(net or "")
    return "" if is_no_net(name) else name


_ESCAPES = {
    "slash": "/",
    "backslash": "\\",
    "colon": ":",
    "space": " ",
    "dblquote": '"',
    "lt": "<",
    "gt": ">",
    "bar": "|",
}


def unescaped(net: str) -> str:
    """Take back KiCad's own escapes in names (`{slash}`)."""
    return re.sub(r"\{(\w+)\}", lambda m: _ESCAPES.get(m[1], m[0]), net)
