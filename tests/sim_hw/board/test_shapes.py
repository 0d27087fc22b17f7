"""Polygons of apertures whose corners are known by hand."""

import math

import numpy as np
import pytest
from gerbonara import GerberFile

from sim_hw.board.shapes import shapes


def _corners(primitive: str) -> np.ndarray:
    """Return the polygon of one flash at (3, 0) mm of a macro with one primitive."""
    text = f"%FSLAX46Y46*%\n%MOMM*%\n%AMTURNED*{primitive}*%\n%ADD10TURNED*%\nD10*\nX3000000Y0D03*\nM02*\n"
    (shape,) = shapes(GerberFile.from_string(text).objects)
    return shape.outline_mm


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("turn_deg", [0, 30, -45, 90, 200])
@pytest.mark.parametrize("middle_mm", [(0.0, 0.0), (0.5, -0.2)])
def test_turned_rectangle_of_a_macro_lies_turned_counter_clockwise(
    turn_deg: int, middle_mm: tuple[float, float]
) -> None:
    """Gerber format specification, 4.5.1.5: the primitive turns about the macro's origin, not about its own middle."""
    found = _corners(f"21,1,2,1,{middle_mm[0]},{middle_mm[1]},{turn_deg}")
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    upright = np.array([(-1, -0.5), (1, -0.5), (1, 0.5), (-1, 0.5)]) + middle_mm
    expected = upright @ np.array([(c, s), (-s, c)]) + (3.0, 0.0)
    assert np.allclose(sorted(found.tolist()), sorted(expected.tolist()), atol=1e-6)
