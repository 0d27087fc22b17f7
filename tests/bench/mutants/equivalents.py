"""Mutants that change no behaviour, so that no test can catch them: each named with its reason, none by pattern."""

from __future__ import annotations

from dataclasses import dataclass

from tests.bench.mutants.operators import Mutant


@dataclass(frozen=True, slots=True)
class Equivalent:
    """A change of one line of a file, both without indent, and why nothing comes of it."""

    path: str
    line: str
    becomes: str
    reason: str


EQUIVALENTS: tuple[Equivalent, ...] = (
    Equivalent(
        "daemon/jobs/watchdog.py",
        "self._shown_at_s = 0.0",
        "self._shown_at_s = 1.0",
        "read only while a job is watched, and `begin` sets it when that begins",
    ),
)


def is_equivalent(path: str, text: str, mutant: Mutant, known: tuple[Equivalent, ...] | None = None) -> bool:
    """Tell whether a mutant of a file's text is listed, or is in `known`, as one that changes nothing."""
    line, becomes = (t.splitlines()[mutant.line - 1].strip() for t in (text, mutant.apply(text)))
    return any(
        (one.path, one.line, one.becomes) == (path, line, becomes) for one in (EQUIVALENTS if known is None else known)
    )
