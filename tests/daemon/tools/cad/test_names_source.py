"""Names come from a netlist, else X2 attributes, a KiCad board or a list of points; without any: what to export."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from daemon.tools.cad import Cad, read_cad
from tests.daemon.tools.cad.small_board import (
    PADS,
    GerberStyle,
    Pad,
    SmallBoard,
    ToolFolder,
    netlist,
    plain_folder,
    write,
)
from tests.daemon.tools.cad.tool_folders import TOOLS

NAMED = {(p.part, p.pin, p.net) for p in PADS}
PARTS = {n for n in NAMED if n[0]}


def without_netlist(folder: Path) -> Path:
    plain_folder(folder)
    (folder / "b.ipc").unlink()
    return folder


def names(cad: Cad) -> set[tuple[str, str, str]]:
    return {(p.part, p.pin, p.net) for p in cad.pins}


def test_x2_attributes_of_the_copper_name_pins_nets_and_sides(tmp_path: Path) -> None:
    files = {role: name for role, name in TOOLS["kicad 8"].names.items() if role != "netlist"}
    cad = read_cad(write(tmp_path, ToolFolder(files, GerberStyle(x2="command", names=True))))
    assert names(cad) >= PARTS
    by_name = {(p.part, p.pin): p for p in cad.pins}
    assert by_name["J1", "3"].access == {"top", "bottom"}
    assert by_name["J1", "3"].hole_mm == pytest.approx(1.0)
    assert by_name["U1", "2"].access == {"top"}
    assert by_name["R1", "1"].access == {"bottom"}
    assert any("X2 attributes" in note for note in cad.notes)


KICAD_BOARD = """(kicad_pcb (version 20240108) (generator "pcbnew")
  (general (thickness 1.6)) (net 0 "") (net 1 "VCC") (net 2 "SDA") (net 3 "SCL") (net 4 "RESET_N") (net 5 "GND")
  (footprint "Lib:U" (layer "F.Cu") (at 57.905 -44.2 0) (property "Reference" "U1" (at 0 0))
    (pad "1" smd rect (at -1.905 2.2) (size 0.6 1.2) (layers "F.Cu" "F.Paste" "F.Mask") (net 1 "VCC"))
    (pad "2" smd rect (at -0.635 2.2) (size 0.6 1.2) (layers "F.Cu" "F.Paste" "F.Mask") (net 2 "SDA"))
    (pad "3" smd rect (at 0.635 2.2) (size 0.6 1.2) (layers "F.Cu" "F.Paste" "F.Mask") (net 3 "SCL"))
    (pad "4" smd rect (at 1.905 2.2) (size 0.6 1.2) (layers "F.Cu" "F.Paste" "F.Mask") (net 5 "GND"))
    (pad "5" smd rect (at -1.905 -2.2) (size 0.6 1.2) (layers "F.Cu" "F.Paste" "F.Mask") (net 4 "RESET_N"))
    (pad "6" smd rect (at 1.905 -2.2) (size 0.6 1.2) (layers "F.Cu" "F.Paste" "F.Mask") (net 5 "GND")))
  (footprint "Lib:H" (layer "F.Cu") (at 59.08 -34 90) (fp_text reference "J1" (at 0 0) (layer "F.SilkS"))
    (pad "1" thru_hole circle (at 0 -5.08 90) (size 1.7 1.7) (drill 1) (layers "*.Cu" "*.Mask") (net 1 "VCC"))
    (pad "2" thru_hole circle (at 0 -2.54 90) (size 1.7 1.7) (drill 1) (layers "*.Cu" "*.Mask") (net 2 "SDA"))
    (pad "3" thru_hole circle (at 0 0 90) (size 1.7 1.7) (drill 1) (layers "*.Cu" "*.Mask") (net 3 "SCL"))
    (pad "4" thru_hole circle (at 0 2.54 90) (size 1.7 1.7) (drill 1) (layers "*.Cu" "*.Mask") (net 4 "RESET_N"))
    (pad "5" thru_hole circle (at 0 5.08 90) (size 1.7 1.7) (drill 1) (layers "*.Cu" "*.Mask") (net 5 "GND")))
  (footprint "Lib:TP" (layer "F.Cu") (at 67.3 -44.1) (property "Reference" "TP1")
    (pad "1" smd circle (at 0 0) (size 1 1) (property pad_prop_testpoint) (layers "F.Cu" "F.Mask") (net 2 "SDA")))
  (footprint "Lib:TP" (layer "B.Cu") (at 71.7 -39.9 180) (property "Reference" "TP2")
    (pad "1" smd circle (at 0 0 180) (size 1.2 1.2) (layers "B.Cu" "B.Mask") (net 3 "SCL")))
  (footprint "Lib:R" (layer "B.Cu") (at 74.85 -35.3) (property "Reference" "R1")
    (pad "1" smd rect (at -0.85 0) (size 0.9 1) (layers "B.Cu" "B.Mask") (net 1 "VCC"))
    (pad "2" smd rect (at 0.85 0) (size 0.9 1) (layers "B.Cu" "B.Mask") (net 2 "SDA")))
  (via (at 63.1 -39.2) (size 0.6) (drill 0.3) (layers "F.Cu" "B.Cu") (net 5))
  (via (at 69.4 -47.7) (size 0.6) (drill 0.3) (layers "F.Cu" "B.Cu") (net 2))
  (via (at 77.3 -42.9) (size 0.6) (drill 0.3) (layers "F.Cu" "B.Cu") (net 3))
  (zone (net 5) (polygon (pts (xy 0 0) (xy 1 1)))))
