"""CAD files of a board folder: which is which, and how to open them.

What a file is for is taken from the folder's `reprobe-roles.json` where it lies there, so that dialects are learned
once; the geometry is read here. Without it, gerbonara's `LayerStack` knows the naming habits of many tools; where it
fails or leaves a layer out, the files are told apart by their X2 `.FileFunction`, else by their suffix.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gerbonara import GerberFile, LayerStack

from sim_hw.board.drills import DrillFormat, is_capped, is_drill_text, open_drills
from sim_hw.board.folder import cad_files
from sim_hw.board.roles import Roles, read_roles

_FUNCTION = re.compile(r"TF\.FileFunction,([^*\r\n]+)")
_BY_SUFFIX = {
    ".gtl": "top copper",
    ".gbl": "bottom copper",
    ".gts": "top mask",
    ".gbs": "bottom mask",
    ".gto": "top silk",
    ".gbo": "bottom silk",
    ".gm1": "outline",
    ".gko": "outline",
}
_BY_NAME = (
    (re.compile(r"(?:^|[-_.])(F|B)[._]?(?:Courtyard|CrtYd)", re.IGNORECASE), "courtyard"),
    (re.compile(r"(?:^|[-_.])(F|B)[._]?Fab(?:$|[-_.])", re.IGNORECASE), "fabrication"),
)
_DRILL_SUFFIXES = {".drl", ".xln", ".exc", ".drd", ".nc", ".xnc", ".drill", ".tap", ".txt"}
_NETLIST_SUFFIXES = {".d356", ".ipc", ".356"}
_NETLIST = re.compile(r"^P  (?:JOB|CODE|UNITS).*?^3[126]7", re.MULTILINE | re.DOTALL)


@dataclass
class BoardFiles:
    """The opened files: layer name (`top copper`, ..., `outline`) -> gerbonara objects."""

    layers: dict[str, list[Any]] = field(default_factory=dict)
    sources: dict[str, Path] = field(default_factory=dict)
    drills: list[Any] = field(default_factory=list)  # hits whose hole can be seen where no mask covers it
    capped: list[Any] = field(default_factory=list)  # filled and capped: IPC-4761 type VII
    netlist: Path | None = None
    left_out: dict[str, str] = field(default_factory=dict)  # file -> why it could not be read

    def text(self, layer: str) -> str:
        """Return the text of a layer's file, or nothing where it is not known which file that is."""
        path = self.sources.get(layer)
        return "" if path is None else path.read_text(errors="replace")


def _function_layer(function: str) -> str | None:
    parts = [part.strip() for part in function.split(",")]
    side = {"top": "top", "bot": "bottom"}.get(parts[-1].lower())
    match parts[0].lower():
        case "profile":
            return "outline"
        case "copper":
            side = next((s for p in parts for k, s in (("Top", "top"), ("Bot", "bottom")) if p == k), None)
            return f"{side} copper" if side else None
        case "soldermask" if side:
            return f"{side} mask"
        case "legend" if side:
            return f"{side} silk"
    return None


def _by_stack(folder: Path) -> dict[str, list[Any]]:
    try:
        stack = LayerStack.open(folder)
    except Exception:  # noqa: BLE001  # whatever a foreign guess raises, the files are opened one by one instead
        return {}
    layers = {f"{side} {use}": layer for (side, use), layer in stack.graphic_layers.items() if layer is not None}
    if "mechanical outline" in layers:
        layers["outline"] = layers.pop("mechanical outline")
    return {name: list(layer.objects) for name, layer in layers.items()}


def _role_of(path: Path, text: str) -> str | None:
    """Return what a file is for by what it says of itself, else by its name; None for what is not needed."""
    suffix = path.suffix.lower()
    if suffix in _NETLIST_SUFFIXES or _NETLIST.search(text[:20_000]):
        return "netlist"
    if suffix in _DRILL_SUFFIXES and is_drill_text(text):
        return "drill"
    if "%FS" not in text:
        return None
    function = _FUNCTION.search(text)
    by_function = _function_layer(function.group(1)) if function else None
    if by_function or (function and not function.group(1).startswith("Other")):
        return by_function
    for pattern, use in _BY_NAME:
        if (found := pattern.search(path.name)) is not None:
            return f"{'top' if found[1].upper() == 'F' else 'bottom'} {use}"
    return _BY_SUFFIX.get(suffix)


def open_folder(folder: Path, side: str) -> BoardFiles:
    """Open what is needed to draw one side; a file that cannot be read is left out and named, if it is not needed.

    Raises:
        ValueError: no such folder, or the copper, mask or outline is missing; the message says which.

    """
    if not folder.is_dir():
        raise ValueError(f"no board folder at {folder}; give a folder with Gerber, Excellon and IPC-D-356 files")
    files, roles = BoardFiles(), read_roles(folder)
    needed = (f"{side} copper", f"{side} mask")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gerbonara comments on every foreign habit it repairs
        if not roles.of:
            files.layers = _by_stack(folder)
        complete = all(files.layers.get(name) for name in (*needed, "outline"))
        for path, name, role in _with_roles(folder, roles):
            _take(files, path, role, side, known=complete, written=roles.drills.get(name))
    missing = [name for name in needed if not files.layers.get(name)]
    if missing:
        why = "".join(f"; {name} cannot be read: {reason}" for name, reason in files.left_out.items())
        raise ValueError(f"{folder}: no {', '.join(missing)} found; export Gerber X2 or use the usual suffixes{why}")
    return files


def _with_roles(folder: Path, roles: Roles) -> Iterator[tuple[Path, str, str]]:
    """Yield the files of use: path, name in the folder and role; the roles file wins over guesses."""
    for path in cad_files(folder):
        name = path.relative_to(folder).as_posix()
        role = roles.of[name] if name in roles.of else _role_of(path, path.read_text(errors="replace"))
        if role is not None:
            yield path, name, role


def _take(files: BoardFiles, path: Path, role: str, side: str, *, known: bool, written: DrillFormat | None) -> None:
    try:
        if role == "netlist":
            files.netlist = path
        elif role in ("drill", "capped drill"):
            hits = open_drills(path, written)
            capped = role == "capped drill" or is_capped(path.read_text(errors="replace"))
            (files.capped if capped else files.drills).extend(hits)
        elif role == "outline" or role.startswith(side):
            if not known or role not in files.layers:
                found = list(GerberFile.open(path).objects)
                files.layers[role] = [*files.layers[role], *found] if role in files.sources else found
            files.sources[role] = path
    except Exception as error:  # noqa: BLE001  # one odd file must not end the station, whatever a foreign parser raises
        files.left_out[path.name] = " ".join(f"{type(error).__name__}: {error}".split())
