"""Drill files of any format and spelling are read so that they meet the copper; what does not is refused."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from daemon.tools.board_import import Options, import_boards
from daemon.tools.cad import Cad, read_cad
from daemon.tools.cad.excellon import read_excellon
from tests.daemon.tools.cad.small_board import PADS, DrillStyle, Pad, SmallBoard, drills, plain_folder, write
from tests.daemon.tools.cad.tool_folders import TOOLS


def holes_in_place(cad: Cad) -> bool:
    wanted = [(p.x, p.y, p.drill) for p in SmallBoard().placed() if p.drill]
    found = [(d.x_mm, d.y_mm, d.diameter_mm) for d in cad.drills]
    return all(any(f == pytest.approx(w, abs=0.03) for f in found) for w in wanted)


def with_drills(folder: Path, text: str, name: str = "b.drl") -> Path:
    plain_folder(folder)
    (folder / "b.drl").unlink()
    (folder / name).write_text(text)
    return folder


FORMATS = {
    "points, unit not said": DrillStyle(header=("M48",)),
    "points in inch, unit not said": DrillStyle("inch", header=("M48",)),
    "digits, nothing said, mm": DrillStyle(points=False, header=("M48",)),
    "digits, nothing said, inch 2.4": DrillStyle("inch", 2, 4, points=False, header=("M48",)),
    "digits, nothing said, inch leading kept": DrillStyle("inch", 2, 4, "leading", points=False, header=("M48",)),
    "digits 2.5, only INCH": DrillStyle("inch", 2, 5, points=False, header=("M48", "INCH")),
    "digits 4.2, only METRIC": DrillStyle("mm", 4, 2, points=False, header=("M48", "METRIC,TZ")),
    "no header at all": DrillStyle("inch", 2, 4, points=False, header=()),
    "M71": DrillStyle(points=False, header=("M48", "M71")),
    "says inch, is mm": DrillStyle(points=True, header=("M48", "INCH")),
    "says LZ, keeps trailing": DrillStyle("inch", 2, 4, "trailing", points=False, header=("M48", "INCH,LZ")),
    "KiCad, suppress leading": DrillStyle(
        "mm",
        3,
        3,
        points=False,
        header=("M48", "; FORMAT={3:3/ absolute / metric / suppress leading zeros}", "METRIC,TZ"),
    ),
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_format_is_the_one_that_meets_the_pads(name: str, tmp_path: Path) -> None:
    assert holes_in_place(read_cad(with_drills(tmp_path, drills(SmallBoard(), FORMATS[name]))))


def test_a_format_that_was_not_said_is_told(tmp_path: Path) -> None:
    cad = read_cad(with_drills(tmp_path, drills(SmallBoard(), FORMATS["digits, nothing said, inch 2.4"])))
    assert any("does not say its format: read as inch, 2.4 digits" in note for note in cad.notes)


def test_unplated_holes_that_meet_no_pad_are_read_like_their_sibling(tmp_path: Path) -> None:
    style = FORMATS["digits, nothing said, mm"]
    folder = with_drills(tmp_path, drills(SmallBoard(), style, plated=True), "b-PTH.drl")
    (folder / "b-NPTH.drl").write_text(drills(SmallBoard(), style, plated=False))
    cad = read_cad(folder)
    assert {(d.x_mm, d.y_mm) for d in cad.drills if d.plated is False} == {(52.2, 47.8), (77.6, 32.3)}


SLOTS = {
    "one line": ["T01", "X66.0Y44.0G85X68.0Y44.0"],
    "end without x": ["T01", "X68.0Y44.0G85X66.0"],
    "end without y": ["T01", "X66.0Y44.0G85X68.0"],
    "on the next line": ["T01", "X66.0Y44.0", "G85X68.0Y44.0"],
    "on the line after": ["T01", "X66.0Y44.0", "G85", "X68.0Y44.0"],
    "both ends after it": ["T01", "G85X66.0Y44.0X68.0Y44.0"],
    "with blanks": ["T01", "X66.0Y44.0 G85 X68.0Y44.0"],
    "routed with plunge": ["T01", "G00X66.0Y44.0", "M15", "G01X68.0Y44.0", "M16", "G05"],
    "routed without plunge": ["T01", "G00X66.0Y44.0", "G01X68.0Y44.0", "G05"],
    "routed, modal": ["T01", "G00X66.0Y44.0", "M15", "G01X68.0", "M17", "G05"],
    "tool and slot in one line": ["T01X66.0Y44.0G85X68.0Y44.0"],
}


@pytest.mark.parametrize("spelling", SLOTS)
def test_a_slot_is_a_slot_however_it_is_written(spelling: str, tmp_path: Path) -> None:
    cad = read_cad(with_drills(tmp_path, drills(SmallBoard(), DrillStyle(), extra=SLOTS[spelling])))
    slots = [d for d in cad.drills if d.end_x_mm is not None]
    assert len(slots) == 1
    assert {(slots[0].x_mm, slots[0].y_mm), (slots[0].end_x_mm, slots[0].end_y_mm)} == {(66.0, 44.0), (68.0, 44.0)}
    assert holes_in_place(cad)
    assert len(cad.drills) == 11


def test_digits_without_points_also_make_slots(tmp_path: Path) -> None:
    style = DrillStyle(points=False, header=("M48", "METRIC,TZ"))
    cad = read_cad(with_drills(tmp_path, drills(SmallBoard(), style, extra=["T01", "X66000Y44000G85X68000Y44000"])))
    assert [(d.x_mm, d.end_x_mm) for d in cad.drills if d.end_x_mm is not None] == [(66.0, 68.0)]


def test_repeats_and_modal_coordinates_are_hits() -> None:
    found = read_excellon("M48\nMETRIC\nT1C0.5\n%\nT1\nX1.0Y2.0\nX3.0\nY4.0\nR2X1.0\nM30\n")
    assert [(float(h.x), float(h.y)) for h in found.hits] == [(1, 2), (3, 2), (3, 4), (4, 4), (5, 4)]


INCREMENTS = {
    "G91 and back": "G91\nX1.0Y2.0\nX2.0\nG90\nX7.0Y8.0\n",
    "in the lines": "G91X1.0Y2.0\nX2.0\nG90X7.0Y8.0\n",
    "ICI": "ICI,ON\nX1.0Y2.0\nX2.0\nICI,OFF\nX7.0Y8.0\n",
    "absolute first": "G90\nX1.0Y2.0\nG91\nX2.0\nG90\nX7.0Y8.0\n",
    "with a tool between": "G91\nX1.0Y2.0\nX2.0\nT1\nG90\nX7.0\nY8.0\n",
}


@pytest.mark.parametrize("spelling", INCREMENTS)
def test_coordinates_are_increments_until_they_are_absolute_again(spelling: str) -> None:
    found = read_excellon(f"M48\nMETRIC\nT1C0.5\n%\nT1\n{INCREMENTS[spelling]}M30\n")
    places = [(float(h.x), float(h.y)) for h in found.hits]
    assert places[:2] == [(1, 2), (3, 2)]
    assert places[-1] == (7, 8)


BROKEN = {
    "a coordinate": ("T1C0.5\n%\nT1\nX1.2.3Y4.0", 5, "1.2.3"),
    "a sign": ("T1C0.5\n%\nT1\nX1.0Y4.0\nX1-2Y4.0", 6, "1-2"),
    "no digits": ("T1C0.5\n%\nT1\nX1.0Y4.0\nX.Y4.0", 6, "."),
    "a tool": ("T1C0.5.1\n%\nT1\nX1.0Y4.0", 2, "0.5.1"),
    "a repeat": ("T1C0.5\n%\nT1\nX1.0Y4.0\nR3X1..5", 6, "1..5"),
    "a slot": ("T1C0.5\n%\nT1\nX1.0Y4.0G85X1.5.Y4.0", 5, "1.5."),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_line_that_cannot_be_read_is_named_and_its_file_left_out(what: str, tmp_path: Path) -> None:
    body, line, number = BROKEN[what]
    folder = plain_folder(tmp_path)
    (folder / "vias.drl").write_text(f"M48\n{body}\nM30\n")
    cad = read_cad(folder)
    text = f"M48\n{body}".splitlines()[line - 1]
    told = f"line {line} ({text}) cannot be read: {number} is no number; export the drills anew"
    assert f"vias.drl (drill) was left out: {told}" in cad.notes
    assert holes_in_place(cad)
    with pytest.raises(ValueError, match=rf"^vias\.drl \(drill\) cannot be read: {re.escape(told)}$"):
        read_cad(folder, layers={"drill": Path("vias.drl")})


def test_a_file_without_holes_is_no_drill_file_whoever_says_so(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "bom.txt").write_text("R1 10k\n")
    with pytest.raises(ValueError, match=r"bom\.txt drills nothing, and cannot be the drill; give another file"):
        read_cad(folder, layers={"drill": Path("bom.txt")})


def test_tool_sizes_come_from_the_drill_report_beside_it(tmp_path: Path) -> None:
    text = drills(SmallBoard(), DrillStyle("inch", 2, 4, points=False, header=("%",), tools_in_header=False))
    folder = with_drills(tmp_path, text)
    (folder / "b.rep").write_text("# Tool  Size (inches)  No. of holes\nT1 0.0394 5\nT2 0.0118 3\nT3 0.0787 2\n")
    cad = read_cad(folder)
    assert holes_in_place(cad)
    assert len(cad.drills) == 10


def test_holes_of_unknown_size_are_left_out_and_told(tmp_path: Path) -> None:
    text = drills(SmallBoard(), DrillStyle(tools_in_header=False))
    cad = read_cad(with_drills(tmp_path, text))
    assert any("does not say how large T1, T2, T3 is" in note for note in cad.notes)


@pytest.mark.parametrize("way", [(12.7, 0.0), (-3.3, 7.1), (0.4, 0.0), (-50.0, -30.0)])
def test_drills_that_lie_elsewhere_are_refused_with_the_way(way: tuple[float, float], tmp_path: Path) -> None:
    board = SmallBoard()
    moved = replace(board, origin=(board.origin[0] + way[0], board.origin[1] + way[1]))
    folder = with_drills(tmp_path, drills(moved, DrillStyle()))
    with pytest.raises(
        ValueError, match=rf"b\.drl lie {way[0]:.2f}, {way[1]:.2f} mm from the copper's pads: export both"
    ):
        read_cad(folder)


def test_one_of_two_drill_files_elsewhere_is_named(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.drl").rename(folder / "b-PTH.drl")
    vias = SmallBoard(tuple(p for p in PADS if p.drill), origin=(55.0, 30.0))
    (folder / "vias.drl").write_text(drills(vias, DrillStyle(), plated=True))
    with pytest.raises(ValueError, match=r"drills of vias\.drl lie 5\.00, 0\.00 mm"):
        read_cad(folder)


OTHER = tuple(
    replace(p, x=1.5 + 0.37 * k * k % 27, y=1.5 + 1.1 * k, drill=0.6, part="") for k, p in enumerate(PADS[:14])
)
"""Pads of another board as large as the small one."""


@pytest.mark.parametrize("name", ["other.drl", "other-PTH.drl", "other-NPTH.drl"])
@pytest.mark.parametrize("beside", [True, False])
def test_the_drill_file_of_another_board_is_refused_by_its_name(name: str, beside: bool, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    if not beside:
        (folder / "b.drl").unlink()
    larger = tuple(replace(p, x=p.x * 3 - 30, y=p.y * 2 - 10) for p in OTHER)
    through = tuple((p.x + 0.3, p.y, 0.5) for p in PADS if p.part == "U1")
    board = SmallBoard((), through) if "NPTH" in name else SmallBoard(larger, ())
    (folder / name).write_text(drills(board, DrillStyle(), plated={"other-PTH.drl": True}.get(name)))
    with pytest.raises(ValueError, match=rf"the holes of {name} do not fit the board: .*--layer ignored={name}"):
        read_cad(folder)
    assert read_cad(folder, layers={"ignored": Path(name)}).pins


def test_several_files_of_another_board_may_be_left_out(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    for name in ("c.drl", "d.drl"):
        (folder / name).write_text(
            drills(SmallBoard(OTHER), DrillStyle(), plated=True).replace("T01", f"T0{ord(name[0]) % 7}")
        )
    cad = read_cad(folder, layers={"ignored": (Path("c.drl"), Path("d.drl"))})
    assert holes_in_place(cad)
    assert len(cad.drills) == 10


def test_plated_holes_where_there_is_no_pad_are_those_of_another_board(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b-PTH.drl").write_text(drills(SmallBoard(OTHER), DrillStyle(), plated=True))
    with pytest.raises(
        ValueError, match=r"b-PTH\.drl do not fit the board: 1\d of 14 lie in copper that is no pad, or are"
    ):
        read_cad(folder)


def test_some_holes_in_the_wrong_place_are_told(tmp_path: Path) -> None:
    extra = tuple(Pad("", "", "", x, y, 0.6, 0.0, 0.3) for x, y in ((33.0, 3.0), (-4.0, 9.0)))
    cad = read_cad(with_drills(tmp_path, drills(SmallBoard((*PADS, *extra)), DrillStyle())))
    assert "the holes of b.drl do not fit the board: 2 of 12 lie outside of its edge; compare them" in cad.notes


@pytest.mark.parametrize("plated", [False, None])
def test_holes_that_need_no_pad_fit(plated: bool | None, tmp_path: Path) -> None:
    """Clear of the copper inside of the edge; tooling holes in a frame outside of it are told only."""
    holes = tuple((x, y, 1.5) for x, y in ((2.2, 17.8), (27.6, 2.3), (24.0, 10.0), (15.0, 17.0)))
    folder = plain_folder(tmp_path)
    (folder / "b-1.drl").write_text(drills(SmallBoard((), holes), DrillStyle(), plated=plated))
    assert not any("do not fit" in note for note in read_cad(folder).notes)


def test_tooling_holes_beside_the_board_are_told_only(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    frame = tuple((x, y, 2.0) for x in (-5.0, 35.0) for y in (-5.0, 25.0))
    (folder / "b-NPTH.drl").write_text(drills(SmallBoard((), frame), DrillStyle(), plated=False))
    assert any("4 of 4 lie outside of its edge; compare" in note for note in read_cad(folder).notes)


def test_capped_vias_are_known_by_their_attribute(tmp_path: Path) -> None:
    text = drills(SmallBoard(), DrillStyle()).replace(
        "T02C0.3000", "; #@! TA.AperFunction,Plated,PTH,ViaDrill,VII\nT02C0.3000"
    )
    cad = read_cad(with_drills(tmp_path, text))
    assert [round(d.diameter_mm, 3) for d in cad.drills if d.capped] == [0.3, 0.3, 0.3]


def test_drills_in_gerber_are_holes_and_slots(tmp_path: Path) -> None:
    lines = ["%TF.FileFunction,Plated,1,2,PTH*%", "%FSLAX46Y46*%", "%MOMM*%", "%ADD10C,1.0*%", "%ADD11C,0.3*%", "G01*"]
    for pad in SmallBoard().placed():
        if pad.drill:
            lines += ["D10*" if pad.part else "D11*", f"X{round(pad.x * 1e6)}Y{round(pad.y * 1e6)}D03*"]
    lines += ["D10*", "X66000000Y44000000D02*", "X68000000Y44000000D01*", "M02*"]
    cad = read_cad(with_drills(tmp_path, "\n".join(lines), "b-drl.gbr"))
    assert holes_in_place(cad)
    assert [(d.x_mm, d.end_x_mm, d.plated) for d in cad.drills if d.end_x_mm] == [(66.0, 68.0, True)]


HEADER = "M48\nMETRIC\nT1C1.0\n%\nT1\n"


def places(text: str) -> list[tuple[float, float]]:
    return [(float(h.x), float(h.y)) for h in read_excellon(text).hits]


@pytest.mark.parametrize(
    "body",
    [
        "X1.0Y2.0\nX3.0Y2.0", "G93X0Y0\nX1.0Y2.0\nX3.0Y2.0", "G92\nX0.0Y0.0\nX1.0Y2.0\nX3.0Y2.0",
        "M97,BOARD 2\nX7.0Y7.0\nX1.0Y2.0\nX3.0Y2.0", "X1,0Y2,0\nX3,0Y2,0", "M25\nX1.0Y2.0\nM01\nM02X2.0Y0\nM08",
        "T0101\nX1.0Y2.0\nX3.0",
    ],
)  # fmt: skip
def test_what_is_no_hit_is_none_and_a_repeated_pattern_is(body: str) -> None:
    file = read_excellon(f"{HEADER}{body}\nM30\n")
    assert [(float(h.x), float(h.y), h.tool) for h in file.hits] == [(1.0, 2.0, 1), (3.0, 2.0, 1)]


def test_a_pattern_is_repeated_from_its_last_copy() -> None:
    body = "X9.0Y9.0\nM25\nX1.0Y1.0\nX2.0Y1.0G85X2.5\nM01\nR2M02X10.0\nM02Y5.0\nM08\nX8.0Y8.0\n"
    assert places(f"{HEADER}{body}M30\n") == [
        (9, 9), (1, 1), (2, 1), (11, 1), (12, 1), (21, 1), (22, 1), (21, 6), (22, 6), (8, 8)
    ]  # fmt: skip


@pytest.mark.parametrize(("zeros", "digits", "step"), [("LZ", "012", "00254"), ("TZ", "12000", "2540")])
def test_steps_count_from_the_end_that_the_file_says(zeros: str, digits: str, step: str) -> None:
    file = read_excellon(f"M48\nMETRIC,{zeros},000.000\nT1C1.0\n%\nT1\nX{digits}Y0\nR1X{step}\nM30\n")
    assert file.said.length_mm(file.hits[1].x) == pytest.approx(14.54)


@pytest.mark.parametrize("body", ["G93X5.0Y0", "X1.0Y1.0G82X9.0Y9.0", "X1.0Y1.0\nG84X2.0", "M25\nX1Y1\nM01\nM02X5M80"])
def test_a_line_that_would_be_drilled_wrongly_is_none(body: str) -> None:
    with pytest.raises(ValueError, match="cannot be read"):
        read_excellon(f"{HEADER}{body}\nM30\n")


def test_a_tool_may_be_written_with_blanks() -> None:
    assert read_excellon("M48\nMETRIC\nT1 C0.7 F200\n%\nT1\nX1.0Y1.0\nM30\n").tools[1].diameter == 0.7


@pytest.mark.parametrize(
    "turn", ["G03X64.0Y44.0A2.0", "G03X64.0Y44.0I2.0J0", "G02X64.0Y44.0I2.0J0", "G02X64.0Y44.0A2.0"]
)
def test_a_way_round_is_cut_round(turn: str, tmp_path: Path) -> None:
    text = drills(SmallBoard(), DrillStyle(), extra=["G00X60.0Y44.0", "M15", turn, "M16", "G05"])
    cut = [d for d in read_cad(with_drills(tmp_path, text, "b.drl")).drills if d.end_x_mm is not None]
    assert len(cut) > 8
    assert all(math.hypot(d.x_mm - 62.0, d.y_mm - 44.0) == pytest.approx(2.0, abs=0.01) for d in cut)
    below = "G03" in turn
    assert all((d.y_mm <= 44.001) if below else (d.y_mm >= 43.999) for d in cut)


def test_a_whole_circle_leaves_nothing_in_its_middle(tmp_path: Path) -> None:
    extra = ["G00X66.0Y44.0", "M15", "G03X66.0Y44.0I1.0J0", "M16", "G05"]
    cad = read_cad(with_drills(tmp_path, drills(SmallBoard(), DrillStyle(), extra=extra), "b.drl"))
    (hole,) = [d for d in cad.drills if (d.x_mm, d.y_mm) == (67.0, 44.0)]
    assert hole.diameter_mm == pytest.approx(4.0)  # the last tool of the file is 2 mm wide


@pytest.mark.parametrize(("aperture", "way"), [("O,2.6X1.0", (0.8, 0.0)), ("O,1.0X2.6", (0.0, 0.8))])
def test_a_flashed_slot_of_a_drill_file_in_gerber_is_a_slot(
    aperture: str, way: tuple[float, float], tmp_path: Path
) -> None:
    text = "%TF.FileFunction,Plated,1,2,PTH*%\n%FSLAX46Y46*%\n%MOMM*%\n"
    text += f"%ADD10{aperture}*%\nD10*\nX54000000Y34000000D03*\nM02*\n"
    cad = read_cad(with_drills(tmp_path, text, "b-drl.gbr"))
    (slot,) = [d for d in cad.drills if d.end_x_mm is not None]
    ends = sorted([(slot.x_mm, slot.y_mm), (slot.end_x_mm, slot.end_y_mm)])
    assert ends[0] == pytest.approx((54.0 - way[0], 34.0 - way[1]), abs=0.01)
    assert ends[1] == pytest.approx((54.0 + way[0], 34.0 + way[1]), abs=0.01)
    assert slot.diameter_mm == pytest.approx(1.0, abs=0.01)


def test_a_file_of_all_holes_beside_those_by_plating_counts_once(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b-PTH.drl").write_text(drills(SmallBoard(), DrillStyle(), plated=True))
    (folder / "b-NPTH.drl").write_text(drills(SmallBoard(), DrillStyle(), plated=False))
    cad = read_cad(folder)
    assert len(cad.drills) == 10
    assert [d.plated for d in cad.drills].count(False) == 2


def test_a_blind_via_comes_out_on_one_side(tmp_path: Path) -> None:
    folder = write(tmp_path, TOOLS["kicad 8"])
    for name in ("front_panel-F_Cu.gtl", "front_panel-B_Cu.gbl"):
        (folder / name).write_text((folder / name).read_text().replace("Copper,L2,Bot", "Copper,L4,Bot"))
    vias = SmallBoard(tuple(p for p in PADS if p.drill and not p.part))
    for span, name in (("1,2,Blind", "f-in1.drl"), ("2,3,Buried", "in1-in2.drl")):
        text = drills(vias, DrillStyle(), plated=True).replace("M48", f"M48\n; #@! TF.FileFunction,Plated,{span}")
        (folder / name).write_text(text.replace("C0.3000", "C0.2000" if "Blind" in span else "C0.1500"))
    cad = read_cad(folder)
    assert {d.diameter_mm: d.sides for d in cad.drills if d.diameter_mm < 0.25} == {0.2: {"top"}, 0.15: frozenset()}
    assert all(d.sides == {"top", "bottom"} for d in cad.drills if d.diameter_mm > 0.25)


def test_a_blind_via_whose_drills_are_in_gerber_comes_out_on_one_side(tmp_path: Path) -> None:
    folder = write(tmp_path, TOOLS["kicad 8"])
    for name in ("front_panel-F_Cu.gtl", "front_panel-B_Cu.gbl"):
        (folder / name).write_text((folder / name).read_text().replace("Copper,L2,Bot", "Copper,L4,Bot"))
    for span, size in (("1,2,Blind", 0.2), ("2,3,Buried", 0.15), ("3,4,Blind", 0.22)):
        lines = [f"%TF.FileFunction,Plated,{span}*%", "%FSLAX46Y46*%", "%MOMM*%", f"%ADD10C,{size}*%", "D10*"]
        vias = (p for p in SmallBoard().placed() if p.drill and not p.part)
        lines += [f"X{round(p.x * 1e6)}Y{round(p.y * 1e6)}D03*" for p in vias]
        (folder / f"{span[:1]}-drl.gbr").write_text("\n".join([*lines, "M02*"]))
    found = {d.diameter_mm: d.sides for d in read_cad(folder).drills if d.diameter_mm < 0.25}
    assert found == {0.2: {"top"}, 0.15: frozenset(), 0.22: {"bottom"}}


def test_a_hole_that_does_not_come_out_on_a_side_makes_no_hole_in_that_sides_pads(tmp_path: Path) -> None:
    """Blind vias from the top lie over TP2 and R1.1 of the bottom; on R1.1 one comes out from below too."""
    folder = write(tmp_path, TOOLS["kicad 8"])
    for name in ("front_panel-F_Cu.gtl", "front_panel-B_Cu.gbl"):
        (folder / name).write_text((folder / name).read_text().replace("Copper,L2,Bot", "Copper,L4,Bot"))
    bottom = {p.part + p.pin: replace(p, drill=0.3, part="") for p in PADS if p.side == "bottom"}
    for span, name, places in (
        ("1,2", "a.drl", ("TP21", "R11")),
        ("3,4", "b.drl", ("R11",)),
        ("2,3", "c.drl", ("R12",)),
    ):
        text = drills(SmallBoard(tuple(bottom[p] for p in places)), DrillStyle(), plated=True)
        (folder / name).write_text(text.replace("M48", f"M48\n; #@! TF.FileFunction,Plated,{span},Blind"))
    boards = import_boards(folder, "bottom", Options(bare=True))
    points = {p.name: p for p in boards["bottom"].points}
    assert (points["TP2"].hole_um, points["R1.1"].hole_um, points["R1.2"].hole_um) == (None, 300.0, None)
    layers = boards["bottom"].layers
    assert layers is not None
    small = {side: sum(h.diameter_um == 300.0 for h in getattr(layers, side).holes) for side in ("top", "bottom")}
    assert small == {"top": 3 + 2, "bottom": 3 + 1}


def test_the_format_kept_in_the_roles_file_is_used_until_the_file_is_a_new_one(tmp_path: Path) -> None:
    style = DrillStyle("inch", 2, 4, points=False, header=("M48",))
    folder = with_drills(tmp_path, drills(SmallBoard(), style))
    read_cad(folder, keep=True)
    kept = json.loads((folder / "reprobe-roles.json").read_text())["drills"]["b.drl"]
    assert (kept["unit"], kept["integers"], kept["decimals"], kept["zeros_kept"]) == ("inch", 2, 4, "trailing")
    (folder / "b.drl").write_text(drills(SmallBoard(), DrillStyle(points=False, header=("M48",))))
    assert holes_in_place(read_cad(folder))


@pytest.mark.parametrize("drill_file", [None, "", "M48\nMETRIC\nT1C2.0\n%\nT1\nX52.2Y47.8\nX77.6Y32.3\nM30\n"])
def test_holes_that_only_the_netlist_tells_are_holes_and_told(drill_file: str | None, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.drl").unlink()
    if drill_file is not None:
        (folder / "b-NPTH.drl").write_text(drill_file)
    cad = read_cad(folder)
    assert holes_in_place(cad)
    assert any("8 holes of b.ipc are in no drill file" in note for note in cad.notes)
    boards = import_boards(folder, "bottom")
    ring = next(p for p in boards["bottom"].points if p.name == "J1.2")
    assert ring.hole_um == pytest.approx(1000.0, abs=5.0)
