"""Folders as tools deliver them: sub-folders, zips, roles that were found out, odd files, slots in every spelling."""

import json
import shutil
from pathlib import Path

import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.board.drills import DrillFormat, open_drills, routed
from sim_hw.board.files import open_folder
from sim_hw.board.roles import ROLES_FILE
from sim_hw.board.writer import GerberText
from tests.sim_hw.small_board import Pin, RectPad, write_board

FOREIGN = {
    "b-F_Cu.gtl": "art/ETCH_1.art",
    "b-F_Mask.gts": "art/SM_1.art",
    "b-B_Cu.gbl": "art/ETCH_2.art",
    "b-B_Mask.gbs": "art/SM_2.art",
    "b-Edge_Cuts.gm1": "art/OUT.art",
    "b-PTH.drl": "nc/holes-1.tapx",
    "b.d356": "net/board.lst",
}
ROLES = {
    "art/ETCH_1.art": "top copper",
    "art/SM_1.art": "top mask",
    "art/ETCH_2.art": "bottom copper",
    "art/SM_2.art": "bottom mask",
    "art/OUT.art": "outline",
    "nc/holes-1.tapx": "drill plated",
    "net/board.lst": "netlist",
}


def without_attributes(folder: Path) -> Path:
    """Take out of all Gerbers what they say of themselves."""
    for path in folder.rglob("*.art"):
        path.write_text("\n".join(line for line in path.read_text().splitlines() if "%TF" not in line))
    return folder


def keep_roles(folder: Path, roles: dict[str, str] | None = None, **more: object) -> None:
    said = {"format": "reprobe-roles-1", "roles": ROLES if roles is None else roles, **more}
    (folder / ROLES_FILE).write_text(json.dumps(said))


def geometry(board: Board) -> object:
    layers = board.layers
    return board.outline_mm, board.pads, [len(part) for part in (layers.copper, layers.mask, layers.holes)]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Board:
    return load_board(write_board(tmp_path_factory.mktemp("plain")))


def test_the_roles_file_tells_what_no_name_tells(tmp_path: Path, plain: Board) -> None:
    folder = without_attributes(write_board(tmp_path, names=FOREIGN))
    with pytest.raises(ValueError, match="no top copper, top mask"):
        load_board(folder)
    keep_roles(folder)
    assert geometry(load_board(folder)) == geometry(plain)
    assert load_board(folder, "bottom").layers.copper


def test_a_file_the_roles_do_not_name_is_found_out_as_before(tmp_path: Path, plain: Board) -> None:
    folder = write_board(tmp_path)
    (folder / "b-F_Mask.gts").rename(folder / "openings.gbr")
    keep_roles(folder, {"openings.gbr": "top mask", "b-PTH.drl": "ignored"})
    board = load_board(folder)
    assert [pad.name for pad in board.pads] == [pad.name for pad in plain.pads]
    assert (len(board.layers.mask), len(board.layers.holes)) == (len(plain.layers.mask), 0)


@pytest.mark.parametrize(
    "text", ["{", '{"format": "other", "roles": {}}', '{"format": "reprobe-roles-1", "roles": []}']
)
def test_a_roles_file_that_is_none_is_named(tmp_path: Path, text: str) -> None:
    folder = write_board(tmp_path)
    (folder / ROLES_FILE).write_text(text)
    with pytest.raises(ValueError, match=r"reprobe-roles\.json.*mend it or delete it"):
        load_board(folder)


def test_sub_folders_are_read(tmp_path: Path, plain: Board) -> None:
    folder = write_board(
        tmp_path,
        names={"b.d356": "Netlist/b.txt", "b-PTH.drl": "NC Drill/b.txt", "b-F_Cu.gtl": "Gerber/b.gtl"},
    )
    assert geometry(load_board(folder)) == geometry(plain)


def test_a_zip_is_read_and_leaves_nothing_behind(tmp_path: Path, plain: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    room = tmp_path / "room"
    room.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(room))
    folder = write_board(tmp_path / "inside" / "gerbers")
    path = Path(shutil.make_archive(str(tmp_path / "board"), "zip", folder.parent))
    board = load_board(path)
    assert (board.name, geometry(board)) == ("board", geometry(plain))
    assert not list(room.iterdir())


def test_one_odd_file_is_left_out_and_named(tmp_path: Path, plain: Board) -> None:
    folder = write_board(tmp_path)
    (folder / "b-F_Silkscreen.gto").write_text("%FSLAX46Y46*%\n%MOMM*%\n%ADD10Q,broken*%\nD10*\nX1D03*\nM02*\n")
    (folder / "b-odd.drl").write_text("M48\nMETRIC\nT1C0.3\n%\nT1\nX1.0Y2.0\nG84X..Y!!\nM30\n")
    (folder / "b-odd2.drl").write_bytes(bytes(range(256)) * 20)
    assert geometry(load_board(folder)) == geometry(plain)
    assert set(open_folder(folder, "top").left_out) >= {"b-F_Silkscreen.gto"}


def test_a_needed_file_that_is_broken_is_named_with_the_reason(tmp_path: Path) -> None:
    folder = write_board(tmp_path)
    (folder / "b-F_Mask.gts").write_text(
        "%FSLAX46Y46*%\n%TF.FileFunction,Soldermask,Top*%\n%MOMM*%\n%ADD10Q,broken*%\nD10*\nX1D03*\nM02*\n"
    )
    with pytest.raises(ValueError, match=r"no top mask found.*b-F_Mask\.gts cannot be read"):
        load_board(folder)


