"""The legs of a move, and the coordinate of the head."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import EnvelopeViolation
from drivers.gantry import Approach, GantryConfig, Position, axis_theta_deg
from drivers.gantry.path import Ends, Leg, plan

ENDS = Ends((0.0, 200000.0), (0.0, 150000.0), (0.0, 30000.0), (-220.0, 100.0))
CONFIG = GantryConfig()


def _ways(*planned: Any) -> list[Mapping[str, float]]:
    """Return where the legs go, whatever their speed."""
    return [leg.to for leg in plan(*planned)]


def places() -> st.SearchStrategy[Position]:
    return st.builds(
        Position,
        st.floats(*ENDS.x_um),
        st.floats(*ENDS.y_um),
        st.floats(*ENDS.z_um),
        st.floats(*ENDS.theta_deg),
    )


def targets() -> st.SearchStrategy[Position]:
    """Draw places with the room that every approach needs, from either side in X."""
    play_um, play_deg = CONFIG.backlash_um, CONFIG.backlash_theta_deg
    return st.builds(
        Position,
        st.floats(ENDS.x_um[0] + play_um, ENDS.x_um[1] - play_um),
        st.floats(ENDS.y_um[0] + play_um, ENDS.y_um[1]),
        st.floats(*ENDS.z_um),
        st.floats(ENDS.theta_deg[0] + play_deg, ENDS.theta_deg[1]),
    )


@given(places(), targets(), st.sampled_from([0.0, 30.0]))
def test_every_path_is_safe(now: Position, target: Position, backlash_z_um: float) -> None:
    """It should move sideways only at the safe height, end on the target, and come to it from below."""
    config = GantryConfig(backlash_z_um=backlash_z_um)
    at = {"x": now.x_um, "y": now.y_um, "z": now.z_um, "theta": now.theta_deg}
    ranges = {"x": ENDS.x_um, "y": ENDS.y_um, "z": ENDS.z_um, "theta": ENDS.theta_deg}
    backlash = {"x": config.backlash_um, "y": config.backlash_um, "theta": config.backlash_theta_deg}
    for leg in plan(now, target, config, ENDS):
        for name, to in leg.to.items():
            low, high = ranges[name]
            assert low <= to <= high
            if name != "z":
                assert at["z"] >= config.safe_z_um
            if name != "z" and to == getattr(target, f"{name}_{'deg' if name == 'theta' else 'um'}"):
                assert at[name] <= to - backlash[name] or at[name] == to, "the final approach is from below"
            at[name] = to
    assert at["z"] == target.z_um
    assert abs(at["x"] - target.x_um) <= config.same_place_um
    assert abs(at["y"] - target.y_um) <= config.same_place_um
    assert abs(at["theta"] - target.theta_deg) <= config.same_place_deg


@pytest.mark.parametrize(
    ("change", "from_above", "says"),
    [
        ({"x_um": 49.0}, frozenset(), "x 49.0000 is too near to the end 0: to come from below, 50 are needed"),
        ({"y_um": 0.0}, frozenset(), "y 0.0000 is too near to the end 0"),
        ({"theta_deg": -219.5}, frozenset(), "theta -219.5000 is too near to the end -220"),
        ({"x_um": 199_960.0}, frozenset({"x"}), "to come from above, 50 are needed"),
    ],
)
def test_a_target_without_room_for_its_approach_is_refused(
    change: dict[str, float], from_above: frozenset[str], says: str
) -> None:
    """It should say which axis, and how much room it needs; with just that much it goes."""
    now = Position(5000.0, 5000.0, 20000.0, 0.0)
    with pytest.raises(EnvelopeViolation, match=says):
        plan(now, replace(now, **change), CONFIG, ENDS, from_above)
    assert [leg.to for leg in plan(now, replace(now, x_um=50.0), CONFIG, ENDS)[:2]] == [{"x": 0.0}, {"x": 50.0}]


def test_a_pure_z_move_needs_no_retract() -> None:
    """It should go straight."""
    now, target = Position(5000.0, 5000.0, 5200.0, 0.0), Position(5000.2, 5000.0, 5300.0, 0.0)
    assert _ways(now, target, CONFIG, ENDS) == [{"z": 5300.0}]
    slow = GantryConfig(backlash_z_um=20.0)
    assert _ways(now, target, slow, ENDS) == [{"z": 5320.0}, {"z": 5300.0}]
    assert _ways(now, Position(5000.0, 5000.0, 5000.0, 0.0), slow, ENDS) == [{"z": 5000.0}]


def test_the_smallest_play_of_z_is_approached_from_above_and_an_axis_that_is_there_stays() -> None:
    """It should lower by the play even of half a micrometre, and name no leg that goes nowhere."""
    target = Position(5000.0, 5000.0, 5300.0, 0.0)
    fine = GantryConfig(backlash_z_um=0.5)
    assert _ways(replace(target, z_um=5200.0), target, fine, ENDS) == [{"z": 5300.5}, {"z": 5300.0}]
    assert _ways(replace(target, z_um=5300.5), target, fine, ENDS) == [{"z": 5300.0}]


def test_z_comes_from_no_higher_than_its_range() -> None:
    top = ENDS.z_um[1]
    now, target = Position(5000.0, 5000.0, 5200.0, 0.0), Position(5000.0, 5000.0, top - 10.0, 0.0)
    assert _ways(now, target, GantryConfig(backlash_z_um=20.0), ENDS) == [{"z": top}, {"z": top - 10.0}]


def test_a_head_at_the_safe_height_goes_across_at_once() -> None:
    now, target = Position(1000.0, 5000.0, CONFIG.safe_z_um, 0.0), Position(9000.0, 5000.0, 5200.0, 0.0)
    assert _ways(now, target, CONFIG, ENDS) == [{"x": 9000.0}, {"z": 5200.0}]


@pytest.mark.parametrize("off_um", [CONFIG.same_place_um, -CONFIG.same_place_um])
def test_an_axis_as_near_as_the_same_place_stays_and_one_farther_off_moves(off_um: float) -> None:
    now = Position(5000.0, 5000.0, 20000.0, 0.0)
    assert _ways(now, replace(now, x_um=5000.0 + off_um), CONFIG, ENDS) == [{"z": 20000.0}]
    assert _ways(now, replace(now, x_um=5000.0 + 1.25 * off_um), CONFIG, ENDS)[-2] == {"x": 5000.0 + 1.25 * off_um}


@pytest.mark.parametrize(("from_above", "side"), [(frozenset(), -1.0), (frozenset({"x"}), 1.0)])
def test_an_axis_that_stands_off_by_the_play_on_the_right_side_goes_straight(
    from_above: frozenset[str], side: float
) -> None:
    target = Position(5000.0, 5000.0, 20000.0, 0.0)
    now = replace(target, x_um=5000.0 + side * CONFIG.backlash_um)
    assert _ways(now, target, CONFIG, ENDS, from_above) == [{"x": 5000.0}, {"z": 20000.0}]
    nearer = replace(target, x_um=5000.0 + side * (CONFIG.backlash_um - 1.0))
    assert _ways(nearer, target, CONFIG, ENDS, from_above)[0] == {"x": now.x_um}


def test_a_small_correction_retracts_and_comes_from_below() -> None:
    """It should take the whole way for the smallest lateral correction."""
    now, target = Position(5000.0, 5000.0, 5200.0, 10.0), Position(4990.0, 5008.0, 5200.0, 10.0)
    assert _ways(now, target, CONFIG, ENDS) == [
        {"z": 12000.0},
        {"x": 4940.0, "y": 4958.0},
        {"x": 4990.0, "y": 5008.0},
        {"z": 5200.0},
    ]


def test_an_axis_already_below_goes_straight() -> None:
    """It should not back off where the way comes from the right side anyway."""
    now, target = Position(1000.0, 2000.0, 20000.0, 0.0), Position(9000.0, 9000.0, 12000.0, 90.0)
    assert _ways(now, target, CONFIG, ENDS) == [
        {"x": 9000.0, "y": 9000.0, "theta": 90.0},
        {"z": 12000.0},
    ]


@pytest.mark.parametrize(
    ("head", "axis"),
    [(0, 0), (100, 100), (140, -220), (180, -180), (359.5, -0.5), (360, 0), (-220, -220), (-90, -90), (460, 100)],
)
def test_head_angles_become_axis_coordinates(head: float, axis: float) -> None:
    """It should leave the forbidden band out of the coordinate."""
    assert axis_theta_deg(head) == pytest.approx(axis)


@pytest.mark.parametrize(("read_back", "end"), [(-220.0001, -220.0), (100.0001, 100.0), (-220.0009, -220.0)])
def test_a_rounded_increment_outside_of_an_end_is_the_end(read_back: float, end: float) -> None:
    """It should take what a drive at the end reads back."""
    assert axis_theta_deg(read_back) == pytest.approx(end, abs=1e-9)


@pytest.mark.parametrize("head", [100.1, 101.0, 120.0, 139.0, 139.9, -240.0, 480.0])
def test_the_forbidden_band_is_refused(head: float) -> None:
    """It should not turn the head into it, whatever the turn it is written in."""
    with pytest.raises(EnvelopeViolation, match="forbidden band"):
        axis_theta_deg(head)


@given(st.floats(-220.0, 100.0))
def test_an_answer_is_a_target(axis_deg: float) -> None:
    """It should take the coordinate it gives as a target for the same place."""
    assert axis_theta_deg(axis_deg) == pytest.approx(axis_deg, abs=1e-6)


@given(places(), targets())
def test_an_axis_asked_to_come_from_above_does_and_the_others_do_not(now: Position, target: Position) -> None:
    """Whoever measures the play needs both sides; every other rule of a path holds for both."""
    at = {"x": now.x_um, "y": now.y_um, "z": now.z_um}
    for leg in plan(now, target, CONFIG, ENDS, frozenset({"x"})):
        for name, to in leg.to.items():
            if name in ("x", "y"):
                assert at["z"] >= CONFIG.safe_z_um
            if name == "x" and to == target.x_um:
                before = target.x_um + CONFIG.backlash_um
                assert at["x"] >= before or at["x"] == to
            if name == "y" and to == target.y_um:
                before = target.y_um - CONFIG.backlash_um
                assert at["y"] <= before or at["y"] == to
            if name in at:
                at[name] = to
    assert at["z"] == target.z_um


# --- slowly where a surface may be --------------------------------------------------------------------------------

SLOW = GantryConfig(slow_z_um=5500.0, slow_um_s=2000.0)


def test_below_the_highest_possible_surface_z_goes_down_slowly() -> None:
    """It should go fast to where a surface may be, slowly from there on, and fast up again."""
    now = Position(5000.0, 5000.0, 12000.0, 0.0)
    low = replace(now, z_um=4800.0)
    assert plan(now, low, SLOW, ENDS) == [Leg({"z": 5500.0}), Leg({"z": 4800.0}, 2000.0)]
    assert plan(now, replace(now, z_um=5500.0), SLOW, ENDS) == [Leg({"z": 5500.0})]
    assert plan(replace(now, z_um=5400.0), low, SLOW, ENDS) == [Leg({"z": 4800.0}, 2000.0)]
    assert plan(low, now, SLOW, ENDS) == [Leg({"z": 12000.0})]
    assert plan(low, replace(now, z_um=5000.0), SLOW, ENDS) == [Leg({"z": 5000.0})]


def test_who_knows_the_surface_says_from_where_on() -> None:
    """It should take the caller's height instead of the configuration's."""
    now, target = Position(5000.0, 5000.0, 12000.0, 0.0), Position(5000.0, 5000.0, 5200.0, 0.0)
    assert plan(now, target, SLOW, ENDS, frozenset(), 5100.0) == [Leg({"z": 5200.0})]
    assert plan(now, target, SLOW, ENDS, frozenset(), 5300.0) == [Leg({"z": 5300.0}), Leg({"z": 5200.0}, 2000.0)]


@given(places(), targets())
def test_no_way_down_is_fast_where_a_surface_may_be(now: Position, target: Position) -> None:
    """It should never lower Z below that height at full speed, wherever it comes from."""
    z_um = now.z_um
    for leg in plan(now, target, SLOW, ENDS):
        to_um = leg.to.get("z", z_um)
        if to_um < min(z_um, SLOW.slow_z_um):
            assert leg.speed_units_s == SLOW.slow_um_s
            assert z_um <= SLOW.slow_z_um
        z_um = to_um


# --- no higher than the way asks ----------------------------------------------------------------------------------


@given(places(), targets(), st.none() | st.floats())
def test_it_goes_sideways_only_at_a_height_that_is_known_to_be_clear(
    now: Position, target: Position, clear_um: float | None
) -> None:
    """It should take any answer: what lies below a possible surface or above the safe height is none to go at."""
    known = clear_um is not None and SLOW.slow_z_um <= clear_um <= SLOW.safe_z_um
    least_um = clear_um if known and clear_um is not None else SLOW.safe_z_um
    z_um = now.z_um
    for leg in plan(now, target, SLOW, ENDS, clear=lambda _places: clear_um):
        if "z" in leg.to:
            assert len(leg.to) == 1
        else:
            assert z_um >= least_um
        z_um = leg.to.get("z", z_um)
    assert z_um == target.z_um


def test_a_small_correction_hops_by_the_clearance() -> None:
    now, target = Position(5000.0, 5000.0, 5200.0, 10.0), Position(4990.0, 5008.0, 5201.0, 10.0)
    assert _ways(now, target, SLOW, ENDS, frozenset(), 5100.0, lambda _places: 5300.0) == [
        {"z": 5300.0},
        {"x": 4940.0, "y": 4958.0},
        {"x": 4990.0, "y": 5008.0},
        {"z": 5201.0},
    ]


def test_a_head_that_stands_clear_does_not_rise() -> None:
    now, target = Position(5000.0, 5000.0, 5600.0, 10.0), Position(9000.0, 5000.0, 5600.0, 10.0)
    assert _ways(now, target, SLOW, ENDS, frozenset(), None, lambda _places: 5500.0) == [
        {"x": 9000.0},
        {"z": 5600.0},
    ]


def test_the_height_is_asked_for_the_whole_way_also_that_to_come_from_below() -> None:
    """It should name every corner, in the axis' coordinate of theta, and ask nothing of a way straight down."""
    asked: list[list[Position]] = []

    def clear(places: Sequence[Position]) -> float:
        asked.append(list(places))
        return 6000.0

    now, target = Position(5000.0, 5000.0, 5200.0, 10.0), Position(4990.0, 5008.0, 5200.0, -200.0)
    plan(now, target, CONFIG, ENDS, clear=clear)
    assert [(at.x_um, at.y_um, at.theta_deg) for at in asked.pop()] == [
        (5000.0, 5000.0, 10.0),
        (4940.0, 4958.0, -200.5625),
        (4990.0, 5008.0, -200.0),
    ]
    plan(now, replace(now, z_um=5000.0), CONFIG, ENDS, clear=clear)
    plan(replace(now, z_um=12000.0), target, CONFIG, ENDS, clear=clear)
    assert not asked


