"""A point counts as below the tip only where its own client put the head there just now, and nothing moved since."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.station.needle import Needle
from daemon.station.stand import Stand
from drivers.gantry import Position
from tests.daemon.clock import Clock

HERE = Position(50_000.0, 40_000.0, 5_200.0, -20.0)
WITHIN_S = 60.0


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def stand(clock: Clock) -> Stand:
    known = Stand(clock)
    known.came("TP7", "tester-1", HERE, seen=True)
    return known


def _refused(stand: Stand, point: str = "TP7", key: str = "tester-1", here: Position = HERE) -> str:
    with pytest.raises(Fault) as caught:
        stand.require(point, key, here, WITHIN_S)
    assert caught.value.kind is FaultCode.NOT_AT_TEST_POINT
    return caught.value.message


def test_a_press_uses_the_look_up(stand: Stand) -> None:
    assert stand.require("TP7", "tester-1", HERE, WITHIN_S)
    stand.pressed()
    assert not stand.require("TP7", "tester-1", HERE, WITHIN_S)
    stand.came("TP7", "tester-1", HERE, seen=True)
    assert stand.require("TP7", "tester-1", HERE, WITHIN_S)


@pytest.mark.parametrize(
    "moved", [{"x_um": 50_004.0}, {"y_um": 39_996.0}, {"theta_deg": -19.94}], ids=lambda moved: str(*moved)
)
def test_a_head_that_moved_aside_is_elsewhere(stand: Stand, moved: dict[str, float]) -> None:
    assert "has moved" in _refused(stand, here=replace(HERE, **moved))


def test_straight_up_and_down_is_no_move_aside(stand: Stand) -> None:
    assert stand.require("TP7", "tester-1", replace(HERE, z_um=12_000.0), WITHIN_S)


def test_theta_is_the_same_after_a_turn(stand: Stand) -> None:
    assert stand.require("TP7", "tester-1", replace(HERE, theta_deg=340.0), WITHIN_S)


def test_another_point_or_another_client_is_refused(stand: Stand) -> None:
    assert "nobody" in _refused(stand, point="TP8")
    assert "another client" in _refused(stand, key="tester-2")


def test_a_stand_of_long_ago_is_refused(stand: Stand, clock: Clock) -> None:
    clock.now_s += WITHIN_S + 1.0
    assert "61 s ago" in _refused(stand)


def test_a_point_that_was_seen_beside_the_tip_is_not_touched_before_it_is_seen_below_it(stand: Stand) -> None:
    stand.beside("TP8", 640.0)
    assert stand.require("TP7", "tester-1", HERE, WITHIN_S), "another point's place is not this one's"
    stand.beside("TP7", 640.0)
    with pytest.raises(Fault, match="640 um") as caught:
        stand.require("TP7", "tester-1", HERE, WITHIN_S)
    assert caught.value.kind is FaultCode.LOOK_NEEDED
    stand.came("TP7", "tester-1", HERE, seen=True)
    assert stand.require("TP7", "tester-1", HERE, WITHIN_S)


def test_with_the_reference_the_stand_is_given_up() -> None:
    needle = Needle()
    needle.stand.came("TP7", "", HERE, seen=True)
    needle.forget()
    assert "nobody" in _refused(needle.stand, key="")
