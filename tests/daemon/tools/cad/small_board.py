"""A small board of the tests' own, written as CAD tools write theirs: names, units, formats, dialects.

30 x 20 mm: a part U1 of four rectangles on top, a header J1 of five pins, three vias, test pads TP1 and TP2 (bottom).
All coordinates in mm, y up, seen from the top.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path


@dataclass(frozen=True)
class Pad:
    """A pad: size (w, h), h 0 for a round one; drill 0 for none."""

    part: str
    pin: str
    net: str
    x: float
    y: float
    w: float
    h: float = 0.0
    drill: float = 0.0
    side: str = "top"
    open: bool = True
    slot: tuple[float, float] | None = None


PADS = (
    Pad("U1", "1", "VCC", 6.0, 12.0, 0.6, 1.2),
    Pad("U1", "2", "SDA", 7.27, 12.0, 0.6, 1.2),
    Pad("U1", "3", "SCL", 8.54, 12.0, 0.6, 1.2),
    Pad("U1", "4", "GND", 9.81, 12.0, 0.6, 1.2),
    Pad("U1", "5", "RESET_N", 6.0, 16.4, 0.6, 1.2),
    Pad("U1", "6", "GND", 9.81, 16.4, 0.6, 1.2),
    Pad("J1", "1", "VCC", 4.0, 4.0, 1.7, 0.0, 1.0),
    Pad("J1", "2", "SDA", 6.54, 4.0, 1.7, 0.0, 1.0),
    Pad("J1", "3", "SCL", 9.08, 4.0, 1.7, 0.0, 1.0),
    Pad("J1", "4", "RESET_N", 11.62, 4.0, 1.7, 0.0, 1.0),
    Pad("J1", "5", "GND", 14.16, 4.0, 1.7, 0.0, 1.0),
    Pad("TP1", "1", "SDA", 17.3, 14.1, 1.0),
    Pad("TP2", "1", "SCL", 21.7, 9.9, 1.2, side="bottom"),
    Pad("R1", "1", "VCC", 24.0, 5.3, 0.9, 1.0, side="bottom"),
    Pad("R1", "2", "SDA", 25.7, 5.3, 0.9, 1.0, side="bottom"),
    Pad("", "", "GND", 13.1, 9.2, 0.6, 0.0, 0.3, open=False),
    Pad("", "", "SDA", 19.4, 17.7, 0.6, 0.0, 0.3, open=False),
    Pad("", "", "SCL", 27.3, 12.9, 0.6, 0.0, 0.3, open=False),
)
SIZE = (30.0, 20.0)


@dataclass(frozen=True)
class SmallBoard:
    """Pads and unplated holes, and where its lower left corner lies."""

    pads: tuple[Pad, ...] = PADS
    holes: tuple[tuple[float, float, float], ...] = ((2.2, 17.8, 2.0), (27.6, 2.3, 2.0))
    origin: tuple[float, float] = (50.0, 30.0)

    def placed(self) -> tuple[Pad, ...]:
        """Return the pads at the board's place."""
        return tuple(replace(p, x=p.x + self.origin[0], y=p.y + self.origin[1]) for p in self.pads)


@dataclass(frozen=True)
class GerberStyle:
    """How a tool writes Gerber."""

    unit: str = "mm"
    integers: int = 4
    decimals: int = 6
    zeros: str = "L"  # omitted: L leading, T trailing
    x2: str = ""  # "" none, "command", "comment"
    names: bool = False  # X2 .P .N
    header: str = ""


def number(value_mm: float, style: GerberStyle) -> str:
    """Write a coordinate."""
    value = value_mm / (25.4 if style.unit == "inch" else 1.0)
    digits = f"{abs(round(value * 10**style.decimals)):0{style.integers + style.decimals}d}"
    digits = digits.lstrip("0") if style.zeros == "L" else digits.rstrip("0")
    return ("-" if value < 0 and digits else "") + (digits or "0")


