"""The board under test as the daemon knows it: what may be touched on its probed side, and the CAD of both sides.

Positions are um in the board frame: origin at the outline's lower left corner as seen from the probed side, x right,
y up. `daemon.tools.board_import` makes such a file from a CAD folder; a station needs only the file.
"""

from __future__ import annotations

import codecs
import hashlib
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from daemon.domain.board_file import file_bytes, unpacked
from daemon.domain.board_layers import BoardLayers, Outline
from daemon.domain.errors import Fault, FaultCode

if TYPE_CHECKING:  # most who read a board register none, and are not to wait for it
    from vision.geometry import Array
    from vision.registration import SideLayers

BoardFormat = Literal["reprobe-board-1", "reprobe-board-2"]
Side = Literal["top", "bottom"]
Kind = Literal["via", "site", "fiducial", "pad", "pin"]
Form = Literal["round", "rectangle", "oblong", "polygon", "ring"]
SAME_SIZE = 0.2
"""Targets whose diameters differ by less than this share look alike to the camera."""
NO_LAYERS = "this board file has no layers: make it again with `reprobe board` and more can be served"


class BoardModel(BaseModel):
    """Base of what a board file holds: frozen, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy the fields alone: what was worked out of the old ones and kept is not true of the new."""
        copied = super().model_copy(update=update, deep=deep)
        for name in set(copied.__dict__) - set(type(self).model_fields):
            del copied.__dict__[name]
        return copied


