"""Gerber apertures as polygons about their origin: standard ones, and aperture macros computed out.

Source: Gerber layer format specification 2024.05, sections 4.4 and 4.5; primitives 2, 6 and 22 and rectangular
holes from older issues.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from daemon.tools.cad.geometry import Points, arc_points, capsule, convex_hull, disc, shifted, with_round_hole
from daemon.tools.cad.gerber_words import CannotDrawError
from daemon.tools.cad.model import Shape

_CELLS = 256
"""Cells across a macro when asking whether its pieces fill their hull."""
_MOST_CORNERS = 1000
"""Of a regular polygon, and rings of a moire; the standard allows 12, a broken number must not fill the memory."""
_FINE_CELLS = 2048
"""Cells across a macro of which pieces are taken out: 1 um on a pad of 2 mm."""


@dataclass(frozen=True, slots=True)
class Aperture:
    """Polygons (points, dark) in mm about the origin. round_mm: its diameter if it is a plain disc. function: X2's.

    block: of a block aperture, its objects; ways: of its pens, points and width in mm.
    """

    polygons: tuple[tuple[Points, bool], ...]
    round_mm: float | None = None
    function: str | None = None
    block: tuple[Shape, ...] = ()
    ways: tuple[tuple[Points, float], ...] = ()

    @property
    def width_mm(self) -> float:
        """Return the width of a pen of that shape."""
        if self.round_mm is not None:
            return self.round_mm
        return max((float(np.ptp(p, axis=0).min()) for p, _ in self.polygons), default=0.0)


def standard(shape: str, numbers: list[float]) -> Aperture | None:
    """Return a standard aperture (C, R, O, P), numbers in mm (a polygon's vertices and turn plain); None: no such."""
    outer: Points
    if shape == "C":
        if len(numbers) < 2 or numbers[1] <= 0.0:
            return Aperture(((disc(round(numbers[0], 7)), True),) if numbers[0] > 0 else (), round_mm=numbers[0])
        outer, hole = disc(round(numbers[0], 7)), numbers[1]
    elif shape in ("R", "O"):
        width, height = numbers[0], numbers[1] if len(numbers) > 1 else numbers[0]
        hole = numbers[2] if len(numbers) > 2 else 0.0
        if shape == "O" and abs(width - height) < 1e-6 and hole <= 0:
            return Aperture(((disc(round(width, 7)), True),), round_mm=width)
        outer = _rectangle(width, height) if shape == "R" else _obround(width, height)
    elif shape == "P":
        outer = _regular(numbers[0], int(numbers[1]), numbers[2] if len(numbers) > 2 else 0.0)
        hole = numbers[3] if len(numbers) > 3 else 0.0
    else:
        return None
    polygons = with_round_hole(outer, hole) if hole > 0.0 else [outer]
    return Aperture(tuple((p, True) for p in polygons))


def _rectangle(width: float, height: float) -> Points:
    x, y = width / 2.0, height / 2.0
    return np.array(((-x, -y), (x, -y), (x, y), (-x, y)))


def _obround(width: float, height: float) -> Points:
    if width >= height:
        return capsule(-(width - height) / 2.0, 0.0, (width - height) / 2.0, 0.0, height)
    return capsule(0.0, -(height - width) / 2.0, 0.0, (height - width) / 2.0, width)


def _regular(diameter: float, corners: int, turn_deg: float) -> Points:
    if corners > _MOST_CORNERS:
        raise CannotDrawError(f"it has a polygon of {corners} corners; at most {_MOST_CORNERS} can be drawn")
    angles = math.radians(turn_deg) + 2.0 * math.pi * np.arange(max(corners, 3)) / max(corners, 3)
    return diameter / 2.0 * np.column_stack((np.cos(angles), np.sin(angles)))


# --- macros ----------------------------------------------------------------------------------------------------

_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_VARIABLE = re.compile(r"\$(\d+)")


def macro(body: str, parameters: list[float], unit_mm: float) -> Aperture:
    """Compute an aperture macro out; raise ValueError or ZeroDivisionError where it is broken."""
    variables = dict(enumerate(parameters, 1))
    polygons: list[tuple[Points, bool]] = []
    for statement in (s.strip() for s in body.replace("\n", "").replace("\r", "").split("*")):
        if not statement or statement.startswith("0"):
            continue
        if statement.startswith("$"):
            name, _, expression = statement.partition("=")
            variables[int(name.strip(" $"))] = _value(expression, variables)
        else:
            code, *fields = statement.split(",")
            polygons += _primitive(int(code), [_value(f, variables) for f in fields if f.strip()], unit_mm)
    polygons = _cut_out(_merged([(p, dark) for p, dark in polygons if len(p) > 2]))
    if len(polygons) == 1 and polygons[0][1] and (size := _round_about_origin(polygons[0][0])):
        return Aperture(tuple(polygons), round_mm=size)
    return Aperture(tuple(polygons))


def _merged(polygons: list[tuple[Points, bool]]) -> list[tuple[Points, bool]]:
    """Make one polygon of several that fill their hull: rounded rectangles are told as five to nine pieces."""
    if len(polygons) < 2 or not all(dark for _, dark in polygons):
        return polygons
    hull = convex_hull(np.concatenate([p for p, _ in polygons]))
    low, size = hull.min(axis=0), float(np.ptp(hull, axis=0).max())
    if len(hull) < 3 or size <= 0.0:
        return polygons
    canvas = np.zeros((2, _CELLS + 4, _CELLS + 4), np.uint8)
    for plane, members in ((0, [hull]), (1, [p for p, _ in polygons])):
        for member in members:
            at = np.round(((member - low) / size * _CELLS + 2) * 16).astype(np.int32)
            cv2.fillPoly(canvas[plane], [at], 1, lineType=cv2.LINE_8, shift=4)
    missing = int(np.count_nonzero(canvas[0] & ~canvas[1] & 1))
    return [(hull, True)] if missing <= 0.002 * np.count_nonzero(canvas[0]) else polygons


def _cut_out(polygons: list[tuple[Points, bool]]) -> list[tuple[Points, bool]]:
    """Take pieces with exposure off out of the macro's own pieces: what lies below the macro stays as it is."""
    if all(dark for _, dark in polygons):
        return polygons
    every = np.concatenate([p for p, _ in polygons])
    low, pitch = every.min(axis=0), max(float(np.ptp(every, axis=0).max()), 1e-6) / _FINE_CELLS
    canvas = np.zeros((_FINE_CELLS + 4, _FINE_CELLS + 4), np.uint8)
    for points, dark in polygons:
        at = np.round(((points - low) / pitch + 1.5) * 16).astype(np.int32)
        cv2.fillPoly(canvas, [at], int(dark), lineType=cv2.LINE_8, shift=4)
    contours, tree = cv2.findContours(canvas, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found: dict[int, Points] = {}
    for k, contour in enumerate(contours):
        ring = (cv2.approxPolyDP(contour, 0.7, closed=True).reshape(-1, 2) - 1.5) * pitch + low
        outer = int(tree[0, k, 3])
        if outer < 0:
            found[k] = ring if k not in found else _joined(ring, found[k])
        else:
            found[outer] = _joined(found[outer], ring) if outer in found else ring
    return [(p, True) for p in found.values() if len(p) > 2]


def _joined(outer: Points, hole: Points) -> Points:
    """Return one polygon of an edge and a hole in it, joined by a slit where they are nearest."""
    apart = np.hypot(*(outer[:, None] - hole[None]).transpose(2, 0, 1))
    i, j = (int(v) for v in np.unravel_index(int(apart.argmin()), apart.shape))
    return np.concatenate((outer[: i + 1], hole[j:], hole[: j + 1], outer[i:]))


def _round_about_origin(points: Points) -> float | None:
    """Return the diameter if the polygon is a fine circle about the origin."""
    radii = np.hypot(*points.T)
    return float(radii.mean() * 2.0) if len(points) > 15 and np.ptp(radii) < 2e-3 else None


def _value(expression: str, variables: dict[int, float]) -> float:
    """Compute an expression of numbers, $n, + - x X / and brackets."""
    plain = expression.strip()
    if plain.startswith("$") and plain[1:].isdecimal():
        return variables.get(int(plain[1:]), 0.0)
    try:
        return float(plain)
    except ValueError:
        pass
    text = _VARIABLE.sub(lambda m: f"({variables.get(int(m[1]), 0.0)!r})", expression)
    text = re.sub(r"(?<![\d.])0+(?=\d)", "", text.replace("x", "*").replace("X", "*").strip())
    try:
        return _compute(ast.parse(text, mode="eval").body)
    except (SyntaxError, RecursionError) as exc:
        raise CannotDrawError(f"the macro's expression {expression!r} cannot be read") from exc


def _compute(node: ast.expr) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        value = _compute(node.operand)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_compute(node.left), _compute(node.right))
    raise CannotDrawError("not arithmetic")


def _primitive(code: int, f: list[float], mm: float) -> list[tuple[Points, bool]]:
    """Return a primitive's polygons, turned about the macro's origin."""
    build = _PRIMITIVES.get(code)
    if build is None:
        raise CannotDrawError(f"aperture macros have no primitive {code}")
    try:
        polygons, turn_deg, dark = build(f, mm)
    except IndexError as exc:
        raise CannotDrawError(f"primitive {code} of an aperture macro has too few numbers") from exc
    return [(turned(p, turn_deg), dark) for p in polygons]


def turned(points: Points, turn_deg: float) -> Points:
    """Turn points about the origin, counter-clockwise."""
    if not turn_deg:
        return points
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    result: Points = points @ np.array(((c, s), (-s, c)))
    return result


_Built = tuple[list[Points], float, bool]


def _circle(f: list[float], mm: float) -> _Built:
    return [shifted(disc(round(f[1] * mm, 7)), f[2] * mm, f[3] * mm)], f[4] if len(f) > 4 else 0.0, f[0] != 0


def _vector_line(f: list[float], mm: float) -> _Built:
    width, a, b = f[1] * mm, np.array(f[2:4]) * mm, np.array(f[4:6]) * mm
    along = (b - a) / max(float(np.hypot(*(b - a))), 1e-12)
    across = np.array((-along[1], along[0])) * width / 2.0
    return [np.array((a + across, a - across, b - across, b + across))], f[6] if len(f) > 6 else 0.0, f[0] != 0


def _centre_line(f: list[float], mm: float) -> _Built:
    return [shifted(_rectangle(f[1] * mm, f[2] * mm), f[3] * mm, f[4] * mm)], f[5] if len(f) > 5 else 0.0, f[0] != 0


def _lower_left_line(f: list[float], mm: float) -> _Built:
    box = shifted(_rectangle(f[1] * mm, f[2] * mm), (f[3] + f[1] / 2) * mm, (f[4] + f[2] / 2) * mm)
    return [box], f[5] if len(f) > 5 else 0.0, f[0] != 0


def _outline(f: list[float], mm: float) -> _Built:
    corners = int(f[1])
    points = np.array(f[2 : 2 + 2 * corners]).reshape(-1, 2) * mm
    turn_at = 2 + 2 * (corners + 1)
    return [points], f[turn_at] if len(f) > turn_at else 0.0, f[0] != 0


def _polygon(f: list[float], mm: float) -> _Built:
    return [shifted(_regular(f[4] * mm, int(f[1]), 0.0), f[2] * mm, f[3] * mm)], f[5] if len(f) > 5 else 0.0, f[0] != 0


def _moire(f: list[float], mm: float) -> _Built:
    x, y, outer, width, gap = (v * mm for v in f[:5])
    found: list[Points] = []
    if f[5] > _MOST_CORNERS:
        raise CannotDrawError(f"it has a target of {int(f[5])} rings; at most {_MOST_CORNERS} can be drawn")
    for _ in range(int(f[5])):
        if outer <= 0:
            break
        inner = outer - 2 * width
        ring = with_round_hole(disc(round(outer, 7)), inner) if inner > 0 else [disc(round(outer, 7))]
        found += [shifted(p, x, y) for p in ring]
        outer = inner - 2 * gap
    found += [shifted(_rectangle(f[a] * mm, f[b] * mm), x, y) for a, b in ((6, 7), (7, 6))]
    return found, f[8] if len(f) > 8 else 0.0, True


def _thermal(f: list[float], mm: float) -> _Built:
    x, y, outer, inner, gap = (v * mm for v in f[:5])
    half = gap / 2.0
    a, b = math.asin(min(1.0, gap / outer)), math.asin(min(1.0, gap / max(inner, gap)))
    quarter = np.concatenate((
        arc_points(0.0, 0.0, outer / 2.0, a, math.pi / 2.0 - 2 * a),
        arc_points(0.0, 0.0, inner / 2.0, math.pi / 2.0 - b, 2 * b - math.pi / 2.0) if inner > gap else [(half, half)],
    ))  # fmt: skip
    return [shifted(turned(quarter, 90.0 * k), x, y) for k in range(4)], f[5] if len(f) > 5 else 0.0, True


_PRIMITIVES: dict[int, Callable[[list[float], float], _Built]] = {
    1: _circle,
    2: _vector_line,
    20: _vector_line,
    21: _centre_line,
    22: _lower_left_line,
    4: _outline,
    5: _polygon,
    6: _moire,
    7: _thermal,
}