def gerber(style: GerberStyle, function: str, body: Iterable[str], apertures: Iterable[str] = ()) -> str:
    """Write a Gerber file round its body."""
    attribute = f"TF.FileFunction,{function}*"
    x2 = {"": "", "command": f"%{attribute}%\n", "comment": f"G04 #@! {attribute}\n"}[style.x2]
    form = f"X{style.integers}{style.decimals}Y{style.integers}{style.decimals}"
    unit = "MM" if style.unit == "mm" else "IN"
    head = f"{style.header}{x2}%FS{style.zeros}A{form}*%\n%MO{unit}*%\n%LPD*%\nG01*\n"
    return head + "".join(f"{a}\n" for a in apertures) + "".join(f"{line}\n" for line in body) + "M02*\n"


def layer(board: SmallBoard, side: str, use: str, style: GerberStyle) -> str:
    """Write copper or mask of one side."""
    unit_mm = 25.4 if style.unit == "inch" else 1.0
    codes: dict[tuple[float, float], int] = {}
    lines: list[str] = []
    for pad in board.placed():
        if (pad.drill == 0 and pad.side != side) or (use == "mask" and not pad.open):
            continue
        grow = 0.1 if use == "mask" else 0.0
        size = (pad.w + grow, pad.h + grow if pad.h else 0.0)
        code = codes.setdefault(size, 10 + len(codes))
        if style.names and use == "copper":
            lines.append(f"%TO.N,{pad.net}*%")
            lines.append(f"%TO.P,{pad.part},{pad.pin}*%" if pad.part else "%TO.C,*%")
        lines.append(f"D{code}*")
        lines.append(f"X{number(pad.x, style)}Y{number(pad.y, style)}D03*")
        if style.names and use == "copper":
            lines.append("%TD*%")
    lines += [
        "D10*",
        *_line(style, (board.origin[0] + 1, board.origin[1] + 1.0), (board.origin[0] + 2, board.origin[1] + 1.2)),
    ]
    defined = [
        f"%ADD{code}{f'R,{w / unit_mm:.6f}X{h / unit_mm:.6f}' if h else f'C,{w / unit_mm:.6f}'}*%"
        for (w, h), code in codes.items()
    ]
    if style.names and use == "copper":
        defined = ["%TA.AperFunction,SMDPad,CuDef*%", *defined, "%TD*%"]
    name = {
        "copper": f"Copper,{'L1,Top' if side == 'top' else 'L2,Bot'}",
        "mask": f"Soldermask,{'Top' if side == 'top' else 'Bot'}",
    }
    return gerber(style, name[use], lines, defined)


def _line(style: GerberStyle, a: tuple[float, float], b: tuple[float, float]) -> list[str]:
    return [
        f"X{number(a[0], style)}Y{number(a[1], style)}D02*",
        f"X{number(b[0], style)}Y{number(b[1], style)}D01*",
    ]


def strokes(board: SmallBoard, style: GerberStyle, function: str, ways: list[list[tuple[float, float]]]) -> str:
    """Write a layer of pen strokes: silkscreen, outline; board coordinates."""
    x0, y0 = board.origin
    pen = 0.1 / (25.4 if style.unit == "inch" else 1.0)
    body = ["D10*"]
    for way in ways:
        for a, b in itertools.pairwise(way):
            body += _line(style, (a[0] + x0, a[1] + y0), (b[0] + x0, b[1] + y0))
    return gerber(style, function, body, [f"%ADD10C,{pen:.6f}*%"])


def outline(board: SmallBoard, style: GerberStyle) -> str:
    """Write the board's edge."""
    w, h = SIZE
    return strokes(board, style, "Profile,NP", [[(0, 0), (w, 0), (w, h), (0, h), (0, 0)]])


def silk(board: SmallBoard, style: GerberStyle, side: str) -> str:
    """Write some ink."""
    return strokes(
        board, style, f"Legend,{'Top' if side == 'top' else 'Bot'}", [[(5, 10), (11, 10), (11, 18), (5, 18)]]
    )


@dataclass(frozen=True)
class DrillStyle:
    """How a tool writes Excellon. header: its lines; points: decimal points; tools in inch or mm as the unit."""

    unit: str = "mm"
    integers: int = 3
    decimals: int = 3
    zeros_kept: str = "trailing"
    points: bool = True
    header: tuple[str, ...] = ("M48", "METRIC")
    footer: tuple[str, ...] = ("M30",)
    tools_in_header: bool = True


