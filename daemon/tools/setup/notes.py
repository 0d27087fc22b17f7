"""Notes of a set-up: what was answered and which steps are done, so that it goes on where it was interrupted."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from daemon.platform.atomic_file import replace_whole
from daemon.platform.plain_file import read_small


class _Content(BaseModel):
    model_config = ConfigDict(extra="forbid")
    answers: dict[str, str] = {}
    done: list[str] = []


class Notes:
    """One set-up's notes, beside its configuration; written with each change. Methods raise OSError."""

    def __init__(self, path: Path) -> None:
        """Read what is there; what cannot be read is begun anew."""
        self.path = path
        try:
            self._content = _Content.model_validate_json(read_small(path))
        except (OSError, ValidationError):
            self._content = _Content()

    @property
    def done(self) -> tuple[str, ...]:
        """Steps that are over."""
        return tuple(self._content.done)

    def answer(self, key: str) -> str | None:
        """Return what was answered before."""
        return self._content.answers.get(key)

    def note_answer(self, key: str, answer: str) -> None:
        """Keep an answer: it is the one offered the next time."""
        self._content.answers[key] = answer
        self._write()

    def note_done(self, step: str) -> None:
        """Keep that a step is over."""
        if step not in self._content.done:
            self._content.done.append(step)
        self._write()

    def forget(self) -> None:
        """Start over; the answers stay, to be offered."""
        self._content.done = []
        self._write()

    def _write(self) -> None:
        text = json.dumps(self._content.model_dump(), indent=1)
        replace_whole(self.path, lambda path: path.write_text(text, encoding="utf-8"))
