"""The needle's stays on the board: what the log says of them, and what can be measured through them."""

import math

import pytest

from sim_hw.board.finish import Finish
from sim_hw.board.nest import InNest
from sim_hw.electric.press import PIN_OHM
from sim_hw.plant.motion import Ramps, plan_move
from sim_hw.plant.spots import BRUSH_UM, COIN_UM, Spot
from tests.sim_hw.electric.rig import REACH_UM, Needle, demo_board

NET = "DATA2"


def _pin(needle: Needle, net: str) -> int:
    return next(channel for channel, name in needle.electricity.circuit.pins.items() if name == net)


def test_a_touch_is_logged_with_speed_force_and_what_it_is_on() -> None:
    needle = Needle()
    needle.press(300.0, speed=2_000.0)
    needle.lift()
    (down,), (up,) = needle.events("touch_down"), needle.events("lift_off")
    assert down["speed_um_s"] == pytest.approx(2_000.0, rel=0.02)
    assert down["pressed_um"] == pytest.approx(300.0, abs=1.0)
    assert down["force_n"] == pytest.approx(0.3 + 0.6 * 0.3 + 0.02, rel=0.01)
    assert (down["material"], down["nets"], down["pad"], down["target"]) == ("metal", [NET], "TP5.1", "TP5")
    assert down["error_um"] == pytest.approx(0.0, abs=0.5)
    assert (down["contact"], down["film_ohm"]) == (True, 0.0)
    assert 0.02 < down["ohms"] < 0.1
    assert (up["presses"], up["dragged_um"]) == (1, pytest.approx(0.0, abs=1e-6))
    assert [event for _, event, _ in needle.log] == ["touch_down", "lift_off"]


def test_contact_begins_where_the_surface_is_to_the_microsecond() -> None:
    needle = Needle(board_dz_um=-80.0)
    needle.press(300.0, speed=1_000.0)
    t_s = needle.log[0][0]
    assert needle.plant.state_at(t_s).z_um == pytest.approx(5_000.0 - 80.0, abs=0.05)
    assert needle.events("touch_down")[0]["pressed_um"] == pytest.approx(220.0, abs=1.0)


def test_the_log_is_the_same_however_often_it_is_asked() -> None:
    logs = []
    for asked_every_s in (None, 0.0137):
        needle = Needle(oxide_share=1.0)
        for push_um in (300.0, 100.0, 320.0, -1_000.0):
            before_s = needle.t_s
            if asked_every_s is None:
                needle.press(push_um)
                continue
            update, needle.electricity.update = needle.electricity.update, lambda _t_s: None
            needle.press(push_um)
            needle.electricity.update = update
            while before_s < needle.t_s:
                before_s = min(before_s + asked_every_s, needle.t_s)
                update(before_s)
        logs.append([(event, round(t_s, 4), facts.get("film_ohm")) for t_s, event, facts in needle.log])
    assert logs[0] == logs[1]
    assert [event for event, _, _ in logs[0]] == ["touch_down", "press", "lift_off"]


def test_pumping_is_several_presses_of_one_touch() -> None:
    needle = Needle()
    for push_um in (300.0, 150.0, 300.0, 150.0, 310.0):
        needle.press(push_um)
    needle.press(290.0)
    needle.press(305.0)
    needle.lift()
    assert [facts["number"] for facts in needle.events("press")] == [2, 3]
    assert needle.events("lift_off")[0]["presses"] == 3


def test_only_a_press_that_is_too_hard_dents_and_once() -> None:
    needle = Needle(dent_n=0.9)
    needle.press(600.0)
    assert needle.events("dent") == []
    needle.press(1_010.0)
    needle.press(700.0)
    needle.press(1_020.0)
    (dent,) = needle.events("dent")
    assert dent["force_n"] > 0.9
    assert dent["pad"] == "TP5.1"


def test_a_plunger_that_sticks_dents_at_a_usual_press() -> None:
    needle = Needle()
    needle.plant.faults.switch("pin_stuck", on=True)
    needle.press(100.0)
    assert len(needle.events("dent")) == 1


@pytest.mark.parametrize(("axis", "way"), [("x", 50.0), ("y", -50.0), ("theta", 0.2)])
def test_going_sideways_while_pressed_is_a_scratch(axis: str, way: float) -> None:
    needle = Needle()
    needle.press(300.0)
    needle.move(axis, needle.plant.axes[axis].position(needle.t_s) + way)
    needle.lift()
    (scratch,) = needle.events("scratch")
    assert scratch["pad"] == "TP5.1"
    assert needle.events("lift_off")[0]["dragged_um"] == pytest.approx(50.0, abs=3.0)


