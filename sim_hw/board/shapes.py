"""Polygons in millimetres from gerbonara's objects.

The rasteriser and the target finder need nothing but outlines, so the foreign library stays in here and in
`board_files`.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from gerbonara import graphic_objects as go
from gerbonara import graphic_primitives as gp
from gerbonara.apertures import ApertureMacroInstance, RectangleAperture
from gerbonara.utils import MM

Outline = npt.NDArray[np.float64]

_CHORD_ERROR_MM = 0.001
_NEVER_ROUND = (ApertureMacroInstance, RectangleAperture)


@dataclass(frozen=True)
class Shape:
    """A filled polygon: `outline_mm` (N, 2) float64; `dark` adds, otherwise it removes."""

    outline_mm: Outline
    dark: bool
    box_mm: tuple[float, float, float, float]  # x0, y0, x1, y1


@dataclass(frozen=True)
class Round:
    """A flashed round: a pad, a mask opening or a drill hit."""

    x_mm: float
    y_mm: float
    diameter_mm: float


def _arc(cx: float, cy: float, radius: float, start: float, sweep: float) -> Outline:
    step = 2.0 * math.acos(max(-1.0, 1.0 - _CHORD_ERROR_MM / max(radius, 2 * _CHORD_ERROR_MM)))
    count = max(3, math.ceil(abs(sweep) / step) + 1)
    angles = start + np.linspace(0.0, sweep, count)
    return np.column_stack((cx + radius * np.cos(angles), cy + radius * np.sin(angles)))


def _circle(cx: float, cy: float, radius: float) -> Outline:
    return _arc(cx, cy, radius, 0.0, 2.0 * math.pi)[:-1]


@lru_cache(maxsize=256)
def _half_circle(radius: float) -> Outline:
    return _arc(0.0, 0.0, radius, -math.pi / 2, math.pi)


def _capsule(x1: float, y1: float, x2: float, y2: float, width: float) -> Outline:
    radius, along = width / 2.0, math.atan2(y2 - y1, x2 - x1)
    cap = _half_circle(round(radius, 6))
    c, s = math.cos(along), math.sin(along)
    turned = cap @ np.array([[c, s], [-s, c]])
    return np.concatenate((turned + np.array((x2, y2)), np.array((x1, y1)) - turned))


def _rectangle(cx: float, cy: float, width: float, height: float, turn: float) -> Outline:
    """Turn counter-clockwise about the middle; gerbonara's own `to_arc_poly` leaves the turn out."""
    c, s = math.cos(turn), math.sin(turn)
    corners = np.array(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))) * (width / 2.0, height / 2.0)
    turned: Outline = corners @ np.array(((c, s), (-s, c))) + (cx, cy)
    return turned


def _sweep(p1: tuple[float, float], p2: tuple[float, float], centre: tuple[float, float], *, cw: bool) -> Outline:
    start = math.atan2(p1[1] - centre[1], p1[0] - centre[0])
    end = math.atan2(p2[1] - centre[1], p2[0] - centre[0])
    sweep = (end - start) % (2.0 * math.pi)
    if cw:
        sweep -= 2.0 * math.pi
    if abs(sweep) < 1e-9 or abs(abs(sweep) - 2 * math.pi) < 1e-9:
        sweep = -2.0 * math.pi if cw else 2.0 * math.pi
    return _arc(*centre, math.dist(p1, centre), start, sweep)


def _arc_poly(poly: Any) -> Outline:
    pieces: list[Outline] = []
    for p1, p2, (clockwise, centre) in poly.segments:
        piece = np.array([p1]) if clockwise is None else _sweep(p1, p2, centre, cw=clockwise)[:-1]
        pieces.append(piece)
    return np.concatenate(pieces).astype(np.float64) if pieces else np.empty((0, 2))


def _outlines(primitive: Any) -> Iterator[Outline]:
    if isinstance(primitive, gp.Circle):
        yield _circle(primitive.x, primitive.y, primitive.r)
    elif isinstance(primitive, gp.Line):
        yield _capsule(primitive.x1, primitive.y1, primitive.x2, primitive.y2, max(primitive.width, 0.01))
    elif isinstance(primitive, gp.Arc):
        ends = (primitive.x1, primitive.y1), (primitive.x2, primitive.y2)
        points = _sweep(*ends, (primitive.cx, primitive.cy), cw=primitive.clockwise)
        for (x1, y1), (x2, y2) in itertools.pairwise(points):
            yield _capsule(float(x1), float(y1), float(x2), float(y2), max(primitive.width, 0.01))
    elif isinstance(primitive, gp.Rectangle):
        yield _rectangle(primitive.x, primitive.y, primitive.w, primitive.h, primitive.rotation)
    else:
        yield _arc_poly(primitive.to_arc_poly())


