"""IPC-D-356 is read in the dialects tools write; a line that cannot be read is named, the rest is read."""

from collections.abc import Callable
from pathlib import Path

import pytest

from daemon.tools.cad import read_cad
from daemon.tools.cad.ipc356 import looks_like_netlist, read_ipc356
from tests.daemon.tools.cad.small_board import SmallBoard, netlist, plain_folder

ROOT = Path(__file__).parents[4]
EAGLE = ROOT.parent / "shared" / "boards" / "eagle-ipc-only" / "ipc-d-356.ipc"
HEAD = "P  JOB X\nP  UNITS CUST 0\n"


def one(line: str, head: str = HEAD) -> tuple[str, str, str, float, float]:
    """Read one record: net, part, pin, x and y in the netlist's unit of 2.54 um."""
    (record,) = read_ipc356(f"{head}{line}\n999\n").records
    return record.net, record.reference, record.pin, round(record.x_mm / 0.00254), round(record.y_mm / 0.00254)


RECORDS = {
    "KiCad via without the blank column": (
        "317/SDA             VIA        MD0118PA00X+010787Y+005236X0236Y0000R000S3", ("/SDA", "", "", 10787, 5236)),
    "KiCad pad": (
        "327NET-(D1-K)       D1    -1          A01X+010787Y-005236X0236Y0300R270S2",
        ("NET-(D1-K)", "D1", "1", 10787, -5236)),
    "EAGLE, numbers padded with blanks": (
        "327N$3              C1    -+          A01X   9700Y  10402X1575Y 630R270", ("N$3", "C1", "+", 9700, 10402)),
    "EAGLE, a pin called minus": (
        "327GND              C1    --          A01X   9700Y  13198X1575Y 630R270", ("GND", "C1", "-", 9700, 13198)),
    "a long part name pushes all": (
        "317SENSE_P          TESTPOINT-6-1    D0120PA00X+023000Y+029000X0450Y0000R000 S2",
        ("SENSE_P", "TESTPOINT-6", "1", 23000, 29000)),
    "a long part name ending in D3": (
        "327SENSE_P          LONGPARTD3-12          A01X+023000Y+029000X0450Y0450R000 S2",
        ("SENSE_P", "LONGPARTD3", "12", 23000, 29000)),
    "a long net pushes all": (
        "327A_VERY_LONG_NET_NAME   R12   -2          A01X+000100Y+000200X0450Y0450R000 S2",
        ("A_VERY_LONG_NET_NAME", "R12", "2", 100, 200)),
    "a fiducial with no pin": (
        "327N/C              FID3  -           A01X+013000Y+037000X1000Y0000R000 S2",
        ("", "FID3", "", 13000, 37000)),
    "numbers without plus": (
        "327VCC              U1    -14         A01X 013000Y 037000X0100Y0200R000 S2",
        ("VCC", "U1", "14", 13000, 37000)),
    "no size, no mask": (
        "317VCC              J1    -1     D0400PA00X+013000Y+037000", ("VCC", "J1", "1", 13000, 37000)),
    "unplated hole": (
        "367N/C              MTG1  -1     D1250UA00X+013000Y+037000X1250Y0000", ("", "MTG1", "1", 13000, 37000)),
    "no net, plating without a hole": (
        "327                 U4    -1         PA01X 074295Y 034925X0850Y0400R000 S0", ("", "U4", "1", 74295, 34925)),
    "seven digits": (
        "317GND              D1    -1    D0315PA00X+0001000Y-0002000X0591Y0000R030S0", ("GND", "D1", "1", 1000, -2000)),
    "Altium via": (
        "317GND              VIA   -     MD0118PA00X+013000Y+037000X0236Y0000R000S3", ("GND", "", "", 13000, 37000)),
}  # fmt: skip


RECORDS |= {
    "small letters": (
        "327net-(d1-k)       d1    -1          a01x+010787y-005236x0236y0300r270s2",
        ("net-(d1-k)", "d1", "1", 10787, -5236)),
    "a via in small letters": (
        "317/sda             via        md0118pa00x+010787y+005236x0236y0000r000s3", ("/sda", "", "", 10787, 5236)),
    "indented": (
        "  327VCC              U1    -14         A01X+013000Y+037000X0100Y0200R000 S2",
        ("VCC", "U1", "14", 13000, 37000)),
    "318": (
        "318VCC              J1    -1    MD0400PA00X+013000Y+037000X0600Y0000R000 S0",
        ("VCC", "J1", "1", 13000, 37000)),
    "328": (
        "328VCC              U1    -14         A01X+013000Y+037000X0100Y0200R000 S2",
        ("VCC", "U1", "14", 13000, 37000)),
}  # fmt: skip


@pytest.mark.parametrize("kind", RECORDS)
def test_a_record_is_read_as_the_tool_writes_it(kind: str) -> None:
    line, wanted = RECORDS[kind]
    assert one(line) == wanted


@pytest.mark.parametrize(
    ("unit", "mm"), [("CUST 0", 2.54), ("CUST 1", 1.0), ("CUST 2", 2.54), ("CUST", 2.54), ("SI", 1.0)]
)
def test_units_are_as_said(unit: str, mm: float) -> None:
    text = f"P  JOB X\nP  UNITS {unit}\n327VCC              U1    -14         A01X+001000Y+000000X0100Y0200R000 S2\n"
    assert read_ipc356(text).records[0].x_mm == pytest.approx(mm)


