"""A board with CAD layers for tests without devices: pads of any shape among metal and ink drawn from a seed."""

from __future__ import annotations

from typing import Any

import numpy as np

from daemon.domain.board import Board, BoardPoint, SeatPlace
from daemon.domain.board_layers import BoardLayers, Painting, SideShapes

WIDTH_UM, HEIGHT_UM = 40_000, 30_000


def rectangle(x_um: float, y_um: float, width_um: float, height_um: float) -> tuple[int, ...]:
    """Return a rectangle about its middle, flat whole um."""
    x0, x1 = round(x_um - width_um / 2), round(x_um + width_um / 2)
    y0, y1 = round(y_um - height_um / 2), round(y_um + height_um / 2)
    return (x0, y0, x1, y0, x1, y1, x0, y1)


def cad_pad(
    name: str, x_um: float, y_um: float, width_um: float = 900.0, height_um: float = 600.0, **more: Any
) -> BoardPoint:
    """Return a rectangular pad."""
    whole: dict[str, Any] = {
        "name": name, "kind": "pad", "x_um": x_um, "y_um": y_um, "shape": "rectangle",
        "part": name.split(".", maxsplit=1)[0],
        "metal_um": (rectangle(x_um, y_um, width_um, height_um),), "room_um": min(width_um, height_um) / 2,
    }  # fmt: skip
    return BoardPoint(**whole | more)


def cad_board(*points: BoardPoint, seed: int = 3, twice: bool = False, seat: tuple[SeatPlace, ...] = ()) -> Board:
    """Return a board whose metal and ink are drawn from a seed; `twice`: its right half repeats its left one."""
    rng = np.random.default_rng(seed)
    count = 60
    places = np.column_stack((rng.uniform(1000, WIDTH_UM - 1000, count), rng.uniform(1000, HEIGHT_UM - 1000, count)))
    sizes = rng.uniform(300, 1800, (count, 2))
    if twice:
        places[:, 0] /= 2
        places, sizes = np.vstack((places, places + np.array((WIDTH_UM / 2, 0.0)))), np.vstack((sizes, sizes))
    shapes = [rectangle(*place, *size) for place, size in zip(places, sizes, strict=True)]
    metal = (*(outline for p in points for outline in p.metal_um), *shapes[::2])
    side = SideShapes(
        copper=Painting(outlines=metal),
        openings=Painting(outlines=metal),
        ink=Painting(outlines=tuple(shapes[1::2])),
        outline=Painting(outlines=(rectangle(WIDTH_UM / 2, HEIGHT_UM / 2, WIDTH_UM, HEIGHT_UM),)),
    )
    return Board(
        name="b", side="top", width_um=WIDTH_UM, height_um=HEIGHT_UM, points=points, seat=seat,
        layers=BoardLayers(top=side, bottom=SideShapes()),
    )  # fmt: skip
