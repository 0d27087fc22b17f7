"""Make random places and corrections over three boards with parts, and count what the plant says was hit.

    python -m tests.bench.clearance [--places N] [--seed N] [--board NAME ...] [--wire [--no-seat]]

The gantry's own planner and the daemon's own clearance answer for the ways; the plant, which reads the parts of the
boards for itself, is driven along them. Ends with 1 where anything was hit.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import sys
import tempfile
from pathlib import Path

from daemon.config.sections.motion import ClearanceSection
from daemon.tools.board_import import Options, import_board
from sim_hw.board.board import load_board
from tests.bench.clearance import wire
from tests.bench.clearance.campaign import FIGURES, Case, Tally, run
from tests.bench.see.boards import folder_of, known_boards

BOARDS = ("demo", "glasgow-revC3", "pico-ice-rev1")
HEIGHTS_UM = {"R": 700.0, "FB": 700.0, "C": 1350.0, "L": 1350.0, "D": 1350.0, "LED": 1350.0, "U": 1850.0, "Q": 1850.0}
"""As a person would measure them on the simulated station's boards, at most; of all others nothing is told."""
HIGH_UM, LOW_UM = 15_000.0, 2_000.0
"""How high the head hangs above the needle's end: out of every part's way, and in that of the tallest."""
BOX_UM = (-9_100.0, -6_100.0, 7_100.0, 6_100.0)


def cases(names: list[str], seed: int) -> list[Case]:
    """Read the boards, once as the plant does and once as the daemon does."""
    found = []
    for name in names:
        folder = folder_of(name)
        real, told = load_board(folder, "top", parts_seed=seed), import_board(folder, "top", Options())
        for head_from_um in (HIGH_UM, LOW_UM):
            section = ClearanceSection(**FIGURES, head_from_um=head_from_um, head_box_um=BOX_UM, heights_um=HEIGHTS_UM)
            found.append(Case(name, real, told, section, head_from_um))
    return found


def row(case: Case, tally: Tally) -> str:
    """Return one line of the table."""
    spans = []
    for what in ("place", "correct"):
        rises = tally.rises_um[what]
        lower = sum(rise < 6_999.0 for rise in rises) / max(1, len(rises))
        spans.append(f"{statistics.median(rises):.0f} | {100 * lower:.0f} %" if rises else "- | -")
    parts = ", ".join(sorted({f"{hit.by} in {hit.part}" for hit in tally.hits})) or "none"
    counts = f"{tally.places} | {tally.corrections} | {tally.left_out} | {len(tally.hits)} ({parts})"
    return f"| {case.name} | {case.head_from_um / 1e3:g} | {counts} | {' | '.join(spans)} |"


def say(text: str) -> None:
    """Tell how far it is."""
    sys.stderr.write(f"{text}\n")


def on_the_wire(name: str, places: int, seed: int, *, seat: bool) -> int:
    """Make the places with a daemon, and print what came of them."""
    with tempfile.TemporaryDirectory() as out:
        found = wire.run(Path(out), folder_of(name), HEIGHTS_UM, places, seed, say, seat=seat)
    for outcome, count in sorted(found.outcomes.items()):
        print(f"{outcome}: {count}")
    print(f"hits: {len(found.hits)}")
    for hit in found.hits:
        print(hit)
    return 1 if found.hits else 0


def main() -> int:
    """Read the arguments, run, and print the table."""
    options = argparse.ArgumentParser(prog="python -m tests.bench.clearance")
    options.add_argument("--places", type=int, default=10_000, help="in all")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--board", action="append", choices=known_boards(), help="instead of the three")
    options.add_argument("--wire", action="store_true", help="daemon and simulated station, on the first board alone")
    options.add_argument("--no-seat", action="store_true", help="on the wire: head and seat stay uncalibrated")
    chosen = options.parse_args()
    names = chosen.board or [name for name in BOARDS if name in known_boards()]
    if chosen.wire:
        return on_the_wire(names[0], chosen.places, chosen.seed, seat=not chosen.no_seat)
    made = cases(names, chosen.seed)
    share = max(1, chosen.places // len(made))
    print("| board | head, mm | places | corrections | left out | hits | place across at, um | below safe |"
          " correction across at, um | below safe |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    hits = 0
    for case in made:
        with tempfile.TemporaryDirectory() as folder:
            what = f"{case.name}, head at {case.head_from_um / 1e3:g} mm"

            def tell(so_far: Tally, what: str = what) -> None:
                counts = f"{so_far.corrections} corrections, {len(so_far.hits)} hits"
                say(f"{what}: {so_far.places} of {share} places, {counts}")

            tally = asyncio.run(run(case, share, chosen.seed, Path(folder), tell))
        hits += len(tally.hits)
        print(row(case, tally), flush=True)
    return 1 if hits else 0


if __name__ == "__main__":
    sys.exit(main())
