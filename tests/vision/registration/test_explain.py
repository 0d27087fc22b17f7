import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.vision.registration.drawn import Lie, Shot, circle, shoot, some_board
from vision.registration import (
    NotRegistered,
    Polygon,
    Refusal,
    Registration,
    SideLayers,
    Target,
    Whole,
    draw_whole,
    explain,
    prepare,
    register,
)
from vision.registration.explain import Lie as Way
from vision.registration.explain import named


@lru_cache(maxsize=1)
def sides() -> tuple[SideLayers, list[Target], SideLayers, Whole, Whole]:
    here, targets = some_board(3)
    other, _ = some_board(21)
    return here, targets, other, draw_whole(here), draw_whole(other)


def refused(layers: SideLayers, target: Target, shot: Shot) -> NotRegistered:
    answer = register(prepare(layers, (target.x_um, target.y_um)), shot.frame, shot.assumed, target)
    assert isinstance(answer, NotRegistered)
    return answer


def reason(shot: Shot, target: Target) -> NotRegistered:
    here, _, _, whole, other = sides()
    answer = refused(here, target, shot)
    return explain(answer, shot.frame, shot.assumed, (target.x_um, target.y_um), whole, other)


@pytest.mark.parametrize("turn_deg", [90.0, 180.0, -90.0])
def test_a_turned_board_is_called_turned_and_by_how_much(turn_deg: float) -> None:
    here, targets, _, _, _ = sides()
    # About the middle of the board, so that a quarter's turn leaves it under the camera.
    target = min(targets, key=lambda t: np.hypot(t.x_um - 18_000, t.y_um - 14_000))
    shot = shoot(here, target, Lie(80.0, -50.0, turn_deg), np.random.default_rng(1))
    answer = reason(shot, target)
    assert answer.reason is Refusal.BOARD_TURNED
    assert f"{turn_deg:.0f} degrees" in answer.message


def _half_without_metal(layers: SideLayers) -> SideLayers:
    """Return the side with openings in its left half alone: the right one shows ink and covered copper."""
    openings = tuple(p for p in layers.openings if p.points_um[:, 0].max() < 18_000)
    return replace(layers, openings=openings)


@pytest.mark.parametrize("y_um", [10_000.0, 14_000.0, 18_000.0])
def test_a_turned_board_is_called_turned_where_its_edge_is_in_view_and_no_metal(y_um: float) -> None:
    here, _, _, _, other = sides()
    bare = _half_without_metal(here)
    target = Target(4000.0, y_um, circle(4000.0, y_um, 700.0))
    shot = shoot(bare, target, Lie(80.0, -50.0, 180.0), np.random.default_rng(7))
    answer = refused(bare, target, shot)
    named = explain(answer, shot.frame, shot.assumed, (target.x_um, target.y_um), draw_whole(bare), other)
    assert named.reason is Refusal.BOARD_TURNED


def test_the_other_side_up_is_called_so() -> None:
    _, targets, other, _, _ = sides()
    for target in targets[:3]:
        assert reason(shoot(other, target, Lie(), np.random.default_rng(2)), target).reason is Refusal.WRONG_SIDE


def test_a_board_far_off_is_told_by_how_far() -> None:
    here, targets, _, _, _ = sides()
    shot = shoot(here, targets[0], Lie(5200.0, -1500.0), np.random.default_rng(3))
    answer = reason(shot, targets[0])
    assert answer.reason is Refusal.WRONG_PLACE
    told = [int(number) for number in re.findall(r"-?\d+", answer.message)]
    assert np.allclose(told, (5200, -1500), atol=25)


def test_an_empty_nest_and_another_design_are_told_apart() -> None:
    _, targets, _, _, _ = sides()
    foreign, _ = some_board(33)
    assert reason(shoot(None, targets[0], Lie(), np.random.default_rng(4)), targets[0]).reason is Refusal.NO_BOARD
    answer = reason(shoot(foreign, targets[0], Lie(), np.random.default_rng(5)), targets[0])
    assert answer.reason is Refusal.NOT_THIS_BOARD


