"""Roles of a folder's files: told by options, by the roles file, by X2, by the job file, by content, by name.

In this order. What stays open is not guessed: the file is left out and named, and an option settles it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from daemon.tools.cad.excellon import DRILL
from daemon.tools.cad.folder import CadFile, CadFolder
from daemon.tools.cad.foreign import foreign_format
from daemon.tools.cad.gerber_words import file_attributes
from daemon.tools.cad.ipc356 import looks_like_netlist
from daemon.tools.cad.names import numbered_copper, plating_by_name, role_by_name, shared_words
from daemon.tools.cad.points_file import looks_like_points
from daemon.tools.cad.role_file import ROLE_FILE, RoleFile, parse_role, read_role_file

_GERBER = re.compile(
    r"%\s*(FS[LTD]|MO(MM|IN)|ADD\d|AM\w|LP[DC]|IPPOS|OFA|ASAXBY|TF\.)|^X-?\d+Y-?\d+D0?[123]\*", re.MULTILINE
)


@dataclass
class Roles:
    """File -> role, who said so, and what is still open. unknown: Gerbers whose layer nobody tells; empty: no content.

    unused: files with a role that were not used this time: one that cannot be read, one of which there is a surer one.
    """

    of: dict[str, str] = field(default_factory=dict)
    told_by: dict[str, str] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    foreign: dict[str, str] = field(default_factory=dict)
    unused: set[str] = field(default_factory=set)
    kept: RoleFile = field(default_factory=RoleFile)
    notes: list[str] = field(default_factory=list)

    def files(self, role: str) -> list[str]:
        """Return the files of a role that can be used."""
        return [name for name, is_ in self.of.items() if is_ == role and name not in self.unused]

    def to_keep(self) -> dict[str, str]:
        """Return what is kept for the next time: what people said, and what was used; the rest is told anew then."""
        told = ("option", "roles file")
        return {name: role for name, role in self.of.items() if name not in self.unused or self.told_by[name] in told}

    def settle(self, name: str, role: str, by: str) -> None:
        """Set a file's role."""
        self.of[name], self.told_by[name] = role, by


def find_roles(folder: CadFolder, layers: Mapping[str, Path | Sequence[Path]], netlist: Path | None) -> Roles:
    """Sort the files of a folder; raise ValueError for an option that names no file or no layer."""
    found = Roles()
    told = _told(folder, layers, netlist)
    kept = next((f for f in folder.files if f.name == ROLE_FILE), None)
    if kept is not None:
        found.kept = read_role_file(kept.text)
    jobs = _job_file_roles(folder, found.notes)
    gerbers = [f.name for f in folder.files if f.is_text and _GERBER.search(f.text[:40_000])]
    skip = shared_words(gerbers)
    for file in folder.files:
        if file.name == ROLE_FILE:
            continue
        if file.name in told:
            found.settle(file.name, told[file.name], "option")
        elif file.name in found.kept.roles:
            found.settle(file.name, found.kept.roles[file.name], "roles file")
        elif not file.data.strip():
            found.empty.append(file.name)
        else:
            _by_content(found, file, jobs, skip, is_gerber=file.name in gerbers)
    _number_copper(found)
    _options_alone(found, told)
    missing = sorted(set(found.kept.roles) - {f.name for f in folder.files})
    if missing:
        found.notes.append(f"{ROLE_FILE} names {', '.join(missing)}, which the folder does not have")
    return found


def _number_copper(found: Roles) -> None:
    """Tell top and bottom where copper is only numbered."""
    if found.files("top copper") or found.files("bottom copper"):
        return
    open_ones = [n for n in found.of if found.of[n] == "inner copper" and found.told_by[n] == "name"]
    for name, role in numbered_copper(open_ones).items():
        found.settle(name, role, "name")


def _options_alone(found: Roles, told: dict[str, str]) -> None:
    """Ignore other files of a role that an option names: it is the whole truth, but for drills, which may be many."""
    for role in {r for r in told.values() if not r.startswith("drill") and r != "ignored"}:
        for name in found.files(role):
            if name not in told:
                found.settle(name, "ignored", "option")


