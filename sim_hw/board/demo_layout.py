"""Layout of the demo board: mm from its lower left corner, y up, seen from the top."""

from dataclasses import dataclass

Point = tuple[float, float]

WIDTH_MM = 40.0
HEIGHT_MM = 30.0
ORIGIN_MM: Point = (10.0, 10.0)
"""CAD coordinates of the lower left corner: deliberately not zero."""
VIA_PAD_MM = 0.150
VIA_HOLE_MM = 0.050
SITE_PAD_MM = 0.450
SITE_HOLE_MM = 0.120
MASK_EXPANSION_MM = 0.010
TENTED_PAD_MM = 0.500
TENTED_HOLE_MM = 0.250
FIDUCIAL_MM = 1.0
FIDUCIAL_OPENING_MM = 2.0
FREE_AREA_MM = (29.0, 19.5, 36.0, 26.5)
"""No copper, no silkscreen: the dark place where the probe is taught (x0, y0, x1, y1)."""


@dataclass(frozen=True)
class RoundPad:
    """A bare round pad: a test point, or an untested neighbour when `name` is `VIA`."""

    name: str
    centre_mm: Point
    pad_mm: float
    hole_mm: float | None
    net: str
    capped: bool = False  # hole filled and capped: not visible
    opening_mm: float | None = None  # mask opening when not pad + expansion
    open_below: bool = False

    @property
    def mask_mm(self) -> float:
        """Diameter of the mask opening."""
        return self.opening_mm if self.opening_mm is not None else self.pad_mm + 2 * MASK_EXPANSION_MM


def _via(
    name: str,
    x: float,
    y: float,
    net: str,
    *,
    capped: bool = False,
    opening_mm: float | None = None,
    open_below: bool = False,
) -> RoundPad:
    return RoundPad(
        name=name,
        centre_mm=(x, y),
        pad_mm=VIA_PAD_MM,
        hole_mm=VIA_HOLE_MM,
        net=net,
        capped=capped,
        opening_mm=opening_mm,
        open_below=open_below,
    )


def _site(name: str, x: float, y: float, net: str, *, hole: bool) -> RoundPad:
    return RoundPad(name, (x, y), SITE_PAD_MM, SITE_HOLE_MM if hole else None, net)


TEST_POINTS: tuple[RoundPad, ...] = (
    _via("TP1", 8.0, 25.0, "CLK", open_below=True),
    _via("TP2", 13.0, 25.0, "RESET", capped=True),
    _via("TP3", 18.0, 25.0, "DATA0", opening_mm=0.36, open_below=True),  # its trace shows in the opening
    _site("TP4", 23.5, 25.0, "DATA1", hole=True),
    _site("TP5", 8.0, 19.0, "DATA2", hole=False),
    _site("TP6", 13.0, 19.0, "SENSE_P", hole=True),  # TP6 and TP7 touch at their rims
    _site("TP7", 13.0 + SITE_PAD_MM, 19.0, "SENSE_N", hole=False),
    _site("TP8", 18.0, 19.0, "DATA3", hole=True),
    _site("TP9", 23.5, 19.0, "VREF", hole=False),
    _via("TP10", 8.0, 12.0, "TX", open_below=True),
    _via("TP11", 33.0, 12.5, "RX", capped=True),
    _site("TP12", 26.0, 5.5, "ENABLE", hole=True),  # an untested via lies 0.9 mm beside it
)

NEIGHBOURS: tuple[RoundPad, ...] = tuple(
    _via("VIA", x, y, net, open_below=True)
    for x, y, net in (
        (9.5, 25.6, "GND"),
        (11.6, 23.9, "GND"),
        (15.2, 26.4, "VCC"),
        (21.6, 24.2, "GND"),
        (25.6, 23.6, "VCC"),
        (6.3, 20.2, "GND"),
        (15.4, 20.6, "GND"),
        (20.1, 20.4, "VCC"),
        (25.3, 18.0, "GND"),
        (6.4, 13.2, "GND"),
        (9.6, 11.0, "VCC"),
        (34.4, 13.6, "GND"),
        (26.9, 5.5, "GND"),
        (27.2, 7.4, "VCC"),
    )
)
"""Bare vias nobody asked to test: what a wrong landing would hit."""

