"""When a move is over and when it never will be, judged look by look; time is set by hand."""

import re
from dataclasses import replace

import pytest

from drivers.errors import LimitHit, MotionError, Stalled
from drivers.l4118.arrival import ArrivalWatch
from drivers.l4118.contract import AxisConfig, AxisStatus
from drivers.l4118.objects import (
    DI_NEGATIVE_LIMIT,
    DI_POSITIVE_LIMIT,
    SW_LIMIT_EXCEEDED,
    SW_MODE_ERROR,
    SW_TARGET_REACHED,
)

WINDOW, STALL_S = 1.0, 2.0
CONFIG = AxisConfig("Z", 3, 1638.4, 0.0, 30000.0, 20000.0, 100000.0, WINDOW, stall_s=STALL_S)
BACKWARDS = replace(CONFIG, increments_per_unit=-1638.4)
START, TARGET, NOW_S = 100.0, 500.0, 50.0


def _watch(config: AxisConfig = CONFIG, start: float = START, target: float = TARGET) -> ArrivalWatch:
    return ArrivalWatch(config, start, target, NOW_S)


def _at(position: float, statusword: int = 0, inputs: int = 0) -> AxisStatus:
    return AxisStatus(statusword, 1, position, inputs)


@pytest.mark.parametrize("off", [0.0, WINDOW, -WINDOW])
def test_a_move_is_over_where_the_drive_says_so_within_the_window(off: float) -> None:
    assert _watch().arrived(_at(TARGET + off, SW_TARGET_REACHED), NOW_S)


@pytest.mark.parametrize("off", [WINDOW * 1.25, -WINDOW * 1.25])
def test_a_move_is_not_over_outside_the_window_whatever_the_drive_says(off: float) -> None:
    assert not _watch().arrived(_at(TARGET + off, SW_TARGET_REACHED), NOW_S)


def test_a_move_is_not_over_on_the_target_before_the_drive_says_so() -> None:
    assert not _watch().arrived(_at(TARGET), NOW_S)


def test_a_following_error_is_a_stall_at_once() -> None:
    with pytest.raises(Stalled, match="following error") as caught:
        _watch().arrived(_at(300.0, SW_MODE_ERROR), NOW_S)
    assert caught.value.device == "Z"


def test_an_axis_that_has_arrived_is_not_asked_for_a_following_error() -> None:
    assert _watch().arrived(_at(TARGET, SW_TARGET_REACHED | SW_MODE_ERROR), NOW_S)


@pytest.mark.parametrize(
    ("config", "target", "inputs", "which"),
    [
        (CONFIG, TARGET, DI_POSITIVE_LIMIT, "positive"),
        (CONFIG, -TARGET, DI_NEGATIVE_LIMIT, "negative"),
        (BACKWARDS, TARGET, DI_NEGATIVE_LIMIT, "negative"),
        (BACKWARDS, -TARGET, DI_POSITIVE_LIMIT, "positive"),
    ],
)
def test_the_limit_switch_a_move_runs_into_ends_it(config: AxisConfig, target: float, inputs: int, which: str) -> None:
    """The switches are the motor's: an axis that counts against its motor meets the other one."""
    with pytest.raises(LimitHit, match=f"{which} limit switch at 20.000, on the way to {target:.3f}") as caught:
        _watch(config, target=target).arrived(_at(20.0, 0, inputs), NOW_S)
    assert caught.value.device == "Z"
    other = (DI_POSITIVE_LIMIT | DI_NEGATIVE_LIMIT) ^ inputs  # where it came from
    assert not _watch(config, target=target).arrived(_at(20.0, 0, other), NOW_S)


@pytest.mark.parametrize(("way", "inputs"), [(0.5, DI_POSITIVE_LIMIT), (-0.5, DI_NEGATIVE_LIMIT)])
def test_the_shortest_move_has_a_direction_too(way: float, inputs: int) -> None:
    coarse = replace(CONFIG, increments_per_unit=1.0)
    with pytest.raises(LimitHit):
        _watch(coarse, start=TARGET - way).arrived(_at(TARGET - 3.0, 0, inputs), NOW_S)


def test_a_move_to_where_the_axis_stands_meets_no_limit_switch() -> None:
    watch = _watch(start=TARGET)
    assert not watch.arrived(_at(TARGET + 3.0, 0, DI_POSITIVE_LIMIT | DI_NEGATIVE_LIMIT), NOW_S)


@pytest.mark.parametrize("off", [0.0, -WINDOW])
def test_a_limit_switch_within_the_window_of_the_target_is_no_trouble(off: float) -> None:
    assert not _watch().arrived(_at(TARGET + off, 0, DI_POSITIVE_LIMIT), NOW_S)


def test_an_axis_that_stands_still_longer_than_the_stall_time_has_stalled() -> None:
    watch = _watch()
    assert not watch.arrived(_at(START), NOW_S + STALL_S)
    with pytest.raises(Stalled, match=re.escape("stands at 100.000, 400.000 short of 500.000")) as caught:
        watch.arrived(_at(START), NOW_S + STALL_S + 0.125)
    assert caught.value.device == "Z"


@pytest.mark.parametrize("step", [WINDOW, -WINDOW])
def test_an_axis_that_creeps_by_more_than_half_the_window_has_not_stalled(step: float) -> None:
    watch, position, now_s = _watch(start=300.0), 300.0, NOW_S
    for _ in range(5):
        position, now_s = position + 0.75 * step, now_s + STALL_S
        assert not watch.arrived(_at(position), now_s)
    # From the last step on it has the whole time again, and no longer
    assert not watch.arrived(_at(position), now_s + STALL_S)
    with pytest.raises(Stalled):
        watch.arrived(_at(position), now_s + STALL_S + 0.125)


def test_a_tremor_of_half_the_window_is_a_stall() -> None:
    watch = _watch()
    assert not watch.arrived(_at(START + WINDOW / 2), NOW_S + STALL_S)
    with pytest.raises(Stalled):
        watch.arrived(_at(START - WINDOW / 2), NOW_S + STALL_S + 0.125)


def test_a_stall_at_a_limit_inside_the_drive_is_told_as_one() -> None:
    with pytest.raises(MotionError, match=r"short of 500\.000: the drive reports an internal limit") as caught:
        _watch().arrived(_at(START, SW_LIMIT_EXCEEDED), NOW_S + STALL_S + 0.125)
    assert type(caught.value) is LimitHit
    assert caught.value.device == "Z"
