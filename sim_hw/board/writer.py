"""Text of Gerber X2, Excellon and IPC-D-356: the few statements a board of our own needs.

Sources: Ucamco, The Gerber Layer Format Specification (X2 attributes, IPC-4761 via types);
IPC-D-356A column layout.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

Point = tuple[float, float]


def _xy(point_mm: Point) -> str:
    """Return `X..Y..` in format 4.6 millimetres, leading zeros left out."""
    return f"X{round(point_mm[0] * 1e6)}Y{round(point_mm[1] * 1e6)}"


@dataclass
class GerberText:
    """Collect one Gerber layer; `function` is the value of the X2 file attribute `.FileFunction`."""

    function: str
    polarity: str = "Positive"
    _apertures: dict[tuple[str, str], int] = field(default_factory=dict)
    _body: list[str] = field(default_factory=list)

    def circle(self, diameter_mm: float, purpose: str = "Other,Shape") -> int:
        """Return the D-code of a round aperture with the X2 aperture function `purpose`."""
        return self._aperture(f"C,{diameter_mm:.6f}", purpose)

    def rectangle(self, width_mm: float, height_mm: float, purpose: str = "Other,Shape") -> int:
        """Return the D-code of a rectangular aperture with the X2 aperture function `purpose`."""
        return self._aperture(f"R,{width_mm:.6f}X{height_mm:.6f}", purpose)

    def _aperture(self, shape: str, purpose: str) -> int:
        return self._apertures.setdefault((shape, purpose), 10 + len(self._apertures))

    def flash(self, code: int, centre_mm: Point) -> None:
        """Flash aperture `code` at a centre."""
        self._body += [f"D{code}*", f"{_xy(centre_mm)}D03*"]

    def line(self, code: int, points_mm: Sequence[Point]) -> None:
        """Draw a polyline with aperture `code`."""
        self._body += [f"D{code}*", f"{_xy(points_mm[0])}D02*"]
        self._body += [f"{_xy(point)}D01*" for point in points_mm[1:]]

    def region(self, points_mm: Sequence[Point]) -> None:
        """Fill a polygon; it is closed here."""
        self._body += ["G36*", f"{_xy(points_mm[0])}D02*"]
        self._body += [f"{_xy(point)}D01*" for point in [*points_mm[1:], points_mm[0]]]
        self._body.append("G37*")

    def clear(self) -> None:
        """Make what follows remove instead of add, until `dark`."""
        self._body.append("%LPC*%")

    def dark(self) -> None:
        """Make what follows add again."""
        self._body.append("%LPD*%")

    def text(self) -> str:
        """Return the whole file."""
        head = [
            "%TF.GenerationSoftware,reprobe,make_demo_board,1*%",
            "%TF.SameCoordinates,Original*%",
            f"%TF.FileFunction,{self.function}*%",
            f"%TF.FilePolarity,{self.polarity}*%",
            "%FSLAX46Y46*%",
            "%MOMM*%",
            "G01*",
            "%LPD*%",
        ]
        for (shape, purpose), code in self._apertures.items():
            head += [f"%TA.AperFunction,{purpose}*%", f"%ADD{code}{shape}*%", "%TD*%"]
        return "\n".join([*head, *self._body, "M02*", ""])


def excellon_text(holes_mm: Iterable[tuple[Point, float]], tool_function: str, layers: int = 2) -> str:
    """Return a plated drill file; `tool_function` is the X2 tool attribute, e.g. `ViaDrill,VII`.

    `VII` is the IPC-4761 type of a via that was filled and capped: its hole cannot be seen.
    """
    by_diameter: dict[float, list[Point]] = {}
    for centre_mm, diameter_mm in holes_mm:
        by_diameter.setdefault(diameter_mm, []).append(centre_mm)
    lines = [
        "M48",
        "; FORMAT={-:-/ absolute / metric / decimal}",
        "; #@! TF.GenerationSoftware,reprobe,make_demo_board,1",
        f"; #@! TF.FileFunction,Plated,1,{layers},PTH",
        "FMAT,2",
        "METRIC",
    ]
    diameters_mm = sorted(by_diameter)
    for tool, diameter_mm in enumerate(diameters_mm, start=1):
        lines += [f"; #@! TA.AperFunction,Plated,PTH,{tool_function}", f"T{tool}C{diameter_mm:.3f}"]
    lines += ["%", "G90", "G05"]
    for tool, diameter_mm in enumerate(diameters_mm, start=1):
        lines.append(f"T{tool}")
        lines += [f"X{x:.3f}Y{y:.3f}" for x, y in by_diameter[diameter_mm]]
    return "\n".join([*lines, "M30", ""])


@dataclass(frozen=True)
class NetRecord:
    """One IPC-D-356 test record; `access` 0 is both sides, 1 the top; `mask` is the S code 0..3."""

    net: str
    reference: str
    centre_mm: Point
    size_mm: tuple[float, float]
    hole_mm: float | None = None
    pin: str = ""
    access: int = 1
    mask: int = 2

    def line(self) -> str:
        """Return the 80-column record in metric units of 0.001 mm (`UNITS CUST 1`)."""
        code = "327" if self.hole_mm is None else "317"
        hole = "      " if self.hole_mm is None else f"D{round(self.hole_mm * 1e3):04d}P"
        middle = "M" if self.reference == "VIA" else " "
        pin = f"-{self.pin:<4}" if self.pin else "     "
        x, y = (f"{round(value * 1e3):+07d}" for value in self.centre_mm)
        width, height = (f"{round(value * 1e3):04d}" for value in self.size_mm)
        return (
            f"{code}{self.net:<14.14}   {self.reference:<6.6}{pin}{middle}{hole}A{self.access:02d}"
            f"X{x}Y{y}X{width}Y{height}R000 S{self.mask}"
        )


def netlist_text(job: str, records: Iterable[NetRecord]) -> str:
    """Return the whole IPC-D-356 file."""
    head = ["C  Netlist of a board of our own, for the simulated station", f"P  JOB {job}", "P  UNITS CUST 1"]
    return "\n".join([*head, *(record.line() for record in records), "999", ""])
