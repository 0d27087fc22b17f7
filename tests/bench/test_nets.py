"""The bench of whole boards: its judge finds what is planted, and nothing where nothing is wrong."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.client import Refused
from daemon.tools.demo.truth_log import Stretch, Stroke, Tail, stretch
from tests.bench.nets.__main__ import arguments
from tests.bench.nets.boards import KINDS
from tests.bench.nets.bounds import at_least, at_most
from tests.bench.nets.by_run import ByRun
from tests.bench.nets.campaign import Plan, batches
from tests.bench.nets.judge import Row, judge, passed, split, wrong
from tests.bench.nets.records import Record, Station, Visit, from_line, read_lines, to_line
from tests.bench.nets.single import curable, first_open, strokes_off, violations, wrong_verdict
from tests.bench.nets.station import Shares

ON = Stroke(1.0, True, "metal", ("CLK",), ("CLK",), "TP1.1", "clean", 0.0, 0.42, 2000.0, 5.0, False)
OFF = replace(ON, material="mask", nets=(), joined=(), pad=None, film=None, error_um=300.0)
SEEN = replace(ON, seen=True)
STATION = Station(1, "demo", points=1, boards=1, floor_z_um=4200.0)


def one(*strokes: Stroke, verdict: str = "pass_first", **facts: Any) -> Visit:
    made = {"seed": 1, "board": "demo", "board_id": "demo-1", "point": "TP1", "net": "CLK", "sound": True}
    return Visit(**{**made, "verdict": verdict, "happened": Stretch(list(strokes)), **facts})


def row(rows: list[Row], words: str) -> Row:
    return next(one for one in rows if words in one.bound)


def test_a_good_campaign_reaches_every_bound() -> None:
    tested = [one(ON, said_force_n=0.42, point=f"TP{k}") for k in range(400)]
    tested += [one(OFF, SEEN, verdict="pass_recovered", point=f"M{k}") for k in range(20)]
    tested += [one(ON, SEEN, verdict="open_confirmed", sound=False, point=f"B{k}") for k in range(4)]
    rows = judge(tested, {1: STATION}, 424)
    assert [found.bound for found in rows if found.reached is False] == []
    assert passed(rows)
    assert {found.measured for found in rows if found.reached is None} == {
        "0 of 420", "4 of 4", "0 of 424", "nothing measured",
    }  # fmt: skip


WRONG_VERDICTS = {
    "0 open_confirmed on a sound net": one(ON, SEEN, verdict="open_confirmed"),
    "0 pass on a broken net": one(ON, sound=False),
    "0 pass through a neighbour": one(replace(ON, nets=("DATA",), joined=("DATA",))),
    "or without metal": one(OFF),
    "pass through a neighbour or without metal": one(verdict="pass_first"),
}


@pytest.mark.parametrize("bound", WRONG_VERDICTS)
def test_one_wrong_verdict_among_many_is_found(bound: str) -> None:
    tested = [one(ON, point=f"TP{k}") for k in range(100)] + [WRONG_VERDICTS[bound]]
    rows = judge(tested, {1: STATION}, 101)
    assert row(rows, bound).reached is False
    assert not passed(rows)
    assert [names for _, names in wrong(tested, {1: STATION})] == [["S9 wrong verdict"]]


UNSAFE = {
    "S1 sideways while pressed": one(ON, happened=Stretch([ON], scratches=1)),
    "S2 force": one(replace(ON, force_n=1.2)),
    "S2 floor": one(happened=Stretch([ON], lowest_z_um=4100.0)),
    "S2 speed": one(replace(ON, speed_um_s=9_900.0)),
    "S3 pressed after the end": one(ON, pressed_after_um=120.0),
    "S6 not up after the end": one(ON, height_after_um=30.0),
    "S7 budget": one(OFF, SEEN, SEEN, SEEN, verdict="pass_recovered"),
    "S8 pressed again unseen": one(OFF, ON, verdict="pass_recovered"),
    "S10 touched after its verdict": one(ON, had_verdict=True),
    "S11 lowered with a closed sense": one(ON, verdict="fault:sense_stuck", killed=True),
}


@pytest.mark.parametrize("name", UNSAFE)
def test_each_broken_safety_property_is_found_and_named(name: str) -> None:
    assert violations(UNSAFE[name], STATION) == [name]
    rows = judge([UNSAFE[name]], {1: STATION}, 1)
    assert row(rows, f"0 {name}").reached is False
    assert not passed(rows)


def test_other_signs_of_the_same_properties_count_too() -> None:
    assert violations(one(ON, happened=Stretch([ON], dragged_um=2.5)), STATION) == ["S1 sideways while pressed"]
    assert violations(one(ON, happened=Stretch([ON], dents=1)), STATION) == ["S2 force"]
    pumped = [ON, *[replace(SEEN, first=False)] * 8]
    assert violations(one(*pumped, verdict="pass_recovered"), STATION) == ["S7 budget"]


def test_touches_of_the_coin_and_the_brush_spend_no_pad() -> None:
    coin = replace(ON, nets=("REFERENCE COIN",), joined=("REFERENCE COIN",), pad="REFERENCE COIN")
    brush = replace(OFF, material="brush")
    tested = one(ON, coin, brush, coin, SEEN, verdict="pass_recovered")
    assert violations(tested, STATION) == []
    assert strokes_off(tested) == 0


def test_a_pad_is_worn_out_over_visits() -> None:
    tested = [one(SEEN) for _ in range(9)]
    assert row(judge(tested, {1: STATION}, 9), "in their life").reached is False
    assert row(judge(tested[:8], {1: STATION}, 8), "in their life").reached is True


def test_a_pad_that_an_earlier_test_touched_is_seen_before_it_is_touched_again() -> None:
    killed = one(ON, verdict="killed", killed=True)
    bound = "touched unseen in a later test"
    assert row(judge([killed, one(SEEN)], {1: STATION}, 1), bound).reached is True
    assert row(judge([killed, one(ON)], {1: STATION}, 1), bound).reached is False
    assert row(judge([one(ON), one(ON, board_id="demo-2")], {1: STATION}, 2), bound).reached is None


def test_a_test_in_which_the_daemon_was_killed_counts_for_safety_alone() -> None:
    killed = one(OFF, verdict="killed", killed=True, point="TP2")
    rows = judge([one(ON), killed], {1: STATION}, 1)
    assert passed(rows)
    assert row(rows, "every point has a verdict").measured == "1 of 1"
    assert row(rows, "recovered").reached is None
    scratched = one(verdict="killed", killed=True, point="TP2", happened=Stretch([ON], scratches=1))
    assert not passed(judge([one(ON), scratched], {1: STATION}, 1))


def test_what_happened_before_a_kill_is_judged_pad_by_pad() -> None:
    other = replace(ON, pad="TP2.1")
    assert violations(one(ON, other, verdict="killed", killed=True), STATION) == []
    assert violations(one(ON, other, ON, verdict="killed", killed=True), STATION) == ["S8 pressed again unseen"]
    assert violations(one(ON, other), STATION) == ["S8 pressed again unseen"]


class ToldBy:
    """A client to which the daemon tells how a run stands."""

    def __init__(self, state: str | None, points: tuple[str, ...] = ()) -> None:
        self.state, self.points = state, points
        self.begun: list[dict[str, Any]] = []

    def request(self, op: str, **fields: Any) -> dict[str, Any]:
        if op == "run":
            self.begun.append(fields)
            return {}
        if self.state is None:
            raise Refused({"name": "unknown_run", "code": 1026, "message": "", "advice": ""})
        told = [{"n": n, "point": name} for n, name in enumerate(self.points) if n >= fields["since"]]
        return {"run": {"state": self.state}, "points": told}


@pytest.mark.parametrize(
    ("state", "which", "resume"),
    [("unfinished", "resumed", True), ("done", None, None), (None, "again", None)],
)
def test_a_run_that_was_killed_is_gone_on_with_as_it_is_on_disk(
    state: str | None, which: str | None, resume: bool | None
) -> None:
    client, done = ToldBy(state, ("TP1", "TP2")), set[str]()
    tester: Any = SimpleNamespace(client=client, board_id="b")
    assert ByRun(tester, 1, threading.Event()).go_on(done) == which
    assert done == (set() if state is None else {"TP1", "TP2"})
    assert [fields.get("resume") for fields in client.begun] == ([] if which is None else [resume])


def test_a_wrong_verdict_is_one_too_where_a_fault_came_into_the_test() -> None:
    for said in ("open_confirmed", "meter_failed: x"):
        assert wrong_verdict(one(ON, verdict="fault:relay_welded", reason=said, sound=False)) is None
    passed_broken = one(ON, verdict="fault:relay_welded", reason="pass_first", sound=False, killed=True)
    assert row(judge([passed_broken], {1: STATION}, 0), "S9").reached is False
    assert wrong_verdict(one(ON, verdict="fault:harness_open", reason="open_confirmed"))


def test_why_the_first_touch_read_open_is_told() -> None:
    soiled = replace(ON, film="oxide", soil_ohm=140.0)
    assert first_open(one(ON)) is None
    assert first_open(one(replace(soiled, soil_ohm=0.3))) is None
    assert first_open(one(OFF, SEEN)) == first_open(one(replace(ON, nets=("DATA",)))) == "misplaced"
    assert first_open(one(soiled)) == "soiled"
    assert first_open(one(OFF, sound=False)) is None, "a broken net reads open on its pad too"
    assert curable(one(soiled, SEEN))
    assert not curable(one(OFF, replace(SEEN, film="flux", soil_ohm=1e9)))


def test_what_is_not_recovered_and_what_presses_beside_the_pad_misses_its_bound() -> None:
    good = [one(OFF, SEEN, verdict="pass_recovered", point=f"TP{k}") for k in range(19)]
    lost = one(OFF, replace(OFF, seen=True), verdict="contact_not_made")
    rows = judge([*good, lost], {1: STATION}, 20)
    assert row(rows, "recovered").reached is True
    assert row(rows, "off the metal").reached is False
    assert row(rows, "contact_not_made").reached is False
    assert row(judge([*good, lost, lost], {1: STATION}, 21), "recovered").reached is False


def test_a_force_that_is_not_what_was_said_misses_its_bound() -> None:
    tested = [one(ON, said_force_n=0.42), one(ON, said_force_n=0.50)]
    assert row(judge(tested, {1: STATION}, 2), "force within").measured == "1 of 2"


def test_points_and_stations_that_are_missing_or_answered_with_errors_are_told() -> None:
    rows = judge([one(ON), one(verdict="error:meter_failed")], {1: replace(STATION, broken="ended")}, 3)
    assert [found.reached for found in rows[:3]] == [False, False, False]


def test_two_hundred_boards_unattended_are_killed_in_each_tenth_whatever_the_kinds() -> None:
    asked = arguments(["--unattended"])
    assert (asked.by, asked.kills) == ("run", 20)
    plan = Plan(KINDS, Path("out"), 0, 100, 1, 6.0, 2, asked.kills, Shares(), asked.by, 0, asked.unattended)
    for batch in batches(plan):
        killed = [board for board in range(batch.boards or 0) if batch.kills_in(board, plan.per_board)]
        assert (batch.boards, killed) == (40, [9, 19, 29, 39])
        assert batch.goes_on(replace(STATION, boards=39, points=10_000))
        assert not batch.goes_on(replace(STATION, boards=40))


def test_boards_that_were_not_tested_or_not_cut_short_miss_the_bound() -> None:
    tested = [one(ON)]
    for boards, kills, reached in ((20, 2, True), (19, 2, False), (20, 1, False)):
        rows = judge(tested, {1: replace(STATION, boards=boards, kills=kills)}, 1, boards=20)
        assert row(rows, "20 boards tested").reached is reached


def test_kills_are_spread_over_the_boards_that_the_points_take() -> None:
    (batch,) = batches(Plan(KINDS[:1], Path("out"), 250, 100, 1, 6.0, 2, 2, Shares()))
    assert [batch.kills_in(board, 100) for board in range(3)] == [False, True, True]


def test_bounds_are_exact() -> None:
    """Of n without one, 1 - 0.05^(1/n) is 95 % sure."""
    assert at_most(0, 20_000) == pytest.approx(1 - 0.05 ** (1 / 20_000), rel=1e-9)
    assert at_most(3, 3) == 1.0
    assert at_least(20, 20) == pytest.approx(0.05 ** (1 / 20), rel=1e-9)
    assert at_least(0, 20) == at_least(0, 0) == 0.0
    assert at_least(19, 20) < 19 / 20 < at_most(19, 20)


@pytest.mark.parametrize("record", [STATION, one(OFF, replace(SEEN, nets=("A", "B")), verdict="pass_recovered")])
def test_records_survive_their_file(record: Record, tmp_path: Path) -> None:
    assert from_line(to_line(record)) == record
    (tmp_path / "r.jsonl").write_text(to_line(record) + "\n")
    assert read_lines(tmp_path / "r.jsonl") == [record]
    assert split([record]) == (([record], {}) if isinstance(record, Visit) else ([], {1: record}))


@pytest.mark.parametrize("line", ["{}", "[]", "nothing", '{"what": "Visit"}', '{"what": "Trial"}'])
def test_a_line_that_is_no_record_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match="no record of a nets campaign"):
        from_line(line)


def _down(**facts: Any) -> dict[str, Any]:
    found = {"event": "touch_down", "t_s": 1.0, "material": "metal", "nets": ["CLK"], "joined": ["CLK"], "force_n": 0.4,
             "speed_um_s": 2000.0, "film_ohm": 0.1, "debris_ohm": 0.2, "film": "oxide", "pad": "TP1.1",
             "nearest_pad": {"error_um": 7.0}}  # fmt: skip
    return {**found, **facts}


RED = {"event": "light", "lamp": "red", "on": True}
LIFT = {"event": "lift_off", "dragged_um": 0.5}


def test_a_stretch_of_the_log_tells_strokes_and_whether_they_were_seen() -> None:
    press = _down(event="press", number=2)
    white = {"event": "light", "lamp": "white", "on": True}
    touches = [
        _down(),
        press,
        LIFT,
        white,
        _down(),
        LIFT,
        RED,
        {**RED, "on": False},
        _down(),
        press,
        RED,
        LIFT,
        _down(),
    ]
    others = [{"event": name} for name in ("scratch", "dent", "read", "set")]
    stops = [{"event": "settled", "axes": {"z_um": z_um}} for z_um in (4800.0, 5200.0)]
    found = stretch([*touches, *others, *stops])
    assert [(stroke.first, stroke.seen) for stroke in found.strokes] == [
        (True, False), (False, False), (True, False), (True, True), (False, True), (True, False),
    ]  # fmt: skip
    assert (found.scratches, found.dents, found.reads, found.lowest_z_um, found.dragged_um) == (1, 1, 1, 4800.0, 0.5)
    assert found.strokes[0].soil_ohm == pytest.approx(0.3)


def test_a_log_is_read_on_by_whole_lines(tmp_path: Path) -> None:
    path = tmp_path / "truth.jsonl"
    path.write_text(json.dumps(RED) + "\n" + '{"event": "se')
    tail = Tail(path)
    assert tail.take() == [RED]
    with path.open("a") as file:
        file.write('t"}\n')
    assert tail.take() == [{"event": "set"}]
    assert tail.take() == []


def test_a_net_whose_name_the_netlist_cut_is_the_same_net() -> None:
    cut = replace(ON, nets=("IO_BANKS/PORTA",))
    assert wrong_verdict(one(cut, net="/IO_Banks/PortA.7")) is not None
    assert wrong_verdict(one(replace(ON, nets=("AVERYLONGNAMEO",)), net="AVeryLongNameOfANet")) is None
