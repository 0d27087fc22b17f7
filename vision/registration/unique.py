"""Places of a side that are like no other: by several one knows which board lies there, which side up, how turned.

Candidates are ranked by how alike their windows are to others of this side, the other side, and both turned by
quarters. That is a guess, for it lets what parts may hide speak: a corner with a mounting hole and little else is told
from its like by it (0.79), and passes for it in a look (0.9 of what is seen agrees). So the best are tried as
registration goes about it, and those count as unique whose every rival a look would refuse by a margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration.drawing import IndexedSide, Material
from vision.registration.layers import SideLayers
from vision.registration.reference import usual_picture
from vision.registration.refine import slopes
from vision.registration.register import LEAST_AGREEMENT, LEAST_ALONE
from vision.registration.rival import ITSELF_UM, Searched, Trial
from vision.registration.whole import Whole, draw_whole

WINDOW_UM = 5000.0
"""Half a window: what a look surely shows about a place."""
PITCH_UM = 2000.0
LEAST_CONTRAST = 0.08
"""Standard deviation of the usual look, of the step from mask to metal: less is too little to see."""
POOR_KNOWN, POOR_METAL_MM2 = 0.25, 0.5
"""Share of a window that CAD knows, and metal or solder in it: with less no place is tried."""
GOOD_KNOWN, FAIR_KNOWN = 0.75, 0.6
"""Share of a window that is board, known, and not beside parts, of a good place and of a fair one; all others are poor.
Of the bench beside the board nothing is asked, and what a part may hide makes right looks fail."""
NEAR_UM, LEAST_EDGE_MM = 3000.0, 4.0
"""So long an edge of bare metal is near a good place; the edges of solder, asked elsewhere, confirm less."""
METAL_NEAR_UM, LEAST_METAL_MM2 = 2500.0, 1.5
"""So much bare metal is near any place that is not poor: by one dot and the rim of a ring a look may settle beside."""
LEANS_UM = 700.0
"""As far about a part its top may hide the board; from which way it is looked at, no one knows beforehand."""
UNIQUE_SCORE = 0.8
"""A place whose nearest rival comes less near to being taken for it counts as found once on the board."""
MOST_CANDIDATES, MOST_TRIED = 240, 16
"""Places that are ranked, and those that are tried of each grade; up to a quarter of a second each."""
ORDER = ((0, 1.0), (1, 1.0), (0, 0.5), (1, 0.5), (2, 1.0), (0, 0.25), (1, 0.25), (2, 0.5), (2, 0.25))
"""In which places are taken: grade, and how far apart as a share of what is asked. Good ones stand nearer together
rather than that poor ones come in between, but not so near that one label hides two."""
COARSER = 2
"""How many cells of the search are one, where places are only ranked."""
SIDES = ("here", "other side")


@dataclass(frozen=True, slots=True)
class UniquePlace:
    """A place, board frame, how near its nearest rival comes to being taken for it, and where that is.

    rival_score: the worst of the rival's figures as a share of what registration asks for; from 1 on it is accepted.
    rival: `here` (this side, unturned), `here turned 180`, `other side` and so on; empty: none. contrast: how much
    there is to see.
    """

    x_um: float
    y_um: float
    rival_score: float
    rival: str
    rival_um: tuple[float, float]
    contrast: float


@dataclass(frozen=True, slots=True)
class _Guess:
    """A candidate: its grade (0 good, 1 fair, 2 poor), and how alike the likest other window is."""

    x_um: float
    y_um: float
    grade: int
    alike: float
    contrast: float


def unique_places(
    side: IndexedSide | SideLayers,
    other: IndexedSide | SideLayers | None,
    *,
    count: int = 8,
    apart_um: float = 10_000.0,
    allowed_um: tuple[float, float, float, float] | None = None,
) -> tuple[UniquePlace, ...]:
    """Return the most unique places, best first, no two nearer than `apart_um` as long as there are others.

    Places that are found once come before all others, and of them those with much to see before poorer ones.

    other: the board's other side, None where it is not known. allowed_um: box (x0, y0, x1, y1) that the camera reaches.
    Takes some seconds for a large board: done once, when a board is imported.
    """
    here = draw_whole(side)
    wholes = [here] if other is None else [here, draw_whole(other)]
    looks = [_Side(whole) for whole in wholes]
    guesses = [_guess(place, here, looks, grade) for place, grade in _candidates(here, allowed_um)]
    guesses.sort(key=lambda guess: (guess.grade, guess.alike))
    searched = [Searched(whole) for whole in wholes]

    def trial(guess: _Guess) -> Trial:
        return Trial((guess.x_um, guess.y_um), searched, LEAST_ALONE)

    return _spread(guesses, trial, count, apart_um)


def how_unique(place_um: tuple[float, float], here: Whole, other: Whole | None, *, alone: bool = False) -> UniquePlace:
    """Return what a look is likeliest to take for a place (board frame, um).

    alone: by a look for the board alone, which asks for more than one for a target does.
    """
    searched = [Searched(whole) for whole in (here, other) if whole is not None]
    trial = Trial(place_um, searched, LEAST_ALONE if alone else LEAST_AGREEMENT)
    trial.stays_within(math.inf)
    return _told(place_um, trial, contrast=0.0)


def _told(place_um: tuple[float, float], trial: Trial, contrast: float) -> UniquePlace:
    """Return what a trial has found out so far."""
    taken = trial.nearest
    if taken is None:
        return UniquePlace(*place_um, 0.0, "", place_um, contrast)
    turned = f" turned {90 * taken.quarters}" if taken.quarters else ""
    name, there = SIDES[taken.side] + turned, (taken.x_um, taken.y_um)
    return UniquePlace(*place_um, trial.nearness, name, there, contrast)


def _spread(
    guesses: list[_Guess], trial: Callable[[_Guess], Trial], count: int, apart_um: float
) -> tuple[UniquePlace, ...]:
    """Return places that are found once and far apart, the best first; others after them where there are too few."""
    trials: dict[int, Trial] = {}
    chosen: list[int] = []
    for grade, share in ORDER:
        for n, guess in enumerate(guesses):
            if guess.grade != grade or len(chosen) == count or not _far(guess, _of(guesses, chosen), share * apart_um):
                continue
            if n not in trials and sum(guesses[k].grade == grade for k in trials) < MOST_TRIED:
                trials[n] = trial(guess)
            # Of a place that is not found once, most of its rivals need not be tried.
            if n in trials and trials[n].stays_within(UNIQUE_SCORE):
                chosen.append(n)
    chosen.sort(key=lambda n: (guesses[n].grade, trials[n].nearness))
    _fill_up(guesses, trials, chosen, count, apart_um / 4)
    return tuple(_told((guesses[n].x_um, guesses[n].y_um), trials[n], guesses[n].contrast) for n in chosen)


def _fill_up(guesses: list[_Guess], trials: dict[int, Trial], chosen: list[int], count: int, apart_um: float) -> None:
    """Add those of the others whose rivals come least near, no two nearer than told, until there are enough."""
    others = [n for n in trials if n not in chosen]
    while len(chosen) < count and (others := [n for n in others if _far(guesses[n], _of(guesses, chosen), apart_um)]):
        # A trial that has not ended may still find a nearer rival: the place that leads is tried further, or has won.
        least = min(others, key=lambda n: trials[n].nearness)
        if trials[least].ended:
            chosen.append(least)
        else:
            trials[least].stays_within(trials[least].nearness)


def _of(guesses: list[_Guess], numbers: list[int]) -> list[_Guess]:
    return [guesses[n] for n in numbers]


def _far(guess: _Guess, others: list[_Guess], apart_um: float) -> bool:
    return all(np.hypot(guess.x_um - one.x_um, guess.y_um - one.y_um) >= apart_um for one in others)


class _Side:
    """A side that windows are compared with, in coarser cells than those of the search: it is only for a ranking.

    half: of a window, in these cells; spread: standard deviation in each window.
    """

    def __init__(self, whole: Whole) -> None:
        self.cell_um = COARSER * whole.search.grid.cell_um
        self.half = round(WINDOW_UM / self.cell_um)
        shrunk = cv2.resize(_look(whole), None, fx=1.0 / COARSER, fy=1.0 / COARSER, interpolation=cv2.INTER_AREA)
        self.look = np.asarray(shrunk, dtype=np.float32)
        ones = np.full((2 * self.half, 2 * self.half), 0.25 / self.half**2, dtype=np.float32)
        mean = np.asarray(cv2.matchTemplate(self.look, ones, cv2.TM_CCORR))
        square = np.asarray(cv2.matchTemplate(self.look * self.look, ones, cv2.TM_CCORR))
        self.spread = np.sqrt(np.maximum(square - mean * mean, 0.0))

    def likeness(self, window: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how alike each window of the side is, -1..1: correlation, less where there is less contrast."""
        covariance = np.asarray(cv2.matchTemplate(self.look, window, cv2.TM_CCOEFF)) / window.size
        own = max(float(window.std()), 1e-3)
        return np.asarray(covariance / (own * np.maximum(self.spread, own)), dtype=np.float32)


