"""CAD formats that are not read, told by name, each with what to export instead."""

from __future__ import annotations

from pathlib import PurePosixPath

INSTEAD = "export Gerber (X2), Excellon drills and an IPC-D-356 netlist"
PACKED = "packed in a way that is not opened; unpack it and give the folder"
_BY_SUFFIX = {
    ".pcbdoc": "an Altium board",
    ".brd": "a board of EAGLE or Allegro",
    ".fbrd": "a Fusion board",
    ".dip": "a DipTrace board",
    ".pcb": "a board of PADS, P-CAD or gEDA",
    ".lyt": "a Proteus layout",
    ".pdsprj": "a Proteus project",
    ".fzz": "a Fritzing sketch",
    ".lay6": "a Sprint-Layout board",
    ".lay": "a Sprint-Layout board",
    ".t3001": "a TARGET 3001! board",
    ".ewprj": "an Ultiboard project",
    ".epro": "an EasyEDA project",
    ".cvg": "an IPC-2581 file",
    ".gds": "a GDSII file",
    ".asc": "a PADS ASCII board",
    ".cad": "a GenCAD file",
    ".gcd": "a GenCAD file",
}


def foreign_format(name: str, data: bytes) -> str | None:
    """Say what a file is if it holds a board in a format that is not read; None otherwise."""
    lower, head = name.lower(), data[:4000]
    suffix = PurePosixPath(lower).suffix
    if b"IPC-2581" in head or b"ipc2581" in head:
        return "an IPC-2581 file"
    if lower.endswith((".tgz", ".tar.gz")) or "/matrix/matrix" in f"/{lower}" or "/steps/" in f"/{lower}":
        return "an ODB++ archive"
    if b"$HEADER" in head and b"GENCAD" in head:
        return "a GenCAD file"
    if b"BRDFILE" in head or (b"BRDOUT:" in head and b"PINS" in data):
        return "an OpenBoardView file"
    if suffix in (".gbr", ".ger", ".txt") or b"%FS" in head or b"%MO" in head or b"M48" in head[:500]:
        return None
    return _BY_SUFFIX.get(suffix)


def is_packed(name: str) -> bool:
    """Say whether a file is an archive that is not opened."""
    return PurePosixPath(name.lower()).suffix in (".rar", ".7z", ".tar", ".gz", ".bz2", ".xz", ".zst")
