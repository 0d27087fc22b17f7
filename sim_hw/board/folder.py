"""Files of a board folder, sub-folders included; a zip is laid out beside where it is needed."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

_NEVER = {".zip", ".png", ".jpg", ".jpeg", ".pdf", ".svg", ".step", ".stp", ".wrl", ".kicad_pcb", ".html"}
_LARGEST_BYTES = 50_000_000
_MOST_FILES = 2_000


def cad_files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder and its sub-folders in a fixed order; hidden, huge and foreign ones are passed by."""
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith((".", "__MACOSX")) for part in path.relative_to(folder).parts)
        wanted = not hidden and path.suffix.lower() not in _NEVER and path.is_file()
        if wanted and path.stat().st_size <= _LARGEST_BYTES:
            yield path


def unpacked(path: Path) -> tuple[Path, tempfile.TemporaryDirectory[str] | None]:
    """Return the folder to read, and what removes it when it was made for a zip.

    Raises:
        ValueError: neither a folder nor a zip, or a zip with too much in it.

    """
    if path.is_dir():
        return path, None
    if not path.is_file() or not zipfile.is_zipfile(path):
        raise ValueError(f"no board folder at {path}; give a folder or a zip of Gerber, Excellon and IPC-D-356 files")
    room = tempfile.TemporaryDirectory(prefix="sim_hw-board-")
    with zipfile.ZipFile(path) as archive:
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
        if len(entries) > _MOST_FILES or sum(entry.file_size for entry in entries) > 10 * _LARGEST_BYTES:
            room.cleanup()
            raise ValueError(f"{path} holds more than a board's files; unpack what belongs to the board")
        for entry in entries:
            if entry.file_size <= _LARGEST_BYTES:
                archive.extract(entry, room.name)  # names that lead out of the folder are mended by zipfile
    return Path(room.name), room
