"""Drawings for people: what was seen, over the image it was seen in."""

from vision.annotate.draw import (
    Searched,
    crop,
    draw_control_point,
    draw_look,
    draw_test_points,
    draw_tip,
    draw_untaught,
)

__all__ = ["Searched", "crop", "draw_control_point", "draw_look", "draw_test_points", "draw_tip", "draw_untaught"]
