"""The seeded choice of mutants: as many of each file, and of each operator within it, as there are."""

from __future__ import annotations

import random
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

from tests.bench.mutants.core_files import CoreFile
from tests.bench.mutants.equivalents import is_equivalent
from tests.bench.mutants.operators import Mutant, mutants


def candidates(root: Path, core: CoreFile) -> list[Mutant]:
    """List a file's mutants but for those known to change nothing."""
    text = (root / core.path).read_text()
    return [m for m in mutants(text) if not is_equivalent(core.path, text, m)]


def shuffled(found: Sequence[Mutant], seed: str) -> list[Mutant]:
    """Order mutants by chance, one of each operator in turn."""
    rng = random.Random(seed)
    rows = [[m for m in found if m.operator == name] for name in sorted({m.operator for m in found})]
    for row in rows:
        rng.shuffle(row)
    rng.shuffle(rows)
    return [m for turn in zip_longest(*rows) for m in turn if m is not None]


def sample(root: Path, files: Sequence[CoreFile], count: int, seed: int) -> list[tuple[CoreFile, Mutant]]:
    """Choose `count` mutants, one of each file in turn until there are enough; in the order of files and lines."""
    rows = [[(core, m) for m in shuffled(candidates(root, core), f"{seed}:{core.path}")] for core in files]
    random.Random(seed).shuffle(rows)
    taken = [one for turn in zip_longest(*rows) for one in turn if one is not None][:count]
    place = {core.path: number for number, core in enumerate(files)}
    return sorted(taken, key=lambda one: (place[one[0].path], one[1].start, one[1].end, one[1].new))
