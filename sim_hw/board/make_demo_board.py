"""Maker of the demo board: `python -m sim_hw.board.make_demo_board [FOLDER]` (default: the one kept here)."""

import sys
from collections.abc import Iterator
from pathlib import Path

from sim_hw.board import demo_layout as lay
from sim_hw.board.font import strokes
from sim_hw.board.writer import GerberText, NetRecord, excellon_text, netlist_text

FOLDER = Path(__file__).parents[1] / "demo_board"
_PADS = lay.TEST_POINTS + lay.NEIGHBOURS


def _cad(point_mm: lay.Point) -> lay.Point:
    return (point_mm[0] + lay.ORIGIN_MM[0], point_mm[1] + lay.ORIGIN_MM[1])


def _purpose(pad: lay.RoundPad) -> str:
    return "ViaPad" if pad.pad_mm == lay.VIA_PAD_MM else "TestPad"


def _flash_holes(layer: GerberText) -> None:
    for pad in _PADS:
        if pad.hole_mm is not None:
            layer.flash(layer.circle(pad.pad_mm, _purpose(pad)), _cad(pad.centre_mm))
    for centre_mm in lay.TENTED:
        layer.flash(layer.circle(lay.TENTED_PAD_MM, "ViaPad"), _cad(centre_mm))
    for _, centre_mm, _ in lay.HEADER_PINS:
        layer.flash(layer.circle(lay.HEADER_PAD_MM, "ComponentPad"), _cad(centre_mm))


def _top_copper() -> GerberText:
    layer = GerberText("Copper,L1,Top")
    layer.region([_cad(point) for point in lay.POUR_MM])
    layer.clear()
    for pad in _PADS:
        layer.flash(layer.circle(pad.mask_mm + 2 * lay.POUR_GAP_MM, "Other,Clearance"), _cad(pad.centre_mm))
    layer.dark()
    for width_mm, corners in lay.TRACES:
        layer.line(layer.circle(width_mm, "Conductor"), [_cad(point) for point in corners])
    _flash_holes(layer)
    for pad in _PADS:
        if pad.hole_mm is None:
            layer.flash(layer.circle(pad.pad_mm, "TestPad"), _cad(pad.centre_mm))
    for smd in lay.SMD_PADS:
        layer.flash(layer.rectangle(*smd.size_mm, "SMDPad,CuDef"), _cad(smd.centre_mm))
    for _, centre_mm in lay.FIDUCIALS:
        layer.flash(layer.circle(lay.FIDUCIAL_MM, "FiducialPad,Global"), _cad(centre_mm))
    return layer


def _bottom_copper() -> GerberText:
    layer = GerberText("Copper,L2,Bot")
    for (x0, y0), (x1, y1) in zip(lay.TENTED, lay.TENTED[1:], strict=False):
        layer.line(layer.circle(0.25, "Conductor"), [_cad((x0, y0)), _cad((x1, y0)), _cad((x1, y1))])
    layer.clear()
    for pad in _PADS:
        if pad.hole_mm is not None:
            layer.flash(layer.circle(pad.mask_mm + 2 * lay.POUR_GAP_MM, "Other,Clearance"), _cad(pad.centre_mm))
    layer.dark()
    _flash_holes(layer)
    return layer


def _top_mask() -> GerberText:
    layer = GerberText("Soldermask,Top", "Negative")
    grow_mm = 2 * lay.MASK_EXPANSION_MM
    for pad in _PADS:
        layer.flash(layer.circle(pad.mask_mm), _cad(pad.centre_mm))
    for smd in lay.SMD_PADS:
        width_mm, height_mm = smd.size_mm
        layer.flash(layer.rectangle(width_mm + grow_mm, height_mm + grow_mm), _cad(smd.centre_mm))
    for _, centre_mm in lay.FIDUCIALS:
        layer.flash(layer.circle(lay.FIDUCIAL_OPENING_MM), _cad(centre_mm))
    for _, centre_mm, _ in lay.HEADER_PINS:
        layer.flash(layer.circle(lay.HEADER_PAD_MM + grow_mm), _cad(centre_mm))
    return layer


def _bottom_mask() -> GerberText:
    layer = GerberText("Soldermask,Bot", "Negative")
    for pad in _PADS:
        if pad.open_below:
            layer.flash(layer.circle(pad.mask_mm), _cad(pad.centre_mm))
    for _, centre_mm, _ in lay.HEADER_PINS:
        layer.flash(layer.circle(lay.HEADER_PAD_MM + 2 * lay.MASK_EXPANSION_MM), _cad(centre_mm))
    return layer


