"""Measure registration on frames of the simulated station's artist: what is right, wrong, refused; how well, how fast.

    python -m tests.bench.see [--boards demo,...] [--kinds near,displaced,...|all] [--count N] [--seed S]
                              [--workers N] [--json FILE] [--no-peers]

One JSON line a frame (to standard output, or FILE), and the tables at the end. A wrong answer is a result: exit 0.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Self

# Before NumPy loads: process time should be the time of one thread.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(_variable, "1")

from tests.bench.see import boards, frames, kinds, table  # noqa: E402 -- after the threads are limited


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """Read the command line; a wrong name is a usage error."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.see", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--boards", default="demo", help=f"of {', '.join(boards.known_boards())}; `all`; default demo")
    parser.add_argument("--kinds", default=",".join(kinds.USUAL), help=f"of {', '.join(kinds.KINDS)}; or `all`")
    parser.add_argument("--count", type=int, default=10, help="frames a kind and side (default 10)")
    parser.add_argument("--seed", type=int, default=1, help="first seed; the others follow on")
    parser.add_argument("--workers", type=int, default=1, help="processes; times are fair with 1")
    parser.add_argument("--json", type=Path, help="file for the lines instead of standard output")
    parser.add_argument("--no-peers", action="store_true", help="leave TDEA, Hough and OpenCV's matchers out")
    asked = parser.parse_args(argv)
    asked.boards = _names(parser, asked.boards, boards.known_boards(), "board")
    asked.kinds = _names(parser, asked.kinds, list(kinds.KINDS), "kind")
    if asked.count < 1 or asked.workers < 1:
        parser.error("--count and --workers are at least 1")
    return asked


def _names(parser: argparse.ArgumentParser, text: str, known: list[str], what: str) -> list[str]:
    wanted = known if text == "all" else [name.strip() for name in text.split(",") if name.strip()]
    for name in wanted:
        if name not in known:
            parser.error(f"no {what} {name!r} here; there are {', '.join(known)}")
    return wanted


def listed(asked: argparse.Namespace) -> list[frames.Asked]:
    """Return every frame to be made, side by side of each board."""
    known = boards.known_boards()
    frames_asked = []
    for board in asked.boards:
        others = [name for name in known if name != board]
        for side in ("top", "bottom"):
            for kind in asked.kinds:
                for k in range(asked.count):
                    if kinds.KINDS[kind].frames_of == "foreign" and not others:
                        continue
                    foreign = others[k % len(others)] if others else ""
                    peers = not asked.no_peers and kinds.KINDS[kind].right
                    frames_asked.append(frames.Asked(board, side, kind, asked.seed + k, foreign, peers, explained=True))
    return frames_asked


def main(argv: list[str] | None = None) -> int:
    """Make the frames, write a line for each, print the tables."""
    asked = arguments(argv)
    rows: list[dict[str, Any]] = []
    out = asked.json.open("w") if asked.json else sys.stdout
    wanted = listed(asked)
    with get_context("spawn").Pool(asked.workers) if asked.workers > 1 else _Alone() as pool:
        for row in pool.imap(frames.make, wanted, 8):
            if row is not None:
                rows.append(row)
                print(json.dumps(row), file=out, flush=True)
    if asked.json:
        out.close()
    table.print_all(rows)
    return 0


class _Alone:
    """A pool of nobody else."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def imap(self, work: Any, items: list[frames.Asked], _chunk: int) -> Any:
        return map(work, items)


if __name__ == "__main__":
    sys.exit(main())
