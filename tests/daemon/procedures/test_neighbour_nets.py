"""The nets on which a needle that ends up beside its point may stand are known by their metal, whatever its shape."""

from __future__ import annotations

from daemon.procedures.neighbour_nets import neighbour_nets
from tests.daemon.procedures.cad_board import cad_board, cad_pad


def test_a_net_is_near_where_its_metal_is_within_reach_and_not_only_its_middle() -> None:
    own = cad_pad("A", 10_000.0, 10_000.0, net="NA")
    long = cad_pad("LONG", 10_000.0, 13_000.0, 900.0, 5_000.0, net="NL")
    far = cad_pad("FAR", 14_000.0, 10_000.0, net="NF")
    via = cad_pad("V", 9_200.0, 10_000.0, shape="round", diameter_um=300.0, net="NV")
    board = cad_board(own, long, far, via)
    assert neighbour_nets(board, own, 700.0) == ("NL", "NV")
    assert neighbour_nets(board, own, 600.0) == ("NL",)


def test_other_pads_of_the_own_net_and_of_none_are_no_neighbours() -> None:
    own = cad_pad("A", 10_000.0, 10_000.0, net="NA")
    twin = cad_pad("A2", 10_000.0, 10_700.0, net="NA")
    bare = cad_pad("N", 10_000.0, 9_300.0, net=None)
    assert neighbour_nets(cad_board(own, twin, bare), own, 700.0) == ()


def test_a_place_aside_on_the_pads_own_metal_has_the_neighbours_of_that_place() -> None:
    own = cad_pad("A", 10_000.0, 10_000.0, 4_000.0, 600.0, net="NA")
    other = cad_pad("B", 13_000.0, 10_000.0, net="NB")
    board = cad_board(own, other)
    assert neighbour_nets(board, own, 700.0) == ()
    assert neighbour_nets(board, own.model_copy(update={"x_um": 11_900.0}), 700.0) == ("NB",)


def test_of_all_targets_only_those_near_a_place_are_held_against_their_shape() -> None:
    own = cad_pad("A", 10_000.0, 10_000.0, net="NA")
    beside = cad_pad("B", 10_000.0, 11_000.0, net="NB")
    board = cad_board(own, beside, *(cad_pad(f"F{n}", 15_000.0 + n, 10_000.0) for n in range(20)))
    assert [point.name for point in board.points_near(own.place_um, 700.0)] == ["A", "B"]
    assert neighbour_nets(board.model_copy(update={"points": (own,)}), own, 700.0) == ()
    assert board.model_copy(update={"points": ()}).points_near(own.place_um, 700.0) == ()