TENTED: tuple[Point, ...] = (
    (5.0, 23.2),
    (10.6, 27.2),
    (16.2, 22.6),
    (20.4, 26.6),
    (10.4, 17.2),
    (16.0, 17.2),
    (21.0, 17.0),
    (5.0, 16.4),
    (12.0, 13.0),
    (25.2, 12.4),
    (26.8, 15.2),
    (22.8, 4.4),
    (28.6, 3.6),
    (34.8, 4.0),
)

FIDUCIALS: tuple[tuple[str, Point], ...] = (
    ("FID1", (3.0, 3.0)),
    ("FID2", (37.0, 3.0)),
    ("FID3", (3.0, 27.0)),
)

HEADER_PINS: tuple[tuple[str, Point, str], ...] = (
    ("1", (7.0, 4.5), "VCC"),
    ("2", (9.54, 4.5), "TX"),
    ("3", (12.08, 4.5), "RX"),
    ("4", (14.62, 4.5), "GND"),
)
"""Four through-hole pins of a connector: round, bare, larger than a probe site."""
HEADER_PAD_MM = 1.6
HEADER_HOLE_MM = 0.95


@dataclass(frozen=True)
class SmdPad:
    """A rectangular surface pad."""

    reference: str
    pin: str
    centre_mm: Point
    size_mm: tuple[float, float]
    net: str


_U1_NETS = ("CLK", "RESET", "DATA0", "DATA1", "DATA2", "DATA3", "SENSE_P", "GND")


def _soic() -> tuple[SmdPad, ...]:
    left = tuple(
        SmdPad("U1", str(i + 1), (14.0 + 1.27 * i, 8.4), (0.6, 1.55), _U1_NETS[i]) for i in range(len(_U1_NETS))
    )
    right = tuple(
        SmdPad("U1", str(16 - i), (14.0 + 1.27 * i, 13.6), (0.6, 1.55), "VCC" if i == 0 else f"N{i}")
        for i in range(len(_U1_NETS))
    )
    return left + right


def _chip(reference: str, x: float, y: float, nets: tuple[str, str]) -> tuple[SmdPad, ...]:
    return tuple(
        SmdPad(reference, str(pin), (x + shift, y), (0.8, 0.95), net)
        for pin, shift, net in ((1, -0.775, nets[0]), (2, 0.775, nets[1]))
    )


SMD_PADS: tuple[SmdPad, ...] = (
    _soic()
    + _chip("R1", 10.5, 22.0, ("CLK", "GND"))
    + _chip("R2", 18.2, 22.4, ("DATA0", "VCC"))
    + _chip("C1", 24.2, 21.4, ("VCC", "GND"))
    + _chip("C2", 10.0, 15.0, ("VCC", "GND"))
    + _chip("R3", 20.6, 5.2, ("ENABLE", "VCC"))
    + _chip("R4", 32.6, 6.8, ("RX", "GND"))
)

