"""Edge of a board: the polygon of the outline layer that holds the pads, its cut-outs, and the box round it.

A drawing's frame is larger than the edge, a cut-out or a logo holds no pads.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.shapes import Shape, boxed, centre_line_box, outline_polygons

Box = tuple[float, float, float, float]
Places = npt.NDArray[np.float64]

_MOST = 0.97
"""The edge holds at least this share of the pads; some lie on it (castellations) or are drawn beside the board."""
_SAME_MM = 0.01
_SMALLEST_MM2 = 0.5


def edge_and_box(
    outline: Sequence[Any], pads_mm: Places, others: Iterable[Sequence[Shape]]
) -> tuple[tuple[Shape, ...], Box]:
    """Return the edge with its cut-outs (not dark), and its box.

    Args:
        outline: gerbonara objects of the outline layer; none where a folder has no such layer.
        pads_mm: (N, 2) places of pads.
        others: copper and mask, whose extent is taken for a board that comes without an outline.

    """
    if not outline:
        boxes = np.array([shape.box_mm for shapes in others for shape in shapes]).reshape(-1, 4)
        x0, y0 = boxes[:, :2].min(axis=0).tolist()
        x1, y1 = boxes[:, 2:].max(axis=0).tolist()
        return (boxed((x0, y0, x1, y1)),), (x0, y0, x1, y1)
    drawn = centre_line_box(outline)
    polygons = [shape for shape in outline_polygons(outline) if _area_mm2(shape) > _SMALLEST_MM2]
    if not polygons:
        return (boxed(drawn),), drawn
    edge = _edge(polygons, pads_mm)
    if edge is None:
        return tuple(polygons), drawn
    cut = [replace(shape, dark=False) for shape in polygons if shape is not edge and _is_cut(shape, edge, pads_mm)]
    near = max(abs(a - b) for a, b in zip(edge.box_mm, drawn, strict=True)) < _SAME_MM
    return (edge, *cut), drawn if near else edge.box_mm


def _edge(polygons: Sequence[Shape], pads_mm: Places) -> Shape | None:
    """Return the smallest polygon that holds the pads; None where none holds them all, as on some panels."""
    if len(polygons) == 1 or not len(pads_mm):
        return max(polygons, key=_area_mm2)
    whole = [shape for shape in polygons if _share_held(shape, pads_mm) >= _MOST]
    return min(whole, key=_area_mm2, default=None)


def _is_cut(shape: Shape, edge: Shape, pads_mm: Places) -> bool:
    x0, y0, x1, y1 = shape.box_mm
    inside = _share_held(edge, np.array([((x0 + x1) / 2.0, (y0 + y1) / 2.0)])) > 0.0
    return inside and _area_mm2(shape) < 0.95 * _area_mm2(edge) and _share_held(shape, pads_mm) < 0.05


def _share_held(shape: Shape, places_mm: Places) -> float:
    if not len(places_mm):
        return 0.0
    outline = (shape.outline_mm * 1e3).astype(np.float32)[:, None, :]
    some = places_mm[:: max(1, len(places_mm) // 400)]
    held = [cv2.pointPolygonTest(outline, (x * 1e3, y * 1e3), measureDist=False) >= 0 for x, y in some.tolist()]
    return sum(held) / len(held)


def _area_mm2(shape: Shape) -> float:
    return abs(float(cv2.contourArea((shape.outline_mm * 1e3).astype(np.float32)))) / 1e6
