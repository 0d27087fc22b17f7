"""Colours of what a point of a board can be, by class bits, for each mask and metal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_hw.board.finish import Finish, MaskColour
from sim_hw.board.surface import BOARD, COPPER, HOLE, INK, LEAD, OPEN, SOLDER

BENCH_WHITE = (20, 21, 22)
BENCH_RED = 12

Colour = tuple[int, int, int, int]
"""Blue, green and red under the white lamp, red under the red lamp."""

_MASKS: dict[MaskColour, tuple[Colour, Colour, Colour]] = {
    "green": ((36, 50, 25, 29), (46, 63, 32, 40), (33, 47, 23, 30)),
    "red": ((27, 26, 92, 88), (36, 35, 116, 110), (25, 24, 80, 78)),
    "blue": ((92, 42, 20, 18), (112, 56, 28, 26), (84, 38, 19, 18)),
    "black": ((23, 23, 23, 16), (29, 29, 29, 21), (21, 21, 21, 16)),
    "white": ((170, 175, 173, 166), (158, 163, 161, 154), (150, 154, 152, 146)),
}
"""Mask over laminate, over copper, over a hole."""
_GOLD, _TIN = (138, 184, 206, 192), (168, 174, 177, 176)
_SOLDER, _LEAD = (150, 156, 160, 152), (128, 134, 138, 126)
_HOLE_OPEN, _LAMINATE = (11, 13, 14, 9), (62, 84, 88, 52)
_INK, _INK_ON_WHITE = (196, 202, 198, 116), (30, 31, 30, 22)


def palette(finish: Finish) -> npt.NDArray[np.uint8]:
    """Return the colours (256, 4) by class bits."""
    table = np.zeros((256, 4), dtype=np.uint8)
    for bits in range(128):
        table[bits] = _colour(bits, finish)
    return table


def _colour(bits: int, finish: Finish) -> Colour:
    if not bits & BOARD:
        return (*BENCH_WHITE, BENCH_RED)
    if bits & LEAD:
        return _LEAD
    mask, covered, over_hole = _MASKS[finish.mask]
    if bits & OPEN:
        if bits & HOLE:
            return _HOLE_OPEN
        if not bits & COPPER:
            return _LAMINATE
        return _SOLDER if bits & SOLDER else _TIN if finish.metal == "hasl" else _GOLD
    if bits & INK:
        return _INK_ON_WHITE if finish.mask == "white" else _INK
    if bits & HOLE:
        return over_hole
    return covered if bits & COPPER else mask
