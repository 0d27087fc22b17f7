"""Layers, outline and netlist that do not lie on each other are noticed; panels are recognised with their copies."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.tools.board_import import import_boards
from daemon.tools.cad import Cad, read_cad
from tests.daemon.tools.cad.small_board import (
    PADS,
    PLAIN,
    SIZE,
    DrillStyle,
    GerberStyle,
    Pad,
    SmallBoard,
    ToolFolder,
    drills,
    layer,
    netlist,
    outline,
    plain_folder,
    strokes,
    write,
)

STYLE = GerberStyle()


def moved(x: float, y: float) -> SmallBoard:
    return SmallBoard(origin=(50.0 + x, 30.0 + y))


def test_a_mask_at_another_origin_is_refused_with_the_way(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTS").write_text(layer(moved(3.0, -1.5), "top", "mask", STYLE))
    with pytest.raises(ValueError, match=r"the top mask lies 3\.00, -1\.50 mm from the top copper: export both"):
        read_cad(folder)


def test_masks_that_are_exchanged_are_refused(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTS").write_text(layer(SmallBoard(), "bottom", "mask", STYLE))
    (folder / "b.GBS").write_text(layer(SmallBoard(), "top", "mask", STYLE))
    with pytest.raises(
        ValueError, match=r"the bottom mask has its openings on the pads of the top copper \(100% of them"
    ):
        read_cad(folder)


def test_an_outline_that_does_not_hold_the_pads_is_refused_with_the_way(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GKO").unlink()
    (folder / "outline.gbr").write_text(outline(moved(-50.0, -30.0), STYLE))
    with pytest.raises(
        ValueError, match=r"outline\.gbr does not hold the copper's pads \(0% of them, .* --layer outline"
    ):
        read_cad(folder)


FLIPS = {
    "x": replace(SmallBoard(), pads=tuple(replace(p, x=SIZE[0] - p.x) for p in PADS)),
    "y": replace(SmallBoard(), pads=tuple(replace(p, y=SIZE[1] - p.y) for p in PADS)),
}


@pytest.mark.parametrize("flip", FLIPS)
@pytest.mark.parametrize("side", ["top", "bottom"])
def test_a_side_seen_from_the_other_one_is_refused(side: str, flip: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    for use in ("copper", "mask"):
        (folder / PLAIN[f"{side} {use}"]).write_text(layer(FLIPS[flip], side, use, STYLE))
    with pytest.raises(ValueError, match=f"the {side} copper is mirrored against the drills: export it unmirrored"):
        read_cad(folder)


@pytest.mark.parametrize("flip", FLIPS)
def test_mirrored_drills_are_refused_as_such(flip: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.drl").write_text(drills(FLIPS[flip], DrillStyle()))
    with pytest.raises(ValueError, match="the drills are mirrored against the copper: export both unmirrored"):
        read_cad(folder)


@pytest.mark.parametrize("side", ["top", "bottom"])
def test_a_side_at_another_origin_is_refused_with_the_way(side: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    for use in ("copper", "mask"):
        (folder / PLAIN[f"{side} {use}"]).write_text(layer(moved(3.0, -1.5), side, use, STYLE))
    with pytest.raises(ValueError, match=rf"the {side} copper lies 3\.00, -1\.50 mm from the drills: export all"):
        read_cad(folder)


@pytest.mark.parametrize(("side", "name"), [("top", "b.GTS"), ("bottom", "b.GBS")])
def test_a_mask_seen_from_the_other_side_is_refused(side: str, name: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    flipped = replace(SmallBoard(), pads=tuple(replace(p, x=SIZE[0] - p.x) for p in PADS))
    (folder / name).write_text(layer(flipped, side, "mask", STYLE))
    with pytest.raises(
        ValueError, match=f"the {side} mask is mirrored against the {side} copper: export it unmirrored"
    ):
        read_cad(folder)


def test_a_mask_that_does_not_fit_is_told(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    strewn = replace(SmallBoard(), pads=tuple(replace(p, x=p.y * 1.37 + 0.8, y=p.x * 0.61) for p in PADS))
    (folder / "b.GTS").write_text(layer(strewn, "top", "mask", STYLE))
    assert any(
        "% of the top mask's openings lie on a pad of the top copper: compare" in note
        for note in read_cad(folder).notes
    )


def panel(places: Sequence[tuple[float, float, float]], pads: tuple[Pad, ...] = PADS) -> SmallBoard:
    """Lay copies of the small board: lower left corner (x, y) before it is turned about it by degrees."""
    laid: list[Pad] = []
    holes = []
    for x, y, turn in places:
        c, s = round(math.cos(math.radians(turn))), round(math.sin(math.radians(turn)))
        for p in pads:
            w, h = (p.w, p.h) if not s or not p.h else (p.h, p.w)
            laid.append(replace(p, x=x + p.x * c - p.y * s, y=y + p.x * s + p.y * c, w=w, h=h))
        holes += [(x + hx * c - hy * s, y + hx * s + hy * c, d) for hx, hy, d in SmallBoard().holes]
    return SmallBoard(tuple(laid), tuple(holes), (0.0, 0.0))


def panel_folder(folder: Path, places: list[tuple[float, float, float]], at: tuple[float, float]) -> Path:
    board = panel(places)
    names = {
        "top copper": "b.GTL", "bottom copper": "b.GBL", "top mask": "b.GTS", "bottom mask": "b.GBS", "drill": "b.drl",
    }  # fmt: skip
    write(folder, ToolFolder(names), board)
    xs, ys = [p.x for p in board.pads], [p.y for p in board.pads]
    box = [
        (min(xs) - 6, min(ys) - 6),
        (max(xs) + 6, min(ys) - 6),
        (max(xs) + 6, max(ys) + 6),
        (min(xs) - 6, max(ys) + 6),
    ]
    (folder / "b.GKO").write_text(strokes(board, STYLE, "Profile,NP", [[*box, box[0]]]))
    (folder / "b.ipc").write_text(netlist(SmallBoard(origin=at)))
    return folder


PANELS = {
    "two side by side": [(10, 10, 0), (42, 10, 0)],
    "two by three": [(10 + 32 * i, 10 + 22 * j, 0) for j in range(3) for i in range(2)],
    "head to head": [(10, 10, 0), (72, 30, 180)],
    "a quarter turned": [(10, 10, 0), (70, 10, 90)],
    "four ways": [(10, 10, 0), (72, 30, 180), (110, 10, 90), (140, 40, 270)],
}


def check_copies(cad: Cad, places: list[tuple[float, float, float]]) -> None:
    """Check that every copy's pose carries the named pins onto pads."""
    pads = {(round(s.place_mm[0], 1), round(s.place_mm[1], 1)) for s in cad.layers["top", "copper"] if s.place_mm}
    here = cad.copies[cad.named_copy]
    assert len({(c.x_mm, c.y_mm) for c in cad.copies}) == len(places)
    for copy in cad.copies:
        turn = math.radians(copy.turn_deg - here.turn_deg)
        for pin in cad.pins:
            if "top" in pin.access:
                dx, dy = pin.x_mm - here.x_mm, pin.y_mm - here.y_mm
                x = copy.x_mm + dx * math.cos(turn) - dy * math.sin(turn)
                y = copy.y_mm + dx * math.sin(turn) + dy * math.cos(turn)
                near = itertools.product((-0.1, 0.0, 0.1), repeat=2)
                assert any((round(x + a, 1), round(y + b, 1)) in pads for a, b in near)