def test_going_sideways_above_the_board_or_only_up_and_down_is_none() -> None:
    needle = Needle()
    needle.press(-50.0)
    needle.move("x", needle.plant.axes["x"].position(needle.t_s) + 500.0)
    needle.press(300.0)
    needle.press(100.0)
    needle.lift()
    assert needle.events("scratch") == []


def test_a_slip_while_pressed_is_a_scratch_although_nothing_was_ordered() -> None:
    needle = Needle()
    needle.press(300.0)
    needle.plant.axes["y"].slip(needle.t_s, 40.0)
    needle.electricity.update(needle.t_s + 0.5)
    assert needle.events("scratch")[0]["dragged_um"] == pytest.approx(40.0, abs=0.1)


def test_through_the_needle_its_net_is_read_and_no_other() -> None:
    needle = Needle(harness_ohm=0.5)
    needle.press(300.0)
    electricity = needle.electricity
    own = electricity.ohms([_pin(needle, NET)], needle.t_s)
    assert own == pytest.approx(0.5 + PIN_OHM + 0.01 / math.sqrt(0.5) + 0.0, abs=0.03)
    assert math.isinf(electricity.ohms([_pin(needle, "CLK")], needle.t_s))
    assert math.isinf(electricity.ohms([], needle.t_s))
    needle.lift()
    assert math.isinf(electricity.ohms([_pin(needle, NET)], needle.t_s))


@pytest.mark.parametrize("all_of_them", [False, True])
def test_through_a_wire_of_the_harness_that_is_broken_nothing_is_read(all_of_them: bool) -> None:
    needle = Needle()
    needle.press(300.0)
    own, other, kelvin = _pin(needle, NET), _pin(needle, "CLK"), needle.electricity.ohms([1], needle.t_s)
    needle.plant.faults.switch("harness_open", on=True, channel=0 if all_of_them else own)
    assert math.isinf(needle.electricity.ohms([own], needle.t_s))
    assert needle.electricity.ohms([1], needle.t_s) == kelvin, "the needle's own second wire is no part of it"
    needle.plant.faults.switch("harness_open", on=True, channel=other)
    assert needle.electricity.ohms([own], needle.t_s) < 1.0


def test_through_a_wire_of_the_harness_that_touches_the_nets_own_it_is_read_too() -> None:
    needle = Needle()
    needle.press(300.0)
    own, other = _pin(needle, NET), _pin(needle, "CLK")
    needle.plant.faults.switch("harness_joined", on=True, channel=other, other=own)
    assert needle.electricity.ohms([other], needle.t_s) < 0.3
    assert needle.electricity.ohms([own], needle.t_s) < 0.2
    assert math.isinf(needle.electricity.ohms([], needle.t_s)), "neither is closed"
    needle.plant.faults.switch("harness_joined", on=False)
    assert math.isinf(needle.electricity.ohms([other], needle.t_s))


def test_beside_the_pad_there_is_no_contact() -> None:
    needle = Needle(off_um=(400.0, 0.0))
    needle.press(300.0)
    down = needle.events("touch_down")[0]
    assert (down["material"], down["contact"], down["ohms"], down["nets"]) == ("mask", False, None, [])
    assert math.isinf(needle.electricity.ohms([1, _pin(needle, NET)], needle.t_s))


def test_a_neighbour_that_is_hit_instead_is_not_the_net_that_was_meant() -> None:
    """TP6 and TP7 are 0.45 mm apart: a needle 0.45 mm off TP6 reads TP7's net."""
    needle = Needle("TP6", off_um=(450.0, 0.0))
    needle.press(300.0)
    assert needle.events("touch_down")[0]["nets"] == ["SENSE_N"]
    assert math.isinf(needle.electricity.ohms([_pin(needle, "SENSE_P")], needle.t_s))
    assert needle.electricity.ohms([_pin(needle, "SENSE_N")], needle.t_s) < 0.2
    assert needle.electricity.ohms([1], needle.t_s) < 0.2, "it stands on metal, and proves no more than that"


def test_a_via_is_touched_on_the_rim_of_its_hole() -> None:
    needle = Needle("TP1")
    needle.press(300.0)
    assert needle.events("touch_down")[0]["nets"] == ["CLK"]


def test_a_film_takes_its_voltage_of_the_diode_test_too() -> None:
    for seed in range(8):
        needle = Needle(seed=seed, stubborn_share=1.0)
        needle.press(300.0)
        pin = [_pin(needle, NET)]
        through_ohm = needle.electricity.needle_ohm(needle.t_s)
        assert through_ohm > 10.0
        assert needle.electricity.diode_v(pin, needle.t_s) == pytest.approx(through_ohm * 1e-3, rel=0.01)


