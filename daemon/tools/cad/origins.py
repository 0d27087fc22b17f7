"""Origins of layers: masks and bottoms that lie elsewhere than the copper, or mirrored."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from daemon.tools.cad.geometry import Points
from daemon.tools.cad.layers import Layers
from daemon.tools.cad.model import Side
from daemon.tools.cad.places import Places, distinct, likely_shifts, pad_places, share_met, tree_of


def check_origins(layers: Layers) -> None:
    """Refuse a mask, or a bottom, that lies elsewhere than the copper: registration by eye would be led astray."""
    pads = layers.pads()
    for side, copper in pads.items():
        mask = pad_places(layers.shapes.get((side, "mask"), ()))
        _check_side_of_mask(side, mask, pads)
        if (shift := _other_place(mask, copper)) is not None:
            raise ValueError(
                f"the {side} mask lies {shift[0]:.2f}, {shift[1]:.2f} mm from the {side} copper: "
                "export both with the same origin"
            )
        _check_mask(layers, side, mask, copper)


def _check_side_of_mask(side: Side, mask: Places, pads: Mapping[Side, Places]) -> None:
    """Refuse a mask that is the one of the other side."""
    other: Side = "bottom" if side == "top" else "top"
    if len(mask) < 8 or other not in pads:
        return
    here, there = (share_met(mask, tree_of(pads[s])) for s in (side, other))
    if there > _OTHERS and here < there - _CLEARLY / 2.0:
        raise ValueError(
            f"the {side} mask has its openings on the pads of the {other} copper ({there:.0%} of them, {here:.0%} on "
            f"its own): files are exchanged; say --layer top_mask=FILE --layer bottom_mask=FILE"
        )


def _check_mask(layers: Layers, side: Side, mask: Places, copper: Places) -> None:
    """Refuse a mask that was exported as seen from the other side; tell of one that does not fit at all."""
    tree = tree_of(copper)
    if len(mask) < 8 or tree is None or (here := share_met(mask, tree)) > 0.5:
        return
    flipped: Points = mask * (-1.0, 1.0)
    mirrored = max(share_met(flipped + s, tree) for s in likely_shifts([(flipped, copper)]))
    if mirrored > 0.7 and mirrored > here + 0.3:
        raise ValueError(
            f"the {side} mask is mirrored against the {side} copper: export it unmirrored, as seen from the top"
        )
    if here < 0.3:
        layers.notes.append(
            f"only {here:.0%} of the {side} mask's openings lie on a pad of the {side} copper: compare the two files"
        )


def _other_place(mask: Places, copper: Places) -> tuple[float, float] | None:
    """Return how far the mask lies off, if another place fits clearly better than this one."""
    tree = tree_of(copper)
    if len(mask) < 8 or tree is None or (here := share_met(mask, tree)) > 0.6:
        return None
    best = max(likely_shifts([(mask, copper)]), key=lambda s: share_met(mask + s, tree))
    there = share_met(mask + best, tree)
    return (-best[0], -best[1]) if there > 0.7 and there > here + 0.3 else None


def check_sides(layers: Layers, holes: Places) -> None:
    """Refuse a side that lies mirrored, or elsewhere, against the drills: a bottom as seen from below, another origin.

    The drills are the ones that are mirrored where both sides are.
    """
    pads = layers.pads()
    if len(holes) < 8 or any(len(p) < 8 for p in pads.values()):
        return
    met = {side: share_met(holes, tree_of(places)) for side, places in pads.items()}
    mirrored = [side for side, places in pads.items() if met[side] < _MIRRORED and _fits_mirrored(places, holes, met)]
    if mirrored and len(mirrored) == len(pads):
        raise ValueError("the drills are mirrored against the copper: export both unmirrored, as seen from the top")
    if mirrored:
        raise ValueError(
            f"the {mirrored[0]} copper is mirrored against the drills: export it unmirrored, as seen from the top"
        )
    for side, places in pads.items():
        if (off := _shift_to(holes, places, met[side])) is not None:
            raise ValueError(
                f"the {side} copper lies {off[0]:.2f}, {off[1]:.2f} mm from the drills: export all with the same origin"
            )


_MIRRORED, _CLEARLY = 0.6, 0.4
_OTHERS = 0.95
"""A mask of which more openings lie on the other side's pads, and clearly fewer on its own, is that side's."""


def _fits_mirrored(pads: Places, holes: Places, met: Mapping[Side, float]) -> bool:
    """Say whether a side's pads meet the holes clearly better with x, or y, the other way."""
    here, best = share_met(holes, tree_of(pads)), 0.0
    for flip in ((-1.0, 1.0), (1.0, -1.0)):
        flipped: Points = pads * flip
        tree = tree_of(flipped)
        best = max(best, *(share_met(holes + s, tree) for s in likely_shifts([(holes, flipped)])))
    return best > max(0.9 * max(met.values()), 0.5) and best > here + _CLEARLY


def _shift_to(holes: Places, pads: Places, here: float) -> tuple[float, float] | None:
    """Return how far pads lie from the holes, if all but none of them lie where they should."""
    if here > 1.0 - 2.0 * _CLEARLY:
        return None
    best = max(likely_shifts([(holes, pads)]), key=lambda s: share_met(holes + s, tree_of(pads)))
    there = share_met(holes + best, tree_of(pads))
    return best if there > 0.7 and there > here + _CLEARLY else None


def all_pads(layers: Layers) -> Places:
    """Return the places of all pads of both sides."""
    clouds = list(layers.pads().values())
    return distinct(np.concatenate(clouds)) if clouds else np.empty((0, 2))
