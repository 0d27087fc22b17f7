"""Drill files of a folder: each read, its format decided, its holes held against the copper's pads."""

from __future__ import annotations

from dataclasses import dataclass, replace

from daemon.tools.cad.drills import (
    Copper,
    decide_format,
    displacement_mm,
    drills_of,
    drills_of_gerber,
    make_copper,
    raw_places,
)
from daemon.tools.cad.excellon import DrillFile, DrillFormat, read_excellon
from daemon.tools.cad.folder import CadFile, CadFolder
from daemon.tools.cad.gerber import read_gerber
from daemon.tools.cad.layers import Layers
from daemon.tools.cad.model import Drill, Side
from daemon.tools.cad.origins import all_pads
from daemon.tools.cad.outline import box_of
from daemon.tools.cad.places import share_met
from daemon.tools.cad.roles import Roles
from daemon.tools.cad.tool_table import add_tool_sizes

_PLATING = {"drill plated": True, "drill unplated": False}


@dataclass
class _DrillSource:
    """One drill file on its way: its words, then the reading that fits."""

    file: CadFile
    words: DrillFile
    plated: bool | None
    sides: frozenset[Side] = frozenset(("top", "bottom"))
    reading: DrillFormat | None = None
    share: float = 0.0


@dataclass(frozen=True)
class Drills:
    """All holes, each once; those of each file; the formats decided, by file; what to tell."""

    holes: list[Drill]
    files: list[tuple[str, list[Drill]]]
    formats: dict[str, DrillFormat]
    notes: list[str]


def read_drills(folder: CadFolder, roles: Roles, drawn: Layers) -> Drills:
    """Read all drill files; raise ValueError for one that lies elsewhere than the copper."""
    box = box_of(s.points_mm for shapes in drawn.copper().values() for s in shapes) or (0.0, 0.0, 0.0, 0.0)
    copper = make_copper(all_pads(drawn), box)
    notes: list[str] = []
    files = [f for f in folder.files if roles.of.get(f.name, "").startswith("drill")]
    in_gerber = [f for f in files if "%FS" in f.text[:5000]]
    found = [(file.name, _gerber_drills(file, roles, drawn, notes)) for file in in_gerber]
    sources = [s for f in files if f not in in_gerber and (s := _source(f, folder, roles, drawn, notes)) is not None]
    _decide(sources, roles, copper)
    found += [(source.file.name, _excellon_drills(source, notes)) for source in sources]
    for name, drills in found:
        if (off := displacement_mm(drills, copper)) is not None:
            raise ValueError(
                f"the drills of {name} lie {off[0]:.2f}, {off[1]:.2f} mm from the copper's pads: "
                "export both with the same origin"
            )
    drills = [d for _, group in found for d in group]
    if not drills:
        notes.append("no drill file was found: holes are not known; export Excellon drills, or say --layer drill=FILE")
    formats = {s.file.name: s.reading for s in sources if s.reading is not None}
    return Drills(_deduplicated(drills), found, formats, notes)


def _source(file: CadFile, folder: CadFolder, roles: Roles, drawn: Layers, notes: list[str]) -> _DrillSource | None:
    """Read a file's words, sizes and plating; None where it cannot be read."""
    words = _excellon(file, roles, notes)
    if words is None:
        return None
    reports = [f for f in folder.files if f.is_text and f.name not in roles.of]
    if report := add_tool_sizes(words, reports):
        notes.append(f"the drill sizes of {file.name} are those of {report}")
    plated = _PLATING.get(roles.of[file.name], words.plated)
    if words.plated is not None and roles.told_by[file.name] == "content":
        plated = words.plated
    return _DrillSource(file, words, plated, drawn.sides_of(words.span))