class BoardPoint(BoardModel):
    """One bare-metal target on the probed side.

    kind: `via`; `site`, a pad that belongs to no part; `pad` and `pin` of a part, on the surface and through the board;
    `fiducial`.
    """

    name: str
    kind: Kind
    x_um: float
    """Where the needle goes: not always the middle of the metal."""
    y_um: float
    diameter_um: float | None = None
    """Of the bare metal where that is round, with or without a hole; None where it is not round."""
    hole_um: float | None = None
    net: str | None = None
    why_not: str | None = None
    """Why it must not be touched; None when it may."""
    part: str | None = None
    pin: str | None = None
    shape: Form = "round"
    centre_um: tuple[float, float] | None = None
    """Middle of round metal where the needle goes elsewhere, beside a hole; None: to the middle."""
    metal_um: tuple[Outline, ...] = ()
    """Outlines of its bare metal; what lies within two of them is a hole."""
    room_um: float | None = None
    """Radius of free bare metal about the target: to mask, hole, lead, body or another net. None: not known."""
    stands_um: float | None = Field(default=None, ge=0, le=5000, allow_inf_nan=False)
    """How high its metal stands above the board's surface, solder and lead: no CAD file says so. None: not known."""
    rank: int | None = None
    """Place in the order of preference within its net, 0 the best; None where it may not be touched."""

    @model_serializer(mode="wrap")
    def _without_unknown_height(self, facts: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a height that nobody knows: files of before say nothing of it, and keep their fingerprint."""
        told: dict[str, Any] = facts(self)
        if self.stands_um is None:
            told.pop("stands_um", None)
        return told

    @property
    def place_um(self) -> tuple[float, float]:
        """Where the needle goes on the board."""
        return self.x_um, self.y_um

    @property
    def middle_um(self) -> tuple[float, float]:
        """The middle of round metal, which is where its outline is found."""
        return self.centre_um or self.place_um

    @property
    def probeable(self) -> bool:
        """Whether the needle may touch it."""
        return self.why_not is None

    @property
    def stands_round(self) -> bool:
        """Whether it is round and touched in its middle: its outline alone says where the needle goes."""
        return self.diameter_um is not None and self.centre_um is None

    @property
    def round_um(self) -> float:
        """Diameter of a target that is found by its round outline; `Fault` for every other."""
        if self.diameter_um is None or self.centre_um is not None:
            raise Fault(FaultCode.UNKNOWN_TEST_POINT, self.why_not_round, test_point=self.name)
        return self.diameter_um

    @property
    def why_not_round(self) -> str:
        """Say why the outline of a target that does not stand round is no help."""
        what = "is not round" if self.diameter_um is None else "is touched beside its middle"
        return f"{self.name} {what}: a round outline alone does not lead there"


class SeatPlace(BoardModel):
    """A place whose view is found nowhere else: not on this side, on the other, or turned."""

    x_um: float
    y_um: float
    rival: float
    """How near another place comes to being taken for it: 1 it would."""


class PanelCopy(BoardModel):
    """One board of a panel: where the origin lies that its own board file would have, and how it is turned there."""

    name: str
    x_um: float
    y_um: float
    turn_deg: float


class Board(BoardModel):
    """One side of one board."""

    format: BoardFormat = "reprobe-board-2"
    name: str
    side: Side
    width_um: float
    height_um: float
    points: tuple[BoardPoint, ...]
    hidden: dict[str, str] = Field(default_factory=dict)
    """Named points that cannot be probed from this side -> why."""
    unserved: dict[str, str] = Field(default_factory=dict)
    """Nets without a point on this side -> why."""
    notes: tuple[str, ...] = ()
    """What the import left out, guessed or took for granted, in sentences for people."""
    sources: dict[str, str] = Field(default_factory=dict)
    """Fingerprint of what it was made of: file -> SHA-256."""
    copies: tuple[PanelCopy, ...] = ()
    seat: tuple[SeatPlace, ...] = ()
    layers: BoardLayers | None = None

    @classmethod
    def load(cls, path: Path) -> Board:
        """Read a board file, packed with gzip or not; any trouble is a ValueError that says what to do."""
        if path.exists() and not path.is_file():  # a pipe would be waited for without end
            raise ValueError(f"{path} is no plain file; make it with `reprobe board DIR`")
        try:
            return cls.model_validate_json(unpacked(path.read_bytes()).removeprefix(codecs.BOM_UTF8))
        except OSError as exc:
            raise ValueError(f"{path} cannot be read ({exc.strerror}); make it with `reprobe board DIR`") from exc
        except ValidationError as exc:
            first = exc.errors(include_input=False)[0]
            where = ".".join(str(part) for part in first["loc"])
            what = f"{where}: {first['msg']}" if where else first["msg"]
            raise ValueError(f"{path} is not a board file ({what}); make it with `reprobe board DIR`") from exc
        except ValueError as exc:  # packed, and broken
            raise ValueError(f"{path} is not a board file ({exc}); make it with `reprobe board DIR`") from exc

    def save(self, path: Path) -> None:
        """Write the board file, packed where its name ends in .gz; raise OSError if that cannot be done."""
        path.write_bytes(self.content(packed=path.suffix == ".gz"))

    def content(self, *, packed: bool) -> bytes:
        """Return the bytes of the board file, packed with gzip or not."""
        facts = self.model_dump(mode="json", exclude_defaults=True)
        return file_bytes({"format": self.format, **facts}, packed=packed)

    def point(self, name: str) -> BoardPoint:
        """Return the test point of that name, or raise `Fault` saying why it cannot be served."""
        point = self.find(name)
        if point.why_not is not None:
            raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"{name} cannot be probed: {point.why_not}", test_point=name)
        return point

    def round_point(self, name: str) -> BoardPoint:
        """Return the test point of that name; raise `Fault` also where its round outline does not lead to it."""
        point = self.point(name)
        if not point.stands_round:
            raise Fault(FaultCode.UNKNOWN_TEST_POINT, point.why_not_round, test_point=name)
        return point

    def find(self, name: str) -> BoardPoint:
        """Return the target of that name, also one that may be seen but not touched."""
        point = self._by_name.get(name)
        if point is not None:
            return point
        if name in self.hidden:
            raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"{name} cannot be probed: {self.hidden[name]}", test_point=name)
        more = f"; {NO_LAYERS}" if self.layers is None else ""
        raise Fault(FaultCode.UNKNOWN_TEST_POINT, f"board {self.name} has no test point {name}{more}", test_point=name)

    @cached_property
    def _by_name(self) -> dict[str, BoardPoint]:
        return {point.name: point for point in reversed(self.points)}  # the first of a name wins

    def points_near(self, place_um: tuple[float, float], reach_um: float) -> tuple[BoardPoint, ...]:
        """Return the targets of which a box about their metal comes so near to a place, in the order of the file."""
        low, high = self._boxes_um[:, :2] - reach_um, self._boxes_um[:, 2:] + reach_um
        inside = ((low <= place_um) & (place_um <= high)).all(axis=1)
        return tuple(self.points[i] for i in np.flatnonzero(inside).tolist())

    @cached_property
    def _boxes_um(self) -> Array:
        """x0, y0, x1, y1 about each target's place and metal, (N, 4)."""
        boxes = np.array([_box_um(point) for point in self.points], dtype=float)
        return boxes.reshape(-1, 4)

    @cached_property
    def revision(self) -> str:
        """Fingerprint of all that the file says, for what was measured with another one of the same name."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    def side_layers(self, side: Side) -> SideLayers | None:
        """Return what CAD says of a side, in that side's own frame; None: the file has no layers."""
        if self.layers is None:
            return None
        return (self.layers.top if side == "top" else self.layers.bottom).layers

    def test_points(self) -> tuple[BoardPoint, ...]:
        """Return the targets that may be touched."""
        return tuple(p for p in self.points if p.probeable)

    def round_points(self) -> tuple[BoardPoint, ...]:
        """Return the targets that may be touched and are found by their round outline alone."""
        return tuple(p for p in self.test_points() if p.stands_round)

    def flat_points(self) -> tuple[BoardPoint, ...]:
        """Return the round targets that may be touched and carry no solder: what a surface is measured on."""
        return tuple(p for p in self.round_points() if p.kind in ("via", "site") and not p.stands_um)

    def part_pads(self) -> tuple[BoardPoint, ...]:
        """Return the pads of parts on the surface that may be touched; they carry solder, unless the board is bare.

        One that is told to stand above the board says nothing of the board's surface.
        """
        return tuple(p for p in self.test_points() if p.kind == "pad" and not p.stands_um)

    def pins(self) -> tuple[BoardPoint, ...]:
        """Return the rings of leads that may be touched, the roomiest first; what solder stands on them varies most."""
        pins = (p for p in self.test_points() if p.kind == "pin" and not p.stands_um)
        return tuple(sorted(pins, key=lambda p: -(p.room_um or 0.0)))

    def of_net(self, net: str) -> tuple[BoardPoint, ...]:
        """Return the targets of a net that may be touched, the best first."""
        return tuple(sorted((p for p in self.test_points() if p.net == net), key=lambda p: p.rank or 0))

    def lookalikes_um(self, point: BoardPoint, within_um: float) -> Array:
        """Return the middles (M, 2) of all round targets of its size near `point`, itself first; board frame, um.

        Raises `Fault` where the point itself is not found by a round outline.
        """
        others = [
            p.middle_um
            for p in self.points
            if p is not point
            and p.diameter_um is not None
            and abs(p.diameter_um - point.round_um) <= SAME_SIZE * point.round_um
            and math.dist(p.middle_um, point.middle_um) <= within_um
        ]
        return np.array([point.middle_um, *others])


def _box_um(point: BoardPoint) -> tuple[float, float, float, float]:
    """Return x0, y0, x1, y1 about a target's place and metal."""
    radius_um, (x_um, y_um) = (point.diameter_um or 0.0) / 2, point.middle_um
    xs = [point.x_um, x_um - radius_um, x_um + radius_um, *(x for flat in point.metal_um for x in flat[::2])]
    ys = [point.y_um, y_um - radius_um, y_um + radius_um, *(y for flat in point.metal_um for y in flat[1::2])]
    return min(xs), min(ys), max(xs), max(ys)
