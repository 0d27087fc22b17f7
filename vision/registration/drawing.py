"""CAD polygons as pictures of classes: what each cell of a grid on the board is made of.

Layers are filled in painting order on fine texels; bits of the layers give a class for each texel, and area averages
give the share of each class in a cell. Row and column run with y and x of the board.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.registration.layers import Hole, Polygon, SideLayers

Labels = NDArray[np.uint8]
Points = NDArray[np.float64]
_COPPER, _OPEN, _INK, _HOLE, _CAPPED, _BOARD, _UNKNOWN, _SOLDERED = 1, 2, 4, 8, 16, 32, 64, 128
_FRACTION_BITS = 4
_HOLE_POINTS = 32
_BAND_ROWS = 64
"""Rows of cells that are averaged at once: a large board's texels are many times the cache."""
_EVERYWHERE = np.array([[-1e7, -1e7], [1e7, -1e7], [1e7, 1e7], [-1e7, 1e7]])


class Material(IntEnum):
    """What a place of the board shows to the camera.

    UNKNOWN: parts, whose look nobody knows. SOLDER: metal that carries solder or a lead, mostly bright, with facets
    that throw the lamp elsewhere.
    """

    OFF_BOARD = 0
    MASK = 1
    COVERED_COPPER = 2
    INK = 3
    LAMINATE = 4
    METAL = 5
    HOLE = 6
    UNKNOWN = 7
    SOLDER = 8


@dataclass(frozen=True, slots=True)
class LayerShifts:
    """By how much ink and mask openings lie off the copper, um, board frame."""

    ink_um: tuple[float, float] = (0.0, 0.0)
    openings_um: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Cells on the board: `origin_um` is the centre of cell (0, 0), lower left; `rows` along y, `columns` along x."""

    origin_um: tuple[float, float]
    cell_um: float
    rows: int
    columns: int

    @property
    def to_um(self) -> NDArray[np.float64]:
        """The map (3, 3) from (column, row) to board um."""
        x_um, y_um = self.origin_um
        return np.array([[self.cell_um, 0.0, x_um], [0.0, self.cell_um, y_um], [0.0, 0.0, 1.0]])

    def part(self, rows: slice, columns: slice) -> Grid:
        """Return the grid of a block of cells."""
        x_um, y_um = self.origin_um
        corner = (x_um + columns.start * self.cell_um, y_um + rows.start * self.cell_um)
        return Grid(corner, self.cell_um, rows.stop - rows.start, columns.stop - columns.start)


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Share 0..1 of each material in each cell: `cover` (materials, rows, columns) float32."""

    grid: Grid
    cover: NDArray[np.float32]

    def around(self, x_um: float, y_um: float, half_um: float) -> Planes:
        """Return the cells within `half_um` of a place, clipped to what there is; an even number where possible."""
        rows, columns = _around(self.grid, x_um, y_um, half_um)
        return Planes(self.grid.part(rows, columns), self.cover[:, rows, columns])


@dataclass(frozen=True, slots=True, eq=False)
class PackedPlanes:
    """The same in a quarter of the memory: `shares` (materials, rows, columns) uint8, of 255."""

    grid: Grid
    shares: NDArray[np.uint8]

    def around(self, x_um: float, y_um: float, half_um: float) -> Planes:
        """Return the cells within `half_um` of a place, as `Planes.around` does."""
        rows, columns = _around(self.grid, x_um, y_um, half_um)
        return Planes(self.grid.part(rows, columns), _unpacked(self.shares[:, rows, columns]))

    def plane(self, material: Material) -> NDArray[np.float32]:
        """Return the share 0..1 of a material in each cell."""
        return _unpacked(self.shares[material])


def _unpacked(shares: NDArray[np.uint8]) -> NDArray[np.float32]:
    return shares.astype(np.float32) * np.float32(1.0 / 255.0)


def _around(grid: Grid, x_um: float, y_um: float, half_um: float) -> tuple[slice, slice]:
    """Return rows and columns within `half_um` of a place, clipped; an even number where possible."""
    half = round(half_um / grid.cell_um)
    column = round((x_um - grid.origin_um[0]) / grid.cell_um + 0.5)
    row = round((y_um - grid.origin_um[1]) / grid.cell_um + 0.5)
    rows = slice(max(0, row - half), min(grid.rows, row + half))
    return rows, slice(max(0, column - half), min(grid.columns, column + half))


