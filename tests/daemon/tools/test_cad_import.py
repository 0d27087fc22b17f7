"""Real boards are read as their makers meant them; what cannot be touched is never offered."""

import shutil
from pathlib import Path

import pytest

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.tools.cad_import import import_board
from daemon.tools.demo.session import choose_mark, choose_points

ROOT = Path(__file__).parents[3]
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
    names = [p.name for p in choose_points(demo, 100)]
    assert names == [f"TP{n}" for n in range(1, 13)]
    kinds = {p.name: p.kind for p in demo.test_points()}
    assert set(kinds.values()) == {"via", "site"}
    assert demo.width_um == pytest.approx(40_000.0)


def test_the_tangent_sites_touch(demo: Board) -> None:
    one, two = demo.point("TP6"), demo.point("TP7")
    assert abs(two.x_um - one.x_um) == pytest.approx(one.diameter_um, abs=1.0)


def test_tented_vias_are_not_even_seen_and_pins_not_offered(demo: Board) -> None:
    assert all(p.why_not for p in demo.points if p.name.startswith(("J", "FID")))
    assert not any(p.diameter_um == 500.0 for p in demo.points)  # the tented ones
    with pytest.raises(Fault, match="a fiducial") as caught:
        demo.point("FID1")
    assert caught.value.kind is FaultCode.UNKNOWN_TEST_POINT


def test_a_fiducial_is_the_mark_for_the_map(demo: Board) -> None:
    assert choose_mark(demo).kind == "fiducial"


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
    assert len(choose_points(board, 100)) == count


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
        ("*.d356", "no IPC-D-356"),
        ("*F_Mask*", "no Gerber for top mask"),
        ("*Edge_Cuts*", "outline"),
        ("*", "cannot be read"),
    ],
)
def test_a_folder_that_lacks_a_file_says_which(tmp_path: Path, missing: str, complaint: str) -> None:
    folder = tmp_path / "board"
    shutil.copytree(DEMO, folder)
    for file in folder.glob(missing):
        file.unlink()
    with pytest.raises(ValueError, match=complaint):
        import_board(folder, "top")


def test_a_netlist_of_another_board_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "board"
    shutil.copytree(DEMO, folder)
    netlist = next(folder.glob("*.d356"))
    lines = netlist.read_text().splitlines()
    for n, line in enumerate(lines):
        if line.startswith("317"):
            lines[n] = line.replace("Y+0", f"Y+0{n % 7}"[:4], 1)
    netlist.write_text("\n".join(lines))
    with pytest.raises(ValueError, match="does not fit the drill"):
        import_board(folder, "top")
