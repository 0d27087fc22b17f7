"""The board under test as the daemon knows it: round targets with names, sizes and what may be touched.

Positions are um in the board frame: origin at the outline's lower left corner as seen from the probed side, x right,
y up. `daemon.tools.cad_import` makes such a file from a CAD folder; a station needs only the file.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from daemon.domain.errors import Fault, FaultCode
from vision.geometry import Array

BOARD_FORMAT: Literal["reprobe-board-1"] = "reprobe-board-1"
SAME_SIZE = 0.2
"""Targets whose diameters differ by less than this share look alike to the camera."""


class BoardModel(BaseModel):
    """Base of what a board file holds: frozen, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class BoardPoint(BoardModel):
    """One round bare-metal target on the probed side."""

    name: str
    kind: Literal["via", "site", "fiducial"]
    x_um: float
    y_um: float
    diameter_um: float
    hole_um: float | None = None
    net: str | None = None
    why_not: str | None = None
    """Why it must not be touched; None when it may."""

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is on the board."""
        return self.x_um, self.y_um

    @property
    def probeable(self) -> bool:
        """Whether the needle may touch it."""
        return self.why_not is None


class Board(BoardModel):
    """One side of one board."""

    format: Literal["reprobe-board-1"] = BOARD_FORMAT
    name: str
    side: Literal["top", "bottom"]
    width_um: float
    height_um: float
    points: tuple[BoardPoint, ...]
    hidden: dict[str, str] = Field(default_factory=dict)
    """Named points that cannot be probed from this side -> why."""

    @classmethod
    def load(cls, path: Path) -> Board:
        """Read a board file; any trouble is a ValueError that says what to do."""
        if path.exists() and not path.is_file():  # a pipe would be waited for without end
            raise ValueError(f"{path} is no plain file; make it with `reprobe board DIR`")
        try:
            return cls.model_validate_json(path.read_bytes())
        except OSError as exc:
            raise ValueError(f"{path} cannot be read ({exc.strerror}); make it with `reprobe board DIR`") from exc
        except ValidationError as exc:
            first = exc.errors()[0]["msg"]
            raise ValueError(f"{path} is not a board file ({first}); make it with `reprobe board DIR`") from exc

    def point(self, name: str) -> BoardPoint:
        """Return the test point of that name, or raise `Fault` saying why it cannot be served."""
        point = self.find(name)
        if point.why_not is not None:
            raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"{name} cannot be probed: {point.why_not}", test_point=name)
        return point

    def find(self, name: str) -> BoardPoint:
        """Return the round target of that name, also one that may be seen but not touched."""
        for point in self.points:
            if point.name == name:
                return point
        if name in self.hidden:
            raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"{name} cannot be probed: {self.hidden[name]}", test_point=name)
        raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"board {self.name} has no test point {name}", test_point=name)

    @property
    def revision(self) -> str:
        """Fingerprint of all that the file says, for what was measured with another one of the same name."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    def test_points(self) -> tuple[BoardPoint, ...]:
        """Return the targets that may be touched."""
        return tuple(p for p in self.points if p.probeable)

    def lookalikes_um(self, point: BoardPoint, within_um: float) -> Array:
        """Return the places (M, 2) of all targets of about that size near `point`, itself first, board frame, um."""
        others = [
            (p.x_um, p.y_um)
            for p in self.points
            if p is not point
            and abs(p.diameter_um - point.diameter_um) <= SAME_SIZE * point.diameter_um
            and math.dist((p.x_um, p.y_um), (point.x_um, point.y_um)) <= within_um
        ]
        return np.array([(point.x_um, point.y_um), *others])