def _top_silk() -> GerberText:
    layer = GerberText("Legend,Top")
    pen = layer.circle(lay.SILK_WIDTH_MM)
    for text, at_mm, height_mm in lay.SILK_TEXT:
        for stroke in strokes(text, _cad(at_mm), height_mm):
            layer.line(pen, stroke)
    for (x0, y0), (x1, y1) in lay.SILK_BOXES:
        layer.line(pen, [_cad(point) for point in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))])
    return layer


def _bottom_silk() -> GerberText:
    layer = GerberText("Legend,Bot")
    pen = layer.circle(lay.SILK_WIDTH_MM)
    corners = ((4.0, 2.0), (17.0, 2.0), (17.0, 7.0), (4.0, 7.0), (4.0, 2.0))
    layer.line(pen, [_cad(point) for point in corners])
    return layer


def _outline() -> GerberText:
    layer = GerberText("Profile,NP")
    width_mm, height_mm = lay.WIDTH_MM, lay.HEIGHT_MM
    corners = ((0.0, 0.0), (width_mm, 0.0), (width_mm, height_mm), (0.0, height_mm), (0.0, 0.0))
    layer.line(layer.circle(0.05, "Profile"), [_cad(point) for point in corners])
    return layer


def _records() -> Iterator[NetRecord]:
    for pad in _PADS:
        size_mm = (pad.pad_mm, 0.0)
        drilled = pad.hole_mm is not None
        below = pad.open_below
        yield NetRecord(
            net=pad.net,
            reference=pad.name,
            centre_mm=_cad(pad.centre_mm),
            size_mm=size_mm,
            hole_mm=pad.hole_mm,
            pin="" if pad.name == "VIA" else "1",
            access=0 if drilled else 1,
            mask=0 if below else 2,
        )
    for i, centre_mm in enumerate(lay.TENTED):
        net = "GND" if i % 2 else "VCC"
        yield NetRecord(
            net=net,
            reference="VIA",
            centre_mm=_cad(centre_mm),
            size_mm=(lay.TENTED_PAD_MM, 0.0),
            hole_mm=lay.TENTED_HOLE_MM,
            pin="",
            access=0,
            mask=3,
        )
    for pin, centre_mm, net in lay.HEADER_PINS:
        yield NetRecord(
            net=net,
            reference="J1",
            centre_mm=_cad(centre_mm),
            size_mm=(lay.HEADER_PAD_MM, 0.0),
            hole_mm=lay.HEADER_HOLE_MM,
            pin=pin,
            access=0,
            mask=0,
        )
    for smd in lay.SMD_PADS:
        yield NetRecord(
            net=smd.net,
            reference=smd.reference,
            centre_mm=_cad(smd.centre_mm),
            size_mm=smd.size_mm,
            hole_mm=None,
            pin=smd.pin,
        )
    for name, centre_mm in lay.FIDUCIALS:
        yield NetRecord("N/C", name, _cad(centre_mm), (lay.FIDUCIAL_MM, 0.0))


def board_files() -> dict[str, str]:
    """Return every file of the demo board: name -> text."""
    drilled = [(_cad(pad.centre_mm), pad.hole_mm, pad.capped) for pad in _PADS if pad.hole_mm is not None]
    open_holes = [(centre, hole) for centre, hole, capped in drilled if not capped]
    open_holes += [(_cad(centre), lay.TENTED_HOLE_MM) for centre in lay.TENTED]
    open_holes += [(_cad(centre), lay.HEADER_HOLE_MM) for _, centre, _ in lay.HEADER_PINS]
    capped_holes = [(centre, hole) for centre, hole, capped in drilled if capped]
    return {
        "demo-F_Cu.gtl": _top_copper().text(),
        "demo-B_Cu.gbl": _bottom_copper().text(),
        "demo-F_Mask.gts": _top_mask().text(),
        "demo-B_Mask.gbs": _bottom_mask().text(),
        "demo-F_Silkscreen.gto": _top_silk().text(),
        "demo-B_Silkscreen.gbo": _bottom_silk().text(),
        "demo-Edge_Cuts.gm1": _outline().text(),
        "demo-PTH.drl": excellon_text(open_holes, "ViaDrill"),
        "demo-capped-PTH.drl": excellon_text(capped_holes, "ViaDrill,VII"),
        "demo.d356": netlist_text("DEMO", _records()),
    }


def main(folder: Path = FOLDER) -> None:
    """Write the files into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in board_files().items():
        (folder / name).write_text(text)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
