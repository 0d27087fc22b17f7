"""The search for where CAD fits: what parts hide says nothing, and a place need not show bare metal."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from tests.vision.registration.drawn import Lie, Shot, box, shoot, some_board
from vision.registration import Polygon, Registration, SideLayers, index_side, prepare, register
from vision.registration.lean import lean
from vision.registration.rectify import Picture

SEED = 11
RED = 2
TALL_UM = 2800.0


def _bare_of_metal(layers: SideLayers, place_um: tuple[float, float], reach_um: float) -> SideLayers:
    """Return a side without copper, openings and holes in a square about a place; its ink stays."""

    def far(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(p for p in polygons if np.abs(p.points_um - place_um).max(axis=1).min() > reach_um)

    holes = tuple(h for h in layers.holes if max(abs(h.x_um - place_um[0]), abs(h.y_um - place_um[1])) > reach_um)
    return replace(layers, copper=far(layers.copper), openings=far(layers.openings), holes=holes)


def _stood_up(shot: Shot, bodies: tuple[Polygon, ...], seed: int) -> np.ndarray:
    """Paint bodies as prisms that lean away from the camera, their tops and flanks of random grey."""
    rng, frame = np.random.default_rng(seed), shot.frame.copy()
    picture = Picture.of(np.zeros(frame.shape[:2], dtype=np.uint8), shot.assumed, ())
    for body in bodies:
        (way,) = lean(picture, tuple(body.points_um.mean(axis=0)))
        top, flank = (int(v) for v in rng.integers(60, 190, 2))
        corners = [body.points_um, body.points_um + np.asarray(way) * TALL_UM]
        foot, lid = (cv2.perspectiveTransform(c[None], shot.real)[0] for c in corners)
        hull = cv2.convexHull(np.vstack((foot, lid)).astype(np.float32))
        cv2.fillPoly(frame, [np.round(hull).astype(np.int32)], (0, 0, flank))
        cv2.fillPoly(frame, [np.round(lid).astype(np.int32)], (0, 0, top))
    return frame


def _by_ink(seed: int, letters: int, k: int, lie: Lie) -> tuple[Registration, Any]:
    """Register a place about which no bare metal is; return what was found, and where the target truly is, (2,) um."""
    layers, targets = some_board(seed, letters=letters)
    place = targets[k].x_um, targets[k].y_um
    cleared = _bare_of_metal(layers, place, 3800.0)
    shot = shoot(cleared, targets[k], lie, np.random.default_rng(k))
    answer = register(prepare(cleared, place), shot.frame, shot.assumed, None)
    assert isinstance(answer, Registration), answer.message
    return answer, shot.truth_um(targets[k])


@pytest.mark.parametrize(("seed", "letters", "k"), [(11, 25, 17), (11, 25, 20), (12, 25, 17), (13, 15, 7)])
def test_a_place_that_shows_no_bare_metal_is_found_by_its_ink(seed: int, letters: int, k: int) -> None:
    answer, truth_um = _by_ink(seed, letters, k, Lie(600.0, -450.0, 0.1))
    assert np.hypot(*(np.asarray(answer.target_um) - truth_um)) < 40.0


@pytest.mark.parametrize(("seed", "letters", "k"), [(11, 25, 0), (12, 25, 15), (13, 15, 10)])
def test_of_a_view_of_ink_alone_as_much_agrees_as_of_any_other(seed: int, letters: int, k: int) -> None:
    answer, _ = _by_ink(seed, letters, k, Lie(200.0, -150.0, 0.1))
    assert answer.agreement > 0.95
    assert answer.metal_seen > 0.9


@pytest.mark.parametrize("k", [2, 4, 10, 14, 26])
def test_a_place_between_tall_parts_is_found_by_what_they_do_not_hide(k: int) -> None:
    layers, targets = some_board(SEED, letters=90)
    target = targets[k]
    at = np.array((target.x_um, target.y_um))
    bodies = tuple(Polygon(box(*(at + way), 4600.0, 4200.0)) for way in ((-300.0, -200.0), (5300.0, 900.0)))
    cad = replace(layers, bodies=bodies)
    shot = shoot(layers, target, Lie(-350.0, 500.0, 0.1), np.random.default_rng(k))
    frame = _stood_up(shot, bodies, k)
    answer = register(prepare(index_side(cad), (target.x_um, target.y_um)), frame, shot.assumed, None)
    assert isinstance(answer, Registration), answer.message
    assert np.hypot(*(np.asarray(answer.target_um) - shot.truth_um(target))) < 40.0


@pytest.mark.parametrize("k", [0, 5])
def test_a_board_whose_only_ink_lies_behind_a_part_is_found_all_the_same(k: int) -> None:
    layers, targets = some_board(SEED)
    target, layers = targets[k], replace(layers, ink=())
    place = np.array((target.x_um, target.y_um))
    shot = shoot(layers, target, Lie(200.0, -150.0, 0.1), np.random.default_rng(k))
    (way,) = lean(Picture.of(np.zeros(shot.frame.shape[:2], dtype=np.uint8), shot.assumed, ()), (*place,))
    away = np.asarray(way) / np.abs(way).max()
    body, ink = place - 5000.0 * away, place - 3850.0 * away
    cad = replace(layers, ink=(Polygon(box(*ink, 500.0, 500.0)),), bodies=(Polygon(box(*body, 1600.0, 1600.0)),))
    frame = _stood_up(shot, cad.bodies, k)
    answer = register(prepare(cad, (target.x_um, target.y_um)), frame, shot.assumed, None)
    assert isinstance(answer, Registration), answer.message
    assert np.hypot(*(np.asarray(answer.target_um) - shot.truth_um(target))) < 40.0
