"""Rivals of a place: how near a look comes to taking what lies elsewhere on a board, or on it turned, for the place.

It is tried, not guessed: CAD of the other place is looked at as a picture, registered, and judged as any other look by
agreement, by metal that is seen and by metal edges. What either place does not know counts for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.registration import spectra, wide
from vision.registration.answer import Edges
from vision.registration.drawing import Grid, Material
from vision.registration.edges import LEAST_CONFIRMED, LEAST_NEAR, LEAST_SOLDERED, judge_edges
from vision.registration.fine import BARE, SOLDERED
from vision.registration.rectify import Picture, Pose
from vision.registration.reference import usual_picture, usual_picture_of
from vision.registration.refine import Fit, Problem, refine
from vision.registration.register import (
    LEAST_AGREEMENT,
    LEAST_METAL,
    LEAST_METAL_BESIDE_PARTS,
    LEAST_ODDS,
    SURE_AGREEMENT,
    SURE_EDGES,
)
from vision.registration.sheet import Sheet, make_sheet
from vision.registration.spectra import Spectra
from vision.registration.whole import Place, Whole, find_in

GREY_MASK, GREY_STEP = 60.0, 120.0
"""Level of mask in a picture made of CAD, and from there to metal."""
APART = 6
"""Places that are tried are by so many cells apart."""
WINDOWS = ((wide.WIDE_UM, 4), (spectra.WINDOW_UM, 2))
"""Half the windows in which they are looked for, and how many of each side and turn are tried: a look finds its
hypotheses by what is near, and of two sides with the same connector ink and parts farther off may be all the
difference."""
ITSELF_UM = 600.0
"""A window shifted by less is itself."""
NEAR_UM = 3000.0
"""Metal edges are asked within this."""
PAIRS_UM, TOLD_APART = 6000.0, 3.0 * LEAST_ODDS
"""A place of the same side as near is compared with this one in every look; such log odds leave no doubt."""
FEW_EDGES = LEAST_NEAR // 2
"""Cells here are twice as wide as those in which a look judges the edges near."""
_STEPS = 4


@dataclass(frozen=True, slots=True)
class Taken:
    """How a look at a place would judge another one, were that in its view.

    side: number of the side on which the other place lies; x_um, y_um: there; quarters: by which it is turned.
    agreement, metal_seen, confirmed, soldered, assembled: as `Registration` has them.
    """

    side: int
    quarters: int
    x_um: float
    y_um: float
    agreement: float
    metal_seen: float
    confirmed: float
    soldered: bool
    assembled: bool

    def nearness(self, least_agreement: float) -> float:
        """Return how near the look comes to being accepted: the worst of its figures, as a share of what is asked.

        least_agreement: of a look alone; with all metal and its edges seen it may agree less, as `decide` has it.
        """
        least_metal = LEAST_METAL_BESIDE_PARTS if self.assembled else LEAST_METAL
        least_confirmed = LEAST_SOLDERED if self.soldered else LEAST_CONFIRMED
        metal = max(self.agreement / SURE_AGREEMENT, self.metal_seen / least_metal)
        sure = min(self.metal_seen / LEAST_METAL, self.confirmed / SURE_EDGES, self.agreement / LEAST_AGREEMENT)
        return max(min(self.agreement / least_agreement, metal, self.confirmed / least_confirmed), sure)


class Searched:
    """A side on which rivals are looked for: its usual look as a picture, and what is needed to search it."""

    def __init__(self, whole: Whole) -> None:
        self.whole = whole

    def spectra(self, cells: int) -> Spectra:
        """Return spectra of the whole side, for windows as wide, one of `WINDOWS`."""
        return spectra.for_window(self._spectra, cells)

    @cached_property
    def _spectra(self) -> Spectra:
        largest = wide.window((0.0, 0.0), self.whole.search.grid.cell_um, WINDOWS[0][0])
        return spectra.transform_all(self.whole.search, largest.rows)

    @cached_property
    def look(self) -> NDArray[np.float32]:
        """The usual look in the cells of the search."""
        return usual_picture(self.whole.search)

    def picture(self, place: Place, about_um: tuple[float, float]) -> Picture:
        """Return the picture in which a place of this side, turned, lies where another one is looked for."""
        turn = 90.0 * place.quarters
        lies = Pose(about_um[0] - place.x_um, about_um[1] - place.y_um, turn, (place.x_um, place.y_um))
        return self._picture.under(np.linalg.inv(self.whole.wide.grid.to_um) @ np.linalg.inv(lies.matrix))

    @cached_property
    def _picture(self) -> Picture:
        """The usual look in the cells of the wide check; what nobody knows is hidden."""
        grey = np.asarray(np.round(GREY_MASK + GREY_STEP * usual_picture_of(self.whole.wide)), dtype=np.uint8)
        covered = (self.whole.wide.plane(Material.UNKNOWN) > 0.5).astype(np.uint8)
        contours, _ = cv2.findContours(covered, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        return Picture.of(grey, np.eye(3), [contour[:, 0, :].astype(np.float64) for contour in contours])


class _Drawn:
    """CAD about a place on trial."""

    def __init__(self, place_um: tuple[float, float], whole: Whole) -> None:
        self._place_um, self._whole = place_um, whole

    @cached_property
    def sheet(self) -> Sheet:
        """What a look compares with."""
        return make_sheet(self._whole.wide.around(*self._place_um, 1.2 * wide.WIDE_UM))

    @cached_property
    def broad(self) -> Sheet:
        """The same as far as places are compared in pairs."""
        return make_sheet(self._whole.wide.around(*self._place_um, wide.WIDE_UM + PAIRS_UM))


class Trial:
    """A place on trial: the likest places of all sides, turned by quarters, are tried one by one, as far as is asked.

    nearness: of what came nearest to being taken for it so far; it only grows. nearest: that, None of none yet.
    ended: all were tried.
    """

    def __init__(self, place_um: tuple[float, float], sides: Sequence[Searched], least_agreement: float) -> None:
        self._place_um, self._sides, self._least_agreement = place_um, sides, least_agreement
        self._rivals = ((number, place) for number, side in enumerate(sides)
                        for place in likest(place_um, sides[0], side))  # fmt: skip
        self.nearness = 0.0
        self.nearest: Taken | None = None
        self.ended = False

    def stays_within(self, nearness: float) -> bool:
        """Say whether no rival comes nearer than this; the first that does is the last that is tried."""
        # Not kept from one time to the next: dozens of places may be on trial, and sheets take some 10 MB each.
        drawn = _Drawn(self._place_um, self._sides[0].whole)
        while self.nearness <= nearness and not self.ended:
            self._try_next(drawn)
        return self.nearness <= nearness

    def _try_next(self, drawn: _Drawn) -> None:
        rival = next(self._rivals, None)
        if rival is None:
            self.ended = True
            return
        taken = self._take(drawn, *rival)
        if taken is not None and taken.nearness(self._least_agreement) > self.nearness:
            self.nearness, self.nearest = taken.nearness(self._least_agreement), taken

    def _take(self, drawn: _Drawn, number: int, place: Place) -> Taken | None:
        """Register CAD of the place in the picture that another one makes, and judge it as a look would.

        None where the other is the place itself, or every look compares the two and tells the place itself; and where
        it comes no nearer than another did: its edges are not asked then.
        """
        sheet, place_um = drawn.sheet, self._place_um
        picture = self._sides[number].picture(place, place_um)
        fit = refine(Problem(sheet, picture, 1.0, _STEPS), Pose(about_um=place_um))
        if fit is None:
            return None
        shown = wide.look(picture, place_um, sheet.planes.grid.cell_um, 1.0)
        view = wide.draw_view(sheet, shown, fit.pose, wide.wide_levels(sheet, shown, fit.pose, fit.levels))
        agrees = wide.agreement(sheet, shown, view)
        assembled = bool(sheet.planes.cover[Material.UNKNOWN].any())
        at_best = Taken(number, place.quarters, place.x_um, place.y_um, agrees.all, agrees.metal, confirmed=1.0,
                        soldered=True, assembled=assembled)  # fmt: skip
        if at_best.nearness(self._least_agreement) <= self.nearness:
            return None
        if number == 0 and place.quarters == 0 and self._told_apart(drawn, place, shown, view):
            return None
        edges = _edges(sheet, picture, fit, place_um)
        return replace(at_best, confirmed=edges.confirmed, soldered=edges.soldered)

    def _told_apart(self, drawn: _Drawn, place: Place, shown: wide.Shown, view: wide.View) -> bool:
        """Whether a place unturned, on the same side, is the one itself, or is compared with it and found out."""
        x_um, y_um = self._place_um
        itself = Pose(x_um - place.x_um, y_um - place.y_um, 0.0, self._place_um)
        off_um = math.hypot(itself.x_um - view.pose.x_um, itself.y_um - view.pose.y_um)
        if off_um < ITSELF_UM or off_um > PAIRS_UM:
            return off_um < ITSELF_UM
        true = wide.draw_view(drawn.broad, shown, itself, view.levels)
        return wide.log_odds(true, view, shown) > TOLD_APART


def likest(place_um: tuple[float, float], here: Searched, side: Searched) -> Iterator[Place]:
    """Yield the places of a side, turned by quarters, that look most like one of `here`: all about it, or near it."""
    cell_um = here.whole.search.grid.cell_um
    found: list[Place] = []
    for half_um, peaks in WINDOWS:
        shown, seen = _on(here, wide.window(place_um, cell_um, half_um))
        more = find_in(side.spectra(shown.shape[0]), side.whole, shown, seen, peaks, APART)
        more = [place for place in more if not any(_same(place, other, side) for other in found)]
        yield from more
        found += more


def _same(one: Place, other: Place, side: Searched) -> bool:
    apart_um = math.hypot(one.x_um - other.x_um, one.y_um - other.y_um)
    return one.quarters == other.quarters and apart_um < APART * side.whole.search.grid.cell_um


def _on(side: Searched, window: Grid) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the usual look of a window, and which cells are known."""
    grid = side.whole.search.grid
    to_field = np.linalg.inv(grid.to_um) @ window.to_um
    size, flags = (window.columns, window.rows), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    look = cv2.warpAffine(side.look, to_field[:2], size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    unknown = side.whole.search.cover[Material.UNKNOWN]
    hidden = cv2.warpAffine(unknown, to_field[:2], size, flags=flags, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(look, dtype=np.float32), np.asarray(hidden) < 0.5


def _edges(sheet: Sheet, picture: Picture, fit: Fit, place_um: tuple[float, float]) -> Edges:
    """Judge the metal edges near, and those of solder too where bare metal is scarce, as a look does."""
    grid = sheet.planes.grid
    shown, seen = picture.on(grid, fit.pose, 1.0)
    expected, near = sheet.expect(fit.levels), _near(grid, place_um)
    edges = judge_edges(sheet, shown, expected, seen, fit.levels.step, near, BARE)
    if edges.cells >= FEW_EDGES:
        return edges
    near_all = judge_edges(sheet, shown, expected, seen, fit.levels.contrast, near, SOLDERED)
    return (
        near_all
        if near_all.cells >= FEW_EDGES
        else judge_edges(sheet, shown, expected, seen, fit.levels.contrast, None, SOLDERED)
    )


def _near(grid: Grid, place_um: tuple[float, float]) -> NDArray[np.bool_]:
    x = grid.origin_um[0] + np.arange(grid.columns) * grid.cell_um - place_um[0]
    y = grid.origin_um[1] + np.arange(grid.rows) * grid.cell_um - place_um[1]
    return np.asarray((np.abs(y) < NEAR_UM)[:, None] & (np.abs(x) < NEAR_UM)[None, :])
