"""Painter of a Gerber layer: flashes, pen strokes and regions become polygons in painting order, mm."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from daemon.tools.cad.apertures import Aperture, turned
from daemon.tools.cad.geometry import Points, along_arc, arc_stroke, box_hull, capsule, shifted
from daemon.tools.cad.gerber_words import CannotDrawError, attribute_fields
from daemon.tools.cad.model import Shape

_MAX_SHAPES = 3_000_000
_MAX_IN_BLOCK = 100_000
"""More objects in one block than a board has: blocks of blocks double with every line."""
Place = tuple[float, float]


class Path(NamedTuple):
    """A pen's way: its points, its width in mm; 0 for the edge of a region."""

    points: Points
    width_mm: float


@dataclass(slots=True)
class GerberLayer:
    """What a Gerber file draws. paths: the ways of its pens and the edges of its regions, for outlines and slots.

    ended: whether the file has its end (M02); one without may be cut off. torn: it surely is, within a command.
    """

    shapes: list[Shape] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    attributes: dict[str, list[str]] = field(default_factory=dict)
    ended: bool = False
    torn: bool = False


@dataclass(slots=True)
class ImageFrame:
    """What old files say of the whole image: mirror, turn, offset."""

    mirror: tuple[float, float] = (1.0, 1.0)
    turn_deg: float = 0.0
    offset: Place = (0.0, 0.0)
    plain: bool = True

    def apply(self, points: Points) -> Points:
        """Return the points as they lie in the image."""
        if self.plain:
            return points
        return shifted(turned(points * np.array(self.mirror), self.turn_deg), *self.offset)


@dataclass(slots=True)
class _Repeat:
    count: tuple[int, int]
    step: Place
    shapes: list[Shape]
    first_path: int


