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
    Equivalent(
        "vision/geometry/board_alignment.py",
        "turn = (pose.theta_deg - nominal.theta_deg + 180.0) % 360.0 - 180.0",
        "turn = (pose.theta_deg - nominal.theta_deg - 180.0) % 360.0 - 180.0",
        "half a turn more or less is the same modulo a whole one",
    ),
    Equivalent(
        "vision/geometry/board_alignment.py",
        "yield from (order for order in permutations(range(n)) if order != tuple(range(n)))",
        "yield from (order for order in permutations(range(n)) if True)",
        "orders are tried only where the given one has been found not to fit; asked again it fits no better",
    ),
)


def is_equivalent(path: str, text: str, mutant: Mutant, known: tuple[Equivalent, ...] | None = None) -> bool:
    """Tell whether a mutant of a file's text is listed, or is in `known`, as one that changes nothing."""
    line, becomes = (t.splitlines()[mutant.line - 1].strip() for t in (text, mutant.apply(text)))
    return any(
        (one.path, one.line, one.becomes) == (path, line, becomes) for one in (EQUIVALENTS if known is None else known)
    )
