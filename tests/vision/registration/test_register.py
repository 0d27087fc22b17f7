import pickle
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.vision.registration.drawn import Lie, Shot, box, moved, pin_row, shoot, some_board, without
from vision.registration import (
    NotRegistered,
    Polygon,
    Refusal,
    Registration,
    SideLayers,
    Target,
    follow,
    index_side,
    prepare,
    register,
)
from vision.registration.register import decide

WRONG_PX = 4.0


@lru_cache(maxsize=4)
def board(seed: int = 3) -> tuple[SideLayers, list[Target]]:
    return some_board(seed)


def found(
    layers: SideLayers, target: Target | None, shot: Shot, about: tuple[float, float] | None = None
) -> Registration | NotRegistered:
    place = about or ((0.0, 0.0) if target is None else (target.x_um, target.y_um))
    return register(prepare(layers, place), shot.frame, shot.assumed, target, shot.hidden_px)


def off_px(answer: Registration | NotRegistered, shot: Shot, target: Target) -> float:
    assert isinstance(answer, Registration), answer
    return float(np.hypot(*(np.asarray(answer.target_px) - shot.truth_px(target))))


def test_a_near_board_is_found_to_a_fraction_of_a_pixel_with_an_honest_sigma() -> None:
    layers, targets = board()
    rng = np.random.default_rng(1)
    off, own = [], []
    for target in targets[:10]:
        shot = shoot(layers, target, Lie(*rng.uniform(-60, 60, 2), turn_deg=rng.normal(0, 0.1)), rng)
        answer = found(layers, target, shot)
        off.append(off_px(answer, shot, target))
        assert isinstance(answer, Registration)
        miss = np.asarray(answer.target_um) - shot.truth_um(target)
        own.append(float(miss @ np.linalg.solve(answer.covariance_um2, miss)) / 2)
    assert np.sqrt(np.mean(np.square(off))) < 0.2
    assert 0.3 < np.sqrt(np.mean(own)) < 2.0


def test_a_board_displaced_by_the_way_to_another_pad_of_the_size_is_not_mistaken() -> None:
    layers, targets = board()
    rng = np.random.default_rng(2)
    tried = 0
    for target in targets:
        size = np.ptp(target.outline_um, axis=0)
        for other in targets:
            way = np.array((target.x_um - other.x_um, target.y_um - other.y_um))
            alike = np.abs(np.ptp(other.outline_um, axis=0) - size).max() < 30.0
            if not alike or not 400.0 < np.hypot(*way) < 3000.0 or tried >= 8:
                continue
            tried += 1
            shot = shoot(layers, target, Lie(*way), rng)
            assert off_px(found(layers, target, shot), shot, target) < WRONG_PX
    assert tried == 8


def test_a_displacement_beyond_the_search_is_refused() -> None:
    layers, targets = board()
    rng = np.random.default_rng(3)
    for target in targets[:6]:
        shot = shoot(layers, target, Lie(*rng.choice([-1, 1], 2) * rng.uniform(3600, 4500, 2)), rng)
        assert not found(layers, target, shot)


@pytest.mark.parametrize("turn_deg", [90.0, 180.0, -90.0])
def test_a_turned_board_is_refused(turn_deg: float) -> None:
    layers, targets = board()
    rng = np.random.default_rng(4)
    for target in targets[:4]:
        assert not found(layers, target, shoot(layers, target, Lie(turn_deg=turn_deg), rng))


def test_another_board_and_no_board_are_refused() -> None:
    layers, targets = board()
    other, _ = board(8)
    rng = np.random.default_rng(5)
    for target in targets[:4]:
        assert not found(layers, target, shoot(other, target, Lie(), rng))
        assert not found(layers, target, shoot(None, target, Lie(), rng))


def test_a_needle_over_the_target_does_not_move_it() -> None:
    layers, targets = board()
    rng = np.random.default_rng(6)
    for target in targets[:8]:
        shot = shoot(layers, target, Lie(*rng.uniform(-60, 60, 2)), rng, needle=True)
        assert off_px(found(layers, target, shot), shot, target) < 0.8


def test_dirt_is_never_a_reason_for_another_place() -> None:
    layers, targets = board()
    rng = np.random.default_rng(7)
    right = 0
    for target in targets[:10]:
        shot = shoot(layers, target, Lie(*rng.uniform(-300, 300, 2)), rng, dirt=120)
        answer = found(layers, target, shot)
        if answer:
            assert off_px(answer, shot, target) < WRONG_PX
            right += 1
    assert right >= 8


def test_a_board_without_ink_is_found_though_cad_has_some() -> None:
    layers, targets = board()
    rng = np.random.default_rng(8)
    for target in targets[:4]:
        shot = shoot(replace(layers, ink=()), target, Lie(900.0, -700.0), rng)
        answer = register(prepare(layers, (target.x_um, target.y_um)), shot.frame, shot.assumed, target)
        best = answer if isinstance(answer, Registration) else answer.best
        assert best is not None
        assert np.hypot(*(np.asarray(best.target_px) - shot.truth_px(target))) < WRONG_PX


def test_a_pin_row_whose_ends_are_out_of_the_frame_is_ambiguous_never_wrong() -> None:
    layers, pins = pin_row(16)
    rng = np.random.default_rng(9)
    for way in (0.0, 2540.0, -2540.0, 5080.0):
        shot = shoot(layers, pins[8], Lie(way, 0.0), rng)
        answer = found(layers, pins[8], shot)
        assert isinstance(answer, NotRegistered)
        assert answer.reason in {Refusal.AMBIGUOUS, Refusal.NOT_THIS_BOARD}


