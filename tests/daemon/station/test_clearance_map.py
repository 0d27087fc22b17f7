"""What stands on a board by its file: heights where they are told, endlessly high where nothing is known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from daemon.config.sections.motion import ClearanceSection
from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_layers import BoardLayers, Body, HoleShape, Painting, SideShapes
from daemon.station.clearance_map import ClearanceMap

WIDTH_UM, HEIGHT_UM = 40_000, 30_000
EDGE = (0, 0, WIDTH_UM, 0, WIDTH_UM, HEIGHT_UM, 0, HEIGHT_UM)
SECTION = ClearanceSection(heights_um={"C": 800.0, "CN": 6000.0}, outline_um=0.0)


def box(x: int, y: int, width: int = 2000, height: int = 1000) -> tuple[int, ...]:
    """Return a rectangle's outline about a place."""
    x0, x1, y0, y1 = x - width // 2, x + width // 2, y - height // 2, y + height // 2
    return x0, y0, x1, y0, x1, y1, x0, y1


def a_map(section: ClearanceSection = SECTION, *, bottom: SideShapes | None = None, **shapes: Any) -> ClearanceMap:
    top = SideShapes(**{"outline": Painting(outlines=(EDGE,)), **shapes})
    layers = BoardLayers(top=top, bottom=bottom or SideShapes())
    board = Board(name="b", side="top", width_um=WIDTH_UM, height_um=HEIGHT_UM, points=(), layers=layers)
    return ClearanceMap(board, section)


def height_um(known: ClearanceMap, x: float, y: float, reach_um: float = 100.0) -> float:
    return known.height_um(np.array([(x - 50.0, y - 50.0), (x + 50.0, y - 50.0), (x, y + 50.0)]), reach_um)


@pytest.mark.parametrize(
    ("part", "told_um", "height"),
    [("C7", None, 800.0), ("C7", 650.0, 650.0), ("CN7", None, 6000.0), ("R1", None, math.inf), (None, None, math.inf)],
)
def test_a_part_is_as_high_as_its_file_or_its_letters_say_and_else_not_known(
    part: str | None, told_um: float | None, height: float
) -> None:
    known = a_map(bodies=(Body(outline=box(10_000, 10_000), part=part, height_um=told_um),))
    assert height_um(known, 10_000, 10_000) == height
    assert height_um(known, 11_140, 10_000) == height
    assert height_um(known, 11_160, 10_000) == 0.0
    assert height_um(known, 11_160, 10_000, reach_um=2000.0) == height


def test_the_highest_counts_of_several_and_each_reaches_beyond_its_outline() -> None:
    bodies = (
        Body(outline=box(10_000, 10_000), part="C1"),
        Body(outline=box(13_000, 10_000), part="CN1"),
    )
    assert height_um(a_map(bodies=bodies), 11_500, 10_000, reach_um=500.0) == 6000.0
    assert height_um(a_map(bodies=bodies), 11_200, 10_000, reach_um=300.0) == 800.0
    wide = SECTION.model_copy(update={"outline_um": 500.0})
    assert height_um(a_map(wide, bodies=bodies), 11_200, 10_000, reach_um=300.0) == 6000.0


@pytest.mark.parametrize(("nest_um", "height"), [(None, math.inf), (2000.0, 2000.0)])
def test_beyond_the_edge_in_a_cut_out_and_over_a_large_hole_stands_the_nest(
    nest_um: float | None, height: float
) -> None:
    section = SECTION.model_copy(update={"nest_um": nest_um, "bare": True})
    outline = Painting(outlines=(EDGE, box(20_000, 20_000)), removes=(1,))
    holes = (HoleShape(x_um=5000.0, y_um=5000.0, diameter_um=3200.0), HoleShape(x_um=30e3, y_um=5e3, diameter_um=300.0))
    known = a_map(section, outline=outline, holes=holes)
    assert height_um(known, 100, 15_000) == height
    assert height_um(known, -3000, 15_000) == height
    assert height_um(known, 20_000, 20_000) == height
    assert height_um(known, 5000, 5000) == height
    assert height_um(known, 5000 + 4650, 5000) == height, "a screw's head"
    assert height_um(known, 5000, 10_000) == 0.0
    assert height_um(known, 30_000, 5000) == 0.0
    assert height_um(known, 200, 15_000) == 0.0


def test_solder_of_a_part_that_is_drawn_is_low_and_that_of_one_that_is_not_stands_for_anything() -> None:
    soldered = Painting(outlines=(box(10_000, 10_000, 300, 300), box(20_000, 10_000, 300, 300)))
    known = a_map(soldered=soldered, bodies=(Body(outline=box(10_000, 10_000), part="C1", height_um=100.0),))
    assert height_um(known, 10_000, 10_000) == SECTION.solder_um
    assert height_um(known, 20_000, 10_000) == math.inf


def test_a_part_with_leads_may_stand_on_this_side_though_its_file_has_it_on_the_other() -> None:
    """It should take the other side's outline, mirrored; as high as told, but no lower than a lead is long."""
    soldered = Painting(outlines=(box(10_000, 10_000, 1600, 1600),))
    hole = HoleShape(x_um=10_000.0, y_um=10_000.0, diameter_um=1000.0)
    for part, height in (("J1", math.inf), ("CN1", 6000.0), ("C1", SECTION.lead_um)):
        below = SideShapes(bodies=(Body(outline=box(WIDTH_UM - 10_000, 10_000, 4000, 4000), part=part),))
        known = a_map(soldered=soldered, holes=(hole,), bottom=below)
        assert height_um(known, 10_000, 10_000) == height_um(known, 11_900, 10_000) == height
        assert height_um(known, 12_200, 10_000) == 0.0
        beside = SideShapes(bodies=(Body(outline=box(10_000, 10_000, 4000, 4000), part=part),))
        assert height_um(a_map(soldered=soldered, holes=(hole,), bottom=beside), 10_000, 10_000) == math.inf
    flat = SideShapes(bodies=(Body(outline=box(WIDTH_UM - 10_000, 10_000, 4000, 4000), part="J1"),))
    assert height_um(a_map(bodies=(Body(outline=box(3000, 3000)),), bottom=flat), 10_000, 10_000) == 0.0


def test_a_file_that_tells_of_no_parts_is_believed_only_where_none_are_fitted() -> None:
    assert height_um(a_map(), 10_000, 10_000) == math.inf
    assert height_um(a_map(SECTION.model_copy(update={"bare": True})), 10_000, 10_000) == 0.0
    edgeless = a_map(SECTION.model_copy(update={"bare": True}), outline=Painting())
    assert height_um(edgeless, 10_000, 10_000) == math.inf
    flat = Board(name="b", side="top", width_um=4e4, height_um=3e4, points=())
    assert not ClearanceMap(flat, SECTION).known


def test_a_pad_that_is_told_to_stand_up_is_as_high_as_that() -> None:
    raised = BoardPoint(name="J1.1", kind="pin", x_um=10_000.0, y_um=10_000.0, diameter_um=1_000.0, stands_um=4_200.0)
    shapes = SideShapes(outline=Painting(outlines=(EDGE,)))
    layers = BoardLayers(top=shapes, bottom=SideShapes())
    board = Board(name="b", side="top", width_um=WIDTH_UM, height_um=HEIGHT_UM, points=(raised,), layers=layers)
    known = ClearanceMap(board, SECTION.model_copy(update={"bare": True}))
    assert height_um(known, 10_000, 10_000) == 4_200.0
    assert height_um(known, 10_700, 10_000) == 0.0
    assert height_um(known, 10_700, 10_000, reach_um=200.0) == 4_200.0
