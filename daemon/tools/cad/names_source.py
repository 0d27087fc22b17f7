"""Source of a board's names: the netlist, else a KiCad board, the copper's X2 attributes, a list of points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.tools.cad.folder import CadFile, CadFolder
from daemon.tools.cad.ipc356 import looks_like_netlist, read_ipc356
from daemon.tools.cad.kicad_board import read_kicad_board
from daemon.tools.cad.model import Drill, Pin, Shape, Side
from daemon.tools.cad.panel_cut import NotCutError, one_board
from daemon.tools.cad.pins import pins_of_copper, pins_of_netlist
from daemon.tools.cad.points_file import read_points
from daemon.tools.cad.roles import Roles

_FEWEST = 0.9
"""Share of a netlist's records that must be readable."""
NETLIST_UNITS = (1.0, 2.54, 1.0 / 2.54)
"""A netlist whose unit line is wrong (1 um for 2.54 um, or the other way) is this much too small or large."""


@dataclass(frozen=True)
class Named:
    """Pins in their source's origin. source: the file, for people; scales: what lengths may have to be taken times.

    each_copy: the source names every board of a panel, and these are the pins of one of them; every: those of all,
    where the copper does not name them. unsaid: the numbers of the pins whose side the source does not say.
    """

    pins: list[Pin]
    source: str
    notes: tuple[str, ...] = ()
    scales: tuple[float, ...] = (1.0,)
    each_copy: bool = False
    every: tuple[Pin, ...] = ()
    unsaid: frozenset[int] = frozenset()


def find_pins(folder: CadFolder, roles: Roles, copper: dict[Side, Sequence[Shape]], drills: Sequence[Drill]) -> Named:
    """Return the pins of the best source there is; raise ValueError saying what to export where there is none.

    A source that cannot be read is left out and told, if there is another one.
    """
    failed: list[ValueError] = []
    for role in ("netlist", "board", "copper", "points"):
        try:
            found = _of_copper(copper, drills) if role == "copper" else _of_role(folder, roles, role)
        except CannotReadError as exc:
            failed.append(exc)
            continue
        if found is not None:
            return replace(found, notes=(*(f"left out: {exc}" for exc in failed), *found.notes))
    if failed:
        raise failed[0]
    raise ValueError(_nothing(folder, roles))


class CannotReadError(ValueError):
    """A source of names cannot be read, though it looks like one."""


def _of_copper(copper: dict[Side, Sequence[Shape]], drills: Sequence[Drill]) -> Named | None:
    try:
        pins = pins_of_copper(copper, drills)
    except NotCutError as exc:
        raise CannotReadError(str(exc)) from exc
    if not any(p.part for p in pins):
        return None
    note = "no netlist: names and nets are the X2 attributes of the copper Gerbers"
    return Named(pins, "the copper's X2 attributes", (note,), each_copy=True)


_PLURAL = {"netlist": "netlists", "board": "board files", "points": "lists of points"}


def _of_role(folder: CadFolder, roles: Roles, role: str) -> Named | None:
    files = _distinct(folder, roles.files(role))
    if len(files) > 1:
        names = ", ".join(f.name for f in files)
        raise ValueError(
            f"{folder.path} has {len(files)} {_PLURAL[role]}: {names}; say which one counts: --netlist FILE"
        )
    if not files:
        return None
    try:
        return _of_file(files[0])
    except ValueError as exc:
        if roles.told_by[files[0].name] == "option":
            raise
        raise CannotReadError(str(exc)) from exc


def _nothing(folder: CadFolder, roles: Roles) -> str:
    foreign = "".join(f"{name} is {kind}, which is not read; " for name, kind in list(roles.foreign.items())[:1])
    empty = f"{', '.join(roles.empty[:4])} is empty, " if roles.empty else ""
    return (
        f"{folder.path} has no names for its pads: {foreign}{empty}export an IPC-D-356 netlist, or Gerber X2 with "
        "netlist attributes, or a CSV of test points (name, net, x, y, side), and put it into the folder"
    )


def _distinct(folder: CadFolder, names: Sequence[str]) -> list[CadFile]:
    """Return the files without those that say the same as an earlier one."""
    found: dict[frozenset[str], CadFile] = {}
    for file in folder.files:
        if file.name in names:
            found.setdefault(_said(file.text), file)
    return list(found.values())


def _said(text: str) -> frozenset[str]:
    """Return the lines that say something; in a netlist remarks (C) do not."""
    remark = "C" if looks_like_netlist(text) else "\0"
    return frozenset(line.strip() for line in text.splitlines() if not line.startswith(remark))


def _of_file(file: CadFile) -> Named:
    """Read a source of names by its content, whatever its role was called."""
    text = file.text
    if text[:200].lstrip().startswith("(kicad_pcb"):
        return Named(read_kicad_board(file.name, text), file.name)
    if looks_like_netlist(text):
        return _of_netlist(file)
    points = read_points(file.name, text)
    note = f"names are the {len(points.pins)} points of {file.name} alone: other pads have no names"
    return Named(points.pins, file.name, (note,), points.scales, unsaid=points.unsaid)


def _of_netlist(file: CadFile) -> Named:
    netlist = read_ipc356(file.text)
    lines = ", ".join(str(n) for n in netlist.unread[:5])
    if not netlist.records or len(netlist.records) < _FEWEST * (len(netlist.records) + len(netlist.unread)):
        if lines:
            raise ValueError(f"{file.name}: line {lines} cannot be read; export the netlist (IPC-D-356A) again")
        raise ValueError(f"{file.name} has no test records (317, 327); export the netlist as IPC-D-356A")
    notes = [] if netlist.ended else [f"{file.name} has no end (999) and may be cut off: compare its size"]
    if netlist.unread:
        many = len(netlist.unread) > 1
        what = f"line{'s' if many else ''} {lines}{', ...' if len(netlist.unread) > 5 else ''}"
        notes.append(f"{file.name}: {what} cannot be read and {'were' if many else 'was'} left out")
    every = pins_of_netlist(netlist)
    places = np.array([(p.x_mm, p.y_mm) for p in every])
    pins = one_board(every, np.hstack((places, places)), f"{file.name} names")
    several = len(pins) < len(every)
    return Named(pins, file.name, tuple(notes), NETLIST_UNITS, each_copy=several, every=tuple(every) if several else ())
