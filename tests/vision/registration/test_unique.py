"""Places that are called unique are those at which no look takes another place, or the board turned, for them."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from tests.vision.registration.drawn import HEIGHT_UM, WIDTH_UM, Lie, box, circle, shoot, some_board
from vision.registration import (
    UNIQUE_SCORE,
    Hole,
    Polygon,
    Registration,
    SideLayers,
    Target,
    draw_whole,
    how_unique,
    index_side,
    prepare,
    register,
    unique_places,
)
from vision.registration.rival import Searched, likest

CORNERS = ((4500.0, 4500.0), (WIDTH_UM - 4500.0, HEIGHT_UM - 4500.0))
RED = 2


@lru_cache(maxsize=1)
def _board() -> SideLayers:
    """Return a board with the same mounting hole in two corners, a part beside one, and else no two places alike."""
    layers, _ = some_board(21)
    copper, openings, holes = [], [], []
    # What a part hides in one corner is bright in the other: by that the corners look unlike each other.
    part = box(10_000.0, 4500.0, 3800.0, 7000.0)
    pads = [box(WIDTH_UM - x, HEIGHT_UM - 4500.0, 800.0, 6000.0) for x in (8800.0, 10_000.0, 11_200.0)]
    pads += [box(3500.0, 9000.0, 5000.0, 1000.0), box(WIDTH_UM - 3500.0, HEIGHT_UM - 9000.0, 5000.0, 1000.0)]
    copper += [Polygon(pad) for pad in pads]
    openings += [Polygon(pad) for pad in pads]
    for corner in CORNERS:
        copper.append(Polygon(circle(*corner, 6000.0)))
        openings.append(Polygon(circle(*corner, 6100.0)))
        holes.append(Hole(*corner, 3200.0))

    def elsewhere(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(p for p in polygons
                     if all(np.hypot(*(p.points_um.mean(axis=0) - corner)) > 9500.0 for corner in CORNERS))  # fmt: skip

    return replace(
        layers,
        copper=(*elsewhere(layers.copper), *copper),
        openings=(*elsewhere(layers.openings), *openings),
        ink=elsewhere(layers.ink),
        holes=tuple(holes),
        bodies=(Polygon(part),),
    )


def _looks(place_um: tuple[float, float], lie: Lie) -> list[bool]:
    """Look at a place of a board that lies as told, parts of any grey; say which looks register it."""
    indexed, accepted = index_side(_board()), []
    around = Target(*place_um, box(*place_um, 1000.0, 1000.0))
    for seed in range(2):
        shot = shoot(replace(_board(), bodies=()), around, lie, np.random.default_rng(seed))
        frame = shot.frame.copy()
        for body in _board().bodies:
            corners = cv2.perspectiveTransform(body.points_um[None], shot.real)[0]
            cv2.fillPoly(frame, [np.round(corners).astype(np.int32)], (0, 0, 20 + 40 * seed), cv2.LINE_AA)
        found = register(prepare(indexed, place_um), frame, shot.assumed, None)
        accepted.append(isinstance(found, Registration))
    return accepted


def test_a_corner_for_which_a_look_takes_its_like_on_the_turned_board_is_not_unique() -> None:
    corner = CORNERS[0]
    assert any(_looks(corner, Lie(turn_deg=180.0)))
    assert how_unique(corner, draw_whole(_board()), None, alone=True).rival_score > UNIQUE_SCORE


def test_at_no_place_called_unique_is_the_turned_board_registered_and_the_board_as_it_should_lie_is() -> None:
    whole = draw_whole(_board())
    places = [p for p in unique_places(_board(), None, count=4) if p.rival_score <= UNIQUE_SCORE]
    assert len(places) >= 3
    for place in places:
        at = (place.x_um, place.y_um)
        assert not any(_looks(at, Lie(turn_deg=180.0)))
        assert all(_looks(at, Lie(60.0, -40.0)))
        # A look for a target asks for less agreement, so its place has to be more unlike all others.
        assert how_unique(at, whole, None).rival_score >= place.rival_score


def _with_header(seed: int, at_um: tuple[float, float]) -> SideLayers:
    """Return a board with the same small header at a place, and about it only what is its own."""
    layers, _ = some_board(seed)

    def elsewhere(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(p for p in polygons if np.abs(p.points_um - at_um).max(axis=1).min() > 2900.0)

    pins = [(at_um[0] + dx, at_um[1] + dy) for dx, dy in ((-1800, 0), (-600, 500), (600, 500), (1800, -400))]
    metal = tuple(Polygon(circle(*pin, 1000.0)) for pin in pins)
    holes = tuple(h for h in layers.holes if max(abs(h.x_um - at_um[0]), abs(h.y_um - at_um[1])) > 2900.0)
    return replace(
        layers,
        copper=(*elsewhere(layers.copper), *metal),
        openings=(*elsewhere(layers.openings), *metal),
        ink=elsewhere(layers.ink),
        holes=(*holes, *(Hole(*pin, 500.0) for pin in pins)),
    )


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_what_is_alike_near_on_the_other_side_is_tried_whatever_lies_farther_off(seed: int) -> None:
    """A look finds its hypotheses by what is near."""
    at, there = (18_000.0, 14_000.0), (16_000.0, 14_500.0)
    here, other = Searched(draw_whole(_with_header(3, at))), Searched(draw_whole(_with_header(seed, there)))
    unturned = [place for place in likest(at, here, other) if place.quarters == 0]
    assert any(np.hypot(place.x_um - there[0], place.y_um - there[1]) < 400.0 for place in unturned)