def shapes(objects: Iterable[Any]) -> tuple[Shape, ...]:
    """Return the polygons of a layer's objects in drawing order."""
    found: list[Shape] = []
    flashes: dict[tuple[int, bool], list[Shape]] = {}  # computing an aperture macro out is slow: once is enough
    for item in objects:
        if not isinstance(item, go.Flash):
            found += _item_shapes(item)
            continue
        x_mm, y_mm = (float(MM(value, item.unit)) for value in (item.x, item.y))
        key = (id(item.aperture), bool(item.polarity_dark))
        if key not in flashes:
            flashes[key] = [_moved(shape, -x_mm, -y_mm) for shape in _item_shapes(item)]
        found += [_moved(shape, x_mm, y_mm) for shape in flashes[key]]
    return tuple(found)


def _item_shapes(item: Any) -> list[Shape]:
    return [
        _shape(outline, dark=bool(primitive.polarity_dark))
        for primitive in item.to_primitives(MM)
        for outline in _outlines(primitive)
        if len(outline) >= 3
    ]


def _shape(outline_mm: Outline, *, dark: bool) -> Shape:
    low, high = outline_mm.min(axis=0), outline_mm.max(axis=0)
    return Shape(outline_mm, dark, (float(low[0]), float(low[1]), float(high[0]), float(high[1])))


def _moved(shape: Shape, dx_mm: float, dy_mm: float) -> Shape:
    x0, y0, x1, y1 = shape.box_mm
    box = (x0 + dx_mm, y0 + dy_mm, x1 + dx_mm, y1 + dy_mm)
    return Shape(shape.outline_mm + np.array((dx_mm, dy_mm)), shape.dark, box)


def disc(x_mm: float, y_mm: float, diameter_mm: float) -> Shape:
    """Return a filled round."""
    return _shape(_circle(x_mm, y_mm, diameter_mm / 2.0), dark=True)


def boxed(box_mm: tuple[float, float, float, float]) -> Shape:
    """Return a filled rectangle (x0, y0, x1, y1)."""
    x0, y0, x1, y1 = box_mm
    return _shape(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), dark=True)


def rounds(objects: Iterable[Any]) -> tuple[Round, ...]:
    """Return what was flashed round: circles, and obrounds or rounded squares that are circles in fact."""
    found: list[Round] = []
    for item in objects:
        if not isinstance(item, go.Flash) or not item.polarity_dark or isinstance(item.aperture, _NEVER_ROUND):
            continue
        primitives = list(item.to_primitives(MM))
        if len(primitives) != 1:
            continue
        one = primitives[0]
        if isinstance(one, gp.Circle):
            found.append(Round(float(one.x), float(one.y), 2.0 * float(one.r)))
        elif isinstance(one, gp.Line) and math.dist((one.x1, one.y1), (one.x2, one.y2)) < 1e-6:
            found.append(Round(float(one.x1), float(one.y1), float(one.width)))
    return tuple(found)


def centre_line_box(objects: Iterable[Any]) -> tuple[float, float, float, float]:
    """Return (x0, y0, x1, y1) in mm of an outline drawn with a pen, measured at the pen's centre.

    Raises:
        ValueError: there is nothing in the layer.

    """
    boxes: list[tuple[float, float, float, float]] = []
    for item in objects:
        (x0, y0), (x1, y1) = item.bounding_box(MM)
        pen_mm = 0.0
        if isinstance(item, (go.Line, go.Arc)) and item.aperture is not None:
            pen_mm = float(item.aperture.equivalent_width(MM))
        half = pen_mm / 2.0
        boxes.append((x0 + half, y0 + half, x1 - half, y1 - half))
    if not boxes:
        raise ValueError("the outline layer is empty; export the board's edge (Edge.Cuts, profile)")
    low = np.array(boxes).min(axis=0)
    high = np.array(boxes).max(axis=0)
    return (round(float(low[0]), 6), round(float(low[1]), 6), round(float(high[2]), 6), round(float(high[3]), 6))


def outline_polygons(objects: Iterable[Any]) -> tuple[Shape, ...]:
    """Chain the pen strokes of an outline layer into closed polygons (arcs kept as chords)."""
    strokes: list[Outline] = []
    polygons: list[Shape] = []
    for item in objects:
        if isinstance(item, go.Region):
            polygons += _item_shapes(item)
            continue
        primitive = next(iter(item.to_primitives(MM)))
        if isinstance(primitive, gp.Line):
            strokes.append(np.array([[primitive.x1, primitive.y1], [primitive.x2, primitive.y2]]))
        elif isinstance(primitive, gp.Arc):
            ends = (primitive.x1, primitive.y1), (primitive.x2, primitive.y2)
            strokes.append(_sweep(*ends, (primitive.cx, primitive.cy), cw=primitive.clockwise))
    while strokes:
        chain = strokes.pop(0)
        while strokes and math.dist(chain[0], chain[-1]) > 1e-3:
            reach = [min(math.dist(chain[-1], stroke[0]), math.dist(chain[-1], stroke[-1])) for stroke in strokes]
            nearest = int(np.argmin(reach))
            if reach[nearest] > 0.05:
                break
            following = strokes.pop(nearest)
            if math.dist(chain[-1], following[-1]) < math.dist(chain[-1], following[0]):
                following = following[::-1]
            chain = np.concatenate((chain, following))
        if len(chain) >= 3:
            polygons.append(_shape(chain, dark=True))
    return tuple(polygons)
