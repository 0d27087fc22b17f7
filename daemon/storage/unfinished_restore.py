"""Unfinished restore: a note in the data folder that putting a backup back has begun there and has not ended.

As long as it lies there, what is beside it is half of one time and half of another, and no daemon starts with it.
"""

from __future__ import annotations

import json
from pathlib import Path

from daemon.platform.atomic_file import flush_folder, replace_whole

_NOTE = "restore-unfinished.json"


class HalfRestoredError(Exception):
    """A restore was interrupted; `advice` says how it is ended."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


def begin(data_dir: Path, archive: Path) -> None:
    """Write down that this archive is being put back; OSError."""
    text = json.dumps({"archive": str(archive.absolute())})
    replace_whole(data_dir / _NOTE, lambda path: path.write_text(text, encoding="utf-8"))


def end(data_dir: Path) -> None:
    """Write down that it is there whole; OSError."""
    (data_dir / _NOTE).unlink()
    flush_folder(data_dir)


def require_whole(data_dir: Path) -> None:
    """Raise `HalfRestoredError` if a restore into this folder was begun and not ended."""
    note = data_dir / _NOTE
    if not note.exists():
        return
    try:
        archive = str(json.loads(note.read_text(encoding="utf-8"))["archive"])
    except (OSError, ValueError, KeyError, TypeError):
        archive = "BACKUP"
    raise HalfRestoredError(
        f"a restore into {data_dir} was interrupted: what lies there is half old, half new",
        f"run `reprobe restore {archive}` once more; what was there before is in {data_dir}/before-restore-*",
    )