@pytest.mark.parametrize("kind", PANELS)
def test_a_panel_is_recognised_with_each_copys_pose(kind: str, tmp_path: Path) -> None:
    places = PANELS[kind]
    cad = read_cad(panel_folder(tmp_path, places, (10.0, 10.0)))
    assert sorted(c.turn_deg for c in cad.copies) == sorted(t for *_, t in places)
    assert cad.netlist_shift_mm == (0.0, 0.0)
    check_copies(cad, places)
    assert any(f"a panel of {len(places)} copies; b.ipc names copy" in note for note in cad.notes)


def test_the_copy_that_the_netlist_names_is_the_one_where_it_lies(tmp_path: Path) -> None:
    cad = read_cad(panel_folder(tmp_path, PANELS["two side by side"], (42.0, 10.0)))
    assert cad.named_copy == 1
    assert cad.netlist_shift_mm == (0.0, 0.0)


@pytest.mark.parametrize("kind", ["two side by side", "head to head"])
def test_names_may_be_asked_for_another_copy(kind: str, tmp_path: Path) -> None:
    cad = read_cad(panel_folder(tmp_path, PANELS[kind], (10.0, 10.0)), copy=2)
    assert cad.named_copy == 1
    check_copies(cad, PANELS[kind])
    with pytest.raises(ValueError, match="is a panel of 2 copies; no 3"):
        read_cad(tmp_path, copy=3)


