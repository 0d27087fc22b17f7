"""Real boards are read as their makers meant them; what cannot be touched is never offered."""

import math
import shutil
from pathlib import Path

import pytest

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.tools.board_import import Options, import_board, import_boards
from daemon.tools.demo.session import LARGEST_MARK_UM, choose_mark, choose_points, solitude_um

ROOT = Path(__file__).parents[4]
DEMO = ROOT / "sim_hw" / "demo_board"
REAL = ROOT.parent / "shared" / "boards"
# What each side of a real board offers, counted by hand in its netlist. Run where the boards lie beside the project.
OFFERED = [
    ("glasgow-revC3", "top", 7),
    ("glasgow-revC3", "bottom", 12),
    ("pico-ice-rev1", "top", 0),
    ("pico-ice-rev1", "bottom", 0),
    ("open-motion-light", "top", 0),
]


@pytest.fixture(scope="module")
def demo() -> Board:
    return import_board(DEMO, "top")


def test_the_demo_board_has_its_twelve_points(demo: Board) -> None:
    named = [p for p in demo.test_points() if p.name.startswith("TP")]
    assert {p.name for p in named} == {f"TP{n}" for n in range(1, 13)}
    assert {p.kind for p in named} == {"via", "site"}
    assert all(p.stands_round and p.rank == 0 for p in named)
    assert demo.width_um == pytest.approx(40_000.0)


def test_the_demonstration_serves_each_net_by_its_best_point(demo: Board) -> None:
    chosen = choose_points(demo, 100)
    assert [p.net for p in chosen] == sorted({p.net for p in demo.test_points() if p.net})
    assert all(p.rank == 0 for p in chosen)
    assert {f"TP{n}" for n in range(1, 13)} <= {p.name for p in chosen}
    few = choose_points(demo, 5)
    assert len(few) == 5
    assert {p.name for p in few} < {p.name for p in chosen}


def test_the_tangent_sites_touch(demo: Board) -> None:
    one, two = demo.point("TP6"), demo.point("TP7")
    assert abs(two.x_um - one.x_um) == pytest.approx(one.diameter_um, abs=1.0)


def test_tented_vias_are_not_even_seen_and_pins_under_their_part_not_offered(demo: Board) -> None:
    assert all(p.why_not for p in demo.points if p.name.startswith(("J", "FID")))
    assert demo.find("J1.1").why_not == "it lies under J1, which stands on this side"
    assert not any(p.diameter_um == 500.0 for p in demo.points)  # the tented ones
    with pytest.raises(Fault, match="a fiducial") as caught:
        demo.point("FID1")
    assert caught.value.kind is FaultCode.UNKNOWN_TEST_POINT


def test_the_mark_for_the_map_is_round_small_and_stands_alone(demo: Board) -> None:
    mark = choose_mark(demo)
    assert mark is not None
    assert mark.stands_round
    assert mark.round_um <= LARGEST_MARK_UM
    assert solitude_um(demo, mark) > 2000.0


def test_from_below_x_runs_the_other_way(demo: Board) -> None:
    below = import_board(DEMO, "bottom")
    named = {p.name: p for p in demo.points}
    both = [p for p in below.points if p.name in named and p.kind == "via"]
    assert both
    assert all(p.x_um == pytest.approx(demo.width_um - named[p.name].x_um, abs=0.1) for p in both)
    assert below.hidden  # the points that are on top only


@pytest.mark.parametrize(("name", "side", "count"), [row for row in OFFERED if (REAL / row[0]).is_dir()])
def test_real_boards_offer_what_their_netlist_says(name: str, side: str, count: int) -> None:
    board = import_board(REAL / name, side)  # type: ignore[arg-type]  # a literal from the table
    assert sum(p.name.startswith("TP") for p in board.test_points()) == count


def test_a_board_file_is_read_back(demo: Board, tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    path.write_text(demo.model_dump_json())
    assert Board.load(path) == demo
    path.write_text("{}")
    with pytest.raises(ValueError, match="reprobe board"):
        Board.load(path)


@pytest.mark.parametrize(
    ("missing", "complaint"),
    [
        ("*.d356", "names the pads|netlist"),
        ("*F_Mask*", "no Gerber for top mask"),
        ("*", "no Gerber for top copper"),
    ],
)
def test_a_folder_that_lacks_a_file_says_which(tmp_path: Path, missing: str, complaint: str) -> None:
    folder = tmp_path / "board"
    shutil.copytree(DEMO, folder)
    for file in folder.glob(missing):
        file.unlink()
    with pytest.raises(ValueError, match=complaint):
        import_board(folder, "top")


def test_from_below_a_pin_is_touched_beside_its_lead(demo: Board) -> None:
    below = import_board(DEMO, "bottom")
    for pin in ("J1.1", "J1.2", "J1.3", "J1.4"):
        point = below.point(pin)
        assert point.centre_um is not None
        assert point.hole_um is not None
        away = math.dist(point.place_um, point.centre_um)
        assert away == pytest.approx((950.0 + 1600.0) / 4, abs=10.0)
        assert point.room_um == pytest.approx((1600.0 - 950.0) / 4, abs=5.0)


def test_a_part_s_pad_is_touched_away_from_the_part(demo: Board) -> None:
    """U1's pads are 0.6 x 1.55 mm; their middles lie at 8.4 and 13.6 mm."""
    for number in range(1, 9):
        assert 7_625.0 + 250.0 - 25.0 < demo.point(f"U1.{number}").y_um < 8_400.0
        assert 13_600.0 < demo.point(f"U1.{number + 8}").y_um < 14_375.0 - 250.0 + 25.0


def test_without_parts_every_pad_is_touched_in_its_middle() -> None:
    board = import_boards(DEMO, "top", Options(bare=True))["top"]
    assert board.point("U1.3").place_um == pytest.approx((16_540.0, 8_400.0), abs=5.0)
    assert board.point("J1.1").kind == "pin"
    assert board.layers is not None
    assert not board.layers.top.bodies
    assert not board.layers.top.soldered.outlines


def test_the_points_of_a_net_are_its_test_point_then_its_pads(demo: Board) -> None:
    assert [p.name for p in demo.of_net("CLK")] == ["TP1", "U1.1", "R1.1"]


def test_a_board_file_carries_the_layers_of_both_sides(demo: Board) -> None:
    top, bottom = demo.side_layers("top"), demo.side_layers("bottom")
    assert top is not None
    assert bottom is not None
    assert top.copper
    assert top.ink
    assert len(top.holes) == len(bottom.holes)
    seen = {(h.x_um, h.y_um) for h in top.holes}
    assert all(any(math.dist((40_000.0 - h.x_um, h.y_um), at) < 1.0 for at in seen) for h in bottom.holes)
    capped = [h for h in top.holes if h.diameter_um == 250.0]
    assert capped
    assert all(h.covered for h in capped)


def test_each_net_that_no_point_serves_has_its_reason() -> None:
    below = import_board(DEMO, "bottom")
    assert below.unserved["DATA2"] == "TP5: it lies on the top (and 1 more)"
    offered = {p.net for p in below.test_points()}
    assert offered.isdisjoint(below.unserved)
    assert not import_board(DEMO, "top").unserved


def test_the_file_says_what_it_was_made_of(demo: Board) -> None:
    assert len(demo.sources) >= 9
    assert all(len(digest) == 64 for digest in demo.sources.values())
    assert any("bare metal" in note for note in demo.notes), "what was taken for granted is said"
