"""Reading of a folder or zip of CAD files: from what customers send to one `Cad`.

Order: roles of files, layers drawn, drills read so that they meet the copper, outline, names (netlist, X2 attributes or
points), registration of the names to the layers. Each step either succeeds, leaves something out and says so, or
refuses with a sentence and the cure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from daemon.tools.cad.copies import Panel, on_copy, panel_of, with_nets_of
from daemon.tools.cad.cross_check import complete_names, renamed
from daemon.tools.cad.drill_check import check_drills
from daemon.tools.cad.drill_files import read_drills
from daemon.tools.cad.excellon import DrillFormat
from daemon.tools.cad.folder import CadFolder, open_cad, with_named
from daemon.tools.cad.layers import Layers, draw_layers, find_outline
from daemon.tools.cad.model import Cad
from daemon.tools.cad.names_source import Named, find_pins
from daemon.tools.cad.netlist_fit import Fit, Metal, fit_netlist
from daemon.tools.cad.origins import all_pads, check_origins, check_sides
from daemon.tools.cad.pins import moved
from daemon.tools.cad.role_file import ROLE_FILE, RoleFile, write_role_file
from daemon.tools.cad.roles import Roles, find_roles, named_files
from daemon.tools.cad.strays import without_strays
from daemon.tools.cad.told_holes import add_told_holes
from daemon.tools.cad.unsaid_sides import with_sides

NO_LAYERS: Mapping[str, Path | Sequence[Path]] = MappingProxyType({})


def read_cad(
    path: Path, *, layers: Mapping[str, Path | Sequence[Path]] = NO_LAYERS, netlist: Path | None = None,
    copy: int | None = None, keep: bool = False,
) -> Cad:  # fmt: skip
    """Read a folder or zip of CAD files; raise ValueError with one plain sentence and the cure.

    layers: what the person says of files, layer (`top_mask`) -> file or files; netlist: the file that names the pads;
    copy: the copy of a panel (from 1) that the names are for; keep: write what was found out to the roles file.
    """
    folder = with_named(open_cad(path), [file for _, file in named_files(layers, netlist)])
    roles = find_roles(folder, layers, netlist)
    drawn = draw_layers(folder, roles)
    try:
        return _put_together(path, folder, roles, drawn, copy=copy, keep=keep)
    except ValueError as exc:
        for why in drawn.broken.values():  # nothing fits what could not be read
            raise ValueError(why) from exc
        raise


def _put_together(path: Path, folder: CadFolder, roles: Roles, drawn: Layers, *, copy: int | None, keep: bool) -> Cad:
    """Hold drills, outline and names against the layers that were drawn."""
    check_origins(drawn)
    pads = all_pads(drawn)
    read = read_drills(folder, roles, drawn)
    drills = read.holes
    holes = np.array([(d.x_mm, d.y_mm) for d in drills if d.plated is not False], float).reshape(-1, 2)
    check_sides(drawn, holes)
    outline = find_outline(drawn, pads)
    doubts = check_drills(read.files, drawn.copper(), pads, outline.shapes if outline.file else ())
    roles.unused |= set(roles.files("outline")) - {outline.file}  # a frame, a keep-out, a mechanical drawing
    named = find_pins(folder, roles, drawn.copper(), drills)
    metal = Metal(holes, drawn.pads())
    fit = fit_netlist(named.pins, metal, named.source, named.scales)
    pins, unsided = with_sides(moved(named.pins, fit.shift_mm, fit.scale), named.unsaid, metal, named.source)
    panel = panel_of(fit, pins, outline.shapes)
    if copy is not None:
        panel, pins = on_copy(panel, pins, copy, folder.path)
        pins = with_nets_of(pins, moved(named.every, fit.shift_mm, fit.scale)) if named.every else pins
        pins = renamed(pins, drawn.copper()) if named.each_copy else pins
    pins, differing = complete_names(pins, drawn.copper(), named.source)
    told_apart = drawn.copper() if named.source in roles.of else {}  # the copper's own names lie where it draws them
    pins, strays = without_strays(pins, metal, told_apart, named.source)
    drills, missing = add_told_holes(drills, pins, named.source)
    told = [outline.note] if outline.note else []
    notes = [
        *drawn.notes, *read.notes, *doubts, *missing, *told, *named.notes, *unsided, *differing, *strays,
        *_fit_notes(fit, named.source), *_panel_notes(panel, fit, named),
    ]  # fmt: skip
    cad = Cad(
        name=folder.name, folder=path, layers=drawn.shapes, drills=tuple(drills),
        outline=outline.shapes, box_mm=outline.box, pins=tuple(pins), netlist_shift_mm=fit.shift_mm,
        copies=panel.copies, named_copy=panel.named,
        roles=_all_roles(folder, roles), sources={f.name: f.sha256 for f in folder.files if f.name != ROLE_FILE},
        broken=drawn.broken,
    )  # fmt: skip
    notes += _keep(folder, roles, read.formats, keep=keep)
    return replace(cad, notes=(*notes, *_left_out(folder, roles)))


# --- what is told ----------------------------------------------------------------------------------------------


def _fit_notes(fit: Fit, source: str) -> list[str]:
    notes = []
    if fit.scale != 1.0:
        notes.append(
            f"{source} fits the layers only with its lengths times {fit.scale:.4g}: its unit is wrong or not said"
        )
    if fit.share < 0.8:
        notes.append(f"only {fit.share:.0%} of the places in {source} have a pad or a hole in the layers")
    notes += [
        f"only {met} of the {count} pads that {source} names on the {side} have one there; "
        "export it from the same state of the board"
        for side, (met, count) in fit.poor.items()
    ]
    return notes


def _panel_notes(panel: Panel, fit: Fit, named: Named) -> list[str]:
    """Say which of the copies the names are for, and how that came."""
    if not panel.copies:
        return []
    told, used = panel.copies[panel.told_for].name, panel.copies[panel.named].name
    if named.each_copy:
        which = f"{named.source} {'names' if named.every else 'name'} each; the points are those of copy {used}"
    elif fit.shift_mm != (0.0, 0.0):
        which = f"{named.source} lies elsewhere and was taken for copy {used}"
    else:
        which = f"{named.source} names copy {told}"
        which += f", and its names were carried to copy {used}" if used != told else ""
    return [f"a panel of {len(panel.copies)} copies; {which}", *([panel.note] if panel.note else [])]


def _all_roles(folder: CadFolder, roles: Roles) -> dict[str, str]:
    """Return every file's role, `ignored` for what was not used."""
    used = {name: role for name, role in roles.of.items() if name not in roles.unused}
    return {f.name: used.get(f.name, "ignored") for f in folder.files if f.name != ROLE_FILE}