def named_files(layers: Mapping[str, Path | Sequence[Path]], netlist: Path | None) -> list[tuple[str, Path]]:
    """Return role and file for all that options name; a role may have several files."""
    files = [(role, [said] if isinstance(said, Path) else said) for role, said in layers.items()]
    return [(role, path) for role, paths in (*files, ("netlist", [netlist] if netlist else [])) for path in paths]


def _told(folder: CadFolder, layers: Mapping[str, Path | Sequence[Path]], netlist: Path | None) -> dict[str, str]:
    told: dict[str, str] = {}
    for role, path in named_files(layers, netlist):
        file = folder.find(path)
        if file is None:
            raise ValueError(
                f"{path}: there is no such file in {folder.path}; give its name as it stands there, or its path"
            )
        told[file.name] = parse_role(role)
    return told


def _job_file_roles(folder: CadFolder, notes: list[str]) -> dict[str, str]:
    """Return what a Gerber job file says: file's own name -> FileFunction."""
    found: dict[str, str] = {}
    for file in folder.files:
        if file.suffix != ".gbrjob":
            continue
        try:
            entries = json.loads(file.text).get("FilesAttributes", [])
            found |= {str(e["Path"]).lower(): str(e["FileFunction"]) for e in entries if "Path" in e}
        except (ValueError, KeyError, TypeError, AttributeError):
            notes.append(f"{file.name} is no Gerber job file and was left out")
    return found


def _by_content(found: Roles, file: CadFile, jobs: dict[str, str], skip: int, *, is_gerber: bool) -> None:
    text = file.text if file.is_text else ""
    if is_gerber:
        _gerber(found, file, jobs, skip)
    elif looks_like_netlist(text):
        found.settle(file.name, "netlist", "content")
    elif (name := foreign_format(file.name, file.data)) is not None:
        found.foreign[file.name] = name
    elif DRILL.search(text[:40_000]) and "%FS" not in text[:2000]:
        _drill(found, file)
    elif file.suffix == ".kicad_pcb" or text[:200].lstrip().startswith("(kicad_pcb"):
        found.settle(file.name, "board", "content")
    elif looks_like_points(file.name, text):
        found.settle(file.name, "points", "content")


def _drill(found: Roles, file: CadFile) -> None:
    plated = plating_by_name(file.name)
    role = {True: "drill plated", False: "drill unplated", None: "drill"}[plated]
    found.settle(file.name, role, "content")


def _gerber(found: Roles, file: CadFile, jobs: dict[str, str], skip: int) -> None:
    function = file_attributes(file.text).get(".FileFunction")
    if function and (role := role_of_function(function)):
        found.settle(file.name, role, "X2")
        return
    job = jobs.get(PurePosixPath(file.name).name.lower())
    if job and (role := role_of_function([p.strip() for p in job.split(",")])):
        found.settle(file.name, role, "job file")
        return
    by_name = role_by_name(file.name, skip) or role_by_name(file.name, letters=not skip)
    if by_name is not None:
        found.settle(file.name, by_name, "name")
    else:
        found.unknown.append(file.name)


def role_of_function(fields: list[str]) -> str | None:
    """Return the role of an X2 FileFunction; None where it does not say (`Other,User`: the name may)."""
    kind, rest = fields[0].lower(), [f.lower() for f in fields[1:]]
    side = next(({"top": "top", "bot": "bottom"}[f] for f in rest if f in ("top", "bot")), None)
    if kind == "copper":
        return f"{side} copper" if side else "inner copper"
    sided = {"soldermask": "mask", "legend": "silk", "paste": "paste", "assemblydrawing": "fabrication"}.get(kind)
    if sided:
        return f"{side} {sided}" if side else None
    if kind in ("plated", "nonplated", "mixedplating"):
        return {"plated": "drill plated", "nonplated": "drill unplated"}.get(kind, "drill")
    if kind == "profile":
        return "outline"
    return None if kind in ("other", "otherdrawing") else "ignored"