TRACES: tuple[tuple[float, tuple[Point, ...]], ...] = (
    (0.10, ((18.0, 25.0), (18.9, 25.0), (19.9, 24.0), (19.9, 22.4), (18.975, 22.4))),
    (0.15, ((18.0, 19.0), (18.0, 18.0), (20.35, 15.65), (20.35, 13.6))),
    (0.20, ((9.725, 22.0), (7.6, 22.0), (6.4, 23.2), (5.0, 23.2))),
    (0.08, ((13.0, 25.0), (13.0, 22.8), (12.2, 22.0), (11.275, 22.0))),
    (0.15, ((23.5, 25.0), (23.5, 27.4), (12.0, 27.4), (10.6, 27.2))),
    (0.15, ((8.0, 19.0), (8.0, 16.4), (9.225, 15.0))),
    (0.15, ((13.0, 19.0), (12.2, 18.2), (12.2, 14.6), (14.0, 12.6), (14.0, 13.6))),
    (0.15, ((13.45, 19.0), (14.4, 18.05), (14.4, 16.2), (16.54, 14.6), (16.54, 13.6))),
    (0.15, ((23.5, 19.0), (23.5, 16.0), (25.2, 14.3), (25.2, 12.4))),
    (0.08, ((8.0, 12.0), (8.0, 7.6), (9.54, 6.1), (9.54, 4.5))),
    (0.15, ((26.0, 5.5), (24.4, 5.5), (23.3, 4.4), (22.8, 4.4))),
    (0.30, ((7.0, 4.5), (5.0, 6.5), (5.0, 16.4))),
    (0.30, ((14.62, 4.5), (19.0, 4.5), (19.825, 5.2))),
    (0.15, ((14.0, 8.4), (14.0, 6.8), (12.9, 6.0))),
    (0.15, ((15.27, 8.4), (15.27, 10.4), (13.2, 11.6), (12.0, 13.0))),
    (0.15, ((16.54, 8.4), (16.54, 10.6), (19.08, 11.8), (19.08, 13.6))),
    (0.15, ((17.81, 8.4), (17.81, 6.4), (21.375, 6.4), (21.375, 5.2))),
    (0.30, ((5.0, 23.2), (3.6, 21.8), (3.6, 10.4))),
    (0.08, ((16.2, 22.6), (15.2, 23.6), (15.2, 26.4))),
    (0.20, ((21.0, 17.0), (22.0, 18.0), (22.0, 20.4), (23.425, 21.4))),
)
"""Traces under the mask: width in mm, then the corners."""

POUR_MM: tuple[Point, ...] = ((29.0, 9.0), (38.5, 9.0), (38.5, 17.5), (31.5, 17.5), (29.0, 15.0))
"""A copper pour under the mask, cleared round TP11 and its neighbour by `POUR_GAP_MM`."""
POUR_GAP_MM = 0.30

SILK_TEXT: tuple[tuple[str, Point, float], ...] = (
    ("TP1", (6.4, 25.9), 0.8),
    ("TP2", (12.2, 25.9), 0.8),
    ("TP3", (16.4, 25.9), 0.8),
    ("TP4", (24.3, 25.6), 0.8),
    ("TP5", (8.7, 18.0), 0.8),
    ("TP6", (11.8, 17.3), 0.8),
    ("TP7", (14.0, 19.6), 0.8),
    ("TP8", (18.6, 18.2), 0.8),
    ("TP9", (24.2, 19.4), 0.8),
    ("TP10", (5.4, 11.4), 0.8),
    ("TP11", (33.5, 11.2), 0.8),
    ("TP12", (23.6, 6.4), 0.8),
    ("U1", (24.6, 10.4), 1.2),
    ("R1", (9.8, 20.3), 0.8),
    ("R2", (17.4, 20.7), 0.8),
    ("C1", (26.0, 21.1), 0.8),
    ("C2", (11.8, 15.0), 0.8),
    ("R3", (19.6, 3.4), 0.8),
    ("R4", (31.8, 5.0), 0.8),
    ("J1", (16.4, 3.0), 1.0),
    ("DEMO", (28.4, 28.0), 1.2),
)
"""Silkscreen: text (lower left, height), then boxes (corners) with the line width below."""
SILK_BOXES: tuple[tuple[Point, Point], ...] = (
    ((12.8, 9.5), (24.0, 12.5)),
    ((5.6, 3.2), (16.0, 5.8)),
    ((9.1, 21.3), (11.9, 22.7)),
    ((16.8, 21.7), (19.6, 23.1)),
    ((22.8, 20.7), (25.6, 22.1)),
    ((8.6, 14.3), (11.4, 15.7)),
    ((19.2, 4.5), (22.0, 5.9)),
    ((31.2, 6.1), (34.0, 7.5)),
)
SILK_WIDTH_MM = 0.13
