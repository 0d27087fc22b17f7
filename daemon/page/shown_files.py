"""Files a browser may have: those of two folders, read once at start. Nothing else is reached by any path."""

from __future__ import annotations

import gzip
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

TYPES: Final = {
    ".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8",
    ".json": "application/json", ".svg": "image/svg+xml",
}  # fmt: skip
FOLDERS: Final = ("static", "words")


@dataclass(frozen=True)
class Shown:
    """One file."""

    content: bytes
    packed: bytes
    """The same, gzip."""
    kind: str
    tag: str
    """Of its content, for a browser that has it already."""


def shown_files() -> dict[str, Shown]:
    """Return path below the page's root -> file."""
    here = Path(__file__).parent
    found = {}
    for folder in FOLDERS:
        for file in sorted((here / folder).iterdir()):
            if file.suffix in TYPES:
                content = file.read_bytes()
                tag = f'"{hashlib.sha256(content).hexdigest()[:20]}"'
                found[f"/{folder}/{file.name}"] = Shown(
                    content, gzip.compress(content, mtime=0), TYPES[file.suffix], tag
                )
    found["/"] = found["/static/index.html"]
    return found


def edition(files: dict[str, Shown]) -> str:
    """Return a mark of all files together: a tab that shows another edition has to load again."""
    return hashlib.sha256("".join(shown.tag for shown in files.values()).encode()).hexdigest()[:16]