@dataclass(frozen=True, slots=True, eq=False)
class _Layer:
    """Polygons of one layer with their boxes (N, 4), so that those of a window are found at once.

    inward: for each point the way that moves its edges inward by what filling paints too much, in texels.
    """

    points: tuple[Points, ...]
    inward: tuple[Points, ...]
    dark: NDArray[np.bool_]
    boxes: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class IndexedSide:
    """A side of a board, ready to be drawn from: made once by `index_side`, it may be used by several threads."""

    copper: _Layer
    openings: _Layer
    ink: _Layer
    holes: _Layer
    capped: _Layer
    outline: _Layer
    unknown: _Layer
    soldered: _Layer
    box_um: tuple[float, float, float, float]


def index_side(layers: SideLayers) -> IndexedSide:
    """Index the polygons of a side by their boxes."""
    outline = layers.outline or (Polygon(_EVERYWHERE),)
    everything = _layer(layers.outline or (*layers.copper, *layers.openings))
    box = (0.0, 0.0, 0.0, 0.0)
    if len(everything.boxes):
        low, high = everything.boxes[:, :2].min(axis=0), everything.boxes[:, 2:].max(axis=0)
        box = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return IndexedSide(
        copper=_layer(layers.copper),
        openings=_layer(layers.openings),
        ink=_layer(layers.ink),
        holes=_layer(Polygon(hole_outline(hole)) for hole in layers.holes if not hole.covered),
        capped=_layer(Polygon(hole_outline(hole)) for hole in layers.holes if hole.covered),
        outline=_layer(outline),
        unknown=_layer(layers.bodies),
        soldered=_layer(layers.soldered),
        box_um=box,
    )


