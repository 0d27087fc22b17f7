"""Measure the seat: looks at places that are found once, of boards that lie right, elsewhere, turned, other side up.

    python -m tests.bench.see.seats [--boards cloud-dripper,...|all] [--lies near,turned,...] [--count N] [--seed S]
                                    [--bare] [--json FILE]

One JSON line a seat, with every look's numbers, and the tables at the end. The looks are taken as an alignment takes
them: place by place, a few may fail, three must agree with each other and with the nest. `two looks` is what the first
two that are accepted would have said alone. A wrong seat is a result: exit 0.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import Any

# Before NumPy loads: the time of one thread.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(_variable, "1")

import cv2  # noqa: E402 -- after the threads are limited
import numpy as np  # noqa: E402
from scipy.stats import beta  # noqa: E402

from daemon.procedures.seat import LEAST_PLACES, LEAST_UNIQUE, MOST_PLACES, MOST_TRIES  # noqa: E402
from tests.bench.see import boards, frames, kinds  # noqa: E402
from tests.bench.see.artist import Lie, Shot, Trouble  # noqa: E402
from vision.registration import (  # noqa: E402
    UNIQUE_SCORE,
    NotRegistered,
    Registration,
    Target,
    UniquePlace,
    prepare,
    register,
    unique_places,
)

MOST_PLACEMENT_UM, AGREE_UM, AGREE_TURN_DEG, WRONG_UM = 700.0, 100.0, 1.0, 100.0
"""How far off its nominal place a board is believed; how well looks have to agree; what is farther off is wrong."""
OFFERED = 8


@dataclass(frozen=True)
class Way:
    """How a seat may be wrong: where the board lies, and which is drawn: `own`, `other` (side up), `foreign`."""

    lie: Callable[[boards.Side, Target | None, np.random.Generator], Lie | None]
    drawn: str = "own"
    right: bool = True


def _off(most_um: float) -> Callable[[boards.Side, Target | None, np.random.Generator], Lie]:
    def lie(_side: boards.Side, _target: Target | None, rng: np.random.Generator) -> Lie:
        x_um, y_um = rng.uniform(-most_um, most_um, 2)
        return Lie(float(x_um), float(y_um), turn_deg=float(rng.normal(0.0, 0.15)))

    return lie


def _displaced(side: boards.Side, target: Target | None, rng: np.random.Generator) -> Lie | None:
    return None if target is None else kinds.KINDS["displaced_5mm"].lie(side, target, rng)


def _turned(side: boards.Side, target: Target | None, rng: np.random.Generator) -> Lie:
    near = _off(400.0)(side, target, rng)
    return Lie(near.x_um, near.y_um, near.turn_deg, quarters=int(rng.choice([1, 2, 2, 3])))


def _other(side: boards.Side, target: Target | None, rng: np.random.Generator) -> Lie:
    near = _off(400.0)(side, target, rng)
    return Lie(near.x_um, near.y_um, near.turn_deg, quarters=int(rng.choice([0, 0, 2])))


WAYS = {
    "near": Way(_off(450.0)),
    "displaced": Way(_displaced),
    "turned": Way(_turned, right=False),
    "other side": Way(_other, "other", right=False),
    "foreign": Way(_off(400.0), "foreign", right=False),
}


@lru_cache(maxsize=2)
def _places(board: str, side: str, *, fitted: bool) -> tuple[UniquePlace, ...]:
    """Return what the import offers of a side, in the order in which an alignment looks at it."""
    here, other = (frames.index_of(board, name, fitted=fitted) for name in (side, frames.other_of(side)))
    rest = [p for p in unique_places(here, other, count=OFFERED) if p.rival_score <= UNIQUE_SCORE]
    order = [rest.pop(0)] if rest else []
    while rest:
        far = max(rest, key=lambda p: min(math.hypot(p.x_um - q.x_um, p.y_um - q.y_um) for q in order))
        order.append(far)
        rest.remove(far)
    return tuple(order)


def sit(board: str, side: str, name: str, seed: int, *, fitted: bool) -> dict[str, Any] | None:
    """Return what came of one seat; None where the board has no such lie, or too few places."""
    way, places = WAYS[name], _places(board, side, fitted=fitted)
    rng = np.random.default_rng([seed, sum(map(ord, board + side + name))])
    own = (boards.load_fitted if fitted else boards.load_side)(board, side)
    target = own.targets[int(rng.integers(len(own.targets)))] if own.targets else None
    lie = way.lie(own, target, rng)
    others = [one for one in boards.known_boards() if one not in {board, "demo"}]
    foreign = others[boards.known_boards().index(board) % len(others)]
    drawn = {"own": (board, side), "other": (board, frames.other_of(side)),
             "foreign": (foreign, side)}[way.drawn]  # fmt: skip
    if lie is None or len(places) < LEAST_PLACES:
        return None
    trouble = Trouble(flux=12) if fitted else Trouble()
    looks: list[dict[str, Any]] = []
    for place in places:
        at = (place.x_um, place.y_um)
        shot = frames.artist_of(*drawn, fitted=fitted).shoot(at, lie, trouble, rng)
        found = register(prepare(frames.index_of(board, side, fitted=fitted), at), shot.frame, shot.assumed, None,
                         [shot.needle_px])  # fmt: skip
        looks.append(_numbers(found, shot, place, right=way.right))
        taken = sum(look["accepted"] for look in looks)
        if taken == MOST_PLACES or len(looks) - taken > MOST_TRIES:
            break
    row: dict[str, Any] = {"board": board, "side": side, "lies": name, "seed": seed, "drawn": list(drawn),
                           "quarters": lie.quarters, "lie_um": [round(lie.x_um), round(lie.y_um)]}  # fmt: skip
    two = [look for look in looks if look["accepted"]][:LEAST_UNIQUE]
    row |= {"seat": judged(looks, LEAST_PLACES), "two looks": judged(two, LEAST_UNIQUE), "looks": looks}
    return row


def _numbers(found: Registration | NotRegistered, shot: Shot, place: UniquePlace, *, right: bool) -> dict[str, Any]:
    best = found if isinstance(found, Registration) else found.best
    row = {"accepted": best is found, "reason": getattr(found, "reason", ""), "rival": round(place.rival_score, 3),
           "at_um": [round(place.x_um), round(place.y_um)]}  # fmt: skip
    if best is None:
        return row
    truth = cv2.perspectiveTransform(np.array([[shot.truth_px(place.x_um, place.y_um)]]), np.linalg.inv(shot.assumed))[
        0, 0
    ]
    off_um = float(np.hypot(*(np.asarray(best.target_um) - truth)))
    return row | {
        "right": right and off_um < WRONG_UM, "off_um": round(off_um, 1), "assembled": best.assembled,
        "soldered": best.near.soldered, "agreement": round(best.agreement, 3), "metal": round(best.metal_seen, 3),
        "confirmed": round(best.near.confirmed, 3), "cells": best.near.cells, "log_odds": round(best.log_odds, 1),
        "shift_um": [round(v, 1) for v in best.shift_um], "turn_deg": round(best.turn_deg, 3),
    }  # fmt: skip


def judged(looks: list[dict[str, Any]], least: int) -> str:
    """Say `right`, `wrong` or `refused`, as an alignment by these looks would."""
    taken = [look for look in looks if look["accepted"]]
    if len(taken) < least or not _agree(taken):
        return "refused"
    return "right" if all(look["right"] for look in taken) else "wrong"


def _agree(taken: list[dict[str, Any]]) -> bool:
    """Whether looks put the board at one place, near where it should be, turned alike."""
    near = all(math.hypot(*look["shift_um"]) <= MOST_PLACEMENT_UM for look in taken)
    return near and all(_together(one, other) for one, other in combinations(taken, 2))


def _together(one: dict[str, Any], other: dict[str, Any]) -> bool:
    turn = math.radians((one["turn_deg"] + other["turn_deg"]) / 2)
    x_um, y_um = np.subtract(other["at_um"], one["at_um"])
    turned = np.array((-turn * y_um, turn * x_um))
    apart = np.subtract(other["shift_um"], one["shift_um"]) - turned
    # What the looks' turns leave open grows with the distance.
    least = AGREE_UM + math.radians(0.15) * math.hypot(x_um, y_um)
    return bool(np.hypot(*apart) <= least and abs(one["turn_deg"] - other["turn_deg"]) <= AGREE_TURN_DEG)


def bound(wrong: int, count: int) -> float:
    """Return the exact upper bound (Clopper and Pearson, 95 % one-sided) of a share."""
    return float(beta.ppf(0.95, wrong + 1, count - wrong)) if count > wrong else 1.0


def print_table(rows: list[dict[str, Any]]) -> None:
    """Print verdicts by lie, of the seat and of two looks alone, with the bound of what may be wrong."""
    print("right / wrong / refused, and below what share wrong ones are for sure (95 %)")
    print(f"{'lies':18} {'seats':>6}   {'seat':32} {'two looks alone':32} looks taken")
    for name in [*WAYS, "any that is wrong"]:
        group = [r for r in rows if r["lies"] == name or (name not in WAYS and not WAYS[r["lies"]].right)]
        if not group:
            continue
        told = []
        for what in ("seat", "two looks"):
            right, wrong, refused = (sum(r[what] == v for r in group) for v in ("right", "wrong", "refused"))
            told.append(f"{right} / {wrong} / {refused}, {100 * bound(wrong, len(group)):.2f} %")
        looks = [look["accepted"] for r in group for look in r["looks"]]
        print(f"{name:18} {len(group):6}   {told[0]:32} {told[1]:32} {sum(looks)} of {len(looks)}")


def _asked(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.see.seats", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--boards", default="all")
    parser.add_argument("--sides", default="top,bottom")
    parser.add_argument("--lies", default=",".join(WAYS))
    parser.add_argument("--count", type=int, default=4, help="seats a lie and side (default 4)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bare", action="store_true", help="without parts")
    parser.add_argument("--json", type=Path, help="file for the lines instead of standard output")
    return parser.parse_args(argv)


def _seats(asked: argparse.Namespace) -> Iterator[dict[str, Any]]:
    for board in boards.known_boards() if asked.boards == "all" else asked.boards.split(","):
        for side in asked.sides.split(","):
            for name in asked.lies.split(","):
                rows = (sit(board, side, name, asked.seed + k, fitted=not asked.bare) for k in range(asked.count))
                yield from (row for row in rows if row is not None)


def main(argv: list[str] | None = None) -> int:
    """Sit the boards down, write a line for each seat, print the table."""
    asked = _asked(argv)
    rows = []
    out = asked.json.open("w") if asked.json else sys.stdout
    for row in _seats(asked):
        rows.append(row)
        print(json.dumps(row), file=out, flush=True)
    if asked.json:
        out.close()
    print_table(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