def test_an_approach_that_is_known_better_is_as_long_as_it_has_to_be() -> None:
    now, target = Position(9000.0, 9000.0, 20000.0, 9.0), Position(5000.0, 5000.0, 20000.0, 5.0)
    legs = plan(now, target, CONFIG, ENDS, approach=Approach(20.0, 30.0, 0.1))
    assert [leg.to for leg in legs[:2]] == [
        {"x": 4980.0, "y": 4970.0, "theta": 4.9}, {"x": 5000.0, "y": 5000.0, "theta": 5.0},
    ]  # fmt: skip


def test_an_axis_without_play_comes_straight_from_either_side_and_to_either_end() -> None:
    now, none = Position(9000.0, 9000.0, 20000.0, 9.0), Approach(0.0, 20.0, 0.0)
    target = Position(0.0, 5000.0, 20000.0, -220.0)
    legs = plan(now, target, CONFIG, ENDS, approach=none)
    assert [leg.to for leg in legs[:2]] == [{"y": 4980.0}, {"x": 0.0, "y": 5000.0, "theta": -220.0}]


def test_one_from_above_is_as_long_as_configured_whatever_is_known() -> None:
    now, target = Position(5000.0, 9000.0, 20000.0, 0.0), Position(7000.0, 9000.0, 20000.0, 0.0)
    legs = plan(now, target, CONFIG, ENDS, frozenset({"x"}), approach=Approach(0.0, 0.0, 0.0))
    assert legs[0].to == {"x": 7000.0 + CONFIG.backlash_um}
