"""Sides of points whose list does not say them: told by the pad that lies there, and not guessed where there are two.

The fingers of an edge connector lie back to back, on two nets.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daemon.tools.cad.model import Pin
from daemon.tools.cad.netlist_fit import Metal
from daemon.tools.cad.places import SAME_PLACE_MM, Places, tree_of


def with_sides(pins: Sequence[Pin], unsaid: Collection[int], metal: Metal, source: str) -> tuple[list[Pin], list[str]]:
    """Return the pins with the sides that the layers tell, without those that may be on either; and what to tell."""
    if not unsaid:
        return list(pins), []
    places = np.array([(p.x_mm, p.y_mm) for p in pins])
    there = {side: _near(places, pads) for side, pads in metal.pads.items()}
    drilled = _near(places, metal.holes)
    found: list[Pin] = []
    doubtful: list[str] = []
    for k, pin in enumerate(pins):
        sides = frozenset(side for side, near in there.items() if near[k])
        if k not in unsaid or pin.hole_mm or drilled[k] or not sides:
            found.append(pin)
        elif len(sides) == 1:
            found.append(replace(pin, access=sides))
        else:
            doubtful.append(f"{pin.part}.{pin.pin}" if pin.pin else pin.part)
    if not doubtful:
        return found, []
    more = f" and {len(doubtful) - 8} more" if len(doubtful) > 8 else ""
    told = (
        f"{', '.join(doubtful[:8])}{more} have a pad on both sides, and {source} does not say which is meant: "
        "left out; add a column side"
    )
    return found, [told]


def _near(places: Places, pads: Places) -> NDArray[np.bool_]:
    """Say which places have a pad, or a hole, there."""
    tree = tree_of(pads)
    if tree is None:
        return np.zeros(len(places), np.bool_)
    near: NDArray[np.bool_] = np.asarray(tree.query(places)[0]) <= SAME_PLACE_MM
    return near