def test_a_pin_row_with_an_end_in_the_frame_is_counted_from_it() -> None:
    layers, pins = pin_row(16)
    rng = np.random.default_rng(10)
    for way in (0.0, 2540.0):
        shot = shoot(layers, pins[1], Lie(way, 0.0), rng)
        assert off_px(found(layers, pins[1], shot), shot, pins[1]) < WRONG_PX


def test_a_pad_that_is_not_there_is_named_though_the_board_is_found() -> None:
    layers, targets = board()
    target = targets[0]
    shot = shoot(without(layers, target), target, Lie(50.0, 20.0), np.random.default_rng(11))
    answer = found(layers, target, shot)
    assert isinstance(answer, NotRegistered)
    assert answer.reason is Refusal.TARGET_NOT_CONFIRMED
    assert answer.best is not None


def test_a_pad_moved_against_the_rest_is_followed() -> None:
    layers, targets = board()
    rng = np.random.default_rng(12)
    for target in targets[:4]:
        shot = shoot(moved(layers, target, 36.0, -24.0), target, Lie(), rng)
        answer = found(layers, target, shot)
        assert isinstance(answer, Registration)
        there = replace(target, x_um=target.x_um + 36.0, y_um=target.y_um - 24.0)
        assert off_px(answer, shot, there) < 1.0
        assert 25.0 < np.hypot(*answer.off_rest_um) < 60.0


def test_parts_that_cad_tells_of_do_not_disturb() -> None:
    layers, targets = board()
    rng = np.random.default_rng(13)
    for target in targets[:5]:
        ways = rng.uniform(-6000, 6000, (14, 2))
        bodies = tuple(Polygon(box(target.x_um + x, target.y_um + y, 1800, 1200))
                       for x, y in ways if max(abs(x), abs(y)) > 1700)  # fmt: skip
        assembled = replace(layers, bodies=bodies)
        shot = shoot(assembled, target, Lie(40.0, 30.0), rng, bodies_level=float(rng.uniform(10, 150)))
        assert off_px(found(assembled, target, shot), shot, target) < WRONG_PX


@pytest.mark.parametrize(
    ("metal_seen", "confirmed", "accepted"), [(0.95, 0.75, True), (0.8, 0.75, False), (0.95, 0.62, False)]
)
def test_a_look_for_the_board_alone_may_agree_less_where_its_metal_and_the_edges_of_it_are_all_seen(
    metal_seen: float, confirmed: float, *, accepted: bool
) -> None:
    layers, targets = board()
    shot = shoot(layers, targets[0], Lie(30.0, -20.0), np.random.default_rng(7))
    clean = found(layers, None, shot, (targets[0].x_um, targets[0].y_um))
    assert isinstance(clean, Registration)
    near = replace(clean.near, confirmed=confirmed, soldered=True)
    strewn = replace(clean, agreement=0.66, metal_seen=metal_seen, near=near, assembled=True)
    assert isinstance(decide(strewn), Registration) is accepted
    assert isinstance(decide(replace(strewn, agreement=0.58)), NotRegistered)


def test_the_board_alone_may_be_asked_for() -> None:
    layers, targets = board()
    shot = shoot(layers, targets[0], Lie(200.0, -100.0), np.random.default_rng(14))
    answer = found(layers, None, shot, (targets[0].x_um, targets[0].y_um))
    assert isinstance(answer, Registration)
    assert answer.at_target is None
    assert np.allclose(answer.shift_um, (200.0, -100.0), atol=5.0)


def test_a_board_is_followed_and_one_that_moved_meanwhile_is_noticed() -> None:
    layers, targets = board()
    target = targets[2]
    reference = prepare(index_side(layers), (target.x_um, target.y_um))
    rng = np.random.default_rng(15)
    first = shoot(layers, target, Lie(150.0, 80.0), rng)
    answer = register(reference, first.frame, first.assumed, target)
    assert isinstance(answer, Registration)
    second = shoot(layers, target, Lie(150.0, 80.0), rng, needle=True)
    again = follow(reference, second.frame, second.assumed, target, answer, second.hidden_px)
    assert off_px(again, second, target) < 0.8
    for lie in (Lie(750.0, 80.0), Lie(150.0, 80.0, turn_deg=180.0)):
        third = shoot(layers, target, lie, rng)
        lost = follow(reference, third.frame, third.assumed, target, answer)
        assert isinstance(lost, NotRegistered)
        assert lost.reason is Refusal.WRONG_PLACE


def test_a_frame_without_light_is_refused_as_such() -> None:
    layers, targets = board()
    shot = shoot(layers, targets[0], Lie(), np.random.default_rng(16), gain=0.01)
    answer = found(layers, targets[0], shot)
    assert isinstance(answer, NotRegistered)
    assert answer.reason is Refusal.FRAME_UNUSABLE


def test_a_wrong_array_is_a_value_error() -> None:
    layers, targets = board()
    reference = prepare(layers, (targets[0].x_um, targets[0].y_um))
    with pytest.raises(ValueError, match="uint8"):
        register(reference, np.zeros((10, 10, 3)), np.eye(3), targets[0])  # type: ignore[arg-type]


def test_a_reference_may_be_made_elsewhere_and_sent() -> None:
    layers, targets = board()
    target = targets[0]
    sent = pickle.loads(pickle.dumps(prepare(layers, (target.x_um, target.y_um))))  # noqa: S301 -- our own
    shot = shoot(layers, target, Lie(10.0, 20.0), np.random.default_rng(17))
    assert off_px(register(sent, shot.frame, shot.assumed, target), shot, target) < WRONG_PX