def _decide(sources: list[_DrillSource], roles: Roles, copper: Copper) -> None:
    """Decide each file's format; one that meets no pads (unplated holes) is read like its sibling.

    What the roles file keeps wins, unless the holes clearly meet the pads in another way: then the file is a new one.
    """
    for source in sources:
        source.reading, source.share = decide_format(source.words, copper)
    sure = max(sources, key=lambda s: s.share, default=None)
    for source in sources:
        alike = sure is not None and source.words.said == sure.words.said
        if sure is not None and sure.reading is not None and source.share < 0.3 <= sure.share and alike:
            source.reading = sure.reading
        kept = roles.kept.drills.get(source.file.name)
        if kept is not None:
            kept = replace(kept, has_points=source.words.said.has_points)
            share = share_met(raw_places(source.words.hits, kept), copper.tree)
            if share >= 0.5 * source.share:
                source.reading, source.share = kept, share


def _gerber_drills(file: CadFile, roles: Roles, drawn: Layers, notes: list[str]) -> list[Drill]:
    try:
        layer = read_gerber(file.text)
        _, *ends = [*layer.attributes.get(".FileFunction", []), "", "", ""][:3]
        span = (int(ends[0]), int(ends[1])) if all(e.isdigit() for e in ends) else None
        drills = drills_of_gerber(layer, plated=_PLATING.get(roles.of[file.name]))
        return [replace(d, sides=drawn.sides_of(span)) for d in drills]
    except ValueError as exc:
        _leave_out(file, roles, notes, exc)
        return []


def _excellon(file: CadFile, roles: Roles, notes: list[str]) -> DrillFile | None:
    """Read a file's words; None where it cannot be read."""
    try:
        words = read_excellon(file.text)
    except ValueError as exc:
        _leave_out(file, roles, notes, exc)
        return None
    if not words.hits and not words.tools and roles.told_by[file.name] == "option":
        raise ValueError(f"{file.name} drills nothing, and cannot be the {roles.of[file.name]}; give another file")
    return words


def _leave_out(file: CadFile, roles: Roles, notes: list[str], why: ValueError) -> None:
    """Leave a file out and tell it; raise ValueError for one that a person named."""
    role = roles.of[file.name]
    if roles.told_by[file.name] == "option":
        raise ValueError(f"{file.name} ({role}) cannot be read: {why}; export the drills anew") from why
    notes.append(f"{file.name} ({role}) was left out: {why}; export the drills anew")
    roles.unused.add(file.name)


def _excellon_drills(source: _DrillSource, notes: list[str]) -> list[Drill]:
    said, reading = source.words.said, source.reading
    if reading is None:
        return []
    drills, nameless = drills_of(source.words, reading, plated=source.plated)
    if len(source.sides) < 2:
        drills = [replace(d, sides=source.sides) for d in drills]
    name = source.file.name
    if nameless:
        tools = ", ".join(f"T{n}" for n in nameless)
        notes.append(
            f"{name} does not say how large {tools} is: its holes were left out; export the tools in the header"
        )
    if said.unit is not None and reading.unit != said.unit:
        notes.append(f"{name} says {said.unit}, but only as {reading.unit} do its holes meet the pads: read so")
    elif not said.has_points and (said.decimals is None or said.zeros_kept is None or said.unit is None):
        notes.append(
            f"{name} does not say its format: read as {reading.unit}, {reading.integers}.{reading.decimals} digits, "
            f"{reading.zeros_kept} zeros kept, by which {source.share:.0%} of its holes meet pads"
        )
    return drills


def _deduplicated(drills: list[Drill]) -> list[Drill]:
    """Drop holes that two files tell (a file of all drills beside those by plating); what says more stays.

    A hole comes out wherever one of its files says so: blind vias of both sides may lie on each other.
    """
    found: dict[tuple[int, ...], Drill] = {}
    for d in drills:
        ends = sorted(((d.x_mm, d.y_mm), (d.end_x_mm or d.x_mm, d.end_y_mm or d.y_mm)))
        key = (*(round(v * 200) for end in ends for v in end), round(d.diameter_mm * 50))
        known = found.get(key)
        if known is None or (known.plated is None and d.plated is not None) or d.capped:
            found[key] = d
        if known is not None:
            found[key] = replace(found[key], sides=known.sides | d.sides)
    return list(found.values())
