"""Folders and zips are read whole and safely; odd files are left out; options and the roles file settle roles."""

import errno
import json
import re
import tempfile
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from daemon.tools.board_import import import_board
from daemon.tools.cad import read_cad
from daemon.tools.cad.folder import open_cad
from daemon.tools.cad.names import role_by_name
from tests.daemon.tools.cad.small_board import PADS, PLAIN, SmallBoard, ToolFolder, plain_folder, strokes, write
from tests.daemon.tools.cad.test_tool_folders import whole
from tests.daemon.tools.cad.tool_folders import INCH25, TOOLS

NAMES = {
    "MASKTOP.art": "top mask", "SILKBOT.art": "bottom silk", "PASTETOP.art": "top paste",
    "tsoldermask.gbr": "top mask", "bsoldermask.gbr": "bottom mask", "componentmask.gbr": "top mask",
    "rev-F.Cu.gbr": "top copper", "x-B_Cu.gbr": "bottom copper", "x-In1_Cu.gbr": "inner copper",
    "x-F_Silkscreen.gbr": "top silk", "x-B_Courtyard.gbr": "bottom courtyard", "x-F_Fab.gbr": "top fabrication",
    "x-User_Comments.gbr": "ignored", "x-F_Adhesive.gbr": "ignored", "x-Edge_Cuts.gbr": "outline",
    "Board_Copper_Signal_Top.gbr": "top copper", "Board_Copper_Signal_1.gbr": "inner copper",
    "Board_Soldermask_Bot.gbr": "bottom mask", "Board_Legend_Top.gbr": "top silk", "Board_Profile.gbr": "outline",
    "Board_Pads_Top.gbr": "ignored", "Board_Drillmap.gbr": "ignored", "x.GPT": "ignored", "x.G1": "inner copper",
    "x.GP2": "inner copper", "L1_TOP.art": "top copper", "L4_BOTTOM.art": "bottom copper", "L2_GND.art": "inner copper",
    "SMT.art": "top mask", "SSB.art": "bottom silk", "PASTEMASK_TOP.art": "top paste",
    "ASSEMBLY_TOP.art": "top fabrication",
    "MASKT.GBR": "top mask", "SILKB.GBR": "bottom silk", "PASTET.GBR": "top paste", "XXX_SM2.PHO": "bottom mask",
    "XXX_SS1.PHO": "top silk", "smd0123.pho": "top paste", "TopMask.gbr": "top mask", "BottomSilk.gbr": "bottom silk",
    "Gerber_TopPasteMaskLayer.GTP": "top paste", "Gerber_InnerLayer1.G1": "inner copper",
    "t.internalplane1.ger": "inner copper",
    "solderpaste_bottom.gbr": "bottom paste", "Solder Side.gbr": "bottom copper", "Component Side.gbr": "top copper",
    "TopOverlay.gbr": "top silk", "x.toppaste.gbr": "top paste", "Top Solder Mask.gbr": "top mask",
    "x_COPPER-TOP.gbr": "top copper", "x_SOLDERMASK-BOTTOM.gbr": "bottom mask", "x_OUTLINES.gbr": "outline",
    "x - Top Copper (Resist).gbr": "top mask", "x - Top Copper (Paste).gbr": "top paste",
    "x - Top Copper.gbr": "top copper",
    "x - Documentation.gbr": "ignored", "Drill Ident Drawing.gbr": "ignored", "Top Elec.gbr": "top copper",
    "front_panel.g1": "inner copper", "x.L2": "inner copper",
    "bottom-F_Cu.gbr": "top copper", "top-B_Mask.gbr": "bottom mask", "art001.pho": "inner copper",
    "sm001021.pho": "top mask", "sm002028.pho": "bottom mask",
    "sst001026.pho": "top silk", "ssb008029.pho": "bottom silk", "SMTOP.art": "top mask", "SSBOT.art": "bottom silk",
    "SPTOP.art": "top paste", "EtchLayer1Top.gdo": "top copper", "EtchLayer4Bottom.gdo": "bottom copper",
    "compmask.gbr": "top mask", "Lötstoppmaske oben.gbr": "top mask", "Bestückungsdruck unten.gbr": "bottom silk",
    "Board_Copper_Plane_1.gbr": "inner copper", "FAB_OUTLINE.art": "outline", "Fab_Top.art": "top fabrication",
    "TSS.art": "top silk", "PMB.pho": "bottom paste", "tsold.ger": "top mask", "bsilk.ger": "bottom silk",
    "MetalMask-B.fph": "bottom paste", "x.tmk": "top mask", "mystery.gbr": None, "oddT.gbr": None, "panel_v2.gbr": None,
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_name_tells_its_role_or_none(name: str) -> None:
    assert role_by_name(name) == NAMES[name]


def zipped(folder: Path, target: Path, root: str = "") -> Path:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in folder.rglob("*"):
            if file.is_file():
                archive.write(file, root + file.relative_to(folder).as_posix())
    return target


@pytest.mark.parametrize("root", ["", "gerbers/"])
def test_a_zip_is_read_like_its_folder(root: str, tmp_path: Path) -> None:
    whole(read_cad(zipped(write(tmp_path / "in", TOOLS["altium"]), tmp_path / "order.zip", root)))


def test_what_a_packer_puts_beside_the_files_is_not_told(tmp_path: Path) -> None:
    archive = zipped(write(tmp_path / "in", TOOLS["altium"]), tmp_path / "order.zip", "order/")
    with zipfile.ZipFile(archive, "a") as more:
        more.writestr("__MACOSX/order/._b.GTL", b"\0\5\x16\7")
        more.writestr("order/.DS_Store", b"x")
    cad = read_cad(archive)
    whole(cad)
    assert not any("MACOSX" in note or "DS_Store" in note for note in cad.notes)


def test_a_zip_in_a_folder_is_read(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    zipped(write(tmp_path / "in", TOOLS["easyeda"]), tmp_path / "out" / "Gerber.zip")
    (tmp_path / "out" / "readme.pdf").write_bytes(b"%PDF")
    whole(read_cad(tmp_path / "out"))


def apart(folder: Path) -> tuple[Path, Path]:
    """Write a zip without its netlist, and the netlist beside it."""
    plain_folder(folder / "in")
    netlist = (folder / "in" / "b.ipc").rename(folder / "b.ipc")
    return zipped(folder / "in", folder / "order.zip"), netlist


def test_a_letter_of_the_projects_name_is_no_side(tmp_path: Path) -> None:
    names = {role: f"b-{name}" for role, name in PLAIN.items()}
    folder = write(tmp_path, ToolFolder(names))
    (folder / "b-copper-plane.gbr").write_text(strokes(SmallBoard(), INCH25, "Copper,L2,Inr", [[(1, 1), (9, 9)]]))
    whole(read_cad(folder))


@pytest.mark.parametrize("apart", [False, True])
def test_a_zip_in_a_zip_is_read(apart: bool, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path / "in")
    (tmp_path / "order").mkdir()
    if apart:
        (tmp_path / "order" / "net").mkdir()
        (folder / "b.ipc").rename(tmp_path / "order" / "net" / "b.ipc")
    zipped(folder, tmp_path / "order" / "gerbers.zip", "fab/")
    whole(read_cad(zipped(tmp_path / "order", tmp_path / "mail.zip")))


def test_zips_in_zips_without_end_are_not_unpacked(tmp_path: Path) -> None:
    packed = zipped(plain_folder(tmp_path / "in"), tmp_path / "0.zip")
    for n in range(1, 6):
        with zipfile.ZipFile(tmp_path / f"{n}.zip", "w") as archive:
            archive.write(packed, packed.name)
        packed = tmp_path / f"{n}.zip"
    with pytest.raises(ValueError, match="has no Gerber for top copper"):
        read_cad(packed)


@pytest.mark.parametrize("name", ["order.rar", "order.7z"])
def test_an_archive_that_is_not_opened_is_named_with_the_cure(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"Rar!\x1a\x07" + bytes(200))
    for given in (tmp_path, tmp_path / name):
        with pytest.raises(ValueError, match=rf"{name} is packed in a way that is not opened; unpack it and give"):
            read_cad(given)


def test_a_zip_with_a_password_is_named_with_the_cure(tmp_path: Path) -> None:
    data = bytearray(zipped(plain_folder(tmp_path / "in"), tmp_path / "order.zip").read_bytes())
    for mark, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = data.find(mark)
        while at >= 0:
            data[at + flags] |= 1
            at = data.find(mark, at + 4)
    (tmp_path / "order.zip").write_bytes(data)
    with pytest.raises(ValueError, match=r"order\.zip is locked with a password; unpack it and give the folder"):
        read_cad(tmp_path / "order.zip")


def test_a_netlist_beside_a_zip_is_read_where_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order, netlist = apart(tmp_path)
    with pytest.raises(ValueError, match="no names for its pads"):
        read_cad(order)
    whole(read_cad(order, netlist=netlist))
    monkeypatch.chdir(tmp_path)
    whole(read_cad(order, netlist=Path("b.ipc")))
    whole(read_cad(order, layers={"netlist": Path("b.ipc")}))
    with pytest.raises(
        ValueError, match=r"c\.ipc: there is no such file in .*order\.zip; give its name .*, or its path"
    ):
        read_cad(order, netlist=Path("c.ipc"))


def test_a_folder_of_a_zip_and_what_lies_beside_it_is_read_whole(tmp_path: Path) -> None:
    order, netlist = apart(tmp_path / "a")
    folder = tmp_path / "a" / "board"
    folder.mkdir()
    for file in (order, netlist):
        file.rename(folder / file.name)
    for name in ("readme.txt", "bom.csv", "order.md", "stackup.txt"):
        (folder / name).write_text("nothing of interest\n")
    whole(read_cad(folder, keep=True))
    assert (folder / "reprobe-roles.json").is_file()
    whole(read_cad(folder))


def test_gerbers_and_drills_in_zips_of_their_own_are_one_board(tmp_path: Path) -> None:
    plain_folder(tmp_path / "in")
    (tmp_path / "out").mkdir()
    (tmp_path / "nc").mkdir()
    (tmp_path / "in" / "b.drl").rename(tmp_path / "nc" / "b.drl")
    for part in ("in", "nc"):
        (tmp_path / part / "notes.txt").write_text(f"{part}\n")
        zipped(tmp_path / part, tmp_path / "out" / f"{part}.zip")
    whole(read_cad(tmp_path / "out"))


def test_a_zip_beside_the_gerbers_it_was_made_of_is_left_alone(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path / "in")
    zipped(folder, tmp_path / "order.zip").rename(folder / "order.zip")
    cad = read_cad(folder)
    whole(cad)
    assert any("order.zip" in note for note in cad.notes)


def test_a_netlist_named_elsewhere_is_read_and_not_kept_in_the_folder(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path / "in")
    (folder / "b.ipc").rename(tmp_path / "elsewhere.ipc")
    whole(read_cad(folder, netlist=tmp_path / "elsewhere.ipc", keep=True))
    assert "elsewhere" not in (folder / "reprobe-roles.json").read_text()
    (folder / "b.ipc").write_bytes((tmp_path / "elsewhere.ipc").read_bytes())
    whole(read_cad(folder))


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("b.gtl", b"\0" * 90_000_000)
    with pytest.raises(ValueError, match="unpacks to more than CAD can be"):
        read_cad(tmp_path / "bomb.zip")


def test_a_path_that_climbs_out_is_left_out(tmp_path: Path) -> None:
    target = zipped(plain_folder(tmp_path / "in"), tmp_path / "evil.zip")
    with zipfile.ZipFile(target, "a") as archive:
        archive.writestr("../../evil.gtl", "%FSLAX46Y46*%")
        archive.writestr("/etc/evil.gtl", "%FSLAX46Y46*%")
    cad = read_cad(target)
    whole(cad)
    assert any("evil.gtl" in note for note in cad.notes)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["evil.zip", "in"]


def test_a_damaged_zip_is_said(tmp_path: Path) -> None:
    data = zipped(plain_folder(tmp_path / "in"), tmp_path / "a.zip").read_bytes()
    broken = bytearray(data)
    for k in range(60, 900):
        broken[k] ^= 0x5A
    (tmp_path / "b.zip").write_bytes(bytes(broken))
    with pytest.raises(ValueError, match="damaged zip"):
        read_cad(tmp_path / "b.zip")


@pytest.mark.parametrize(
    ("name", "kind"), [("x.PcbDoc", "an Altium board"), ("job.tgz", "an ODB.. archive"), ("x.cvg", "an IPC-2581 file")]
)
def test_a_file_of_another_kind_is_refused_by_its_name(name: str, kind: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"\x1f\x8b\x00")
    with pytest.raises(ValueError, match=rf"{name} is {kind}, which is not read; export Gerber \(X2\), Excellon"):
        read_cad(tmp_path / name)


def test_an_odb_folder_is_refused_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "matrix").mkdir()
    (tmp_path / "matrix" / "matrix").write_text("STEP {\n COL=1\n NAME=PCB\n}\n")
    with pytest.raises(ValueError, match=r"matrix/matrix is an ODB\+\+ archive, which is not read; export Gerber"):
        read_cad(tmp_path)


def test_copper_that_is_only_numbered_is_top_and_bottom_by_number(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTL").rename(folder / "layer_1.pho")
    (folder / "b.GBL").rename(folder / "layer_4.pho")
    (folder / "layer_2.pho").write_text((folder / "b.GTS").read_text())
    whole(read_cad(folder))


def test_a_gerber_without_apertures_is_said_to_be_old(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    text = (folder / "b.GTL").read_text()
    (folder / "b.GTL").write_text("".join(line for line in text.splitlines(keepends=True) if "ADD" not in line))
    with pytest.raises(ValueError, match=r"no apertures of its own \(RS-274-D\); export it as RS-274X or X2"):
        import_board(folder, "top")


@pytest.mark.parametrize(("path", "says"), [("nowhere", "does not exist"), ("file.txt", "neither a folder nor a zip")])
def test_what_is_no_folder_is_said(path: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "file.txt").write_text("hello")
    with pytest.raises(ValueError, match=says):
        read_cad(tmp_path / path)


def test_links_are_not_followed_out_of_the_folder(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path / "in")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "x.GTL").write_text("%FSLAX46Y46*%\n%MOMM*%\nM02*\n")
    (folder / "link").symlink_to(tmp_path / "other")
    assert all("link" not in f.name for f in open_cad(folder).files)


ODD = {
    "readme.pdf": b"%PDF-1.4 \x00\x01", "rules.RUL": b"DRC Rules\n", "bom.csv": b"Comment,Designator\n100n,C1\n",
    "report.txt": b"Drill report\nHoles: 12\n", "data.json": b"{}", "picture.png": b"\x89PNG\r\n\x1a\n\x00",
    "empty.gbr": b"", "notes.md": b"# X\n", "half.gbrjob": b'{"Header": ', "odd.bin": b"\x00\x01\x02",
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_an_odd_file_never_stops_the_reading(name: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / name).write_bytes(ODD[name])
    cad = read_cad(folder)
    whole(cad)
    assert any(name in note for note in cad.notes)


def test_a_broken_layer_that_is_not_needed_is_left_out_and_named(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTO").write_text("%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,1*%\nD99*\nX0Y0D03*\nM02*\n")
    cad = read_cad(folder)
    whole(cad)
    assert any(note.startswith("b.GTO (top silk) was left out: it uses an aperture D99") for note in cad.notes)
    assert cad.roles["b.GTO"] == "ignored"  # type: ignore[index]


def test_a_layer_that_could_not_be_read_once_is_read_when_its_file_is_mended(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    good = (folder / "b.GTO").read_text()
    (folder / "b.GTO").write_text("%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,1*%\nD99*\nX0Y0D03*\nM02*\n")
    assert ("top", "silk") not in read_cad(folder, keep=True).layers
    (folder / "b.GTO").write_text(good)
    cad = read_cad(folder, keep=True)
    assert ("top", "silk") in cad.layers
    assert not any("b.GTO" in note for note in cad.notes)


def test_an_outline_that_was_not_chosen_once_is_chosen_when_the_better_one_is_gone(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b-Profile.gbr").write_text((folder / "b.GKO").read_text())
    first = read_cad(folder, keep=True)
    chosen = next(n for n in ("b.GKO", "b-Profile.gbr") if first.roles[n] == "outline")  # type: ignore[index]
    assert read_cad(folder, keep=True).roles == first.roles
    (folder / chosen).unlink()
    cad = read_cad(folder)
    assert cad.box_mm == first.box_mm
    assert not any("no outline file was found" in note for note in cad.notes)


def test_keeping_the_roles_does_not_blur_which_file_is_surer(tmp_path: Path) -> None:
    folder = write(tmp_path, TOOLS["kicad 8"])
    (folder / "old_top_mask.gbr").write_text((plain_folder(tmp_path / "x") / "b.GTS").read_text())
    for file in sorted((tmp_path / "x").iterdir()):
        file.unlink()
    first = read_cad(folder, keep=True)
    assert first.layers.keys() == read_cad(folder, keep=True).layers.keys()


BROKEN = {
    "it uses an aperture D99": lambda _: "%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,1*%\nD99*\nX0Y0D03*\nM02*\n",
    "the command 'X": lambda text: re.sub(r"Y(\d+)D03", r"Y\1q7D03", text, count=1),
    "it is cut off in the middle of a command": lambda text: text[: text.rindex("D03*") - 3],
}


@pytest.mark.parametrize("why", BROKEN)
@pytest.mark.parametrize("role", ["top copper", "top mask"])
def test_a_broken_layer_that_is_needed_is_refused_in_one_line(role: str, why: str, tmp_path: Path) -> None:
    file = plain_folder(tmp_path) / PLAIN[role]
    file.write_text(BROKEN[why](file.read_text()))
    with pytest.raises(ValueError, match=rf"^{file.name} \({role}\) cannot be read: {why}[^\n]*$"):
        import_board(tmp_path, "top")


@pytest.mark.parametrize("content", [b"", b"\r\n \n"])
@pytest.mark.parametrize("role", ["top copper", "top mask", "netlist"])
def test_an_empty_file_that_is_needed_is_named(role: str, content: bytes, tmp_path: Path) -> None:
    file = plain_folder(tmp_path) / PLAIN[role]
    file.write_bytes(content)
    with pytest.raises(ValueError, match=rf"{file.name} [^;]*is empty[;,] export"):
        import_board(tmp_path, "top")


def test_an_empty_file_that_is_not_needed_is_told(tmp_path: Path) -> None:
    (plain_folder(tmp_path) / "b.GTO").write_text("")
    assert "left out, being empty: b.GTO" in import_board(tmp_path, "top").notes


def test_a_side_without_copper_is_asked_for_where_all_names_lie_on_it(tmp_path: Path) -> None:
    folder = plain_folder(
        tmp_path,
        replace(SmallBoard(), pads=tuple(p for p in PADS if p.side == "top" and (p.part != "J1" or p.pin == "1"))),
    )
    (folder / "b.GTL").unlink()
    with pytest.raises(ValueError, match="has no Gerber for top copper; if one of its files is it, say --layer top"):
        import_board(folder, "top")


FAR = "9" * 30


@pytest.mark.parametrize("role", ["top copper", "top mask", "drill", "netlist", "outline", "top silk"])
def test_a_coordinate_that_lies_on_no_board_is_named_or_its_file_left_out(role: str, tmp_path: Path) -> None:
    file = plain_folder(tmp_path) / PLAIN[role]
    lines = file.read_text().splitlines()
    at = max(k for k, line in enumerate(lines) if re.search(r"X[-+]?\d", line))
    lines[at] = re.sub(r"X[-+]?\d+", f"X{FAR}", lines[at], count=1)
    file.write_text("\n".join(lines) + "\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            told = " ".join(import_board(tmp_path, "top").notes)
        except ValueError as exc:
            told = str(exc)
    assert file.name in told
    assert "in a way nobody thought of" not in told


@pytest.mark.parametrize("why", BROKEN)
@pytest.mark.parametrize("role", ["bottom copper", "bottom mask"])
def test_a_broken_layer_of_the_other_side_is_left_out_and_named(role: str, why: str, tmp_path: Path) -> None:
    file = plain_folder(tmp_path) / PLAIN[role]
    file.write_text(BROKEN[why](file.read_text()))
    assert any(
        note.startswith(f"{file.name} ({role}) was left out: {why}") for note in import_board(tmp_path, "top").notes
    )


def test_a_missing_layer_is_asked_for_with_the_files_that_might_be_it(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    for side in "TB":
        (folder / f"b.G{side}S").rename(folder / f"odd{side}.gbr")
    with pytest.raises(
        ValueError, match=r"no Gerber for top mask, bottom mask; it is not known what odd[TB]\.gbr, odd"
    ):
        read_cad(folder)
    cad = read_cad(folder, layers={"top_mask": Path("oddT.gbr"), "bottom-mask": folder / "oddB.gbr"})
    whole(cad)


def test_two_files_for_one_layer_are_asked_about(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "old").mkdir()
    (folder / "old" / "b.GTL").write_text((folder / "b.GTL").read_text().replace("X56", "X57"))
    with pytest.raises(ValueError, match=r"2 files for top copper: b\.GTL, old/b\.GTL; .*--layer top_copper=FILE"):
        read_cad(folder)
    whole(read_cad(folder, layers={"top_copper": Path("b.GTL")}))


@pytest.mark.parametrize(
    ("role", "file", "says"),
    [("topmask", "b.GTS", "is no layer; one of top_copper"), ("top_mask", "c.GTS", "no such file")],
)
def test_an_option_that_means_nothing_is_said(role: str, file: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=says):
        read_cad(plain_folder(tmp_path), layers={role: Path(file)})


def test_what_an_option_said_is_kept_and_read_again(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTS").rename(folder / "odd.gbr")
    read_cad(folder, layers={"top_mask": Path("odd.gbr")}, keep=True)
    kept = json.loads((folder / "reprobe-roles.json").read_text())
    assert kept["format"] == "reprobe-roles-1"
    assert kept["roles"]["odd.gbr"] == "top mask"
    assert kept["drills"]["b.drl"]["unit"] == "mm"
    whole(read_cad(folder))


def test_the_roles_file_wins_over_guesses_and_options_over_it(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    roles = {"b.GTO": "ignored", "gone.gbr": "top mask"}
    (folder / "reprobe-roles.json").write_text(json.dumps({"format": "reprobe-roles-1", "roles": roles}))
    cad = read_cad(folder)
    assert ("top", "silk") not in cad.layers
    assert any("gone.gbr, which the folder does not have" in note for note in cad.notes)
    assert ("top", "silk") in read_cad(folder, layers={"top_silk": Path("b.GTO")}).layers


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"format": "other"}', '{"format": "reprobe-roles-1", "roles": {"b.GTO": "lid"}}',
             '{"format": "reprobe-roles-1", "drills": {"b.drl": {"unit": "cm"}}}',
             '{"format": "reprobe-roles-1", "roles": 3}'],
)  # fmt: skip
def test_a_roles_file_that_is_wrong_is_said(text: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "reprobe-roles.json").write_text(text)
    with pytest.raises(ValueError, match=r"^reprobe-roles\.json.*mend it or delete it$"):
        read_cad(folder)


def test_a_folder_that_cannot_be_written_to_is_read_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = plain_folder(tmp_path / "in")

    def refuse(**_where: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(tempfile, "mkstemp", refuse)  # root may write everywhere
    cad = read_cad(folder, layers={"top_silk": Path("b.GTO")}, keep=True)
    assert any("cannot be written to" in note for note in cad.notes)


def test_a_zip_keeps_nothing_and_says_so(tmp_path: Path) -> None:
    target = zipped(plain_folder(tmp_path / "in"), tmp_path / "order.zip")
    cad = read_cad(target, layers={"top_silk": Path("b.GTO")}, keep=True)
    assert any("cannot be written to" in note for note in cad.notes)


def test_the_job_file_tells_layers_whose_names_do_not(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GTS").rename(folder / "q1.gbr")
    job = {"FilesAttributes": [{"Path": "q1.gbr", "FileFunction": "SolderMask,Top", "FilePolarity": "Negative"}]}
    (folder / "b.gbrjob").write_text(json.dumps(job))
    whole(read_cad(folder))


def test_x2_wins_over_a_name_that_says_otherwise(tmp_path: Path) -> None:
    folder = write(tmp_path, TOOLS["kicad 8"])
    (folder / "front_panel-F_Mask.gts").rename(folder / "front_panel-bottom_silk.gbo")
    whole(read_cad(folder))


def test_a_frame_round_the_outline_is_not_the_edge_and_a_cut_out_is_none(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    edge = [[(0, 0), (30, 0), (30, 20), (0, 20), (0, 0)]]
    frame = [[(-40, -40), (90, -40), (90, 70), (-40, 70), (-40, -40)]]
    cut = [[(22, 14), (26, 14), (26, 17), (22, 17), (22, 14)]]
    (folder / "b.GKO").write_text(strokes(SmallBoard(), INCH25, "Profile,NP", edge + frame + cut))
    cad = read_cad(folder)
    assert cad.box_mm == pytest.approx((50.0, 30.0, 80.0, 50.0), abs=0.01)
    assert [s.dark for s in cad.outline] == [True, False]


def test_an_outline_of_loose_strokes_in_any_order_is_closed(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    loose = [[(30, 0), (30, 20)], [(0, 0.02), (0, 20)], [(30, 20), (0, 20)], [(0, 0), (30, 0)]]
    (folder / "b.GKO").write_text(strokes(SmallBoard(), INCH25, "Profile,NP", loose))  # type: ignore[arg-type]
    cad = read_cad(folder)
    assert cad.box_mm == pytest.approx((50.0, 30.0, 80.0, 50.0), abs=0.03)
    assert not any("outline" in note for note in cad.notes)


def test_without_an_outline_the_layers_extents_are_taken_and_said(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GKO").unlink()
    cad = read_cad(folder)
    assert cad.box_mm[0] == pytest.approx(50.1, abs=0.01)
    assert any("no outline file was found: the board's edge was taken from the extents" in note for note in cad.notes)


@pytest.mark.parametrize("name", ["b.GM13", "b-User.2.gbr", "assembly.gbr", "b.GD1"])
def test_without_an_outline_the_edge_in_another_drawing_is_taken_and_said(name: str, tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    edge = (folder / "b.GKO").read_text()
    (folder / "b.GKO").unlink()
    (folder / name).write_text(edge)
    cad = read_cad(folder)
    whole(cad)
    assert any(f"no outline file was found: the board's edge is the one that {name} draws" in n for n in cad.notes)


def test_a_sheets_frame_is_no_edge(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    (folder / "b.GKO").unlink()
    frame = [(-40.0, -40.0), (90.0, -40.0), (90.0, 60.0), (-40.0, 60.0), (-40.0, -40.0)]
    (folder / "sheet.gbr").write_text(strokes(SmallBoard(), INCH25, "", [frame]))
    assert any("taken from the extents" in note for note in read_cad(folder).notes)


def test_old_line_ends_are_read(tmp_path: Path) -> None:
    folder = plain_folder(tmp_path)
    for file in folder.iterdir():
        file.write_bytes(file.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r"))
    whole(read_cad(folder))
