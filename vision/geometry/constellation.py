"""Pad identification: which of the pads seen is the one meant, by what CAD says must be near.

The nearest pad is the thesis' choice (eq. 5.12), and its section 7.2 names the weakness: a placement error of half the
spacing picks the neighbour. The cure it proposes is done here: all round targets of the neighbourhood move together,
so one shift must explain every pad seen, and must not call for a pad where none is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.geometry.frames import Array


@dataclass(frozen=True)
class ConstellationMatch:
    """The pad that is meant: index into `seen_um`, the placement error it implies, and how many pads agree."""

    index: int
    shift_um: tuple[float, float]
    agreeing: int


@dataclass(frozen=True)
class NoMatch:
    """No pad, or more than one, could be the one meant. Falsy."""

    reason: str
    candidates: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        """Say that nothing was chosen."""
        return False


@dataclass(frozen=True)
class _Hypothesis:
    """One seen pad taken for the target: the shift that follows, and what speaks for and against it."""

    seen: int
    shift: Array
    agreeing: int
    unexplained: int
    missing: int

    @property
    def tenable(self) -> bool:
        """Whether nothing CAD calls for is missing, and any stray object is outweighed by pads that agree."""
        return self.missing == 0 and (self.unexplained == 0 or self.agreeing >= 2)


def match_target(
    seen_um: ArrayLike,
    cad_um: ArrayLike,
    *,
    max_shift_um: float,
    tolerance_um: float,
    reach_um: float,
    doubtful_um: ArrayLike = (),
    hidden: Callable[[Array], Sequence[bool]] = lambda places: [False] * len(places),
) -> ConstellationMatch | NoMatch:
    """Choose the seen pad that is CAD's target.

    `seen_um` (N, 2): pads seen, from the place below the tip. `cad_um` (M, 2): where CAD and the head's position put
    the round targets of that size nearby; row 0 is the target itself. Both robot frame, um. Taking the pad j for the
    target means a shift of all. Against it speaks each pad seen where CAD has none, and each CAD pad that should then
    lie within `reach_um` and is not seen, unless `hidden(places)` says that something stands in front of it.
    `doubtful_um` (K, 2) are objects of which nobody could say whether they are pads: each may be the target or another
    pad, but need not be one.
    The tenable shift with the fewest strays wins if it is alone; else the answer is `ambiguous`, `undecided` when the
    winner is doubtful itself, `contradicted` when no shift is tenable, or `none_near` when none is within
    `max_shift_um`. `candidates` count the doubtful after the seen.
    """
    seen = np.asarray(seen_um, dtype=float).reshape(-1, 2)
    cad = np.asarray(cad_um, dtype=float).reshape(-1, 2)
    objects = np.vstack([seen, np.asarray(doubtful_um, dtype=float).reshape(-1, 2)])
    certain = np.arange(len(objects)) < len(seen)
    every = (_judge(j, objects, certain, cad, tolerance_um, reach_um, hidden) for j in range(len(objects)))
    near = [h for h in every if np.linalg.norm(h.shift) <= max_shift_um]
    if not near:
        return NoMatch("none_near", tuple(range(len(objects))))
    tenable = [h for h in near if h.tenable]
    if not tenable:
        return NoMatch("contradicted", tuple(h.seen for h in near))
    best = min(tenable, key=lambda h: h.unexplained)
    ties = [h for h in tenable if h.unexplained == best.unexplained]
    if len(ties) > 1:
        return NoMatch("ambiguous", tuple(h.seen for h in ties))
    if not certain[best.seen]:
        return NoMatch("undecided", (best.seen,))
    return ConstellationMatch(best.seen, (float(best.shift[0]), float(best.shift[1])), best.agreeing)


def match_near(
    objects_um: ArrayLike, cad_um: ArrayLike, *, shift_um: tuple[float, float], trust_um: float
) -> int | None:
    """Return which object lies where the target is known to be, if it is alone there; else None.

    `objects_um` (N, 2) and `cad_um` (M, 2, row 0 the target) as for `match_target`; `shift_um` is the placement error
    known from elsewhere (a calibrated station's is small; a look later it is what the look before found), `trust_um`
    how well. Unlike `match_target` it asks for no agreement of the surroundings, so strays farther off do not matter;
    but within twice that distance CAD must have no other target of that size, or nothing is said.
    """
    objects = np.asarray(objects_um, dtype=float).reshape(-1, 2)
    cad = np.asarray(cad_um, dtype=float).reshape(-1, 2)
    if (np.linalg.norm(cad[1:] - cad[0], axis=1) <= 2.0 * trust_um).any():
        return None
    near = np.flatnonzero(np.linalg.norm(objects - cad[0] - np.asarray(shift_um), axis=1) <= trust_um)
    return int(near[0]) if len(near) == 1 else None


def _judge(
    j: int,
    objects: Array,
    certain: NDArray[np.bool_],
    cad: Array,
    tolerance_um: float,
    reach_um: float,
    hidden: Callable[[Array], Sequence[bool]],
) -> _Hypothesis:
    """Count what speaks for and against `objects[j]` being the target."""
    shift = objects[j] - cad[0]
    expected = cad + shift
    agrees = np.linalg.norm(objects[:, None] - expected[None, :], axis=2) <= tolerance_um
    explained = agrees.any(axis=1)
    wanted = (np.linalg.norm(expected, axis=1) <= reach_um) & ~agrees.any(axis=0)
    missing = expected[wanted]
    return _Hypothesis(
        seen=j,
        shift=shift,
        agreeing=int(explained.sum()),
        unexplained=int((certain & ~explained).sum()),
        missing=int((~np.asarray(hidden(missing), dtype=bool)).sum()) if len(missing) else 0,
    )