def test_a_panel_with_a_netlist_of_another_origin_names_the_first_copy(tmp_path: Path) -> None:
    cad = read_cad(panel_folder(tmp_path, PANELS["two side by side"], (500.0, 300.0)))
    assert len(cad.copies) == 2
    assert cad.named_copy == 0
    assert cad.netlist_shift_mm == pytest.approx((-490.0, -290.0), abs=0.01)
    check_copies(cad, PANELS["two side by side"])
    assert any("b.ipc lies elsewhere and was taken for copy 1" in note for note in cad.notes)


def outlined(folder: Path, places: list[tuple[float, float, float]]) -> Path:
    """Write a panel whose outline draws the edge of each board."""
    folder = panel_folder(folder, places, places[0][:2])
    ways = []
    for x, y, turn in places:
        c, s = round(math.cos(math.radians(turn))), round(math.sin(math.radians(turn)))
        corners = [(0.0, 0.0), (SIZE[0], 0.0), SIZE, (0.0, SIZE[1]), (0.0, 0.0)]
        ways.append([(x + a * c - b * s, y + a * s + b * c) for a, b in corners])
    (folder / "b.GKO").write_text(strokes(SmallBoard(origin=(0.0, 0.0)), STYLE, "Profile,NP", ways))
    return folder


@pytest.mark.parametrize("kind", ["two side by side", "head to head", "four ways"])
@pytest.mark.parametrize("copy", [None, 1, 2])
def test_a_copys_origin_is_the_corner_of_its_own_edge(kind: str, copy: int | None, tmp_path: Path) -> None:
    cad = read_cad(outlined(tmp_path, PANELS[kind]), copy=copy)
    found = sorted((c.x_mm, c.y_mm, c.turn_deg, c.width_mm) for c in cad.copies)
    assert found == sorted((x, y, turn, SIZE[0]) for x, y, turn in PANELS[kind])
    assert not any("lower left corner of its pads" in note for note in cad.notes)


def test_from_below_a_copys_origin_is_its_lower_left_corner_as_seen_from_there(tmp_path: Path) -> None:
    """10..40 and 42..72 mm wide from the top, the second head to head: from below the panel's edge is at 72 mm."""
    boards = import_boards(outlined(tmp_path, PANELS["head to head"]), "bottom")
    assert [(c.x_um, c.y_um, c.turn_deg) for c in boards["top"].copies] == [(0, 0, 0), (62_000, 20_000, 180)]
    assert [(c.x_um, c.y_um, c.turn_deg) for c in boards["bottom"].copies] == [(32_000, 0, 0), (30_000, 20_000, 180)]


def test_without_the_edge_of_each_board_the_origin_is_the_corner_of_its_pads_and_told(tmp_path: Path) -> None:
    cad = read_cad(panel_folder(tmp_path, PANELS["two side by side"], (10.0, 10.0)))
    assert [(c.x_mm, c.y_mm) for c in cad.copies] == [(14.0, 14.0), (46.0, 14.0)]
    assert any("the origin of each is the lower left corner of its pads" in note for note in cad.notes)


