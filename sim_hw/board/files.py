"""CAD files of a board folder: which is which, and how to open them.

gerbonara's `LayerStack` knows the naming habits of many tools; where it fails or leaves a layer out, the files
are opened one by one and told apart by their X2 `.FileFunction`, else by their suffix.
"""

import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gerbonara import ExcellonFile, GerberFile, LayerStack

_FUNCTION = re.compile(r"TF\.FileFunction,([^*\r\n]+)")
_SLOT = re.compile(r"^(X[-+\d.]+Y[-+\d.]+)G85(X[-+\d.]+Y[-+\d.]+)$", re.MULTILINE)
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
_DRILL_SUFFIXES = {".drl", ".xln", ".exc", ".drd"}
_NETLIST_SUFFIXES = {".d356", ".ipc", ".356"}
_OTHER_SUFFIXES = {".gbrjob", ".json", ".md", ".txt", ""}
_CAPPED = re.compile(r"TA\.AperFunction,Plated,PTH,ViaDrill,VII\s*$", re.MULTILINE)


@dataclass
class BoardFiles:
    """The opened files: layer name (`top copper`, ..., `outline`) -> gerbonara objects."""

    layers: dict[str, list[Any]] = field(default_factory=dict)
    drills: list[Any] = field(default_factory=list)  # hits whose hole can be seen where no mask covers it
    capped: list[Any] = field(default_factory=list)  # filled and capped: IPC-4761 type VII
    netlist: Path | None = None


def _function_layer(function: str) -> str | None:
    parts = [part.strip() for part in function.split(",")]
    side = {"top": "top", "bot": "bottom"}.get(parts[-1].lower())
    match parts[0].lower():
        case "profile":
            return "outline"
        case "copper":
            side = next((s for p in parts for k, s in (("Top", "top"), ("Bot", "bottom")) if p == k), None)
            return f"{side} copper" if side else None
        case "soldermask":
            return f"{side} mask"
        case "legend":
            return f"{side} silk"
    return None


def _open_drills(path: Path) -> list[Any]:
    try:
        return list(ExcellonFile.open(path).objects)
    except (SyntaxError, ValueError, TypeError, AttributeError, KeyError):
        # Slots in the G85 notation stop gerbonara 1.5: say the same as a routed line.
        text = _SLOT.sub(r"G00\1\nM15\nG01\2\nM16\nG05", path.read_text(errors="replace"))
        return list(ExcellonFile.from_string(text, filename=path).objects)


def _by_stack(folder: Path) -> dict[str, list[Any]]:
    try:
        stack = LayerStack.open(folder)
    except Exception:  # noqa: BLE001  # whatever a foreign guess raises, the files are opened one by one instead
        return {}
    layers = {f"{side} {use}": layer for (side, use), layer in stack.graphic_layers.items() if layer is not None}
    if "mechanical outline" in layers:
        layers["outline"] = layers.pop("mechanical outline")
    return {name: list(layer.objects) for name, layer in layers.items()}


def _by_file(path: Path, text: str) -> tuple[str, list[Any]] | None:
    function = _FUNCTION.search(text)
    name = _function_layer(function.group(1)) if function else _BY_SUFFIX.get(path.suffix.lower())
    return (name, list(GerberFile.open(path).objects)) if name else None


def open_folder(folder: Path, side: str) -> BoardFiles:
    """Open what is needed to draw one side.

    Raises:
        ValueError: no such folder, or the copper, mask or outline is missing; the message says which.

    """
    if not folder.is_dir():
        raise ValueError(f"no board folder at {folder}; give a folder with Gerber, Excellon and IPC-D-356 files")
    needed = (f"{side} copper", f"{side} mask", "outline")
    files = BoardFiles()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gerbonara comments on every foreign habit it repairs
        files.layers = _by_stack(folder)
        complete = all(files.layers.get(name) for name in needed)
        for path in sorted(folder.iterdir()):
            _take(files, path, skip_gerber=complete)
    missing = [name for name in needed if not files.layers.get(name)]
    if missing:
        raise ValueError(f"{folder}: no {', '.join(missing)} found; export Gerber X2 or use the usual suffixes")
    return files


def _take(files: BoardFiles, path: Path, *, skip_gerber: bool) -> None:
    suffix = path.suffix.lower()
    if suffix in _NETLIST_SUFFIXES:
        files.netlist = path
    elif suffix in _DRILL_SUFFIXES:
        hits = _open_drills(path)
        (files.capped if _CAPPED.search(path.read_text(errors="replace")) else files.drills).extend(hits)
    elif not skip_gerber and suffix not in _OTHER_SUFFIXES and path.is_file():
        text = path.read_text(errors="replace")
        if "%FS" in text and (found := _by_file(path, text)):
            files.layers[found[0]] = found[1]
