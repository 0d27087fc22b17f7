"""Void alignment: a note on disk that the alignment in force must not be used, and why.

It names the alignment that it means by the moment that was made: a later one is good whether the note could be removed
or not.
"""

from __future__ import annotations

import json
from pathlib import Path

from daemon.platform.atomic_file import FOR_THE_GROUP, replace_whole
from daemon.platform.plain_file import read_small

_FILE = "alignment.void.json"


def void(folder: Path, made_at: str, why: str) -> None:
    """Write down that the alignment of that moment, "" for none, is void; OSError if that is impossible."""
    text = json.dumps({"made_at": made_at, "why": why})
    replace_whole(folder / _FILE, lambda path: path.write_text(text, encoding="utf-8"), FOR_THE_GROUP)


def why_void(folder: Path, made_at: str) -> str | None:
    """Return why the alignment of that moment, "" for none, is void; None if it is not."""
    try:
        note = json.loads(read_small(folder / _FILE))
        return str(note["why"]) if note["made_at"] == made_at else None
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "whether it is void cannot be read"


def forget(folder: Path) -> None:
    """Remove the note: another alignment has passed. OSError if it cannot be removed."""
    (folder / _FILE).unlink(missing_ok=True)
