"""What lies under the needle's end, on a drawn board and on the demo board."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_hw.board.board import Board, Layers
from sim_hw.board.nest import InNest
from sim_hw.board.netlist import Record
from sim_hw.board.parts import Body
from sim_hw.board.shapes import Shape
from sim_hw.electric.contact import METAL, Footing, under
from tests.sim_hw.electric.rig import demo_board

RADIUS_UM = 25.0


def _box(x0: float, y0: float, x1: float, y1: float, *, dark: bool = True) -> Shape:
    return Shape(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), dark, (x0, y0, x1, y1))


def _disc(x: float, y: float, diameter: float) -> Shape:
    turn = np.linspace(0.0, 2 * math.pi, 256, endpoint=False)
    outline = np.column_stack((x + diameter / 2 * np.cos(turn), y + diameter / 2 * np.sin(turn)))
    return Shape(outline, True, (x - diameter / 2, y - diameter / 2, x + diameter / 2, y + diameter / 2))


def _board(**layers: tuple[Shape, ...]) -> Board:
    """A board of 20 mm with a pad A of 1 mm at (5, 5) and a pad B 0.03 mm beside it; its mask opens over both."""
    drawn = {
        "copper": (_disc(5.0, 5.0, 1.0), _disc(6.03, 5.0, 1.0)),
        "mask": (_disc(5.0, 5.0, 1.2), _disc(6.03, 5.0, 1.2)),
        "silk": (), "holes": (), "outline": (_box(0.0, 0.0, 20.0, 20.0),), **layers,
    }  # fmt: skip
    pads = tuple(
        Record(net, part, "1", x, 5.0, 1.0, 1.0, None, 1, 0) for part, x, net in (("A", 5.0, "NA"), ("B", 6.03, "NB"))
    )
    return Board("drawn", "top", (0.0, 0.0, 20.0, 20.0), (), Layers(**drawn), (0.0, 0.0), pads=pads)


class _Ground:
    def __init__(self, board: Board) -> None:
        self._nest = InNest.made(board)

    def under(self, x_mm: float, y_mm: float, radius_um: float) -> Footing:
        return under(self._nest, x_mm, y_mm, radius_um)


def test_in_a_pads_middle_all_of_the_end_is_on_its_net() -> None:
    patch = _Ground(_board()).under(5.1, 5.1, RADIUS_UM).patches
    assert [(one.material, one.share, one.net, one.pad, one.centre_mm) for one in patch] == [
        (METAL, 1.0, "NA", "A.1", (5.0, 5.0))
    ]


@pytest.mark.parametrize("off_um", [-15.0, 0.0, 10.0, 20.0])
def test_at_an_edge_the_share_is_that_of_the_circles_segment(off_um: float) -> None:
    """Against the area of a disc cut by a straight line."""
    footing = _Ground(_board()).under(5.0, 5.5 + off_um / 1e3, RADIUS_UM)
    cut = off_um / RADIUS_UM
    outside = (math.acos(-cut) + cut * math.sqrt(1 - cut * cut)) / math.pi
    assert footing.metal_share == pytest.approx(1.0 - outside, abs=0.03)
    assert {patch.material for patch in footing.patches} == {METAL, "laminate"}


def test_between_two_pads_both_are_held_when_both_carry_enough() -> None:
    ground = _Ground(_board())
    both = ground.under(5.515, 5.0, 60.0)
    assert {patch.net for patch in both.held_by(0.25)} == {"NA", "NB"}
    assert both.held_by(0.6) == ()
    assert {patch.net for patch in ground.under(5.495, 5.0, RADIUS_UM).held_by(0.3)} == {"NA"}


def test_mask_hole_bare_board_and_beside_it_are_no_metal() -> None:
    ground = _Ground(_board(holes=(_disc(5.0, 5.0, 0.6),)))
    for place, material in (
        ((5.0, 5.0), "hole"),
        ((10.0, 10.0), "mask"),
        ((5.0, 5.55), "laminate"),
        ((-1.0, 5.0), "off_board"),
    ):
        footing = ground.under(*place, RADIUS_UM)
        assert (footing.material, footing.metal_share, footing.held_by(0.01)) == (material, 0.0, ())


def test_on_a_narrow_plated_hole_the_needle_stands_on_its_rim() -> None:
    via = (_disc(5.0, 5.0, 0.15),)
    held = _Ground(_board(holes=via)).under(5.0, 5.0, RADIUS_UM).held_by(0.3)
    assert [(patch.net, patch.share) for patch in held] == [("NA", 1.0)]
    unplated = _Ground(_board(holes=via, copper=()))
    assert unplated.under(5.0, 5.0, RADIUS_UM).held_by(0.01) == ()


def test_what_a_clear_polygon_takes_away_is_not_there() -> None:
    copper = (_disc(5.0, 5.0, 1.0), _box(4.9, 4.9, 5.1, 5.1, dark=False))
    ground = _Ground(_board(copper=copper))
    assert ground.under(5.0, 5.0, RADIUS_UM).material == "laminate"


def test_metal_that_no_file_names_is_metal_without_a_net() -> None:
    ground = _Ground(_board(copper=(_disc(15.0, 15.0, 1.0),), mask=(_disc(15.0, 15.0, 1.2),)))
    patch = ground.under(15.0, 15.0, RADIUS_UM).patches[0]
    assert (patch.material, patch.net, patch.pad) == (METAL, None, None)


def test_a_body_stands_in_the_way_of_what_is_below_it() -> None:
    board = _board()
    outline = np.array([(4.0, 4.0), (5.0, 4.0), (5.0, 6.0), (4.0, 6.0)])
    covered = replace(board, bodies=(Body("U1", outline, 900.0, 100, 80),))
    assert _Ground(covered).under(4.8, 5.0, RADIUS_UM).material == "body"
    assert _Ground(covered).under(5.2, 5.0, RADIUS_UM).material == METAL


def test_vias_of_one_net_have_keys_of_their_own() -> None:
    ground = _Ground(demo_board())
    vias = [target for target in demo_board().targets if target.kind == "via" and target.net == "GND"]
    keys = {ground.under(via.x_mm, via.y_mm, RADIUS_UM).held_by(0.3)[0].key for via in vias}
    assert len(keys) == len(vias) > 5


def test_every_target_of_the_demo_board_is_its_own_metal_beside_a_wide_hole() -> None:
    board = demo_board()
    ground = _Ground(board)
    for target in board.targets:
        wide = (target.hole_diameter_mm or 0.0) > 0.3
        at_mm = ((target.hole_diameter_mm or 0.0) + target.pad_diameter_mm) / 4.0 if wide else 0.0
        (held,) = ground.under(target.x_mm + at_mm, target.y_mm, 20.0).held_by(0.5)
        assert (held.net or "", held.centre_mm) == (target.net, pytest.approx((target.x_mm, target.y_mm), abs=0.02))
