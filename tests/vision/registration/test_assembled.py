"""Boards with parts: bodies that lean over the board, solder with facets, things that CAD does not know of."""

import itertools
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from sim_hw.scene.optics import Stand, make_optics
from tests.vision.registration.drawn import Lie, Shot, box, shoot, some_board
from vision.registration import (
    IndexedSide,
    NotRegistered,
    Polygon,
    Registration,
    SideLayers,
    Target,
    index_side,
    prepare,
    register,
    unique_places,
)
from vision.registration.drawing import Material
from vision.registration.lean import beside_parts, lean
from vision.registration.rectify import Picture

SEED = 11
RED = 2


@lru_cache(maxsize=1)
def _assembled() -> tuple[SideLayers, SideLayers, list[Target]]:
    """Return a board as it is drawn, as CAD has it with solder on pads and parts between some, and its targets."""
    bare, targets = some_board(SEED, parts=60)
    pads = [t for t in targets if len(t.outline_um) == 4]
    bodies, soldered = [], []
    for one, other in itertools.pairwise(pads):
        apart = np.hypot(one.x_um - other.x_um, one.y_um - other.y_um)
        if apart < 2000.0:
            middle = (one.x_um + other.x_um) / 2, (one.y_um + other.y_um) / 2
            bodies.append(Polygon(box(*middle, 0.8 * apart, 0.8 * apart)))
            soldered += [Polygon(one.outline_um), Polygon(other.outline_um)]
    return bare, replace(bare, bodies=tuple(bodies[::2]), soldered=tuple(soldered)), targets


@lru_cache(maxsize=1)
def _indexed() -> IndexedSide:
    return index_side(_assembled()[1])


def _with_parts(shot: Shot, layers: SideLayers, *, facets: bool = True, seed: int = 1) -> np.ndarray:
    """Paint solder with dark facets and bodies of random grey, both in the picture's own red."""
    rng = np.random.default_rng(seed)
    frame = shot.frame.copy()
    for polygon in layers.soldered:
        corners = cv2.perspectiveTransform(polygon.points_um[None], shot.real)[0]
        cover = np.zeros(frame.shape[:2], dtype=np.uint8)
        cv2.fillPoly(cover, [np.round(corners).astype(np.int32)], 1)
        relief = cv2.GaussianBlur(rng.normal(0.0, 1.0, (300, 400)).astype(np.float32), (0, 0), 2.0)
        grain = cv2.resize(relief / relief.std(), (frame.shape[1], frame.shape[0]))
        level = np.clip(120.0 + (45.0 * grain if facets else 0.0), 25.0, 230.0)
        frame[cover > 0, RED] = level[cover > 0].astype(np.uint8)
    for body in layers.bodies:
        corners = cv2.perspectiveTransform(body.points_um[None], shot.real)[0]
        cv2.fillPoly(frame, [np.round(corners).astype(np.int32)], (0, 0, int(rng.integers(12, 190))))
    return frame


def _found(frame: np.ndarray, shot: Shot, place_um: tuple[float, float]) -> Registration | NotRegistered:
    return register(prepare(_indexed(), place_um), frame, shot.assumed, None)


def _look(k: int, lie: Lie) -> tuple[np.ndarray, Shot, Target]:
    bare, cad, targets = _assembled()
    target = targets[k]
    shot = shoot(bare, target, lie, np.random.default_rng(k))
    return _with_parts(shot, cad, seed=k), shot, target


@pytest.mark.parametrize("k", [0, 12, 22, 45])
def test_a_board_with_parts_is_found_by_its_solder_ink_and_mask(k: int) -> None:
    frame, shot, target = _look(k, Lie(70.0, -50.0, 0.1))
    answer = _found(frame, shot, (target.x_um, target.y_um))
    assert isinstance(answer, Registration)
    assert np.hypot(*(np.asarray(answer.target_um) - shot.truth_um(target))) < 15.0


@pytest.mark.parametrize("turn_deg", [90.0, 180.0])
def test_a_turned_board_with_parts_is_refused(turn_deg: float) -> None:
    for k in (3, 40):
        frame, shot, target = _look(k, Lie(0.0, 0.0, turn_deg))
        assert isinstance(_found(frame, shot, (target.x_um, target.y_um)), NotRegistered)


def test_a_label_hides_what_is_below_it_and_no_more() -> None:
    frame, shot, target = _look(22, Lie(30.0, 20.0))
    corners = cv2.perspectiveTransform(box(target.x_um + 3500, target.y_um, 3200, 2500)[None], shot.real)[0]
    cv2.fillPoly(frame, [np.round(corners).astype(np.int32)], (0, 0, 205))
    assert isinstance(_found(frame, shot, (target.x_um, target.y_um)), Registration)


def test_a_place_below_a_part_is_refused_not_a_crash() -> None:
    _, cad, _ = _assembled()
    frame, shot, target = _look(5, Lie())
    covered = replace(cad, bodies=(Polygon(box(target.x_um, target.y_um, 60_000, 60_000)),))
    answer = register(prepare(index_side(covered), (target.x_um, target.y_um)), frame, shot.assumed, None)
    assert isinstance(answer, NotRegistered)


def test_a_soldered_board_has_places_that_are_found_once() -> None:
    bare, _, targets = _assembled()
    soldered = replace(bare, soldered=tuple(Polygon(target.outline_um) for target in targets))
    assert len([p for p in unique_places(soldered, None, count=6) if p.rival_score < 0.9]) >= 3


def test_the_way_in_which_upright_things_lean_is_that_of_the_camera() -> None:
    optics = make_optics()
    for theta_deg in (0.0, 70.0, 200.0):
        stand = Stand((0.0, 0.0, 400.0), theta_deg)
        flat, raised = np.eye(3), np.eye(3)
        raised[2, 2] = 1000.0
        to_px = optics.homography(flat, stand)
        picture = Picture.of(np.zeros((1200, 1600), dtype=np.uint8), to_px, ())
        top_px = cv2.perspectiveTransform(np.array([[[500.0, 300.0]]]), optics.homography(raised, stand))
        seen_um = cv2.perspectiveTransform(top_px, np.linalg.inv(to_px))[0, 0]
        (way,) = lean(picture, (500.0, 300.0))
        assert np.allclose(np.asarray(way) * 1000.0, seen_um - (500.0, 300.0), atol=40.0)


def test_what_lies_behind_a_tall_part_is_not_known_and_what_lies_before_it_is() -> None:
    optics = make_optics()
    to_px = optics.homography(np.eye(3), Stand((0.0, 0.0, 400.0), 0.0))
    picture = Picture.of(np.zeros((1200, 1600), dtype=np.uint8), to_px, ())
    bare, _, _ = _assembled()
    one = replace(bare, outline=(), bodies=(Polygon(box(0.0, 0.0, 3200, 3200)),))
    seen = beside_parts(prepare(index_side(one), (0.0, 0.0)), picture)
    (way,) = lean(picture, (0.0, 0.0))
    behind, before = np.asarray(way) / np.hypot(*way) * 2600.0, -np.asarray(way) / np.hypot(*way) * 2600.0

    def known(place_um: np.ndarray) -> bool:
        grid = seen.middle.planes.grid
        column, row = np.round((place_um - grid.origin_um) / grid.cell_um).astype(int)
        return bool(seen.middle.told[row, column])

    assert not known(behind)
    assert known(before)
    assert seen.wide.planes.cover[Material.UNKNOWN].any()