@dataclass(slots=True)
class Painter:
    """Polarity, aperture transformation, attributes; and the shapes painted with them."""

    layer: GerberLayer = field(default_factory=GerberLayer)
    dark: bool = True
    mirror: str = "N"
    turn_deg: float = 0.0
    scale: float = 1.0
    image: ImageFrame = field(default_factory=ImageFrame)
    aperture_function: str | None = None
    _said: dict[str, list[str]] = field(default_factory=dict)
    _names: tuple[str | None, str | None, str | None] = (None, None, None)
    _items: int = 0
    _blocks: list[tuple[int, list[Shape], int]] = field(default_factory=list)
    _repeat: _Repeat | None = None
    _shapes: list[Shape] = field(init=False)

    def __post_init__(self) -> None:
        self._shapes = self.layer.shapes

    # --- painting ----------------------------------------------------------------------------------------------

    def flash(self, pen: Aperture, place: Place) -> None:
        """Paint an aperture at a place."""
        if pen.block:
            self._paint_block(pen, place)
            return
        round_mm = pen.round_mm * self.scale if pen.round_mm is not None else None
        polygons = [(shifted(self._placed(p), *place), dark) for p, dark in pen.polygons]
        self._paint(polygons, pen.function, place, round_mm)

    def _paint_block(self, pen: Aperture, place: Place) -> None:
        """Paint a block's objects, each a pad or a line of its own, with what the file said of it or says now."""
        if len(self._shapes) + len(pen.block) > (_MAX_IN_BLOCK if self._blocks else _MAX_SHAPES):
            raise CannotDrawError("its blocks hold too many shapes to draw")
        first, named = self._items + 1, any(self._names)
        for shape in pen.block:
            points = self.image.apply(shifted(self._placed(shape.points_mm), *place))
            where = self._on_board(shape.place_mm, place) if shape.place_mm is not None else None
            disc = (*where, shape.round_mm[2] * self.scale) if where is not None and shape.round_mm else None
            names = self._names if named else (shape.part, shape.pin, shape.net)
            self._items = first + shape.item
            self._shapes.append(
                Shape(points, shape.dark == self.dark, *names, shape.flashed, disc, where, self._items, shape.function)
            )
        for way, width_mm in pen.ways:
            moved = self.image.apply(shifted(self._placed(way), *place))
            self.layer.paths.append(Path(moved, width_mm * self.scale))

    def _on_board(self, inner: Place, place: Place) -> Place:
        """Return where a place in a block lies when the block is flashed."""
        x, y = self.image.apply(shifted(self._placed(np.array((inner,))), *place))[0]
        return float(x), float(y)

    def line(self, pen: Aperture, here: Place, there: Place) -> None:
        """Draw a straight line with a pen."""
        width_mm = pen.width_mm * self.scale
        self.layer.paths.append(Path(self.image.apply(np.array((here, there))), width_mm))
        if pen.round_mm is not None or not pen.polygons:
            if width_mm > 0.0:
                self._paint([(capsule(*here, *there, width_mm), True)], pen.function)
        else:
            hulls = [(box_hull(self._placed(p), here, there), True) for p, dark in pen.polygons if dark]
            self._paint(hulls, pen.function)

    def arc(self, pen: Aperture, here: Place, there: Place, centre: Place, *, cw: bool) -> None:
        """Draw an arc with a pen; one that is not round is taken as round."""
        width_mm = pen.width_mm * self.scale
        self.layer.paths.append(Path(self.image.apply(along_arc(here, there, centre, cw=cw)), width_mm))
        self._paint([(p, True) for p in arc_stroke(here, there, centre, width_mm, cw=cw)], pen.function)

    def region(self, points: Points) -> None:
        """Fill a closed contour."""
        self.layer.paths.append(Path(self.image.apply(points), 0.0))
        closed = len(points) > 1 and bool(np.allclose(points[0], points[-1], atol=1e-6))
        self._paint([(points[:-1] if closed else points, True)], self.aperture_function)

    def _placed(self, points: Points) -> Points:
        """Apply mirror, turn and scale of the graphics state to an aperture."""
        if self.mirror not in ("N", ""):
            points = points * np.array((-1.0 if "X" in self.mirror else 1.0, -1.0 if "Y" in self.mirror else 1.0))
        if self.turn_deg:
            points = turned(points, self.turn_deg)
        return points * self.scale if self.scale != 1.0 else points

    def _paint(
        self,
        polygons: list[tuple[Points, bool]],
        function: str | None,
        place: Place | None = None,
        round_mm: float | None = None,
    ) -> None:
        self._items += 1
        where = place
        if place is not None and not self.image.plain:
            x, y = self.image.apply(np.array((place,)))[0]
            where = (float(x), float(y))
        disc = (*where, round_mm) if where is not None and round_mm is not None else None
        for points, dark in polygons:
            self._shapes.append(
                Shape(
                    self.image.apply(points), dark == self.dark, *self._names,
                    place is not None, disc, where, self._items, function,
                )
            )  # fmt: skip

    # --- blocks and repetition ---------------------------------------------------------------------------------

    def open_block(self, number: int) -> None:
        """Begin a block aperture."""
        self._blocks.append((number, self._shapes, len(self.layer.paths)))
        self._shapes = []

    def close_block(self) -> tuple[int, Aperture] | None:
        """End a block aperture; return its number and itself."""
        if not self._blocks:
            return None
        number, outer, first_path = self._blocks.pop()
        block, ways = self._shapes, self.layer.paths[first_path:]
        del self.layer.paths[first_path:]
        first = min((s.item for s in block), default=0)
        made = Aperture(
            tuple((s.points_mm, s.dark) for s in block), None, self.aperture_function,
            tuple(replace(s, item=s.item - first) for s in block), tuple(ways),
        )  # fmt: skip
        self._shapes = outer
        return number, made

    def open_repeat(self, count: tuple[int, int], step: Place) -> None:
        """Begin step and repeat."""
        self.close_repeat()
        self._repeat = _Repeat(count, step, self._shapes, len(self.layer.paths))
        self._shapes = []

    def close_repeat(self) -> None:
        """End step and repeat; raise ValueError where it would fill the memory."""
        if self._repeat is None:
            return
        (nx, ny), (dx, dy) = self._repeat.count, self._repeat.step
        if nx * ny * len(self._shapes) > _MAX_SHAPES:
            raise CannotDrawError(f"it repeats {len(self._shapes)} shapes {nx} x {ny} times: too many to draw")
        paths, outer = self.layer.paths[self._repeat.first_path :], self._repeat.shapes
        for k, (i, j) in enumerate((i, j) for i in range(nx) for j in range(ny)):
            if k:
                self.layer.paths += [Path(shifted(p.points, i * dx, j * dy), p.width_mm) for p in paths]
            outer += [_moved(s, i * dx, j * dy, k * (self._items + 1)) for s in self._shapes]
        self._items = (self._items + 1) * nx * ny
        self._shapes, self._repeat = outer, None

    # --- attributes --------------------------------------------------------------------------------------------

    def attribute(self, command: str) -> None:
        """Take `TF...`, `TA...`, `TO...` or `TD...`."""
        kind, (name, *fields) = command[:2], [f.strip() for f in attribute_fields(command[2:])]
        if kind == "TF":
            self.layer.attributes.setdefault(name, fields)
        elif kind == "TA" and name == ".AperFunction":
            self.aperture_function = fields[0] if fields else None
        elif kind == "TO":
            self._said[name] = fields
        elif kind == "TD":
            if name in ("", ".AperFunction"):
                self.aperture_function = None
            self._said = {} if not name else {k: v for k, v in self._said.items() if k != name}
        part, pin = (*self._said.get(".P", ()), None, None)[:2]
        component, net = (self._said.get(key) for key in (".C", ".N"))
        self._names = (part or (component[0] if component else None), pin, net[0] if net else None)

    def say_image(self, command: str, unit_mm: float) -> None:
        """Take `OF`, `MI` or `IR` of old files."""
        numbers = {axis: float(n) for axis, n in re.findall(r"([AB])([+-]?[\d.]+)", command)}
        if command.startswith("OF"):
            self.image.offset = (numbers.get("A", 0.0) * unit_mm, numbers.get("B", 0.0) * unit_mm)
        elif command.startswith("MI"):
            self.image.mirror = (-1.0 if numbers.get("A") else 1.0, -1.0 if numbers.get("B") else 1.0)
        else:
            self.image.turn_deg = float(command[2:] or 0.0)
        frame = self.image
        frame.plain = frame.mirror == (1.0, 1.0) and not frame.turn_deg and frame.offset == (0.0, 0.0)


def _moved(shape: Shape, dx: float, dy: float, item: int) -> Shape:
    place = (shape.place_mm[0] + dx, shape.place_mm[1] + dy) if shape.place_mm else None
    disc = (*place, shape.round_mm[2]) if place and shape.round_mm else None
    return Shape(
        shifted(shape.points_mm, dx, dy), shape.dark, shape.part, shape.pin, shape.net, shape.flashed, disc, place,
        shape.item + item, shape.function,
    )  # fmt: skip
