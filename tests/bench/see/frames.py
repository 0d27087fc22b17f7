"""One frame of the bench: drawn, registered, judged by the truth; times of all that is compared in the same run."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from tests.bench.see import parts, peers
from tests.bench.see.artist import Artist, Lie, Shot
from tests.bench.see.boards import Side, load_fitted, load_side
from tests.bench.see.kinds import KINDS, Kind
from vision.registration import (
    IndexedSide,
    LayerFit,
    LayerShifts,
    NotRegistered,
    Registration,
    Target,
    UniquePlace,
    Whole,
    draw_whole,
    explain,
    fit_layers,
    follow,
    index_side,
    median_shifts,
    place_known,
    prepare,
    register,
    unique_places,
)

WRONG_UM = 100.0
SEAT_LOOKS, SEAT_TRIES = 5, 20
SEED = 5


@dataclass(frozen=True)
class Asked:
    """A frame to be made: everything else follows from it."""

    board: str
    side: str
    kind: str
    seed: int
    foreign: str
    peers: bool = False
    explained: bool = False


def other_of(side: str) -> str:
    """Return the other side's name."""
    return "bottom" if side == "top" else "top"


@lru_cache(maxsize=6)
def index_of(board: str, side: str, *, parts_known: bool = False, fitted: bool = False) -> IndexedSide:
    if fitted:
        return index_side(load_fitted(board, side).layers)
    loaded = load_side(board, side)
    boxes = parts.bodies(loaded, SEED)
    return index_side(parts.with_parts(loaded, boxes) if parts_known else loaded.layers)


@lru_cache(maxsize=4)
def _whole(board: str, side: str, *, fitted: bool = False) -> Whole:
    return draw_whole(index_of(board, side, parts_known=False, fitted=fitted))


@lru_cache(maxsize=4)
def artist_of(board: str, side: str, *, fitted: bool = False) -> Artist:
    if fitted:
        return Artist(load_fitted(board, side).drawn, SEED)
    loaded = load_side(board, side)
    boxes = parts.bodies(loaded, SEED)
    return Artist(loaded.drawn, SEED, bodies_um=(*parts.solder(loaded, boxes), *boxes))


@lru_cache(maxsize=16)
def _seated(board: str, side_name: str, kind_name: str) -> LayerShifts:
    """Return the layers' shifts as a seat measures them before the job: the median of a few accepted looks."""
    kind = KINDS[kind_name]
    if not kind.seated:
        return LayerShifts()
    side, indexed = load_side(board, side_name), index_of(board, side_name, parts_known=False)
    rng = np.random.default_rng([SEED, 8])
    fits = []
    for _ in range(SEAT_TRIES):
        target = side.targets[int(rng.integers(len(side.targets)))]
        at = (target.x_um, target.y_um)
        shot = artist_of(board, side_name).shoot(at, Lie(), kind.trouble, rng)
        found = place_known(register(prepare(indexed, at), shot.frame, shot.assumed, target, [shot.needle_px]))
        if found is not None:
            fit = fit_layers(indexed, at, shot.frame, shot.assumed, found, [shot.needle_px])
            fits += [fit] if isinstance(fit, LayerFit) else []
        if len(fits) == SEAT_LOOKS:
            break
    return median_shifts(fits)