def drill_number(value_mm: float, style: DrillStyle) -> str:
    """Write a drill's coordinate."""
    value = value_mm / (25.4 if style.unit == "inch" else 1.0)
    if style.points:
        return f"{value:.5f}"
    digits = f"{abs(round(value * 10**style.decimals)):0{style.integers + style.decimals}d}"
    if style.zeros_kept == "trailing":
        digits = digits.lstrip("0") or "0"
    elif style.zeros_kept == "leading":
        digits = digits.rstrip("0") or "0"
    return ("-" if value < 0 else "") + digits


def drills(board: SmallBoard, style: DrillStyle, plated: bool | None = None, extra: Iterable[str] = ()) -> str:
    """Write the drill file: plated holes, unplated ones, or both."""
    hits: dict[float, list[tuple[float, float]]] = {}
    if plated is not False:
        for pad in board.placed():
            if pad.drill:
                hits.setdefault(pad.drill, []).append((pad.x, pad.y))
    if plated is not True:
        for x, y, d in board.holes:
            hits.setdefault(d, []).append((x + board.origin[0], y + board.origin[1]))
    unit_mm = 25.4 if style.unit == "inch" else 1.0
    lines = list(style.header)
    if style.tools_in_header:
        lines += [f"T{n:02d}C{d / unit_mm:.4f}" for n, d in enumerate(hits, 1)]
    lines.append("%")
    for n, places in enumerate(hits.values(), 1):
        lines.append(f"T{n:02d}")
        lines += [f"X{drill_number(x, style)}Y{drill_number(y, style)}" for x, y in places]
    return "\n".join([*lines, *extra, *style.footer]) + "\n"


def netlist(board: SmallBoard, shift: tuple[float, float] = (0.0, 0.0), job: str = "P  JOB SMALL") -> str:
    """Write IPC-D-356 in mm (CUST 1)."""
    lines = ["C  IPC-D-356 netlist", job, "P  UNITS CUST 1"]
    for pad in board.placed():
        code = "317" if pad.drill else "327"
        name = f"{pad.part[:6]:<6}-{pad.pin[:4]:<4}" if pad.part else f"{'VIA':<6} {'':<4}"
        hole = f"D{round(pad.drill * 1000):04d}P" if pad.drill else " " * 6
        access = "A00" if pad.drill else "A01" if pad.side == "top" else "A02"
        mask = "S0" if pad.open else "S3"
        x, y = round((pad.x + shift[0]) * 1000), round((pad.y + shift[1]) * 1000)
        w, h = round(pad.w * 1000), round(pad.h * 1000)
        middle = " " if pad.part else "M"
        lines.append(
            f"{code}{pad.net[:14]:<14}   {name}{middle}{hole}{access}X{x:+07d}Y{y:+07d}X{w:04d}Y{h:04d}R000 {mask}"
        )
    return "\n".join([*lines, "999"]) + "\n"


@dataclass(frozen=True)
class ToolFolder:
    """One tool's way: which file is called what, and how it writes."""

    names: dict[str, str]
    style: GerberStyle = field(default_factory=GerberStyle)
    drill: DrillStyle = field(default_factory=DrillStyle)
    extras: dict[str, str] = field(default_factory=dict)


def write(folder: Path, tool: ToolFolder, board: SmallBoard | None = None) -> Path:
    """Write a board's folder as a tool delivers it; return it."""
    board = board or SmallBoard()
    contents = {
        **{
            f"{side} {use}": layer(board, side, use, tool.style)
            for side in ("top", "bottom")
            for use in ("copper", "mask")
        },
        **{f"{side} silk": silk(board, tool.style, side) for side in ("top", "bottom")},
        "outline": outline(board, tool.style),
        "drill": drills(board, tool.drill),
        "drill plated": drills(board, tool.drill, plated=True),
        "drill unplated": drills(board, tool.drill, plated=False),
        "netlist": netlist(board),
    }
    for role, name in tool.names.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(contents[role])
    for name, text in tool.extras.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


PLAIN = {
    "top copper": "b.GTL", "bottom copper": "b.GBL", "top mask": "b.GTS", "bottom mask": "b.GBS",
    "top silk": "b.GTO", "outline": "b.GKO", "drill": "b.drl", "netlist": "b.ipc",
}  # fmt: skip
"""Names that nobody mistakes."""


def plain_folder(folder: Path, board: SmallBoard | None = None) -> Path:
    """Write a board with plain names."""
    return write(folder, ToolFolder(PLAIN), board)
