"""What is printed of a run of mutants."""

from __future__ import annotations

from collections.abc import Sequence

from tests.bench.mutants.runner import Outcome


def share(outcomes: Sequence[Outcome]) -> float:
    """Return the share of mutants that were caught."""
    return sum(o.caught for o in outcomes) / len(outcomes)


def change(outcome: Outcome) -> str:
    """Say where a mutant is and what it changes, in one line."""
    mutant = outcome.mutant
    old, new = (" ".join(text.split()) or "(nothing)" for text in (mutant.old, mutant.new))
    return f"{outcome.core.path}:{mutant.line}: {old}  ->  {new}"


def table(outcomes: Sequence[Outcome]) -> str:
    """Draw caught and total of each file and of all, and below them each survivor."""
    paths = dict.fromkeys(o.core.path for o in outcomes)
    lines = [_row(path, [o for o in outcomes if o.core.path == path]) for path in paths]
    lines.append(_row("all", outcomes))
    survivors = [f"survived  {change(o)}" for o in outcomes if not o.caught]
    return "\n".join([*lines, *([""] if survivors else []), *survivors])


def _row(name: str, outcomes: Sequence[Outcome]) -> str:
    caught = sum(o.caught for o in outcomes)
    return f"{name:<50} {caught:>4} of {len(outcomes):>4} {share(outcomes):>6.1%}"