def _candidates(
    here: Whole, allowed: tuple[float, float, float, float] | None
) -> Iterator[tuple[tuple[int, int], int]]:
    """Yield (row, column) of window middles that are allowed and have something to see, and their grade."""
    grid, cover = here.search.grid, here.search.cover
    look = _look(here)
    edged = cover[Material.METAL] + cover[Material.SOLDER]
    on_board = cover[Material.OFF_BOARD] < 0.5
    hidden = _beside_parts(cover[Material.UNKNOWN], grid.cell_um)
    edge_mm = np.where(hidden, 0.0, np.hypot(*slopes(cover[Material.METAL]))) * (grid.cell_um / 1e3)
    half = round(WINDOW_UM / grid.cell_um)
    near, metal_near = round(NEAR_UM / grid.cell_um), round(METAL_NEAR_UM / grid.cell_um)
    x0, y0, x1, y1 = allowed or here.box_um
    step = max(1, round(PITCH_UM / grid.cell_um))
    while ((x1 - x0) / (step * grid.cell_um)) * ((y1 - y0) / (step * grid.cell_um)) > MOST_CANDIDATES:
        step += 1
    for row in range(half, grid.rows - half, step):
        for column in range(half, grid.columns - half, step):
            x, y = grid.origin_um[0] + column * grid.cell_um, grid.origin_um[1] + row * grid.cell_um
            window = np.s_[row - half : row + half, column - half : column + half]
            known = float(np.mean(cover[Material.UNKNOWN][window] < 0.5))
            inside = x0 <= x <= x1 and y0 <= y <= y1 and bool(on_board[row, column])
            close = np.s_[row - near : row + near, column - near : column + near]
            cell_mm2 = (grid.cell_um / 1e3) ** 2
            enough = float(edged[window].sum()) * cell_mm2 > POOR_METAL_MM2
            if inside and known > POOR_KNOWN and enough and look[window].std() > LEAST_CONTRAST:
                plain = float(np.mean(~hidden[window] & on_board[window]))
                core = np.s_[row - metal_near : row + metal_near, column - metal_near : column + metal_near]
                metal = float(cover[Material.METAL][core].sum()) * cell_mm2 > LEAST_METAL_MM2
                good = metal and plain >= GOOD_KNOWN and float(edge_mm[close].sum()) >= LEAST_EDGE_MM
                yield (row, column), 0 if good else 1 if metal and plain >= FAIR_KNOWN else 2


