"""A board of 20 x 15 mm that a test writes itself: pads of every shape, as a CAD tool would deliver it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sim_hw.board.writer import GerberText, NetRecord, excellon_text, netlist_text

SIZE_MM = (20.0, 15.0)
FAB = "Other,User"


@dataclass(frozen=True)
class RectPad:
    """A surface pad on top; its opening is larger by `opening_mm` all round, negative for a smaller one."""

    part: str
    pin: str
    net: str
    x_mm: float
    y_mm: float
    width_mm: float = 0.5
    height_mm: float = 0.3
    opening_mm: float = 0.05


@dataclass(frozen=True)
class Pin:
    """A drilled pin with a ring on both sides."""

    part: str
    pin: str
    net: str
    x_mm: float
    y_mm: float
    ring_mm: float = 1.6
    hole_mm: float = 1.0


PADS = (
    RectPad("R1", "1", "VIN", 3.0, 3.0),
    RectPad("R1", "2", "GND", 4.4, 3.0),
    RectPad("U1", "1", "SDA", 8.0, 3.0, 0.30, 1.0),
    RectPad("U1", "2", "SCL", 8.33, 3.0, 0.30, 1.0),  # 30 um beside U1.1
    RectPad("U1", "3", "GND", 9.5, 5.0, 3.0, 1.5),
    RectPad("TP1", "1", "VIN", 13.0, 3.0, 1.0, 1.0),
)
PINS = tuple(Pin("J1", str(k + 1), net, 4.0 + 2.54 * k, 10.0) for k, net in enumerate(("VIN", "GND", "SDA")))
VIA = Pin("VIA", "", "GND", 16.0, 10.0, 0.6, 0.3)


def write_board(
    folder: Path,
    pads: Iterable[RectPad] = PADS,
    pins: Iterable[Pin] = (*PINS, VIA),
    courtyards: Iterable[tuple[float, float, float, float]] = (),
    names: dict[str, str] | None = None,
) -> Path:
    """Write the files and return the folder; `names` replaces file names."""
    pads, pins, names = tuple(pads), tuple(pins), names or {}
    copper, mask = GerberText("Copper,L1,Top"), GerberText("Soldermask,Top", "Negative")
    below, below_mask = GerberText("Copper,L2,Bot"), GerberText("Soldermask,Bot", "Negative")
    records = []
    for pad in pads:
        at, size = (pad.x_mm, pad.y_mm), (pad.width_mm, pad.height_mm)
        copper.flash(copper.rectangle(*size), at)
        mask.flash(mask.rectangle(*(value + 2 * pad.opening_mm for value in size)), at)
        records.append(NetRecord(pad.net, pad.part, at, size, pin=pad.pin))
    for pin in pins:
        at, size = (pin.x_mm, pin.y_mm), (pin.ring_mm, 0.0)
        for layer, opening in ((copper, mask), (below, below_mask)):
            layer.flash(layer.circle(pin.ring_mm), at)
            opening.flash(opening.circle(pin.ring_mm + 0.1), at)
        records.append(NetRecord(pin.net, pin.part, at, size, hole_mm=pin.hole_mm, pin=pin.pin, access=0, mask=0))
    copper.line(copper.circle(0.2), [(1.0, 13.0), (19.0, 13.0)])
    outline = GerberText("Profile,NP")
    outline.line(outline.circle(0.1), _rectangle(0.0, 0.0, *SIZE_MM))
    courtyard = GerberText(FAB)
    for box in courtyards:
        courtyard.line(courtyard.circle(0.05), _rectangle(*box))
    holes = [((pin.x_mm, pin.y_mm), pin.hole_mm) for pin in pins]
    texts = {
        "b-F_Cu.gtl": copper.text(),
        "b-F_Mask.gts": mask.text(),
        "b-B_Cu.gbl": below.text(),
        "b-B_Mask.gbs": below_mask.text(),
        "b-Edge_Cuts.gm1": outline.text(),
        "b-PTH.drl": excellon_text(holes, "ComponentDrill"),
        "b.d356": netlist_text("b", records),
    }
    if courtyards:
        texts["b-F_Courtyard.gbr"] = courtyard.text()
    for name, text in texts.items():
        path = folder / names.get(name, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
