"""Void alignment: a note on disk that the alignment in force must not be used, and why.

It names the alignment that it means by the moment that was made: a later one is good whether the note could be removed
or not.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from daemon.platform.atomic_file import FOR_THE_GROUP, replace_whole
from daemon.platform.plain_file import read_small
from daemon.storage.calibration_records import MOST_BYTES, record_file

_FILE = "alignment.void.json"


@dataclass(frozen=True)
class Void:
    """Why the alignment is void, and which board lies in the nest now where somebody named it."""

    why: str
    board_id: str | None = None


def write_void(folder: Path, void: Void) -> None:
    """Write down that the alignment on disk is void, or that there is none; OSError if that is impossible."""
    text = json.dumps({"made_at": made_at(folder), "why": void.why, "board_id": void.board_id})
    replace_whole(folder / _FILE, lambda path: path.write_text(text, encoding="utf-8"), FOR_THE_GROUP)


def read_void(folder: Path) -> Void | None:
    """Return why the alignment on disk, or that there is none, is void; None if it is not."""
    try:
        note = json.loads(read_small(folder / _FILE))
        # Notes of versions before know no `board_id`, and named no moment where the alignment was void already.
        means_any = note["made_at"] == "" and "board_id" not in note
        if not means_any and note["made_at"] != made_at(folder):
            return None
        board_id = note.get("board_id")
        return Void(str(note["why"]), None if board_id is None else str(board_id))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return Void("whether it is void cannot be read")


def made_at(folder: Path) -> str:
    """Return when the alignment on disk was made, whether it is in force or not; "" if that cannot be said.

    What is void twice is not in force at the second time; it must be void after a start all the same.
    """
    try:
        return str(json.loads(read_small(record_file(folder, "alignment"), MOST_BYTES))["made_at"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return ""


def forget(folder: Path) -> None:
    """Remove the note: another alignment has passed. OSError if it cannot be removed."""
    (folder / _FILE).unlink(missing_ok=True)
