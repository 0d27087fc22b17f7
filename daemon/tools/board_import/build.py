"""Board file of a side from what the CAD folder says."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_layers import BoardLayers, SideShapes
from daemon.tools.board_import.frame import Frame, SideCad
from daemon.tools.board_import.merge import merged
from daemon.tools.board_import.names import PinRoles, name_pins, net_of
from daemon.tools.board_import.pads import Openings
from daemon.tools.board_import.panel import copies_on, places_elsewhere
from daemon.tools.board_import.parts import PartBody, bodies, find_parts
from daemon.tools.board_import.points import Found, PointFinder
from daemon.tools.board_import.side_shapes import side_shapes
from daemon.tools.board_import.verdict import Judge
from daemon.tools.cad import read_cad
from daemon.tools.cad.model import Cad, Pin, Side, Use

SIDES: tuple[Side, Side] = ("top", "bottom")
ASSUMED = (
    "no drawing of the parts' bodies on the {side}: the free end of a part's pad is taken to be bare metal, and a part "
    "on pins to stand over its rings; say --bare if no parts are fitted"
)


@dataclass(frozen=True)
class Options:
    """How a folder is read.

    layers: role (`top_mask`) -> file or files, where names do not tell; netlist: the file that names the pads; copy:
    number of the panel's board, from 1; bare: no parts are fitted; keep: what was found out of the files is kept in
    the folder.
    """

    layers: Mapping[str, Path | Sequence[Path]] = field(default_factory=dict)
    netlist: Path | None = None
    copy: int | None = None
    bare: bool = False
    keep: bool = False


AS_DELIVERED = Options()


def import_board(path: Path, side: Side, options: Options = AS_DELIVERED) -> Board:
    """Read a CAD folder or zip; raise ValueError saying which file is missing or does not fit."""
    return import_boards(path, side, options)[side]


def import_boards(path: Path, side: Side, options: Options = AS_DELIVERED) -> dict[Side, Board]:
    """Read both sides of a CAD folder or zip; only `side` must be complete, the other is left out where it is not."""
    cad = _read(path, options)
    needed: tuple[Use, Use] = ("copper", "mask")
    missing = [use for use in needed if (side, use) not in cad.layers]
    for use in missing:
        if why := (cad.broken or {}).get((side, use)):
            raise ValueError(why)
    if missing:
        other: Side = "bottom" if side == "top" else "top"
        alone = all((other, use) in cad.layers for use in ("copper", "mask"))
        raise ValueError(
            f"{path} has no Gerber for {side} {missing[0]}; if one of its files is it, "
            f"say --layer {side}_{missing[0]}=FILE, else export it"
            f"{f'; the {other} can be read without it: --side {other}' if alone else ''}"
        )
    with _said(path):
        return boards_of(cad, bare=options.bare)


def _read(path: Path, options: Options) -> Cad:
    with _said(path):
        return read_cad(path, layers=options.layers, netlist=options.netlist, copy=options.copy, keep=options.keep)


@contextmanager
def _said(path: Path) -> Iterator[None]:
    """Turn whatever fails into a ValueError with a sentence."""
    try:
        yield
    except ValueError:
        raise
    except OSError as exc:
        raise ValueError(f"{path} cannot be read: {exc.strerror}") from exc
    except Exception as exc:  # a reader may fail in any way on a foreign file
        what = f"{type(exc).__name__}: {exc}"[:200]
        raise ValueError(f"{path} cannot be read, in a way nobody thought of ({what}); export Gerber X2 anew") from exc


def boards_of(cad: Cad, *, bare: bool = False) -> dict[Side, Board]:
    """Make the board of each side that has copper and mask."""
    pins = merged(cad.pins)
    works = {side: _SideWork(cad, side, pins, bare=bare) for side in SIDES}
    for side, work in works.items():
        work.look(works["bottom" if side == "top" else "top"].cad)
    layers = BoardLayers.model_construct(top=works["top"].shapes(), bottom=works["bottom"].shapes())
    return {
        side: work.board(layers)
        for side, work in works.items()
        if all((side, u) in cad.layers for u in ("copper", "mask"))
    }


class _SideWork:
    """Steps of one side."""

    def __init__(self, cad: Cad, side: Side, pins: tuple[Pin, ...], *, bare: bool) -> None:
        self.cad = SideCad(cad, Frame(side, cad.box_mm), pins)
        self._roles = PinRoles(pins)
        self._openings = Openings(self.cad)
        self._bare = bare
        self._bodies: list[PartBody] = []
        self._found: Found | None = None

    def look(self, other: SideCad) -> None:
        """Find the bodies and the points."""
        cad = self.cad
        names = name_pins(cad.pins, self._roles)
        parts = find_parts(cad.pins, cad.places, cad, other)
        self._bodies = bodies(cad, parts)
        judge = Judge(cad.side, self._roles, parts, self._bodies, bare=self._bare)
        finder = PointFinder(cad, self._openings, names, self._roles)
        self._found = finder.find(judge, parts, places_elsewhere(cad))

    @property
    def found(self) -> Found:
        """What was found."""
        if self._found is None:
            raise RuntimeError("look first")
        return self._found

    def shapes(self) -> SideShapes:
        """Return the side's layers for the board file."""
        return side_shapes(self.cad, self._openings, self._bodies, self.found.soldered, bare=self._bare)

    def board(self, layers: BoardLayers) -> Board:
        """Put the board file together."""
        cad, frame, found = self.cad.cad, self.cad.frame, self.found
        width, height = frame.size_um
        notes = list(cad.notes)
        if not self._bare and not any(b.drawn for b in self._bodies) and self._bodies:
            notes.append(ASSUMED.format(side=frame.side))
        return Board(
            name=cad.name,
            side=frame.side,
            width_um=round(width, 1),
            height_um=round(height, 1),
            points=found.points,
            hidden=found.hidden,
            unserved=unserved(self.cad.pins, found, frame.side),
            notes=tuple(notes),
            sources=cad.sources or {},
            copies=copies_on(cad, frame),
            layers=layers,
        )


def unserved(pins: tuple[Pin, ...], found: Found, side: Side) -> dict[str, str]:
    """Return each net without a point on a side, and why: the reason of its best pad."""
    served = {p.net for p in found.points if p.probeable}
    refused: defaultdict[str, list[BoardPoint]] = defaultdict(list)
    for point in found.points:
        if point.net is not None and not point.probeable:
            refused[point.net].append(point)
    hidden: defaultdict[str, list[str]] = defaultdict(list)
    for name, (hidden_net, why) in found.hidden_nets.items():
        hidden[hidden_net].append(f"{name}: {why}")
    nets = sorted({net for pin in pins if (net := net_of(pin)) is not None and net not in served})
    return {net: _why(refused[net], hidden[net], side) for net in nets}


def _why(refused: list[BoardPoint], hidden: list[str], side: Side) -> str:
    if refused:
        best = max(refused, key=lambda p: (p.kind != "fiducial", "needs" in (p.why_not or ""), p.hole_um is None))
        more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        return f"{best.name}: {best.why_not}{more}"
    if hidden:
        return hidden[0] + (f" (and {len(hidden) - 1} more)" if len(hidden) > 1 else "")
    return f"it has only vias, and solder mask covers them on the {side}"