def hole_outline(hole: Hole) -> Points:
    """Return the outline (N, 2) of a hole or slot, um."""
    end = (hole.x_um if hole.end_x_um is None else hole.end_x_um, hole.y_um if hole.end_y_um is None else hole.end_y_um)
    along = math.atan2(end[1] - hole.y_um, end[0] - hole.x_um)
    half = np.linspace(along - math.pi / 2, along + math.pi / 2, _HOLE_POINTS // 2, endpoint=True)
    cap = hole.diameter_um / 2.0 * np.column_stack((np.cos(half), np.sin(half)))
    return np.concatenate((cap + end, (hole.x_um, hole.y_um) - cap))


def draw_labels(
    side: IndexedSide, corner_um: tuple[float, float], texel_um: float, size: int, shifts: LayerShifts
) -> Labels:
    """Return the material of each texel (size, size) of a square window; `corner_um` is its lower left corner."""
    bits = np.zeros((size, size), dtype=np.uint8)
    nowhere = (0.0, 0.0)
    for bit, layer, shift_um in (
        (_COPPER, side.copper, nowhere),
        (_OPEN, side.openings, shifts.openings_um),
        (_INK, side.ink, shifts.ink_um),
        (_HOLE, side.holes, nowhere),
        (_CAPPED, side.capped, nowhere),
        (_BOARD, side.outline, nowhere),
        (_UNKNOWN, side.unknown, nowhere),
        (_SOLDERED, side.soldered, nowhere),
    ):
        _fill(bits, layer, bit, (corner_um[0] - shift_um[0], corner_um[1] - shift_um[1]), texel_um)
    return np.asarray(cv2.LUT(bits, _MATERIAL_OF_BITS, dst=bits), dtype=np.uint8)


def average(labels: Labels, corner_um: tuple[float, float], texel_um: float, factor: int) -> Planes:
    """Return the shares of the materials in cells of `factor` x `factor` texels."""
    packed = average_packed(labels, corner_um, texel_um, factor)
    return Planes(packed.grid, _unpacked(packed.shares))


def average_packed(labels: Labels, corner_um: tuple[float, float], texel_um: float, factor: int) -> PackedPlanes:
    """Return the same, packed."""
    rows, columns = labels.shape[0] // factor, labels.shape[1] // factor
    shares = np.zeros((len(Material), rows, columns), dtype=np.uint8)
    for first in range(0, rows, _BAND_ROWS):
        last = min(first + _BAND_ROWS, rows)
        band = labels[first * factor : last * factor]
        for material in Material:
            alone = cv2.inRange(band, int(material), int(material))
            if cv2.countNonZero(alone):
                shares[material, first:last] = cv2.resize(alone, (columns, last - first), interpolation=cv2.INTER_AREA)
    cell_um = texel_um * factor
    return PackedPlanes(Grid((corner_um[0] + cell_um / 2, corner_um[1] + cell_um / 2), cell_um, rows, columns), shares)


def coarser(planes: PackedPlanes, factor: int) -> Planes:
    """Return planes of cells `factor` times as wide."""
    grid = planes.grid
    rows, columns = grid.rows // factor, grid.columns // factor
    cover = np.zeros((len(Material), rows, columns), dtype=np.float32)
    for material in Material:
        cover[material] = cv2.resize(planes.plane(material), (columns, rows), interpolation=cv2.INTER_AREA)
    aside = grid.cell_um * (factor - 1) / 2
    origin = (grid.origin_um[0] + aside, grid.origin_um[1] + aside)
    return Planes(Grid(origin, grid.cell_um * factor, rows, columns), cover)


def _layer(polygons: Iterable[Polygon]) -> _Layer:
    kept = [polygon for polygon in polygons if len(polygon.points_um) >= 3]
    if not kept:
        return _Layer((), (), np.empty(0, dtype=bool), np.empty((0, 4)))
    points = tuple(np.asarray(polygon.points_um, dtype=np.float64) for polygon in kept)
    counts = np.array([len(corners) for corners in points])
    starts = np.cumsum(counts) - counts
    # All polygons at once: there are thousands, most of a few points.
    joined = np.concatenate(points)
    inward = _inward(joined, starts, counts)
    boxes = np.hstack((np.minimum.reduceat(joined, starts), np.maximum.reduceat(joined, starts)))
    dark = np.array([polygon.dark for polygon in kept], dtype=bool)
    return _Layer(points, tuple(inward[i : i + n] for i, n in zip(starts, counts, strict=True)), dark, boxes)


def _inward(points: Points, starts: NDArray[np.intp], counts: NDArray[np.intp]) -> Points:
    """Return what to add to the points (N, 2), in texels, so that filling with the border painted is true to size.

    starts, counts: of the polygons, one after the other. `fillPoly` also paints the texels that the border passes:
    about half a texel, measured along the nearer axis.
    """
    after, before = np.arange(1, len(points) + 1), np.arange(-1, len(points) - 1)
    ends = starts + counts - 1
    after[ends], before[starts] = starts, ends
    along = points[after] - points
    length = np.hypot(along[:, 0], along[:, 1])
    along /= np.where(length > 0.0, length, 1.0)[:, None]
    x, y = (points - np.repeat(points[starts], counts, axis=0)).T
    area = np.add.reduceat(x * y[after] - x[after] * y, starts)
    sense = np.repeat(np.where(area > 0.0, 1.0, -1.0), counts)
    normal = np.column_stack((-along[:, 1], along[:, 0])) * sense[:, None]
    previous = normal[before]
    # Both edges that meet in a point move by as much: a miter, of limited length.
    inner = np.maximum(1.0 + np.sum(normal * previous, axis=1), 0.4)
    miter = (normal + previous) / inner[:, None]
    return np.asarray(0.5 * miter * np.maximum(np.abs(normal), np.abs(previous)).max(axis=1)[:, None])


def _fill(bits: Labels, layer: _Layer, bit: int, corner_um: tuple[float, float], texel_um: float) -> None:
    """Set `bit` in the texels that the layer covers: one polygon at a time, for each may cover what was drawn."""
    size = bits.shape[0]
    far_um = size * texel_um
    x0, y0, x1, y1 = layer.boxes.T
    near = (x1 >= corner_um[0]) & (x0 <= corner_um[0] + far_um) & (y1 >= corner_um[1]) & (y0 <= corner_um[1] + far_um)
    wanted = np.flatnonzero(near)
    if not len(wanted):
        return
    plane = np.zeros_like(bits)
    scale = (1 << _FRACTION_BITS) / texel_um
    # fillPoly counts from pixel centres.
    offset = np.asarray(corner_um) + 0.5 * texel_um
    limit = float(1 << 28)
    for k in wanted:
        fixed = (layer.points[k] - offset) * scale + layer.inward[k] * (1 << _FRACTION_BITS)
        fixed = np.clip(fixed, -limit, limit).round().astype(np.int32)
        cv2.fillPoly(plane, [fixed], bit if layer.dark[k] else 0, cv2.LINE_8, _FRACTION_BITS)
    cv2.bitwise_or(bits, plane, dst=bits)


def _material(bits: int) -> Material:
    if not bits & _BOARD:
        return Material.OFF_BOARD
    if bits & _UNKNOWN:
        return Material.UNKNOWN
    if bits & _OPEN:
        if bits & _SOLDERED and bits & (_COPPER | _CAPPED | _HOLE):
            return Material.SOLDER
        if bits & _HOLE:
            return Material.HOLE
        # A capped hole is metal where its pad is open.
        return Material.METAL if bits & (_COPPER | _CAPPED) else Material.LAMINATE
    if bits & _INK:
        return Material.INK
    if bits & _HOLE:
        return Material.MASK
    return Material.COVERED_COPPER if bits & _COPPER else Material.MASK


_MATERIAL_OF_BITS = np.array([_material(bits) for bits in range(256)], dtype=np.uint8)
