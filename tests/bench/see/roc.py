"""Choose the thresholds of a look beside parts by frames of the bench: what each pair lets pass, right and elsewhere.

    python -m tests.bench.see.roc FILE.jsonl ... [--train board,...]

FILE: lines of `tests.bench.see --json` or `tests.bench.see.seats --json`. Thresholds are chosen on the boards named by
--train, by no place elsewhere first, by most right ones second, and proved on all other boards.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from vision.registration.edges import LEAST_CONFIRMED, LEAST_NEAR, LEAST_SOLDERED
from vision.registration.register import (
    LEAST_AGREEMENT,
    LEAST_ALONE,
    LEAST_METAL,
    LEAST_METAL_BESIDE_PARTS,
    LEAST_ODDS,
    SURE_AGREEMENT,
    SURE_EDGES,
)

METAL = (0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.91)
SOLDERED = (0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.8)
AGREEMENT = (0.6, 0.65, 0.7, 0.75, 0.8, 0.85)
NOW = (LEAST_ALONE, LEAST_METAL_BESIDE_PARTS, LEAST_SOLDERED)


@dataclass(frozen=True)
class Look:
    """A look for the board alone; right: at the right place."""

    board: str
    right: bool
    agreement: float
    metal: float
    confirmed: float
    cells: int
    soldered: bool
    assembled: bool
    log_odds: float

    def passes(self, least: float, metal: float, soldered: float) -> bool:
        """Whether the decision lets it pass with these thresholds beside parts."""
        sure = self.metal >= LEAST_METAL and self.confirmed >= SURE_EDGES
        if self.log_odds < LEAST_ODDS or self.agreement < (LEAST_AGREEMENT if sure else least):
            return False
        if self.cells < LEAST_NEAR:
            return False
        least_metal = metal if self.assembled else LEAST_METAL
        if self.agreement < SURE_AGREEMENT and self.metal < least_metal:
            return False
        return self.confirmed >= (soldered if self.soldered else LEAST_CONFIRMED)


def looks_of(row: dict[str, Any]) -> list[Look]:
    """Return the looks of a line, of a seat or of a frame."""
    if "looks" in row:
        return [Look(row["board"], k["right"], k["agreement"], k["metal"], k["confirmed"], k["cells"], k["soldered"],
                     k["assembled"], k["log_odds"]) for k in row["looks"] if "agreement" in k]  # fmt: skip
    if "agreement" not in row or row["at_target"]:
        return []
    right = row["has_answer"] and row["off_um"] < 100.0
    return [Look(row["board"], right, row["agreement"], row["metal_seen"], row["near"][0], row["near"][2],
                 row["soldered"], row["assembled"], row["log_odds"])]  # fmt: skip


def print_roc(name: str, looks: list[Look]) -> None:
    """Print right / elsewhere that pass, as each threshold goes through its range and the others stay as they are."""
    right, other = [k for k in looks if k.right], [k for k in looks if not k.right]
    decided = sum(k.log_odds >= LEAST_ODDS for k in other)
    print(f"{name}: {len(right)} looks at the right place, {len(other)} elsewhere, {decided} of them decided by odds")
    for n, (what, values) in enumerate((("agreement", AGREEMENT), ("metal", METAL), ("soldered", SOLDERED))):
        told = []
        for value in values:
            limits = [value if k == n else NOW[k] for k in range(3)]
            told.append(
                f"{value:.2f}: {sum(k.passes(*limits) for k in right)} / {sum(k.passes(*limits) for k in other)}"
            )
        print(f"  {what:10} " + ", ".join(told))


def chosen(looks: list[Look]) -> tuple[float, float, float]:
    """Return the thresholds with fewest places elsewhere, then most right ones, then the strictest."""

    def cost(limits: tuple[float, float, float]) -> tuple[int, int, float]:
        wrong = sum(not k.right and k.passes(*limits) for k in looks)
        return wrong, -sum(k.right and k.passes(*limits) for k in looks), -sum(limits)

    return min(product(AGREEMENT, METAL, SOLDERED), key=cost)


def told(looks: list[Look], limits: tuple[float, float, float]) -> str:
    """Return what limits let pass, in words."""
    right, wrong = (sum(k.passes(*limits) for k in looks if k.right is r) for r in (True, False))
    return f"right {right} of {sum(k.right for k in looks)}, elsewhere {wrong} of {sum(not k.right for k in looks)}"


def main(argv: list[str] | None = None) -> int:
    """Print the curves, the choice, and its proof."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.see.roc", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--train", default="cloud-dripper,F1Tenth-powerboard,pico-ice-rev1")
    asked = parser.parse_args(argv)
    looks = [
        look for file in asked.files for line in file.read_text().splitlines() for look in looks_of(json.loads(line))
    ]
    train = [look for look in looks if look.board in asked.train.split(",")]
    test = [look for look in looks if look.board not in asked.train.split(",")]
    print_roc("train", train)
    print_roc("test", test)
    best = chosen(train)
    for name, limits in (("chosen on train", best), ("as it is", NOW)):
        print(f"{name} (agreement, metal, soldered) {limits}: train {told(train, limits)}; test {told(test, limits)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
