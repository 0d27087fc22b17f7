"""Notes of a set-up: what was answered and which steps are done, so that it goes on where it was interrupted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from daemon.platform.atomic_file import replace_whole
from daemon.platform.plain_file import read_small


class Notes:
    """One set-up's notes, beside its configuration; written with each change. Methods raise OSError."""

    def __init__(self, path: Path) -> None:
        """Read what is there; what cannot be read is as if it were not there, and `lost` says why.

        What another version of the program has noted beside stays, and is no reason to ask all again.
        """
        self.path = path
        self.lost: str | None = None
        try:
            self._content = _content(read_small(path))
        except FileNotFoundError:
            self._content = {}
        except (OSError, ValueError, RecursionError) as exc:
            self._content, self.lost = {}, (exc.strerror if isinstance(exc, OSError) else None) or str(exc)
        self._answers = {key: said for key, said in _of(self._content, "answers", {}).items() if isinstance(said, str)}
        self._done = [step for step in _of(self._content, "done", []) if isinstance(step, str)]

    @property
    def done(self) -> tuple[str, ...]:
        """Steps that are over."""
        return tuple(self._done)

    def answer(self, key: str) -> str | None:
        """Return what was answered before."""
        return self._answers.get(key)

    def note_answer(self, key: str, answer: str) -> None:
        """Keep an answer: it is the one offered the next time."""
        self._answers[key] = answer
        self._write()

    def note_done(self, step: str) -> None:
        """Keep that a step is over."""
        if step not in self._done:
            self._done.append(step)
        self._write()

    def forget(self) -> None:
        """Start over; the answers stay, to be offered."""
        self._done = []
        self._write()

    def _write(self) -> None:
        answers = _of(self._content, "answers", {}) | self._answers
        text = json.dumps(self._content | {"answers": answers, "done": self._done}, indent=1)
        replace_whole(self.path, lambda path: path.write_text(text, encoding="utf-8"))


def _content(written: bytes) -> dict[str, Any]:
    """Return what a file of notes has; ValueError if it is none."""
    content = json.loads(written)
    if not isinstance(content, dict):
        raise ValueError("it has no notes")  # noqa: TRY004  # the file's mistake, not the caller's
    return content


def _of(content: dict[str, Any], key: str, empty: Any) -> Any:
    """Return what is noted under a key, if it is of the kind that belongs there."""
    return found if isinstance(found := content.get(key), type(empty)) else empty
