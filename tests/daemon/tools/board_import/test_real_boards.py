"""Points on real boards, held against pictures of whole layers that share nothing with the import."""

from functools import cache
from pathlib import Path

import pytest

from daemon.domain.board import Board, Side
from daemon.tools.board_import import import_boards, net_coverage
from tests.bench.coverage.count import Counted, count, is_net

REAL = Path(__file__).parents[5] / "shared" / "boards"
NAMES = ["F1Tenth-powerboard", "bioreactor", "cloud-dripper", "glasgow-revC3", "open-motion-light", "pico-ice-rev1"]
OFF_UM = 30.0
"""The pictures have 20 um to the pixel."""
pytestmark = pytest.mark.timeout(300)
boards = pytest.mark.parametrize("name", [n for n in NAMES if (REAL / n).is_dir()])


@cache
def _read(name: str) -> tuple[dict[Side, Board], Counted]:
    return import_boards(REAL / name, "top"), count(REAL / name)


@boards
def test_nine_nets_in_ten_that_have_bare_metal_have_a_point(name: str) -> None:
    read, counted = _read(name)
    offered = net_coverage(list(read.values())).either
    served = [net for net in counted.bare_nets if any(is_net(net, whole) for whole in offered)]
    assert len(served) >= 0.9 * len(counted.bare_nets)


@boards
def test_every_net_without_a_point_has_a_reason(name: str) -> None:
    read, counted = _read(name)
    for board in read.values():
        told = {p.net for p in board.test_points()} | board.unserved.keys()
        assert not [net for net in counted.nets if not any(is_net(net, whole) for whole in told)]
        assert all(p.why_not for p in board.points if not p.probeable)


@boards
def test_every_point_stands_on_bare_metal_of_its_own_net_with_the_room_it_says(name: str) -> None:
    read, counted = _read(name)
    bad = []
    for side, board in read.items():
        for point in board.test_points():
            x, y = counted.from_board(side, *point.place_um)
            if point.hole_um is not None and point.stands_round:
                continue  # touched over its hole
            room_um = counted.room[side][counted.grid.pixel(x, y)] * 1e3
            nets = counted.nets_at(side, x, y)
            if point.net is not None and not all(is_net(net, point.net) for net in nets):
                bad.append((side, point.name, "net", point.net, nets))
            if room_um < (point.room_um or 0.0) - OFF_UM:
                bad.append((side, point.name, "room", point.room_um, room_um))
    assert not bad, bad[:20]


@boards
def test_no_two_points_have_one_name(name: str) -> None:
    for board in _read(name)[0].values():
        names = [p.name for p in board.points]
        assert len(set(names)) == len(names)
        assert not set(names) & set(board.hidden)


@boards
def test_the_ranks_of_a_net_count_from_nought(name: str) -> None:
    for board in _read(name)[0].values():
        for net in {p.net for p in board.test_points() if p.net}:
            assert [p.rank for p in board.of_net(net)] == list(range(len(board.of_net(net))))