def test_between_the_needles_two_wires_lies_only_the_metal() -> None:
    """Contact is proved whatever the net is, and on an open net too."""
    needle = Needle(open_share=1.0)
    needle.press(300.0)
    assert 2 * PIN_OHM < needle.electricity.ohms([1], needle.t_s) < 0.2
    needle = Needle(off_um=(400.0, 0.0))
    needle.press(300.0)
    assert math.isinf(needle.electricity.ohms([1], needle.t_s))


def test_a_film_is_read_until_a_press_breaks_it() -> None:
    def one(seed: int) -> tuple[bool, int]:
        needle = Needle(seed=seed, oxide_share=1.0)
        needle.press(150.0)
        filmed = needle.electricity.needle_ohm(needle.t_s) > 1.0
        for tries in range(1, 30):
            if needle.electricity.needle_ohm(needle.t_s) < 0.2:
                return filmed, tries
            needle.press(80.0)
            needle.press(150.0)
        return filmed, 30

    found = [one(seed) for seed in range(20)]
    assert 2 <= sum(filmed for filmed, _ in found) <= 18
    assert all(tries < 30 for _, tries in found)


def test_a_high_voltage_frits_a_film() -> None:
    def pressed(seed: int) -> Needle:
        needle = Needle(seed=seed, oxide_share=1.0)
        needle.press(20.0)
        return needle

    needle = next(one for one in map(pressed, range(30)) if one.electricity.needle_ohm(one.t_s) > 1.0)
    needle.electricity.apply_voltage(0.02, needle.t_s)
    assert needle.electricity.needle_ohm(needle.t_s) > 1.0
    needle.electricity.apply_voltage(50.0, needle.t_s)
    assert needle.electricity.needle_ohm(needle.t_s) < 0.2


def test_debris_travels_to_the_next_touch_and_the_brush_takes_it_off() -> None:
    needle = Needle(debris_share=1.0)
    needle.press(300.0)
    needle.lift()
    needle.plant.set_knob("debris_share", 0.0)
    needle.press(300.0)
    assert needle.events("touch_down")[1]["debris_ohm"] > 0.0
    needle.lift()
    needle.move("x", BRUSH_UM[0] - REACH_UM, speed=100_000.0)
    needle.move("y", BRUSH_UM[1], speed=100_000.0)
    for _ in range(5):
        needle.press(300.0)
        needle.lift()
    assert needle.events("touch_down")[-1]["material"] == "brush"
    needle.move("y", COIN_UM[1], speed=100_000.0)
    needle.press(300.0)
    coin = needle.events("touch_down")[-1]
    assert (coin["material"], coin["debris_ohm"]) == ("metal", 0.0)
    assert needle.electricity.ohms([], needle.t_s) < 0.1, "the coin is on the meter's return"


def test_the_sense_closes_after_its_delay_and_opens_after_it() -> None:
    needle = Needle(sense_delay_s=0.004)
    needle.press(300.0)
    made_s = needle.log[0][0]
    assert [needle.electricity.sense(made_s + after_s) for after_s in (0.0035, 0.0045)] == [False, True]
    needle.lift()
    lost_s = needle.log[-1][0]
    assert [needle.electricity.sense(lost_s + after_s) for after_s in (0.0035, 0.0045)] == [True, False]


def test_the_sense_feels_no_mask_and_sticks_when_it_is_broken() -> None:
    needle = Needle(off_um=(400.0, 0.0))
    needle.press(300.0)
    assert needle.electricity.sense(needle.t_s) is False
    needle.plant.faults.switch("sense_stuck", on=True)
    assert needle.electricity.sense(needle.t_s) is True
    needle = Needle()
    needle.press(300.0)
    needle.plant.faults.switch("sense_stuck", on=True, closed=False)
    assert needle.electricity.sense(needle.t_s) is False


def test_a_station_without_a_sense_never_closes_it() -> None:
    needle = Needle(sense_fitted=0)
    needle.press(300.0)
    assert needle.electricity.sense(needle.t_s) is False


def test_a_contact_is_steady_only_after_its_bounce() -> None:
    bounces = []
    for seed in range(40):
        needle = Needle(seed=seed, contact_bounce_s=0.015)
        needle.press(300.0)
        bounces.append(needle.electricity.steady_since_s(needle.t_s) - needle.log[0][0])
    assert 0.0 <= min(bounces) < 0.003
    assert 0.012 < max(bounces) <= 0.015


def test_each_touch_shortens_a_needle_that_wears() -> None:
    needle = Needle(tip_wear_um=5.0)
    for _ in range(3):
        needle.press(300.0)
        needle.lift()
    assert [round(facts["pressed_um"]) for facts in needle.events("touch_down")] == [300, 295, 290]


