"""CAD import: from a folder of Gerber, Excellon and IPC-D-356 to the board file of one side.

The copper and mask Gerbers say which round metal the camera can see; the netlist says what it is called and
whether it may be touched; both must agree before a point is offered. Needs gerbonara, which a station that has its
board file does not.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial import KDTree

from daemon.domain.board import Board, BoardPoint

Side = Literal["top", "bottom"]
SAME_PLACE_MM = 0.03
"""Netlists round to 2.54 um and drills to 1 um; two entries this near are one place."""
MIN_DIAMETER_MM, MAX_DIAMETER_MM = 0.1, 1.6
"""Smaller is not resolved at 12 um/px, larger does not fit the window of a correction."""
VIA_BELOW_MM = 0.3
_NETLIST_SUFFIXES = (".ipc", ".d356", ".356", ".ipc356")
_MASK_CODE = re.compile(r"R\d{3}\s?S([0-3])")
_TOP: frozenset[Side] = frozenset({"top"})
_BOTTOM: frozenset[Side] = frozenset({"bottom"})
_ACCESS = {0: _TOP | _BOTTOM, 1: _TOP}
"""Access layer -> sides; the bottom's number is the layer count, the largest in the file."""
_COVERED: dict[int, frozenset[Side]] = {0: frozenset(), 1: _TOP, 2: _BOTTOM, 3: _TOP | _BOTTOM}
"""Solder mask code -> sides covered."""


@dataclass(frozen=True)
class _Record:
    """What the netlist says of one pad; mm in the Gerbers' coordinates."""

    name: str
    is_via: bool
    net: str
    x_mm: float
    y_mm: float
    hole_mm: float | None
    access: frozenset[Side]
    covered: frozenset[Side]


@dataclass(frozen=True)
class _Round:
    """A round flash of a Gerber layer, mm."""

    x_mm: float
    y_mm: float
    diameter_mm: float


def import_board(folder: Path, side: Side) -> Board:
    """Read a CAD folder; raise ValueError saying which file is missing or does not fit."""
    stack = _open_stack(folder)
    copper, mask = _layer(stack, folder, side, "copper"), _layer(stack, folder, side, "mask")
    x0, y0, x1, y1 = _outline_mm(stack, folder)
    drills = list(_drills(stack))
    records = _records(folder, drills)
    rounds = list(_bare_rounds(_rounds(copper), _rounds(mask)))
    named = list(_name(rounds, records, drills, side))
    mirror = side == "bottom"

    def place(x_mm: float, y_mm: float) -> tuple[float, float]:
        return round((x1 - x_mm if mirror else x_mm - x0) * 1e3, 2), round((y_mm - y0) * 1e3, 2)

    points = tuple(
        BoardPoint(name=name, kind=kind, x_um=place(r.x_mm, r.y_mm)[0], y_um=place(r.x_mm, r.y_mm)[1],
                   diameter_um=round(r.diameter_mm * 1e3, 1), hole_um=hole, net=net, why_not=why)
        for name, kind, r, hole, net, why in named
    )  # fmt: skip
    seen = {p.name for p in points}
    hidden = {r.name: _why_hidden(r, side) for r in records if _is_test_point(r) and r.name not in seen}
    return Board(
        name=folder.resolve().name, side=side, width_um=round((x1 - x0) * 1e3, 1), height_um=round((y1 - y0) * 1e3, 1),
        points=points, hidden=hidden,
    )  # fmt: skip


# --- files ---------------------------------------------------------------------------------------------------


def _open_stack(folder: Path) -> Any:
    """Let gerbonara sort the files of the folder into layers."""
    try:
        from gerbonara import LayerStack  # noqa: PLC0415  # an extra: a station that has its board file needs no CAD
    except ImportError as exc:
        raise ValueError("reading CAD needs gerbonara; install reprobe[sim]") from exc
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder; give the folder that holds Gerber, Excellon and IPC-D-356 files")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # gerbonara warns of much that does not matter here
            return LayerStack.open(folder)
    except Exception as exc:  # a parser may fail in any way on a foreign file
        raise ValueError(f"{folder}: the Gerbers cannot be read: {type(exc).__name__}: {exc}") from exc


def _layer(stack: Any, folder: Path, side: Side, use: str) -> Any:
    layer = stack.graphic_layers.get((side, use))
    if layer is None:
        raise ValueError(f"{folder} has no Gerber for {side} {use}")
    return layer


