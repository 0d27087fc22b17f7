"""Test records of an IPC-D-356 netlist.

Read by columns and not through gerbonara, which drops the mask code of `R000S3` (written without the blank
column by KiCad). Source: IPC-D-356A, record types 317, 327 and 367.
"""

import re
from dataclasses import dataclass
from pathlib import Path

_UNIT_MM = {"CUST": 0.00254, "CUST 0": 0.00254, "CUST 1": 0.001, "CUST 2": 0.00254}
_TAIL = re.compile(r"R(?P<rotation>\d{3})\s?S(?P<mask>[0-3])")


@dataclass(frozen=True)
class Record:
    """One test record; lengths in mm in the netlist's own origin."""

    net: str
    reference: str  # empty for a via
    pin: str
    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float  # equals the width for a round pad (written as 0000)
    hole_mm: float | None
    access_layer: int  # 0 both sides, 1 top, else the number of the bottom layer
    mask: int  # 0 open both, 1 primary (top) covered, 2 secondary covered, 3 both covered

    @property
    def is_via(self) -> bool:
        """Whether the record names no part."""
        return not self.reference

    @property
    def name(self) -> str:
        """Return `part.pin`, the part alone where it has no pin, or `VIA`."""
        if self.is_via:
            return "VIA"
        return f"{self.reference}.{self.pin}" if self.pin else self.reference

    def on_side(self, side: str) -> bool:
        """Tell whether the pad has copper on a side."""
        return self.access_layer == 0 or (self.access_layer == 1) == (side == "top")


def _length_mm(text: str, unit_mm: float) -> float:
    return int(text) * unit_mm if text.strip(" +-") else 0.0


def _record(line: str, unit_mm: float) -> Record | None:
    if line[41] != "X" or line[49] != "Y":
        return None
    reference = line[20:26].strip()
    hole_mm = _length_mm(line[33:37], unit_mm) if line[32] == "D" else None
    width_mm = _length_mm(line[58:62], unit_mm) if line[57] == "X" else 0.0
    height_mm = _length_mm(line[63:67], unit_mm) if line[62] == "Y" else 0.0
    tail = _TAIL.search(line, 67)
    return Record(
        net="" if line[3:17].strip() == "N/C" else line[3:17].strip(),
        reference="" if reference == "VIA" else reference,
        pin=line[27:31].strip(),
        x_mm=_length_mm(line[42:49], unit_mm),
        y_mm=_length_mm(line[50:57], unit_mm),
        width_mm=width_mm,
        height_mm=height_mm or width_mm,
        hole_mm=hole_mm,
        access_layer=int(line[39:41]) if line[38] == "A" else 0,
        mask=int(tail["mask"]) if tail else 0,
    )


def read_netlist(path: Path) -> tuple[Record, ...]:
    """Return the test records of a file.

    Raises:
        ValueError: a record could not be read; the message names file and line.

    """
    unit_mm = _UNIT_MM["CUST 0"]
    records: list[Record] = []
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        if line.startswith("P  UNITS"):
            unit_mm = _UNIT_MM.get(" ".join(line.split()[2:]), unit_mm)
        elif line[:3] in ("317", "327", "367"):
            try:
                record = _record(f"{line:<80}", unit_mm)
            except ValueError as exc:
                raise ValueError(f"{path}:{number}: not an IPC-D-356 test record: {exc}") from exc
            if record is not None:
                records.append(record)
    return tuple(records)
