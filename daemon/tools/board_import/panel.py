"""Boards of a panel: where each copy lies on a side, and where the pins of the copies lie that the file is not for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daemon.domain.board import PanelCopy
from daemon.tools.board_import.frame import Frame, Points, SideCad
from daemon.tools.cad.copies import carried
from daemon.tools.cad.model import Cad


def copies_on(cad: Cad, frame: Frame) -> tuple[PanelCopy, ...]:
    """Return the copies in a side's frame, each by its lower left corner there; from below, turns run the other way."""
    mirrored = frame.side == "bottom"
    found = []
    for copy in cad.copies:
        corner = np.array([(copy.x_mm + copy.width_mm if mirrored else copy.x_mm, copy.y_mm)])
        x, y = frame.to_um(carried(corner, replace(copy, turn_deg=0.0), copy))[0]
        turn = (-copy.turn_deg if mirrored else copy.turn_deg) % 360.0
        found.append(PanelCopy(name=copy.name, x_um=round(float(x), 2), y_um=round(float(y), 2), turn_deg=turn))
    return tuple(found)


def places_elsewhere(side: SideCad) -> Points:
    """Return where the pins of all other copies lie, (N, 2) um."""
    cad = side.cad
    pins = np.array([(p.x_mm, p.y_mm) for p in side.pins]).reshape(-1, 2)
    others = [c for i, c in enumerate(cad.copies) if i != cad.named_copy]
    if not others or not len(pins):
        return np.empty((0, 2))
    here = cad.copies[cad.named_copy]
    return np.vstack([side.frame.to_um(carried(pins, here, there)) for there in others])