def _outline_mm(stack: Any, folder: Path) -> tuple[float, float, float, float]:
    """Return the board's edges: the middle of the outline's line."""
    if stack.outline is None:
        raise ValueError(f"{folder} has no outline (Edge_Cuts) Gerber")
    unit = _mm()
    boxes = []
    for item in stack.outline.objects:
        (ax, ay), (bx, by) = item.bounding_box(unit)
        pen = item.aperture.equivalent_width(unit) / 2 if getattr(item, "aperture", None) else 0.0
        boxes.append((ax + pen, ay + pen, bx - pen, by - pen))
    edges = np.array(boxes)
    low, high = edges[:, :2].min(axis=0), edges[:, 2:].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _drills(stack: Any) -> Iterator[_Round]:
    unit = _mm()
    for layer in stack.drill_layers:
        for hit in layer.objects:
            if type(hit).__name__ == "Flash":
                diameter_mm = unit(hit.tool.diameter, hit.tool.unit)
                yield _Round(unit(hit.x, hit.unit), unit(hit.y, hit.unit), diameter_mm)


def _rounds(layer: Any) -> list[_Round]:
    """Return the round flashes of a layer."""
    unit = _mm()
    return [
        _Round(unit(o.x, o.unit), unit(o.y, o.unit), unit(o.aperture.diameter, o.aperture.unit))
        for o in layer.objects
        if type(o).__name__ == "Flash" and type(o.aperture).__name__ == "CircleAperture" and o.polarity_dark
    ]


def _mm() -> Any:
    from gerbonara.utils import MM  # noqa: PLC0415  # see _open_stack

    return MM


# --- netlist -------------------------------------------------------------------------------------------------


def _records(folder: Path, drills: list[_Round]) -> list[_Record]:
    """Read the netlist and shift it to the Gerbers' origin."""
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in _NETLIST_SUFFIXES)
    if not files:
        raise ValueError(f"{folder} has no IPC-D-356 netlist ({', '.join(_NETLIST_SUFFIXES)})")
    raw = list(_test_records(files[0]))
    shift = _netlist_offset_mm(raw, drills, files[0])
    bottom_layer = max((r.access_layer for r in raw), default=0)
    numbered: Counter[str] = Counter()
    return [_record(r, shift, bottom_layer, numbered) for r in raw]


def _test_records(path: Path) -> Iterator[Any]:
    """Yield gerbonara's test records, with the mask code it drops from KiCad's `R000S3` put back."""
    from gerbonara.ipc356 import Netlist  # noqa: PLC0415  # see _open_stack

    text = path.read_text(errors="replace")
    lines = [line for line in text.splitlines() if line[:3] in ("317", "327", "367")]
    records = Netlist.from_string(text, filename=path).test_records
    if len(lines) != len(records):
        raise ValueError(f"{path}: {len(records)} of {len(lines)} test records could be read")
    for line, record in zip(lines, records, strict=True):
        code = _MASK_CODE.search(line)
        record.mask_code = int(code[1]) if code else 0
        yield record


def _netlist_offset_mm(records: list[Any], drills: list[_Round], path: Path) -> tuple[float, float]:
    """Estimate the shift from the netlist's origin to the Gerbers': the one most holes agree on."""
    unit = _mm()
    holes = np.array([(unit(r.x, r.unit), unit(r.y, r.unit)) for r in records if r.hole_dia])
    hits = np.array([(d.x_mm, d.y_mm) for d in drills])
    if len(holes) < 2 or len(hits) < 2:
        raise ValueError(f"{path}: too few drilled holes to find the netlist's origin")
    votes = Counter(
        (round(dx / SAME_PLACE_MM), round(dy / SAME_PLACE_MM))
        for dx, dy in (hits[None] - holes[:200, None]).reshape(-1, 2)
    )
    start = np.array(votes.most_common(1)[0][0]) * SAME_PLACE_MM
    found, nearest = KDTree(hits).query(holes + start)
    near, index = np.asarray(found) < 2 * SAME_PLACE_MM, np.asarray(nearest)
    if near.mean() < 0.8:
        raise ValueError(f"{path} does not fit the drill files: only {near.mean():.0%} of its holes are drilled")
    shift = np.median(hits[index[near]] - holes[near], axis=0)
    return float(shift[0]), float(shift[1])


def _record(r: Any, shift_mm: tuple[float, float], bottom_layer: int, numbered: Counter[str]) -> _Record:
    unit = _mm()
    layer = r.access_layer
    access = _ACCESS.get(layer, _BOTTOM if layer == bottom_layer else frozenset())
    return _Record(
        name=_name_of(r, numbered),
        is_via=bool(r.is_via),
        net=r.net_name or "",
        x_mm=unit(r.x, r.unit) + shift_mm[0],
        y_mm=unit(r.y, r.unit) + shift_mm[1],
        hole_mm=unit(r.hole_dia, r.unit) if r.hole_dia else None,
        access=access,
        covered=_COVERED[r.mask_code],
    )