def _left_out(folder: CadFolder, roles: Roles) -> list[str]:
    """Say which files were not used, shortly."""
    notes = list(roles.notes)
    if roles.unknown:
        names = ", ".join(roles.unknown)
        notes.append(f"left out, because nothing tells their layer: {names}; if one is needed: --layer top_mask=FILE")
    if roles.empty:
        notes.append(f"left out, being empty: {', '.join(roles.empty)}")
    notes += [f"left out: {name} is {kind}, which is not read" for name, kind in roles.foreign.items()]
    rest = [*folder.left_out, *(f.name for f in folder.files if not _known(f.name, roles) and f.suffix != ".gbrjob")]
    if rest:
        more = f" and {len(rest) - 12} more" if len(rest) > 12 else ""
        notes.append(f"left out, being no CAD of a layer: {', '.join(rest[:12])}{more}")
    return notes


def _known(name: str, roles: Roles) -> bool:
    return (
        name == ROLE_FILE or name in roles.of or name in roles.unknown or name in roles.foreign or name in roles.empty
    )


def _keep(folder: CadFolder, roles: Roles, formats: dict[str, DrillFormat], *, keep: bool) -> list[str]:
    """Write the roles file where it can be kept; say so where not."""
    if not keep:
        return []
    kept = {name: role for name, role in roles.to_keep().items() if name not in folder.outside}
    if folder.writable and write_role_file(folder.path, RoleFile(kept, formats)):
        return []
    if roles.told_by and "option" in roles.told_by.values():
        return [f"{folder.path} cannot be written to: what the options say is not kept there"]
    return []