def test_what_the_board_explains_where_it_should_lie_is_not_called_another_board() -> None:
    _, targets, _, whole, other = sides()
    foreign, _ = some_board(33)
    shot = shoot(foreign, targets[0], Lie(), np.random.default_rng(5))
    answer = refused(sides()[0], targets[0], shot)
    assert answer.best is not None
    about_um = (targets[0].x_um, targets[0].y_um)
    explained = replace(answer, best=replace(answer.best, agreement=0.75))
    assert explain(explained, shot.frame, shot.assumed, about_um, whole, other) is explained


def _moved_all(layers: SideLayers, x_um: float) -> SideLayers:
    """Return the side with all but its outline moved."""

    def there(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        return tuple(replace(p, points_um=p.points_um + np.array((x_um, 0.0))) for p in polygons)

    holes = tuple(replace(h, x_um=h.x_um + x_um) for h in layers.holes)
    return replace(
        layers, copper=there(layers.copper), openings=there(layers.openings), ink=there(layers.ink), holes=holes
    )


def _turned_in_the_middle(other: SideLayers) -> NotRegistered:
    here, targets, _, whole, _ = sides()
    target = min(targets, key=lambda t: np.hypot(t.x_um - 18_000, t.y_um - 14_000))
    shot = shoot(here, target, Lie(80.0, -50.0, 180.0), np.random.default_rng(1))
    about_um = (target.x_um, target.y_um)
    return explain(refused(here, target, shot), shot.frame, shot.assumed, about_um, whole, draw_whole(other))


def test_where_both_sides_look_alike_neither_a_turn_nor_a_side_is_named() -> None:
    answer = _turned_in_the_middle(sides()[0])
    assert answer.reason is Refusal.NOT_THIS_BOARD
    assert "turned by 180 degrees" in answer.message
    assert "other side up" in answer.message


def test_what_would_take_the_board_out_of_its_nest_makes_no_doubt() -> None:
    answer = _turned_in_the_middle(_moved_all(sides()[0], 11_000.0))
    assert answer.reason is Refusal.BOARD_TURNED


@pytest.mark.parametrize(("agreement", "reason"), [(0.7, Refusal.NOT_THIS_BOARD), (0.8, Refusal.WRONG_PLACE)])
def test_a_board_far_off_its_nest_has_to_explain_more(agreement: float, reason: Refusal) -> None:
    far = Way(False, 0.0, 0.0, 0.0, agreement, (30_000.0, 0.0), 30_000.0)
    assert named(NotRegistered(Refusal.AMBIGUOUS, "two fit"), [far], 0.1).reason is reason
    near = replace(far, off_um=(5000.0, 0.0), middle_off_um=5000.0)
    assert named(NotRegistered(Refusal.AMBIGUOUS, "two fit"), [near], 0.1).reason is Refusal.WRONG_PLACE


def _corner_of(layers: SideLayers, x_um: float, y_um: float) -> SideLayers:
    """Return a side that begins at a place of another, and is like it from there on."""

    def there(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        far = (p for p in polygons if (p.points_um > (x_um, y_um)).all())
        return tuple(replace(p, points_um=p.points_um - (x_um, y_um)) for p in far)

    holes = tuple(replace(h, x_um=h.x_um - x_um, y_um=h.y_um - y_um) for h in layers.holes)
    return replace(
        layers, copper=there(layers.copper), openings=there(layers.openings), ink=there(layers.ink),
        holes=tuple(h for h in holes if h.x_um > 0.0 and h.y_um > 0.0),
    )  # fmt: skip


def test_a_side_that_has_most_of_what_is_bright_beside_it_explains_nothing() -> None:
    """Agreement asks for what lies on the board alone: of a corner that fits, it knows nothing of the rest."""
    here, _, unlike, _, _ = sides()
    target = Target(14_000.0, 11_000.0, circle(14_000.0, 11_000.0, 700.0))
    shot = shoot(here, target, Lie(), np.random.default_rng(2))
    other = draw_whole(_corner_of(here, target.x_um, target.y_um))
    answer = register(prepare(here, (target.x_um, target.y_um)), shot.frame, shot.assumed, None)
    assert isinstance(answer, Registration)
    poor = NotRegistered(Refusal.NOT_THIS_BOARD, "little of it agrees", replace(answer, agreement=0.5))
    about_um = (target.x_um, target.y_um)
    named = explain(poor, shot.frame, shot.assumed, about_um, draw_whole(unlike), other)
    assert named.reason is Refusal.NOT_THIS_BOARD