def test_the_unit_may_be_said_in_small_letters() -> None:
    text = netlist(SmallBoard())
    assert read_ipc356(text.lower()).records[0].x_mm == read_ipc356(text).records[0].x_mm


def test_aliases_give_long_net_names_back() -> None:
    head = HEAD + "P  NNAME1 A_REALLY_LONG_NET_NAME\nP  NNAME12 ANOTHER LONG ONE\n"
    assert (
        one("327NNAME1           R1    -1          A01X+001000Y+000000X0100Y0200", head)[0] == "A_REALLY_LONG_NET_NAME"
    )
    assert one("327NNAME12          R1    -1          A01X+001000Y+000000X0100Y0200", head)[0] == "ANOTHER LONG ONE"


@pytest.mark.parametrize("said", ["NNAME001", "NNAME1", "001"])
def test_aliases_may_be_numbered_apart(said: str) -> None:
    head = HEAD + "P  NNAME 001 A LIM\n"
    assert one(f"327{said:<14}   R1    -1          A01X+001000Y+000000X0100Y0200", head)[0] == "A LIM"


def test_hole_and_mask_and_access_are_read() -> None:
    text = HEAD + "317GND              VIA        MD0118PA00X+013000Y+037000X0236Y0000R000 S1\n"
    record = read_ipc356(text).records[0]
    assert record.hole_mm == pytest.approx(0.29972)
    assert (record.mask, record.access, record.plated) == (1, 0, True)


def test_the_bottom_is_the_largest_access_number_of_surface_pads() -> None:
    text = HEAD + "".join(
        f"327VCC              U1    -{n:<4}       A{n:02d}X+001000Y+000000X0100Y0200R000 S2\n" for n in (1, 4)
    )
    assert read_ipc356(text).bottom_layer == 4


def test_continuations_and_conductors_are_no_pads() -> None:
    text = netlist(SmallBoard()).replace(
        "999", "027                                     A02X+001000Y+000000\n"
        "378SDA              L01 X0100       X+001000Y+000000 X+002000Y+000000\n999"
    )  # fmt: skip
    assert len(read_ipc356(text).records) == 18


def test_a_line_that_cannot_be_read_is_named_and_the_rest_is_read(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    lines = netlist(SmallBoard()).splitlines()
    lines[5] = "327VCC              U1    -3   garbled"
    (folder / "b.ipc").write_text("\n".join(lines) + "\n")
    cad = read_cad(folder)
    assert len(cad.pins) == 17
    assert any("line 6 cannot be read and was left out" in note for note in cad.notes)


@pytest.mark.parametrize(
    "change",
    [
        str.lower,
        lambda text: text.replace("\n3", "\n  3"),
        lambda text: text.replace("\n3", "\n\t3"),
        lambda text: text.replace("    ", "\t"),
    ],
)
def test_small_letters_indents_and_tabs_tell_the_same_pads(change: Callable[[str], str], tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    wanted = {(p.part, p.pin, p.net, p.x_mm, p.y_mm) for p in read_cad(folder).pins}
    (folder / "b.ipc").write_text(change(netlist(SmallBoard())))
    found = {(p.part.upper(), p.pin, p.net.upper(), p.x_mm, p.y_mm) for p in read_cad(folder).pins}
    assert found == wanted


def test_a_netlist_without_its_end_is_told(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    lines = netlist(SmallBoard()).splitlines()
    (folder / "b.ipc").write_text("\n".join(lines[:-5]))
    assert any("b.ipc has no end (999) and may be cut off" in note for note in read_cad(folder).notes)


def test_names_in_an_old_code_page_stay_apart(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    text = netlist(SmallBoard()).replace("SDA", "N\xdc ").replace("SCL", "N\xd6 ")
    (folder / "b.ipc").write_bytes(text.encode("latin-1"))
    assert {"N\xdc", "N\xd6"} <= {p.net for p in read_cad(folder).pins}


def test_a_netlist_of_which_little_can_be_read_is_refused_by_line(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    text = netlist(SmallBoard()).replace("X+", "?")
    (folder / "b.ipc").write_text(text + "327VCC              U1    -14         A01X+001000Y+000000X0100Y0200\n")
    with pytest.raises(ValueError, match=r"b\.ipc: line 4, 5, 6, 7, 8 cannot be read; export the netlist"):
        read_cad(folder)


def test_a_netlist_is_known_by_its_content() -> None:
    assert looks_like_netlist(netlist(SmallBoard()))
    assert looks_like_netlist("\n".join(netlist(SmallBoard()).splitlines()[3:]))  # without any head
    assert not looks_like_netlist("317 Main Street\nX marks the spot\n")


@pytest.mark.parametrize("mark", ["utf-8-sig", "utf-16"])
def test_byte_order_marks_do_not_matter(mark: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    for file in folder.iterdir():
        file.write_bytes(file.read_text().encode(mark))
    assert len(read_cad(folder).pins) == 18


def test_eagles_netlist_is_read_whole() -> None:
    if not EAGLE.is_file():
        pytest.skip("the real boards are not beside the project")
    found = read_ipc356(EAGLE.read_text())
    assert len(found.records) == 105
    assert not found.unread
    assert sum(not r.reference for r in found.records) == 14
    assert "A_REALLY_LONG_NET_NAME" in {r.net for r in found.records}