def make(asked: Asked) -> dict[str, Any] | None:
    """Return what came of one frame; None where the board has no such place."""
    kind = KINDS[asked.kind]
    side = load_side(asked.board, asked.side)
    if kind.fitted and not kind.alone:
        side = load_fitted(asked.board, asked.side)
    rng = np.random.default_rng([asked.seed, sum(map(ord, asked.kind + asked.board + asked.side))])
    target = _unique(asked) if kind.at_unique else _target(side, kind, rng)
    lie = kind.lie(side, target, rng) if target is not None else None
    if target is None or lie is None:
        return None
    drawn = {"own": (asked.board, asked.side), "other": (asked.board, other_of(asked.side)),
             "foreign": (asked.foreign, asked.side)}[kind.frames_of]  # fmt: skip
    shot = artist_of(*drawn, fitted=kind.fitted).shoot((target.x_um, target.y_um), lie, kind.trouble, rng)
    indexed = index_of(asked.board, asked.side, parts_known=kind.trouble.parts and kind.known_parts, fitted=kind.fitted)
    row: dict[str, Any] = {"board": asked.board, "side": asked.side, "kind": asked.kind, "seed": asked.seed,
                           "target_um": [round(target.x_um), round(target.y_um)],
                           "size_um": [round(float(v)) for v in np.ptp(target.outline_um, axis=0)],
                           "lie_um": [round(lie.x_um), round(lie.y_um)], "quarters": lie.quarters,
                           "has_answer": kind.right}  # fmt: skip
    _seated(asked.board, asked.side, asked.kind)
    start = time.process_time()
    reference = prepare(indexed, (target.x_um, target.y_um), _seated(asked.board, asked.side, asked.kind))
    row["prepare_ms"] = 1e3 * (time.process_time() - start)
    start = time.process_time()
    wanted = None if kind.at_unique or kind.alone else target
    found = register(reference, shot.frame, shot.assumed, wanted, [shot.needle_px])
    row["register_ms"] = 1e3 * (time.process_time() - start)
    row |= judged(found, shot, target, right=kind.right)
    if isinstance(found, Registration):
        start = time.process_time()
        again = follow(reference, shot.frame, shot.assumed, wanted, found, [shot.needle_px])
        row["follow_ms"] = 1e3 * (time.process_time() - start)
        row["followed"] = bool(again)
    elif asked.explained:
        start = time.process_time()
        here, other = (_whole(asked.board, name, fitted=kind.fitted) for name in (asked.side, other_of(asked.side)))
        named = explain(found, shot.frame, shot.assumed, (target.x_um, target.y_um), here, other, [shot.needle_px])
        row["explain_ms"] = 1e3 * (time.process_time() - start)
        row["named"] = named.reason.value
    if asked.peers:
        row |= peers.compare(side, target, shot, indexed)
    return row


@lru_cache(maxsize=8)
def _places(board: str, side: str, *, fitted: bool) -> tuple[UniquePlace, ...]:
    here, other = (index_of(board, name, parts_known=False, fitted=fitted) for name in (side, other_of(side)))
    return unique_places(here, other, count=4 if fitted else 2)


def _unique(asked: Asked) -> Target | None:
    """Return one of the two most unique places as if it were a target."""
    places = _places(asked.board, asked.side, fitted=KINDS[asked.kind].fitted)
    if not places:
        return None
    place = places[asked.seed % len(places)]
    around = np.array([[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]])
    return Target(place.x_um, place.y_um, around + np.array((place.x_um, place.y_um)))


def _target(side: Side, kind: Kind, rng: np.random.Generator) -> Target | None:
    free = side.targets
    if kind.trouble.parts:
        boxes = parts.bodies(side, SEED)
        free = tuple(t for t in free if not parts.touched(t, boxes, parts.TOE_UM + 50.0))
    return free[int(rng.integers(len(free)))] if free else None


def judged(found: Registration | NotRegistered, shot: Shot, target: Target, *, right: bool) -> dict[str, Any]:
    """Return verdict and numbers: `right`, `wrong`, `refused`."""
    best = found if isinstance(found, Registration) else found.best
    row: dict[str, Any] = {"reason": found.reason.value if isinstance(found, NotRegistered) else ""}
    if best is not None:
        truth = cv2.perspectiveTransform(
            np.array([[shot.truth_px(target.x_um, target.y_um)]]), np.linalg.inv(shot.assumed)
        )[0, 0]
        off = np.asarray(best.target_um) - truth
        off_px = np.asarray(best.target_px) - shot.truth_px(target.x_um, target.y_um)
        row |= {
            "off_um": round(float(np.hypot(*off)), 2),
            "off_px": round(float(np.hypot(*off_px)), 3),
            "sigma_um": round(best.sigma_um, 3),
            "mahalanobis2": round(float(off @ np.linalg.solve(best.covariance_um2, off)), 3),
            "agreement": round(best.agreement, 3),
            "metal_seen": round(best.metal_seen, 3),
            "assembled": best.assembled,
            "soldered": best.near.soldered,
            "near": [round(best.near.confirmed, 2), round(best.near.contradicted, 2), best.near.cells],
            "at_target": [] if best.at_target is None else [round(best.at_target.confirmed, 2),
                                                           round(best.at_target.contradicted, 2),
                                                           round(best.at_target.hidden, 2)],
            "log_odds": round(best.log_odds, 1),
            "rivals": len(best.rivals),
            "off_rest_um": round(float(np.hypot(*best.off_rest_um)), 2),
            "shift_um": [round(v) for v in best.shift_um],
        }  # fmt: skip
    if isinstance(found, NotRegistered):
        row["verdict"] = "refused"
    else:
        row["verdict"] = "right" if right and row["off_um"] < WRONG_UM else "wrong"
    return row
