"""CAD layers of one side for the board file: whole um, simplified to 3 um, with bodies and soldered pads."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from daemon.domain.board_layers import Body, HoleShape, Painting, SideShapes
from daemon.tools.board_import.frame import Painted, Points, SideCad
from daemon.tools.board_import.pads import Openings
from daemon.tools.board_import.parts import PartBody, closed_drawings

TOLERANCE_UM = 3.0
ROW_UM, ROW_SHARE = 3000.0, 0.25
"""A guess as long, and as slender, is a row of pads."""
ROOM_SHARE, MOST_ROOM_UM = 0.4, 3500.0
"""How far to either side of its row a connector may reach, of the row's length."""


def side_shapes(
    side: SideCad, openings: Openings, bodies: Sequence[PartBody], soldered: Sequence[tuple[int, ...]], *, bare: bool
) -> SideShapes:
    """Put the layers of a side together; bodies and soldered pads only where parts are fitted.

    soldered: outlines of the parts' bare pads, used where no paste is printed.
    """
    paste = painting(side.paste)
    fitted = Painting(outlines=(*paste.outlines, *soldered), removes=paste.removes)
    return SideShapes(
        copper=painting(side.copper),
        openings=painting(side.mask),
        ink=painting(side.silk),
        holes=tuple(_holes(side, openings)),
        outline=painting(side.outline),
        bodies=() if bare else tuple(_bodies(side, bodies)),
        soldered=Painting() if bare else fitted,
    )


def painting(layer: Painted) -> Painting:
    """Simplify a layer."""
    outlines: list[tuple[int, ...]] = []
    removes: list[int] = []
    for polygon, dark in zip(layer.polygons, layer.dark, strict=True):
        simple = simplified(polygon)
        if simple is not None:
            if not dark:
                removes.append(len(outlines))
            outlines.append(simple)
    return Painting.model_construct(outlines=tuple(outlines), removes=tuple(removes))


def simplified(polygon: Points) -> tuple[int, ...] | None:
    """Return a polygon as flat whole um, no farther from it than `TOLERANCE_UM`; None where nothing is left."""
    # Corners are rounded to 1 um afterwards, which may add 0.7 um.
    simple = cv2.approxPolyDP(polygon.astype(np.float32)[:, None], TOLERANCE_UM - 0.7, closed=True)
    if len(simple) < 3:
        return None
    return tuple(np.rint(simple).astype(int).ravel().tolist())


def _holes(side: SideCad, openings: Openings) -> list[HoleShape]:
    found = []
    for hole in side.holes:
        slot = (hole.x, hole.y) != (hole.end_x, hole.end_y)
        found.append(
            HoleShape(
                x_um=round(hole.x, 1),
                y_um=round(hole.y, 1),
                diameter_um=round(hole.diameter, 1),
                end_um=(round(hole.end_x, 1), round(hole.end_y, 1)) if slot else None,
                plated=hole.plated is not False,
                covered=hole.filled or not openings.at(hole.x, hole.y),
            )
        )
    return found


def _with_room(guess: Points) -> Points:
    """Return a guessed body, or that of a single row of pads with room across: a connector reaches far beyond it."""
    middle, (width, height), turn_deg = cv2.minAreaRect(guess.astype(np.float32))
    long, short = max(width, height), min(width, height)
    if long < ROW_UM or short > ROW_SHARE * long:
        return guess
    across = short + 2.0 * min(ROOM_SHARE * long, MOST_ROOM_UM)
    size = (width, across) if width >= height else (across, height)
    return np.asarray(cv2.boxPoints((middle, size, turn_deg)), dtype=np.float64)


def _bodies(side: SideCad, bodies: Sequence[PartBody]) -> list[Body]:
    """Return what hides the board: the room that parts take where it is drawn, else their bodies."""
    rooms = closed_drawings(side.courtyard, side.frame.size_um)
    drawn: list[tuple[Points, str | None]] = [(room, None) for room in rooms] or [
        (b.polygon if b.drawn else _with_room(b.polygon), b.part) for b in bodies
    ]
    outlines = [(simplified(polygon), part) for polygon, part in drawn]
    return [Body(outline=outline, part=part) for outline, part in outlines if outline is not None]