@pytest.mark.parametrize(
    ("at", "copy", "told"),
    [
        ((10.0, 10.0), None, "b.ipc names copy 1"),
        ((10.0, 10.0), 1, "b.ipc names copy 1"),
        ((10.0, 10.0), 2, "b.ipc names copy 1, and its names were carried to copy 2"),
        ((42.0, 10.0), 1, "b.ipc names copy 2, and its names were carried to copy 1"),
        ((500.0, 300.0), 2, "b.ipc lies elsewhere and was taken for copy 2"),
    ],
)
def test_the_note_says_which_copy_the_netlist_names_and_which_is_probed(
    at: tuple[float, float], copy: int | None, told: str, tmp_path: Path
) -> None:
    notes = read_cad(panel_folder(tmp_path, PANELS["two side by side"], at), copy=copy).notes
    assert f"a panel of 2 copies; {told}" in notes


def test_of_a_panel_whose_copper_names_every_board_the_note_says_whose_points_they_are(tmp_path: Path) -> None:
    write(tmp_path, ToolFolder(PANEL_NAMES, X2), panel(PANELS["two side by side"]))
    notes = read_cad(tmp_path, copy=2).notes
    assert "a panel of 2 copies; the copper's X2 attributes name each; the points are those of copy 2" in notes


def test_one_board_is_no_panel(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    assert not read_cad(folder).copies
    with pytest.raises(ValueError, match="is one board, no panel; no 2"):
        read_cad(folder, copy=2)


def test_a_row_of_equal_pads_is_no_panel(tmp_path: Path) -> None:
    pins = tuple(Pad("J1", str(n), f"N{n}", 2.0 + 2.54 * n, 10.0, 1.7, 0.0, 1.0) for n in range(10))
    other = tuple(Pad("J2", str(n), f"N{n}", 2.0 + 2.54 * n, 15.0, 1.7, 0.0, 1.0) for n in range(10))
    cad = read_cad(plain_folder(tmp_path, SmallBoard((*pins, *other))))
    assert not cad.copies
    assert cad.netlist_shift_mm == (0.0, 0.0)


def test_a_netlist_that_fits_in_two_ways_is_refused_not_guessed(tmp_path: Path) -> None:
    pins = tuple(Pad("J1", str(n), f"N{n}", 2.0 + 2.54 * n, 10.0, 1.7, 0.0, 1.0) for n in range(10))
    folder = plain_folder(tmp_path, SmallBoard(pins))
    fewer = SmallBoard(pins[:8])
    (folder / "b.ipc").write_text(netlist(fewer, shift=(100.0, 50.0)))
    with pytest.raises(
        ValueError, match=r"fits the layers in two ways, shifted by .*; export netlist and Gerbers with one"
    ):
        read_cad(folder)


PANEL_NAMES = {
    "top copper": "b.GTL", "bottom copper": "b.GBL", "top mask": "b.GTS", "bottom mask": "b.GBS", "drill": "b.drl",
}  # fmt: skip
TOP_NAMES = {role: name for role, name in PANEL_NAMES.items() if role.startswith("top")}
X2 = GerberStyle(x2="command", names=True)


@pytest.mark.parametrize("kind", PANELS)
def test_a_panel_named_by_its_coppers_attributes_alone_has_the_pins_of_one_board(kind: str, tmp_path: Path) -> None:
    places = PANELS[kind]
    cad = read_cad(write(tmp_path, ToolFolder(PANEL_NAMES, X2), panel(places)))
    x, y, _ = places[0]
    assert {(p.part, p.pin, round(p.x_mm, 2), round(p.y_mm, 2)) for p in cad.pins if p.part} == {
        (p.part, p.pin, round(x + p.x, 2), round(y + p.y, 2)) for p in PADS if p.part
    }
    assert sorted(c.turn_deg for c in cad.copies) == sorted(t for *_, t in places)
    check_copies(cad, places)


@pytest.mark.parametrize("kind", PANELS)
def test_a_panel_whose_netlist_names_every_board_has_the_pins_of_one(kind: str, tmp_path: Path) -> None:
    places = PANELS[kind]
    write(tmp_path, ToolFolder({**PANEL_NAMES, "netlist": "b.ipc"}), panel(places))
    cad = read_cad(tmp_path)
    x, y, _ = places[0]
    assert {(p.part, p.pin, round(p.x_mm, 2), round(p.y_mm, 2)) for p in cad.pins} == {
        (p.part, p.pin, round(x + p.x, 2), round(y + p.y, 2)) for p in PADS
    }
    assert f"a panel of {len(places)} copies; b.ipc names each; the points are those of copy 1" in cad.notes
    check_copies(cad, places)


def test_nets_numbered_by_the_netlist_of_a_panel_are_those_of_the_copy(tmp_path: Path) -> None:
    whole = panel(PANELS["head to head"])
    count = len(PADS)
    named = replace(whole, pads=tuple(replace(p, net=f"{p.net}_{k // count}") for k, p in enumerate(whole.pads)))
    write(tmp_path, ToolFolder({**PANEL_NAMES, "netlist": "b.ipc"}), named)
    assert {p.net for p in read_cad(tmp_path).pins} == {f"{p.net}_0" for p in PADS}
    second = read_cad(tmp_path, copy=2)
    assert {(p.part, p.pin, p.net) for p in second.pins} == {(p.part, p.pin, f"{p.net}_1") for p in PADS}


def test_pins_named_on_both_sides_are_no_panel(tmp_path: Path) -> None:
    """Some tools write a record of a pin for each side."""
    header = tuple(p for p in PADS if p.drill)
    folder = plain_folder(tmp_path, SmallBoard(header))
    text = netlist(SmallBoard(header))
    (folder / "b.ipc").write_text(text.replace("A00", "A01").replace("999\n", text.replace("A00", "A02")))
    assert sorted(min(p.access) for p in read_cad(folder).pins) == ["bottom"] * 8 + ["top"] * 8


HEADS = [(10.0, 10.0, 0.0), (72.0, 30.0, 180.0)]


ROWS = tuple(
    Pad(f"R{k}", "1", f"N{k // 2}", 3.0 + 3 * k + 0.05 * k**2, 16.0 - k % 2 * 12.0, 1.0, 1.0) for k in range(8)
)


def add_tracks(folder: Path, ways: list[tuple[tuple[float, float], tuple[float, float]]]) -> None:
    """Draw tracks of net N0 on the top."""
    drawn = ["%TO.N,N0*%"]
    for way in ways:
        drawn += [f"X{round(x * 1e6)}Y{round(y * 1e6)}D0{code}*" for code, (x, y) in zip((2, 1), way, strict=True)]
    text = (folder / "b.GTL").read_text().replace("%ADD10", "%ADD99C,0.2*%\n%ADD10", 1)
    (folder / "b.GTL").write_text(text.replace("M02*", "\n".join(["D99*", *drawn, "%TD*%", "M02*"])))


def test_tracks_tell_boards_that_stand_head_to_head_from_their_halves(tmp_path: Path) -> None:
    """A row of parts above and below: the line between the rows halves every name, and only a track crosses it."""
    folder = write(tmp_path, ToolFolder(TOP_NAMES, X2), panel(HEADS, pads=ROWS))
    add_tracks(folder, [((13.0, 14.0), (13.0, 26.0)), ((69.0, 26.0), (69.0, 14.0))])
    cad = read_cad(folder)
    assert {(p.part, round(p.x_mm, 2), round(p.y_mm, 2)) for p in cad.pins} == {
        (p.part, round(10 + p.x, 2), 10 + p.y) for p in ROWS
    }


def test_nets_numbered_by_the_panel_tell_its_boards(tmp_path: Path) -> None:
    """The same boards without tracks, their nets named for each board."""
    whole = panel(HEADS, pads=ROWS)
    named = tuple(replace(p, net=f"Board_{k // 8}-{p.net}") for k, p in enumerate(whole.pads))
    cad = read_cad(write(tmp_path, ToolFolder(TOP_NAMES, X2), replace(whole, pads=named)))
    assert {p.net.split("-")[0] for p in cad.pins} == {"Board_0"}
    second = read_cad(tmp_path, copy=2)
    assert {(p.part, p.net) for p in second.pins} == {(p.part, f"Board_1-{p.net}") for p in ROWS}


LEGS = [(2.0 + 2 * k, 2.0) for k in range(14)] + [(2.0, 4.0 + 2 * k) for k in range(7)]
CORNER = tuple(Pad("U1", str(k), f"N{k}", x, y, 1.0, 1.0) for k, (x, y) in enumerate(LEGS))


def test_boards_that_are_not_turned_need_no_straight_cut(tmp_path: Path) -> None:
    """Two boards, each an L, one lying in the corner of the other."""
    folder = write(tmp_path, ToolFolder(TOP_NAMES, X2), panel([(10, 10, 0), (14, 14, 0)], pads=CORNER))
    assert {(p.pin, p.x_mm, p.y_mm) for p in read_cad(folder).pins} == {(p.pin, 10 + p.x, 10 + p.y) for p in CORNER}


def test_a_panel_whose_boards_no_straight_cut_parts_is_refused_with_the_cure(tmp_path: Path) -> None:
    """Two boards of which each reaches into the other: an L and the same turned."""
    folder = write(tmp_path, ToolFolder(TOP_NAMES, X2), panel([(10, 10, 0), (44, 30, 180)], pads=CORNER))
    corner, other = ((38.0, 12.0), (12.0, 12.0), (12.0, 26.0)), ((16.0, 28.0), (42.0, 28.0), (42.0, 14.0))
    add_tracks(folder, [*itertools.pairwise(corner), *itertools.pairwise(other)])
    with pytest.raises(ValueError, match=r"name every part 2 times, and no straight cut .*; give an IPC-D-356 netlist"):
        read_cad(folder)


def test_a_mask_drawn_as_it_lies_is_turned_into_its_openings(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    text = (folder / "b.GTS").read_text()
    ground = "G36*\n" + "".join(
        f"X{x}000000Y{y}000000D0{d}*\n" for x, y, d in ((50, 30, 2), (80, 30, 1), (80, 50, 1), (50, 50, 1), (50, 30, 1))
    )
    (folder / "b.GTS").write_text(text.replace("D10*\n", f"{ground}G37*\n%LPC*%\nD10*\n", 1))
    cad = read_cad(folder)
    assert all(s.dark for s in cad.layers["top", "mask"] if s.flashed)
    assert all(np.ptp(s.points_mm, axis=0).max() < 5.0 for s in cad.layers["top", "mask"])
    assert any("draws the mask itself" in note for note in cad.notes)


def test_a_file_that_is_cut_off_is_told(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTO").write_text((folder / "b.GTO").read_text().replace("M02*", ""))
    assert any("b.GTO (top silk) has no end (M02) and may be cut off" in note for note in read_cad(folder).notes)


def test_a_file_that_is_no_gerber_is_no_layer(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "bom.csv").write_text("Comment,Designator\n100n,C1\n")
    with pytest.raises(ValueError, match=r"bom\.csv is no Gerber, and cannot be the top mask; give another file"):
        read_cad(folder, layers={"top_mask": Path("bom.csv")})


def test_targets_of_the_maker_outside_the_edge_are_told_not_refused(tmp_path: Path) -> None:
    targets = tuple(Pad("", "", "", x, y, 1.0) for x, y in ((-5.0, -5.0), (35.0, 25.0)))
    folder = plain_folder(tmp_path, SmallBoard((*PADS, *targets)))
    (folder / "b.ipc").write_text(netlist(SmallBoard()))
    cad = read_cad(folder)
    assert cad.box_mm == pytest.approx((50.0, 30.0, 80.0, 50.0), abs=0.01)
    assert any("10% of the pads lie outside the edge that b.GKO draws" in note for note in cad.notes)
