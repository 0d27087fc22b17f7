"""Real boards are read whole. Run where the boards lie beside the project."""

import math
import re
import shutil
from pathlib import Path

import pytest

from daemon.tools.cad import Drill, read_cad

ROOT = Path(__file__).parents[4]
REAL = ROOT.parent / "shared" / "boards"
CASES = ROOT.parent / "shared" / "cases" / "cad"
# board: size in mm, the netlist's origin in the Gerbers; read in the boards' own drawings.
BOARDS = {
    "F1Tenth-powerboard": ((57.02, 77.5), (0.0, 0.0)),
    "bioreactor": ((165.0, 110.0), (0.0, 0.0)),
    "cloud-dripper": ((50.8, 50.8), (0.0, 0.0)),
    "glasgow-revC3": ((80.0, 49.0), (50.0, -120.0)),
    "open-motion-light": ((80.0, 80.0), (0.0, 0.0)),
    "pico-ice-rev1": ((22.86, 60.96), (60.96, -132.08)),
}


def lines_of(folder: Path, *suffixes: str) -> list[str]:
    return [line for f in folder.rglob("*") if f.suffix in suffixes for line in f.read_text().splitlines()]


@pytest.mark.parametrize("name", BOARDS)
def test_a_real_board_is_read_whole(name: str) -> None:
    if not (REAL / name).is_dir():
        pytest.skip("the real boards are not beside the project")
    size, origin = BOARDS[name]
    cad = read_cad(REAL / name)
    x0, y0, x1, y1 = cad.box_mm
    assert (x1 - x0, y1 - y0) == pytest.approx(size, abs=0.02)
    assert cad.netlist_shift_mm == pytest.approx(origin, abs=0.003)
    assert not cad.copies
    records = [line for line in lines_of(REAL / name, ".ipc", ".d356") if re.match(r"3[126]7", line)]
    commands = lines_of(REAL / name, ".drl")
    hits, slots = sum(line.startswith("X") for line in commands), commands.count("M15")
    assert len(records) > 200
    assert len(cad.pins) == len(records)
    assert len(cad.drills) == hits + slots
    assert sum(d.end_x_mm is not None for d in cad.drills) == slots


@pytest.mark.parametrize("name", BOARDS)
def test_of_a_real_board_nothing_is_left_over_but_what_is_no_cad(name: str) -> None:
    if not (REAL / name).is_dir():
        pytest.skip("the real boards are not beside the project")
    (note,) = read_cad(REAL / name).notes
    left = note.removeprefix("left out, being no CAD of a layer: ").split(", ")
    assert all(file.startswith("LICENSE") or file.endswith(".csv") for file in left)


@pytest.mark.parametrize("name", BOARDS)
def test_on_a_real_board_netlist_and_drill_file_tell_the_same_holes(name: str) -> None:
    """Two files that know nothing of each other: places to 10 um, diameters to the netlist's 2.54 um."""
    if not (REAL / name).is_dir():
        pytest.skip("the real boards are not beside the project")
    cad = read_cad(REAL / name)
    slots = [d for d in cad.drills if d.end_x_mm is not None]
    drills = {(round(d.x_mm, 1), round(d.y_mm, 1)): d for d in cad.drills if d.end_x_mm is None}
    told = [p for p in cad.pins if p.hole_mm and not any(math.dist((p.x_mm, p.y_mm), middle(d)) < 0.01 for d in slots)]
    assert len(told) >= 0.95 * len(cad.drills)
    for pin in told:
        near = (
            drills.get((round(pin.x_mm + a, 1), round(pin.y_mm + b, 1)))
            for a in (0, 0.05, -0.05)
            for b in (0, 0.05, -0.05)
        )
        drill = min((d for d in near if d), key=lambda d: math.dist((d.x_mm, d.y_mm), (pin.x_mm, pin.y_mm)))
        assert math.dist((drill.x_mm, drill.y_mm), (pin.x_mm, pin.y_mm)) < 0.01, (pin.part, pin.pin)
        assert drill.diameter_mm == pytest.approx(pin.hole_mm, abs=0.003), (pin.part, pin.pin)


def middle(slot: Drill) -> tuple[float, float]:
    return (slot.x_mm + (slot.end_x_mm or 0.0)) / 2, (slot.y_mm + (slot.end_y_mm or 0.0)) / 2


@pytest.mark.parametrize("name", ["pico-ice-rev1", "cloud-dripper"])
def test_the_drill_file_of_another_real_board_is_refused(name: str, tmp_path: Path) -> None:
    """In planes many of the holes are surrounded by copper; the rest cut through tracks or lie beside the board."""
    if not REAL.is_dir():
        pytest.skip("the real boards are not beside the project")
    folder = tmp_path / "board"
    shutil.copytree(REAL / "open-motion-light", folder)
    own, other = next(folder.rglob("*-PTH.drl")), next((REAL / name).rglob("*-PTH.drl"))
    own.write_bytes(other.read_bytes())
    with pytest.raises(ValueError, match=rf"the holes of .*{own.name} do not fit the board: .* of another board"):
        read_cad(folder)


def test_names_cut_by_the_netlist_are_written_out_by_the_coppers_attributes() -> None:
    if not REAL.is_dir():
        pytest.skip("the real boards are not beside the project")
    nets = {p.net for p in read_cad(REAL / "F1Tenth-powerboard").pins}
    assert any(len(net) > 14 for net in nets)


def test_drills_at_another_origin_are_refused_with_the_way() -> None:
    if not CASES.is_dir():
        pytest.skip("the cases are not beside the project")
    with pytest.raises(ValueError, match=r"lie -12\.70, -12\.70 mm from the copper's pads: export both"):
        read_cad(CASES / "drills-at-another-origin")


def test_a_panel_is_recognised_and_the_named_copy_told() -> None:
    if not CASES.is_dir():
        pytest.skip("the cases are not beside the project")
    cad = read_cad(CASES / "panel-of-two")
    assert [(c.name, c.turn_deg) for c in cad.copies] == [("1", 0.0), ("2", 0.0)]
    assert cad.copies[1].x_mm - cad.copies[0].x_mm == pytest.approx(45.0)
    assert cad.named_copy == 0
    assert any("a panel of 2 copies" in note for note in cad.notes)
    second = read_cad(CASES / "panel-of-two", copy=2)
    assert second.pins[0].x_mm - cad.pins[0].x_mm == pytest.approx(45.0)


def test_a_record_with_a_long_part_name_is_read() -> None:
    if not CASES.is_dir():
        pytest.skip("the cases are not beside the project")
    named = {(p.part, p.pin): p for p in read_cad(CASES / "eagle-long-part-name").pins}
    assert named["TESTPOINT-6", "1"].net == "SENSE_P"