def test_several_drill_files_are_added_up(tmp_path: Path, plain: Board) -> None:
    folder = write_board(tmp_path)
    (folder / "b-NPTH.drl").write_text("M48\nMETRIC\nT1C3.000\n%\nG90\nT1\nX18.0Y2.0\nM30\n")
    assert len(load_board(folder).layers.holes) == len(plain.layers.holes) + 1


@pytest.mark.parametrize(
    "slot",
    [
        "X15.000Y12.000G85X16.000Y12.000",
        "X15.0Y12.0 G85 X16.0Y12.0",
        "X15.000Y12.000G85X16.000",
        "X15.0Y12.0\nG85X16.0Y12.0",
        "G00X15.0Y12.0\nM15\nG01X16.0Y12.0\nM16\nG05",
    ],
)
def test_a_slot_is_read_in_every_spelling(tmp_path: Path, slot: str, plain: Board) -> None:
    folder = write_board(tmp_path)
    path = folder / "b-PTH.drl"
    path.write_text(path.read_text().replace("M30", f"{slot}\nM30"))
    holes = load_board(folder).layers.holes
    boxes = [hole.box_mm for hole in holes if hole.box_mm[0] > 14.0 and hole.box_mm[1] > 11.0]
    assert len(holes) - len(plain.layers.holes) in (1, 2), "a first hit at the slot's start may stand alone"
    assert max(box[2] for box in boxes) == pytest.approx(16.5, abs=0.01)
    assert min(box[0] for box in boxes) == pytest.approx(14.5, abs=0.01)


def test_a_slot_keeps_the_coordinates_it_leaves_out() -> None:
    assert routed("X1.0Y2.0\nG85Y3.0\nX5.0\n").splitlines() == [
        "X1.0Y2.0", "G00X1.0Y2.0", "M15", "G01X1.0Y3.0", "M16", "G05", "X5.0",
    ]  # fmt: skip


def test_a_drill_file_that_does_not_say_how_it_writes_is_read_as_the_roles_say(tmp_path: Path) -> None:
    path = tmp_path / "d.txt"
    path.write_text("M48\nT1C0.0400\n%\nT1\nX0123Y0456\nM30\n")
    (hit,) = open_drills(path, DrillFormat("inch", 2, 4, "leading"))
    assert (float(hit.x), float(hit.y)) == pytest.approx((1.23, 4.56))
    (hit,) = open_drills(path, DrillFormat("inch", 2, 4, "trailing"))
    assert (float(hit.x), float(hit.y)) == pytest.approx((0.0123, 0.0456))
    path.write_text("M48\nT1C0.0400\n%\nT1\nX012300Y045600\nM30\n")
    (hit,) = open_drills(path, DrillFormat("inch", 2, 4, "all"))
    assert (float(hit.x), float(hit.y)) == pytest.approx((1.23, 4.56))


def test_pads_have_names_from_attributes_where_there_is_no_netlist(tmp_path: Path) -> None:
    folder = write_board(tmp_path)
    (folder / "b.d356").unlink()
    copper = GerberText("Copper,L1,Top")
    code = copper.rectangle(0.5, 0.3)
    text = copper.text().replace(
        "M02*",
        f"%TO.P,R1,1*%\n%TO.N,/A\\u002FB*%\nD{code}*\nX3000000Y3000000D03*\n%TD*%\nX4400000D03*\n"
        "G04 #@! TO.P,R7,2,A*\nG04 #@! TO.N,N/C*\nX4000000Y10000000D03*\nM02*",
    )
    (folder / "b-F_Cu.gtl").write_text(text)
    pads = load_board(folder).pads
    assert [(pad.name, pad.net, pad.x_mm, pad.y_mm, pad.hole_mm) for pad in pads] == [
        ("R1.1", "/A/B", 3.0, 3.0, None),
        ("R7.2", "", 4.0, 10.0, 1.0),
    ]


def test_names_that_a_netlist_cuts_are_told_in_full_by_attributes(tmp_path: Path) -> None:
    pads = [RectPad("LONGNAME7", "1", "/power/SUPPLY_IN", 3.0, 3.0), RectPad("R1", "2", "GND", 5.0, 3.0)]
    vias = [Pin("VIA", "", "/power/SUPPLY_IN", 9.0, 9.0, 0.6, 0.3)]
    folder = write_board(tmp_path, pads, vias)
    assert [(pad.name, pad.net) for pad in load_board(folder).pads] == [
        ("LONGNA.1", "/power/SUPPLY_"), ("R1.2", "GND"), ("VIA", "/power/SUPPLY_"),
    ]  # fmt: skip
    path = folder / "b-F_Cu.gtl"
    named = "%TO.P,LONGNAME7,1*%\n%TO.N,/power/SUPPLY_IN*%\nX3000000Y3000000D03*\n%TD*%"
    path.write_text(path.read_text().replace("X3000000Y3000000D03*", named))
    assert [(pad.name, pad.net) for pad in load_board(folder).pads] == [
        ("LONGNAME7.1", "/power/SUPPLY_IN"), ("R1.2", "GND"), ("VIA", "/power/SUPPLY_IN"),
    ]  # fmt: skip
