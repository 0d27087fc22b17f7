"""The needle is up only where drives with a sure reference have said so, and each touch is counted once."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.station.needle import HEIGHT_WINDOW_UM, Needle, NeedlePlace
from daemon.station.sight import Sight
from drivers.gantry import Position

SAFE_UM, WORK_UM, TOUCH_UM = 12_000.0, 5_200.0, 5_000.0


def at(z_um: float, x_um: float = 0.0) -> Position:
    return Position(x_um, 0.0, z_um, 0.0)


class Watched:
    """A needle, the doubts about it, and the touches that it told of."""

    def __init__(self) -> None:
        self.doubtful = False
        self.touches = 0
        self.needle = Needle(lambda: self.doubtful, self._touched)
        self.needle.adopt(lambda _at: WORK_UM, lambda _at: TOUCH_UM)

    def _touched(self) -> None:
        self.touches += 1


@pytest.fixture
def watched() -> Watched:
    return Watched()


def test_nothing_is_known_before_a_drive_has_told(watched: Watched) -> None:
    needle = watched.needle
    assert (needle.place, needle.z_um, needle.is_up, needle.may_be_down) == (NeedlePlace.UNKNOWN, None, False, True)


@pytest.mark.parametrize(
    ("z_um", "place"),
    [
        (SAFE_UM, NeedlePlace.UP),
        (WORK_UM - HEIGHT_WINDOW_UM, NeedlePlace.UP),
        (WORK_UM - HEIGHT_WINDOW_UM - 0.1, NeedlePlace.DOWN),
        (TOUCH_UM - 100.0, NeedlePlace.DOWN),
    ],
)
def test_it_is_up_at_the_height_of_looks_and_above(watched: Watched, z_um: float, place: NeedlePlace) -> None:
    watched.needle.reported(at(z_um))
    assert (watched.needle.place, watched.needle.z_um) == (place, z_um)


def test_the_height_of_looks_may_follow_the_surface(watched: Watched) -> None:
    watched.needle.adopt(lambda here: WORK_UM + here.x_um, lambda here: TOUCH_UM + here.x_um)
    watched.needle.reported(at(WORK_UM, x_um=300.0))
    assert not watched.needle.is_up
    watched.needle.reported(at(WORK_UM, x_um=-300.0))
    assert watched.needle.is_up


def test_a_descent_is_down_from_its_beginning_and_a_rise_is_up_at_its_end(watched: Watched) -> None:
    needle = watched.needle
    needle.reported(at(WORK_UM))
    needle.departs(at(TOUCH_UM))
    assert (needle.place, needle.z_um) == (NeedlePlace.DOWN, None)
    needle.reported(at(TOUCH_UM))
    needle.departs(at(SAFE_UM))
    assert needle.place is NeedlePlace.DOWN
    needle.reported(at(SAFE_UM))
    assert needle.is_up


def test_a_move_between_places_above_is_up_all_the_way(watched: Watched) -> None:
    watched.needle.reported(at(SAFE_UM))
    watched.needle.departs(at(WORK_UM))
    assert watched.needle.is_up
    assert watched.needle.z_um is None, "how high it is nobody knows before it has arrived"


def test_a_doubt_makes_it_unknown_and_does_not_take_it_down(watched: Watched) -> None:
    watched.needle.reported(at(SAFE_UM))
    watched.doubtful = True
    needle = watched.needle
    assert (needle.place, needle.z_um, needle.is_up, needle.may_be_down) == (NeedlePlace.UNKNOWN, None, False, False)
    needle.forget()
    watched.doubtful = False
    assert (needle.place, needle.may_be_down) == (NeedlePlace.UNKNOWN, True)


def test_unless_it_is_up_only_what_is_straight_above_or_below_is_allowed(watched: Watched) -> None:
    needle = watched.needle
    needle.reported(at(TOUCH_UM))
    needle.refuse_sideways(at(TOUCH_UM), at(SAFE_UM, x_um=1.0))
    with pytest.raises(Fault) as caught:
        needle.refuse_sideways(at(TOUCH_UM), at(SAFE_UM, x_um=3.0))
    assert caught.value.kind is FaultCode.NEEDLE_DOWN
    assert caught.value.detail["z_um"] == TOUCH_UM
    needle.reported(at(SAFE_UM))
    needle.refuse_sideways(at(SAFE_UM), at(SAFE_UM, x_um=30_000.0))


def test_a_turn_is_counted_the_short_way_round(watched: Watched) -> None:
    watched.needle.reported(at(TOUCH_UM))
    watched.needle.refuse_sideways(Position(0.0, 0.0, TOUCH_UM, -0.02), Position(0.0, 0.0, TOUCH_UM, 359.99))
    with pytest.raises(Fault):
        watched.needle.refuse_sideways(Position(0.0, 0.0, TOUCH_UM, -0.02), Position(0.0, 0.0, TOUCH_UM, 359.0))


def test_a_touch_is_counted_once_from_the_surface_down_and_back_above_it(watched: Watched) -> None:
    for z_um in (SAFE_UM, TOUCH_UM, TOUCH_UM - 100.0, TOUCH_UM - 200.0, WORK_UM, TOUCH_UM - 1.0, SAFE_UM):
        watched.needle.reported(at(z_um))
    assert watched.touches == 2


def test_a_needle_found_pressed_at_the_start_is_no_touch_of_this_daemon(watched: Watched) -> None:
    watched.needle.reported(at(TOUCH_UM - 100.0))
    watched.needle.reported(at(TOUCH_UM - 200.0))
    assert watched.touches == 0


@pytest.mark.parametrize("end", [lambda needle: needle.departs(at(SAFE_UM)), lambda needle: needle.forget()])
def test_what_a_look_has_shown_holds_until_the_head_moves(watched: Watched, end: Callable[[Needle], None]) -> None:
    needle = watched.needle
    needle.sight = seen = Sight((31.0, 24.0), (32.5, 24.0), 1.1, 20.0, since_s=5.0)
    needle.reported(at(WORK_UM))
    assert needle.sight is seen
    end(needle)
    assert needle.sight is None