def _name_of(r: Any, numbered: Counter[str]) -> str:
    """Name a record: a test point by its part, a pin by part and pin, a via by number."""
    if r.is_via or not r.ref_des:
        numbered["VIA"] += 1
        return f"VIA{numbered['VIA']}"
    reference = str(r.ref_des)
    if reference.startswith(("TP", "FID")):
        return reference
    numbered[reference] += 1
    return f"{reference}.{r.pin_num or numbered[reference]}"


# --- putting both together -----------------------------------------------------------------------------------


def _bare_rounds(copper: list[_Round], mask: list[_Round]) -> Iterator[_Round]:
    """Yield round copper seen through a round opening of the mask: the smaller of the two is what shows."""
    if not mask or not copper:
        return
    tree = KDTree([(m.x_mm, m.y_mm) for m in mask])
    seen: set[tuple[int, int]] = set()
    for pad in sorted(copper, key=lambda p: -p.diameter_mm):
        cell = (round(pad.x_mm / SAME_PLACE_MM), round(pad.y_mm / SAME_PLACE_MM))
        opening = [mask[i].diameter_mm for i in tree.query_ball_point((pad.x_mm, pad.y_mm), SAME_PLACE_MM)]
        bare_mm = min(pad.diameter_mm, max(opening, default=0.0))
        if cell not in seen and MIN_DIAMETER_MM <= bare_mm <= MAX_DIAMETER_MM:
            seen.add(cell)
            yield _Round(pad.x_mm, pad.y_mm, bare_mm)


def _name(
    rounds: list[_Round], records: list[_Record], drills: list[_Round], side: Side
) -> Iterator[tuple[str, Literal["via", "site", "fiducial"], _Round, float | None, str | None, str | None]]:
    """Give each bare round its name, kind, hole, net, and why it must not be touched."""
    record_tree = KDTree([(r.x_mm, r.y_mm) for r in records])
    drill_tree = KDTree([(d.x_mm, d.y_mm) for d in drills])
    fiducials = 0
    for item in rounds:
        at = (item.x_mm, item.y_mm)
        hits = drill_tree.query_ball_point(at, SAME_PLACE_MM)
        hole_um = round(drills[hits[0]].diameter_mm * 1e3, 1) if hits else None
        found = [records[i] for i in record_tree.query_ball_point(at, SAME_PLACE_MM)]
        if not found:
            if hole_um is None:
                fiducials += 1
                yield f"FID{fiducials}", "fiducial", item, None, None, "not in the netlist (a fiducial)"
            continue
        record = min(found, key=lambda r: not _is_test_point(r))
        yield (
            record.name,
            _kind(record, hole_um, item),
            item,
            hole_um,
            record.net or None,
            _why_not(record, side, hole_um, item),
        )


def _kind(record: _Record, hole_um: float | None, item: _Round) -> Literal["via", "site", "fiducial"]:
    """Sort a round by name and size (thesis 5.4.1: vias are the small ones with a hole)."""
    if record.name.startswith("FID"):
        return "fiducial"
    return "via" if hole_um is not None and item.diameter_mm < VIA_BELOW_MM else "site"


def _why_not(record: _Record, side: Side, hole_um: float | None, item: _Round) -> str | None:
    """Say why a seen pad must not be touched; None if it may."""
    if side not in record.access:
        return f"the netlist gives no access from the {side}"
    if side in record.covered:
        return "the netlist says solder mask covers it"
    if record.name.startswith("FID"):
        return "a fiducial"
    if not record.is_via and not _is_test_point(record):
        return "a part's pin"
    if record.is_via and hole_um is not None and hole_um > 600 * item.diameter_mm:
        return "its hole leaves too narrow a ring"
    return None


def _why_hidden(record: _Record, side: Side) -> str:
    """Say why a test point of the netlist is not among the bare rounds."""
    if side not in record.access:
        return f"it lies on the {'bottom' if side == 'top' else 'top'}"
    if side in record.covered:
        return "solder mask covers it"
    return "it is not round, or of a size the camera cannot serve"


def _is_test_point(record: _Record) -> bool:
    return record.name.startswith("TP") and not record.is_via


def summary(points: Iterable[BoardPoint]) -> str:
    """Count the points by kind, for people."""
    counts = Counter(p.kind for p in points)
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in sorted(counts.items())) or "none"