def test_a_bent_needle_touches_where_its_end_is_and_a_missing_one_nothing() -> None:
    needle = Needle()
    needle.plant.faults.switch("bent", on=True, px=15.0)
    needle.press(300.0)
    assert needle.events("touch_down")[0]["error_um"] == pytest.approx(180.0, rel=0.05)
    needle = Needle()
    needle.plant.faults.switch("missing", on=True)
    needle.press(300.0)
    assert needle.log == []


def test_a_board_laid_in_again_keeps_what_was_done_to_it_and_the_next_of_its_series_is_another() -> None:
    needle = Needle(oxide_share=0.5, open_share=0.3)
    first, broken = needle.electricity.circuit, needle.electricity.defects()
    needle.electricity.lay_board(InNest.made(demo_board(), Finish(mask_shift_um=(500.0, 0.0))))
    assert needle.electricity.circuit is first
    needle.press(300.0)
    assert needle.events("touch_down")[0]["material"] == "mask", "the opening is not over the pad any more"
    needle.lift()
    needle.plant.set_knob("board_number", 1)
    needle.electricity.lay_board(InNest.made(demo_board()))
    assert needle.electricity.circuit is not first
    assert needle.electricity.defects() != broken


def test_on_the_way_out_the_pin_presses_less_than_on_the_way_in() -> None:
    needle = Needle()
    needle.press(200.0)
    inwards = needle.electricity.needle_ohm(needle.t_s)
    needle.press(300.0)
    needle.press(200.0)
    outwards = needle.electricity.needle_ohm(needle.t_s)
    assert outwards - PIN_OHM == pytest.approx(0.01 / math.sqrt(0.3 + 0.12 - 0.02), rel=1e-3)
    assert inwards - PIN_OHM == pytest.approx(0.01 / math.sqrt(0.3 + 0.12 + 0.02), rel=1e-3)


def test_a_film_is_there_before_the_press_has_come_to_its_end() -> None:
    needle = next(one for one in (Needle(seed=seed, oxide_share=1.0) for seed in range(5)))
    demand = plan_move(needle.t_s, needle.plant.axes["z"].position(needle.t_s), 0.0, 4_700.0, Ramps(2_000.0, 1e6, 1e6))
    needle.plant.axes["z"].follow(demand)
    assert needle.electricity.needle_ohm(demand.end_s - 0.05) > 1.0


def test_a_needle_that_was_dragged_stands_on_what_is_below_it_now() -> None:
    needle = Needle()
    needle.press(300.0)
    assert needle.electricity.sense(needle.t_s)
    needle.move("x", needle.plant.axes["x"].position(needle.t_s) + 400.0)
    assert math.isinf(needle.electricity.ohms([1], needle.t_s))
    assert not needle.electricity.sense(needle.t_s + 0.01)
    needle.move("x", needle.plant.axes["x"].position(needle.t_s) - 400.0)
    assert needle.electricity.ohms([1], needle.t_s) < 0.2


def test_the_coin_is_as_high_whichever_board_lies_in_the_nest() -> None:
    for dz_um in (-200.0, 0.0, 200.0):
        needle = Needle(board_dz_um=dz_um)
        needle.move("x", COIN_UM[0] - REACH_UM, speed=100_000.0)
        needle.move("y", COIN_UM[1], speed=100_000.0)
        needle.press(150.0)
        assert needle.events("touch_down")[0]["pressed_um"] == pytest.approx(150.0, abs=0.5)


def test_where_the_board_was_taken_out_the_needle_finds_the_nest() -> None:
    needle = Needle()
    needle.plant.faults.switch("board_gone", on=True)
    needle.press(300.0)
    assert needle.log == [], "it is deeper than the needle goes"


def test_the_log_tells_which_film_it_stands_on_and_which_pin_of_the_harness_it_reaches() -> None:
    films = set()
    for seed in range(12):
        needle = Needle(seed=seed, oxide_share=0.4, stubborn_share=0.3, open_share=0.5)
        needle.press(20.0)
        down = needle.events("touch_down")[0]
        films.add(down["film"])
        read = needle.electricity.ohms([_pin(needle, NET)], needle.t_s)
        assert (down["joined"] == [NET]) is not math.isinf(read)
    assert {"clean", "oxide"} < films


def test_coin_and_brush_lie_beside_their_nominal_places_and_heights() -> None:
    drawn = [Needle(seed=seed, spots_height_sigma_um=15.0).plant.spots for seed in range(30)]
    away_um = [math.dist((spots.coin.x_um, spots.coin.y_um), COIN_UM) for spots in drawn]
    assert 50.0 < max(away_um) <= 150.0
    assert len({spots.brush for spots in drawn}) == 30
    assert max(abs(spots.coin.dz_um) for spots in drawn) > 15.0
    assert Spot(0.0, 0.0).covers((0.0, 1_999.0))
    assert not Spot(0.0, 0.0).covers((0.0, 2_001.0))
