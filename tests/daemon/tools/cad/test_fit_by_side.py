"""A netlist that fits one side, or in part, or only shrunk to a dot, does not name the pads that it seems to fit."""

from dataclasses import replace
from pathlib import Path

import pytest

from daemon.tools.cad import read_cad
from tests.daemon.tools.cad.small_board import (
    PADS,
    PLAIN,
    SIZE,
    GerberStyle,
    Pad,
    SmallBoard,
    ToolFolder,
    netlist,
    plain_folder,
    write,
)
from tests.daemon.tools.cad.tool_folders import TOOLS

WITH_BOTTOM = SmallBoard(
    (
        *PADS,
        *(
            Pad("R2", str(k + 1), f"N{k}", 21.1 + 1.7 * k, 16.2 - 0.6 * k * k, 0.9, 1.0, side="bottom")
            for k in range(4)
        ),
    )
)


def placed_otherwise(board: SmallBoard, side: str, x: float = 0.0, *, mirrored: bool = False) -> str:
    """Write the board's netlist with the surface pads of one side elsewhere."""
    pads = [
        replace(p, x=(SIZE[0] - p.x if mirrored else p.x + x)) if p.side == side and not p.drill else p
        for p in board.pads
    ]
    return netlist(SmallBoard(tuple(pads)))


@pytest.mark.parametrize("drills", [True, False])
@pytest.mark.parametrize(("x", "how"), [(0.0, "mirrored they do"), (2.5, r"shifted by -2\.50, -?0\.00 mm they do")])
def test_a_side_that_a_netlist_puts_elsewhere_is_refused_with_how(
    x: float, how: str, *, drills: bool, tmp_path: Path
) -> None:
    names = {role: name for role, name in PLAIN.items() if drills or role != "drill"}
    folder = write(tmp_path, ToolFolder(names), WITH_BOTTOM)
    (folder / "b.ipc").write_text(placed_otherwise(WITH_BOTTOM, "bottom", x, mirrored=not x))
    with pytest.raises(ValueError, match=rf"b\.ipc does not fit the bottom: \d+% of the 7 pads .* \({how}\)"):
        read_cad(folder)


def test_a_side_of_which_little_fits_is_told(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(placed_otherwise(SmallBoard(), "bottom", 2.5))
    told = "only 0 of the 3 pads that b.ipc names on the bottom have one there"
    assert any(note.startswith(told) for note in read_cad(folder).notes)


def test_a_shift_that_carries_only_most_of_a_netlist_onto_pads_is_no_origin(tmp_path: Path) -> None:
    """A row of equal pads fits its neighbours: what is left over says that the state of the board is another."""
    folder = plain_folder(tmp_path)
    pads = [replace(p, x=p.x + (9.0 if p.part == "J1" else 1.27)) for p in PADS]
    (folder / "b.ipc").write_text(netlist(SmallBoard(tuple(pads))))
    with pytest.raises(ValueError, match=r"does not fit the layers: at best, shifted by -1\.27, .* with one origin"):
        read_cad(folder)


def test_a_list_of_points_is_not_shrunk_to_a_dot_to_fit(tmp_path: Path) -> None:
    """In um it would all lie on one pad; y runs down in it."""
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").unlink()
    rows = "".join(f"{p.part}.{p.pin},{p.net},{p.x},{-p.y},{p.side}\n" for p in PADS if p.part)
    (folder / "points.csv").write_text(f"Name,Net,X,Y,Side\n{rows}")
    with pytest.raises(ValueError, match="it is mirrored"):
        read_cad(folder)


def test_a_netlist_whose_origin_was_rounded_lies_on_the_pads(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(netlist(SmallBoard(), shift=(0.04, -0.02)))
    assert read_cad(folder).pins[0].x_mm == pytest.approx(56.0, abs=0.002)


def of_another_state(parts: tuple[str, ...]) -> str:
    return netlist(SmallBoard(tuple(replace(p, x=p.x + 0.25) if p.part in parts else p for p in PADS)))


def test_pins_beside_the_middle_of_a_pad_are_of_another_state(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(of_another_state(("J1",)))
    with pytest.raises(ValueError, match=r"b\.ipc puts 5 of 18 pins beside the middle of a pad \(J1\.1\): export"):
        read_cad(folder)


def test_a_pin_beside_the_middle_of_a_pad_is_left_out_and_told(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.ipc").write_text(of_another_state(("TP1",)))
    cad = read_cad(folder)
    assert all(p.part != "TP1" for p in cad.pins)
    assert any("puts 1 of 18 pins beside the middle of a pad (TP1.1): left out" in note for note in cad.notes)


def test_a_pad_that_the_copper_names_may_be_drawn_beside_its_anchor(tmp_path: Path) -> None:
    """A pad of a shape of its own: a small flash, and the region that is the pad, both with the pin's name."""
    files = {role: name for role, name in TOOLS["kicad 8"].names.items() if role != "netlist"}
    folder = write(tmp_path, ToolFolder(files, GerberStyle(x2="command", names=True)))
    copper = folder / files["top copper"]
    regions = "".join(
        f"%TO.N,{p.net}*%\n%TO.P,{p.part},{p.pin}*%\nG36*\n{corners(p)}G37*\n%TD*%\n"
        for p in SmallBoard().placed()
        if p.part == "U1"
    )
    copper.write_text(copper.read_text().replace("M02*", f"{regions}M02*"))
    assert sum(p.part == "U1" for p in read_cad(folder).pins) >= 6


def corners(pad: Pad) -> str:
    """Write a rectangle that reaches 0.5 mm farther up than a pad."""
    x0, x1 = pad.x - pad.w / 2, pad.x + pad.w / 2
    y0, y1 = pad.y - pad.h / 2, pad.y + pad.h / 2 + 0.5
    ways = [(x0, y0, 2), (x1, y0, 1), (x1, y1, 1), (x0, y1, 1), (x0, y0, 1)]
    return "".join(f"X{round(x * 1e6)}Y{round(y * 1e6)}D0{code}*\n" for x, y, code in ways)