"""


def test_a_kicad_board_names_pins_nets_and_what_the_mask_covers(tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    (folder / "b.kicad_pcb").write_text(KICAD_BOARD)
    cad = read_cad(folder)
    assert names(cad) == NAMED
    by_name = {(p.part, p.pin): p for p in cad.pins}
    assert by_name["TP1", "1"].feature == "test_point"
    assert by_name["TP2", "1"].access == {"bottom"}
    assert by_name["J1", "1"].access == {"top", "bottom"}
    assert cad.netlist_shift_mm == pytest.approx((0.0, 0.0), abs=0.01)


def csv_of(heading: str, row: str, unit_mm: float = 1.0, separator: str = ",") -> str:
    """Write the small board's test points and pins by a pattern."""
    lines = [heading]
    for pad in SmallBoard().placed():
        if pad.part:
            side = "Both" if pad.drill else "Top" if pad.side == "top" else "Bottom"
            values = {
                "part": pad.part, "pin": pad.pin, "net": pad.net, "side": side, "size": pad.w,
                "x": f"{pad.x / unit_mm:.4f}", "y": f"{pad.y / unit_mm:.4f}",
            }  # fmt: skip
            lines.append(row.format(**values))
    return "\n".join(lines).replace("|", separator) + "\n"


TABLES = {
    "plain": csv_of("name,net,x,y,side,diameter", "{part}.{pin},{net},{x},{y},{side},{size}"),
    "units in headings": csv_of("Name,Pin,Net Name,X (mil),Y (mil),Layer", "{part},{pin},{net},{x},{y},{side}", 0.0254),
    "units in cells": csv_of("Net,Name,X,Y,Side", "{net},{part}-{pin},{x}mm,{y}mm,{side}"),
    "inch, not said": csv_of("Test Point,Net,X,Y,Side", "{part}_{pin},{net},{x},{y},{side}", 25.4),
    "semicolons and decimal commas": csv_of(
        "Name;Pin;Net;X;Y;Side", "{part};{pin};{net};{x};{y};{side}"
    ).replace(".", ","),
    "after a preamble": "Altium Designer Test Point Report\nDate: 1.1.2024\nUnits used: mm\n\n"
    + csv_of('"Net","Name","X Location","Y Location","Side"', '"{net}","{part}.{pin}","{x}","{y}","{side}"'),
    **{
        f"after a sentence, {sentence}": f"{sentence}\n"
        + csv_of("Name,Net,X,Y,Side", "{part}.{pin},{net},{x},{y},{side}", unit_mm)
        for sentence, unit_mm in (
            ("Test points; all coordinates in mm", 1.0), ("Reported in mils", 0.0254), ("Made in Germany", 1.0),
            ("Units: in", 25.4),
        )
    },
    "sides in German": csv_of("Name,Net,X,Y,Seite", "{part}.{pin},{net},{x},{y},{side}").replace(
        "Top", "Oben").replace("Bottom", "Unten"),
    "a jig maker's": csv_of(
        "source ref des\tsource pad\tnet\tx\ty\tside", "{part}\t{pin}\t{net}\t{x}\t{y}\t{side}"
    ),
    "words run together": csv_of("RefDes,PadNumber,NetName,PosX,PosY,Top/Bottom", "{part},{pin},{net},{x},{y},{side}"),
    "units run together": csv_of("ID,NET,Xmm,Ymm,SIDE", "{part}.{pin},{net},{x},{y},{side}"),
    "centres in millimeters": csv_of(
        "Label,Node,X-Center (millimeters),Y-Center (millimeters),TB", "{part}.{pin},{net},{x},{y},{side}"
    ),
    "in German": csv_of("Prüfpunkt;Netz;X;Y;Seite", "{part}-{pin};{net};{x};{y};{side}").replace(".", ","),
    "um, said with the sign": csv_of("Name,Net,X [µm],Y [µm],Side", "{part}.{pin},{net},{x},{y},{side}", 1e-3),
    "um, not said": csv_of("Name,Net,X,Y,Side", "{part}.{pin},{net},{x},{y},{side}", 1e-3),
    "nm, not said": csv_of("Name,Net,X,Y,Side", "{part}.{pin},{net},{x},{y},{side}", 1e-6),
    "columns of blanks": csv_of(
        "NET NAME        TP NAME   X COORD     Y COORD    SIDE", "{net:<16}{part}.{pin:<8}{x:<12}{y:<11}{side}"
    ),
    "single blanks": csv_of("net name x y side", "{net} {part}.{pin} {x} {y} {side}"),
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES)
def test_a_list_of_points_names_them(kind: str, tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    (folder / "test_points.csv").write_text(TABLES[kind])
    cad = read_cad(folder)
    assert names(cad) == PARTS
    by_name = {(p.part, p.pin): p for p in cad.pins}
    assert (by_name["TP2", "1"].x_mm, by_name["TP2", "1"].y_mm) == pytest.approx((71.7, 39.9), abs=0.03)
    assert by_name["TP2", "1"].access == {"bottom"}
    assert any("alone" in note for note in cad.notes)


@pytest.mark.parametrize("signs", [",.", ".,"])
def test_thousands_may_be_set_apart(signs: str, tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    change = str.maketrans(",.", signs)
    rows = [
        f"{p.part}.{p.pin};{p.net};{f'{p.x / 0.0254:,.2f};{p.y / 0.0254:,.2f}'.translate(change)};{p.side}"
        for p in SmallBoard().placed() if p.part
    ]  # fmt: skip
    (folder / "test_points.csv").write_text("\n".join(["Name;Net;X [mil];Y [mil];Side", *rows]))
    assert names(read_cad(folder)) == PARTS


@pytest.mark.parametrize("net", ["IN", "MM"])
def test_a_nets_name_is_no_unit(net: str, tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    rows = csv_of("Name,Net,X,Y,Side", "{part}.{pin},{net},{x},{y},{side}", 0.0254).replace("VCC", net)
    (folder / "test_points.csv").write_text(rows)
    assert names(read_cad(folder)) == {(part, pin, said.replace("VCC", net)) for part, pin, said in PARTS}


FINGERS = tuple(
    Pad("J2", f"{'AB'[n]}{k + 1}", f"F{2 * k + n}", 18.1 + 1.9 * k, 2.1, 1.0, 2.0, side=side)
    for n, side in enumerate(("top", "bottom")) for k in range(4)
)  # fmt: skip


@pytest.mark.parametrize("heading", ["Name,Net,X,Y", "Name,Net,X,Y,Side"])
def test_a_point_of_unsaid_side_that_has_a_pad_on_both_is_left_out_and_told(heading: str, tmp_path: Path) -> None:
    """Fingers of an edge connector lie back to back, on two nets."""
    board = SmallBoard((*PADS, *FINGERS))
    folder = plain_folder(tmp_path, board)
    (folder / "b.ipc").unlink()
    rows = "".join(f"{p.part}.{p.pin},{p.net},{p.x},{p.y},{p.side}\n" for p in board.placed() if p.part)
    (folder / "test_points.csv").write_text(f"{heading}\n{rows}")
    cad = read_cad(folder)
    sided = "Side" in heading
    assert {p.access for p in cad.pins if p.part == "TP2"} == {frozenset(("bottom",))}
    assert {p.access for p in cad.pins if p.part == "J1"} == {frozenset(("top", "bottom"))} or sided
    assert sum(p.part == "J2" for p in cad.pins) == (8 if sided else 0)
    assert sided != any("J2.B4 have a pad on both sides, and test_points.csv does not say" in n for n in cad.notes)


def test_a_pads_name_in_a_list_makes_no_test_point_of_it(tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    (folder / "test_points.csv").write_text(TABLES["plain"])
    features = {p.part: p.feature for p in read_cad(folder).pins}
    assert (features["U1"], features["TP1"]) == ("pad", "test_point")


def test_a_sentence_is_no_list_of_points(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "readme.txt").write_text("Each test point has\nname net x y side\nin the netlist beside this file.\n")
    assert read_cad(folder).roles["readme.txt"] == "ignored"  # type: ignore[index]


def test_points_may_come_without_nets(tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    (folder / "testpoints.csv").write_text(csv_of("test point,x,y,side", "{part}.{pin},{x},{y},{side}"))
    assert {(p.part, p.pin) for p in read_cad(folder).pins} == {n[:2] for n in PARTS}


def test_a_placement_file_is_no_list_of_points(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "pos.csv").write_text("Designator,Val,Package,X,Y,Rotation,Layer\nU1,x,SO8,1,2,0,top\n")
    assert read_cad(folder).roles["pos.csv"] == "ignored"  # type: ignore[index]


def test_easyedas_flying_probe_file_names_them(tmp_path: Path) -> None:
    fields = ["NET_NAME", "PIN_NAME", "PIN_X", "PIN_Y", "LAYER", "PIN_TYPE", "PAD_SHAPE", "PAD_SIZEX", "PAD_SIZEY",
              "HOLE_SIZE", "PAD_ANGLE"]  # fmt: skip
    rows = [
        [p.net, f"{p.part}_{p.pin}", p.x / 0.0254, p.y / 0.0254, "A" if p.drill else "T" if p.side == "top" else "B",
         "DIP" if p.drill else "SMD", "RECT" if p.h else "ROUND", p.w / 0.0254, (p.h or p.w) / 0.0254,
         p.drill / 0.0254, 0]
        for p in SmallBoard().placed() if p.part
    ]  # fmt: skip
    folder = without_netlist(tmp_path)
    (folder / "FlyingProbeTesting.json").write_text(json.dumps({"pins": {"fields": fields, "rows": rows}}))
    cad = read_cad(folder)
    assert names(cad) == PARTS
    by_name = {(p.part, p.pin): p for p in cad.pins}
    assert by_name["J1", "2"].hole_mm == pytest.approx(1.0)
    assert by_name["J1", "2"].access == {"top", "bottom"}


def test_without_names_the_folder_is_refused_with_what_to_export(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no names for its pads: export an IPC-D-356 netlist, or Gerber X2"):
        read_cad(without_netlist(tmp_path))


@pytest.mark.parametrize(
    ("file", "content", "kind"),
    [
        ("job.tgz", b"\x1f\x8b\x08\x00rest", r"ODB\+\+"),
        ("board.xml", b'<?xml version="1.0"?><IPC-2581 revision="B">', "IPC-2581"),
        ("board.brd", b"\x00\x01\x02binary", "EAGLE or Allegro"),
        ("Board.PcbDoc", b"\xd0\xcf\x11\xe0", "Altium"),
        ("b.cad", b"$HEADER\nGENCAD 1.4\n", "GenCAD"),
    ],
)
def test_what_is_not_read_is_refused_by_its_name(file: str, content: bytes, kind: str, tmp_path: Path) -> None:
    folder = without_netlist(tmp_path)
    (folder / file).write_bytes(content)
    with pytest.raises(ValueError, match=f"{file} is .*{kind}.*, which is not read; export"):
        read_cad(folder)


def test_two_netlists_are_asked_about_and_the_option_settles_it(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    other = replace(SmallBoard(), pads=tuple(replace(p, net=f"OLD_{p.net}") for p in PADS))
    (folder / "old.d356").write_text(netlist(other))
    with pytest.raises(ValueError, match=r"has 2 netlists: b\.ipc, old\.d356; say which one counts: --netlist FILE"):
        read_cad(folder)
    assert names(read_cad(folder, netlist=Path("b.ipc"))) == NAMED
    assert {p.net[:4] for p in read_cad(folder, netlist=folder / "old.d356").pins} == {"OLD_"}


SAME = {
    "to the byte": lambda text: text,
    "with other line ends": lambda text: text.replace("\n", "\r\n"),
    "exported on another day": lambda text: text.replace("C  IPC-D-356", "C  On Tuesday, IPC-D-356"),
    "in another order, with blanks": lambda text: "".join(
        f"{line}  \n" for line in [*text.splitlines()[-2::-1], "999"]
    ),
}


@pytest.mark.parametrize("how", SAME)
def test_the_same_netlist_twice_is_one(how: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "production").mkdir()
    (folder / "production" / "netlist.ipc").write_bytes(SAME[how]((folder / "b.ipc").read_text()).encode())
    assert names(read_cad(folder)) == NAMED


def test_parts_whose_names_were_cut_to_the_same_are_no_boards_of_a_panel(tmp_path: Path) -> None:
    """`channel1_R1`, `channel1_R2`, ... all become `channe`."""
    counts = (2, 3, 5, 7, 4, 3)
    pads = tuple(
        Pad("channel1", str(pin), f"N{pin}_{k}", 3.0 + 4.0 * pin, 3.0 + 2.0 * k + 0.1 * pin, 1.0, 1.0)
        for pin, count in enumerate(counts, 1) for k in range(count)
    )  # fmt: skip
    cad = read_cad(plain_folder(tmp_path, SmallBoard(pads)))
    assert not cad.copies
    assert len(cad.pins) == sum(counts)


def test_a_netlist_of_another_board_is_refused_by_its_share(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    spread = tuple(replace(p, x=p.x * 1.37 + 0.3 * k, y=p.y * 0.71 + 0.21 * k) for k, p in enumerate(PADS))
    (folder / "b.ipc").write_text(netlist(SmallBoard(spread)))
    with pytest.raises(ValueError, match=r"b\.ipc does not fit the layers: at best \d+% of its 18 places"):
        read_cad(folder)


AROUND = {
    "is mirrored": lambda p: replace(p, x=-p.x),
    "is mirrored and is turned by 180 degrees": lambda p: replace(p, y=7.0 - p.y),
    "is turned by 180 degrees": lambda p: replace(p, x=-p.x, y=-p.y),
    "is turned by 90 degrees": lambda p: replace(p, x=-p.y, y=p.x),
    "names the top's pads as the bottom's": lambda p: replace(p, side={"top": "bottom", "bottom": "top"}[p.side]),
    "is mirrored and names the top's pads as the bottom's": lambda p: replace(
        p, x=30.0 - p.x, side={"top": "bottom", "bottom": "top"}[p.side]
    ),
}


@pytest.mark.parametrize("how", AROUND)
def test_a_netlist_that_lies_another_way_round_than_the_layers_is_refused_with_how(how: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(netlist(SmallBoard(tuple(AROUND[how](p) for p in PADS))))
    with pytest.raises(ValueError, match=rf"b\.ipc does not lie as the layers do: it {how}; export both anew, seen"):
        read_cad(folder)


def test_a_netlist_with_another_origin_is_shifted_there(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(netlist(SmallBoard(), shift=(-50.0, 17.35)))
    assert read_cad(folder).netlist_shift_mm == pytest.approx((50.0, -17.35), abs=0.005)


def test_a_netlist_in_the_wrong_unit_is_read_and_told(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(netlist(SmallBoard()).replace("CUST 1", "CUST 0"))
    cad = read_cad(folder)
    assert cad.pins[0].x_mm == pytest.approx(56.0, abs=0.01)
    assert any("its unit is wrong or not said" in note for note in cad.notes)


def named_folder(folder: Path) -> Path:
    return write(folder, ToolFolder(TOOLS["kicad 8"].names, GerberStyle(x2="command", names=True)))


def test_names_that_the_netlist_cut_are_written_out_by_the_attributes(tmp_path: Path) -> None:
    folder = named_folder(tmp_path)
    copper = folder / "front_panel-F_Cu.gtl"
    copper.write_text(
        copper.read_text().replace("TO.P,TP1,", "TO.P,TP1_LONG_NAME,").replace("TO.N,VCC*", "TO.N,VCC_3V3*")
    )
    cad = read_cad(folder)
    assert ("TP1_LONG_NAME", "1", "SDA") in names(cad)
    assert ("U1", "1", "VCC_3V3") in names(cad)


def test_a_netlist_of_another_state_than_the_copper_is_refused(tmp_path: Path) -> None:
    folder = named_folder(tmp_path)
    swapped = {"VCC": "GND", "GND": "VCC"}
    other = replace(SmallBoard(), pads=tuple(replace(p, net=swapped.get(p.net, p.net)) for p in PADS))
    (folder / "production" / "netlist.ipc").write_text(netlist(other))
    with pytest.raises(ValueError, match=r"name 6 of 15 pads differently \(U1\.1 GND / U1\.1 VCC\): export both"):
        read_cad(folder)


def test_a_pad_on_whose_net_netlist_and_copper_differ_has_none(tmp_path: Path) -> None:
    folder = named_folder(tmp_path)
    other = replace(SmallBoard(), pads=tuple(replace(p, net="GND") if p.part == "TP1" else p for p in PADS))
    (folder / "production" / "netlist.ipc").write_text(netlist(other))
    cad = read_cad(folder)
    assert ("TP1", "1", "") in names(cad)
    assert any("name 1 pads differently, whose nets are left open: TP1.1 GND / TP1.1 SDA" in n for n in cad.notes)


def test_a_source_that_cannot_be_read_gives_way_to_the_next_and_is_told(tmp_path: Path) -> None:
    folder = named_folder(tmp_path)
    (folder / "production" / "netlist.ipc").write_text("P  JOB X\n" + "327VCC   X9 garbled\n" * 5)
    cad = read_cad(folder)
    assert names(cad) >= PARTS
    assert any(note.startswith("left out: production/netlist.ipc: line 2, 3, 4, 5, 6 cannot") for note in cad.notes)


def test_nets_numbered_by_the_netlist_are_no_other_nets(tmp_path: Path) -> None:
    folder = named_folder(tmp_path)
    file = folder / "production" / "netlist.ipc"
    numbers = {"VCC": 1, "SDA": 2, "SCL": 3, "GND": 4}
    other = replace(SmallBoard(), pads=tuple(replace(p, net=f"{p.net}{{{numbers.get(p.net, 5)}}}") for p in PADS))
    file.write_text(netlist(other))
    assert names(read_cad(folder)) >= PARTS
