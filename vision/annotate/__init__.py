"""Drawings for people: what was seen, over the image it was seen in."""

from vision.annotate.board import BoardLook
from vision.annotate.draw import (
    Searched,
    draw_board,
    draw_control_point,
    draw_landing,
    draw_look,
    draw_test_points,
    draw_tip,
    draw_untaught,
)
from vision.annotate.landing import Landing
from vision.annotate.sheet import crop

__all__ = [
    "BoardLook",
    "Landing",
    "Searched",
    "crop",
    "draw_board",
    "draw_control_point",
    "draw_landing",
    "draw_look",
    "draw_test_points",
    "draw_tip",
    "draw_untaught",
]