def _beside_parts(unknown: Plane, cell_um: float) -> NDArray[np.bool_]:
    """Return what parts cover or may hide."""
    size = 2 * round(LEANS_UM / cell_um) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate((unknown > 0.5).astype(np.uint8), disc)) > 0


def _look(whole: Whole) -> NDArray[np.float32]:
    """Return the usual look of a side; what nobody knows is like the middle of all else, so that it tells nothing."""
    look, unknown = usual_picture(whole.search), whole.search.cover[Material.UNKNOWN]
    known = float(np.sum(1.0 - unknown))
    mean = float(look.sum()) / known if known else 0.0
    return np.asarray(look + np.float32(mean) * unknown, dtype=np.float32)


def _guess(place: tuple[int, int], here: Whole, sides: list[_Side], grade: int) -> _Guess:
    grid, half = here.search.grid, sides[0].half
    row, column = place[0] // COARSER, place[1] // COARSER
    window = sides[0].look[row - half : row + half, column - half : column + half]
    alike = -1.0
    for side in sides:
        for quarters in range(4):
            likeness = side.likeness(np.ascontiguousarray(np.rot90(window, quarters)))
            if side is sides[0] and quarters == 0:
                cv2.circle(likeness, (column - half, row - half), round(ITSELF_UM / side.cell_um), -1.0, -1)
            alike = max(alike, float(likeness.max()))
    x_um = grid.origin_um[0] + (place[1] - 0.5) * grid.cell_um
    y_um = grid.origin_um[1] + (place[0] - 0.5) * grid.cell_um
    return _Guess(x_um, y_um, grade, alike, float(window.std()))
