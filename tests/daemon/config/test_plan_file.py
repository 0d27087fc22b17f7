"""A plan file is read whole or refused with every mistake, its line and its cure."""

from __future__ import annotations

import pytest

from daemon.config.plan_file import PlanError, read_plan
from daemon.domain.board import NO_LAYERS, Board, BoardPoint
from daemon.domain.plan import Plan
from daemon.domain.point_test import Limits

METHODS = "contact, continuity, resistance, fres, voltage, diode, capacitance, insert"


def _point(name: str, net: str | None, rank: int | None = 0, why_not: str | None = None) -> BoardPoint:
    return BoardPoint(
        name=name, kind="site", x_um=1000.0, y_um=2000.0, diameter_um=600.0, net=net, rank=rank, why_not=why_not
    )


@pytest.fixture
def board() -> Board:
    points = (
        _point("TP1", "GND"), _point("TP2", "GND", 1), _point("TP3", "VCC"), _point("TP4", "SDA"),
        _point("TP5", "SCL", None, "it lies below a part"),
    )  # fmt: skip
    return Board(name="demo", side="top", width_um=40_000.0, height_um=30_000.0, points=points,
                 unserved={"SCL": "its only point lies below a part"})  # fmt: skip


def _mistakes(text: str, board: Board, form: str = "toml") -> list[str]:
    with pytest.raises(PlanError) as caught:
        read_plan(text, form, board, "p")  # type: ignore[arg-type]
    return [str(mistake) for mistake in caught.value.mistakes]


GOOD = """\
[plan]
board = "demo"
name = "power"

[defaults]
method = "continuity"
high = "5 ohm"

[[point]]
net = "GND"

[[point]]
point = "TP3"
method = "voltage"
low = "3.2 V"
high = "3.4 V"
theta_deg = 45
look = "first"
touches = 2
second_site = false
note = "the regulator's"
"""


def test_a_plan_names_points_or_nets_and_defaults_fill_in(board: Board) -> None:
    plan = read_plan(GOOD, "toml", board, "p")
    gnd, vcc = plan.tests
    assert (plan.name, plan.board, plan.board_revision) == ("power", "demo", board.revision)
    assert (gnd.point, gnd.net, gnd.method, gnd.limits) == ("TP1", "GND", "continuity", Limits(high=5.0, unit="ohm"))
    assert (vcc.limits, vcc.theta_deg, vcc.look) == (Limits(low=3.2, high=3.4, unit="V"), 45.0, "first")
    assert (vcc.touches, vcc.second_site, vcc.note) == (2, False, "the regulator's")


def test_all_points_of_a_net_are_tested_where_that_is_asked_for(board: Board) -> None:
    plan = read_plan(GOOD.replace('net = "GND"', 'net = "GND"\npoints = "all"'), "toml", board, "p")
    assert [test.point for test in plan.tests] == ["TP1", "TP2", "TP3"]


def test_all_nets_are_tested_by_the_defaults_but_those_that_have_a_line_of_their_own(board: Board) -> None:
    text = GOOD.replace('name = "power"', 'nets = "all"')
    plan = read_plan(text, "toml", board, "p")
    assert [(test.point, test.method) for test in plan.tests] == [
        ("TP1", "continuity"), ("TP3", "voltage"), ("TP4", "continuity"),
    ]  # fmt: skip


def test_limits_of_the_defaults_are_not_mixed_with_those_of_a_point(board: Board) -> None:
    text = (
        '[plan]\nboard = "demo"\n[defaults]\nhigh = "5 ohm"\n[[point]]\nnet = "VCC"\nmethod = "voltage"\nlow = "3 V"\n'
    )
    (test,) = read_plan(text, "toml", board, "p").tests
    assert test.limits == Limits(low=3.0, unit="V")


def test_a_csv_says_the_same_as_toml(board: Board) -> None:
    text = (
        "\ufeff# board: demo\n# name: power\n"
        "point;net;method;low;high;theta_deg;look;touches;second_site;note\n"
        ";GND;continuity;;5 ohm;;;;;\n"
        "TP3;;voltage;3.2 V;3.4 V;45;first;2;no;the regulator's\n"
    )
    assert read_plan(text, "csv", board, "p").tests == read_plan(GOOD, "toml", board, "p").tests


def test_all_mistakes_are_told_in_one_go_each_with_its_line(board: Board) -> None:
    text = """\
[plan]
board = "demo"

[[point]]
net = "GNDD"
high = "5 ohm"

[[point]]
point = "TP33"
high = "5 ohm"

[[point]]
point = "TP3"
high = 5

[[point]]
point = "TP4"
hihg = "5 ohm"

[[point]]
point = "TP1"
method = "resistence"

[[point]]
net = "SCL"
high = "5 ohm"
"""
    assert _mistakes(text, board) == [
        "line 5: the board has no net 'GNDD'; is 'GND' meant?",
        f"line 9: board demo has no test point TP33; {NO_LAYERS}; is 'TP3' meant?",
        "line 14: high = 5 has no unit; write it with one, between quotes, such as '2 ohm'",
        'line 16: continuity needs a limit: low, high, or both, such as high = "2 ohm"',
        "line 18: a point has no 'hihg'; is 'high' meant?",
        f"line 22: there is no method 'resistence'; there are {METHODS}; is 'resistance' meant?",
        "line 25: net 'SCL' cannot be touched on this side: its only point lies below a part",
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[point]]\nnet = "GND"\nhigh = "5 ohm"\n', "does not say for which board it is: board = 'demo'"),
        ('[plan]\nboard = "other"\n[[point]]\nnet = "GND"\nhigh = "5 ohm"\n', "line 2: the plan is for board 'other'"),
        ('[plan]\nboard = "demo"\nrevision = "x"\n[[point]]\nnet = "GND"\nhigh = "5 ohm"\n', "line 3: the plan is for"),
        ('[plan]\nboard = "demo"\n', "the plan names no point"),
        ('[plan]\nboard = "demo"\nnets = "some"\n', 'line 3: nets is "all", or a list'),
        ('[plan]\nboard = "demo"\n[[point]]\nhigh = "5 ohm"\n', "line 3: name a point or a net"),
        ('[plan]\nboard = "demo"\nname = "a b"\n[[point]]\nnet = "GND"\nhigh = "1 ohm"\n', "line 3: 'a b' cannot be"),
        ('[plan]\nboard = "demo"\n[[points]]\nnet = "GND"\n', "line 3: there is no table [points]"),
        ('[plan]\nboard = "demo"\n[defaults]\nhigh = 5\n[[point]]\nnet = "GND"\n', "line 4: high = 5 has no unit"),
        ('[plan]\nboard = "demo"\n[[point]]\nnet = "GND"\nlow = "3 ohm"\nhigh = "2 ohm"\n', "low 3 is above high 2"),
        ('[plan]\nboard = "demo"\n[[point]]\npoint = "TP1"\nnet = "VCC"\nhigh = "2 ohm"\n', "line 5: TP1 is on"),
        ('[plan]\nboard = "demo"\n[[point]]\nnet = "GND"\nhigh = "1 ohm"\ntouches = 0\n', "line 6: touches = 0: "),
        ('[plan]\nboard = "demo"\n[[point]]\nnet = "GND"\nmethod = "insert"\nhigh = "1 ohm"\n', "takes no high"),
        ('[plan]\nboard = "demo"\n[[point]]\nnet = "GND"\nhigh = "1 V"\n', "line 5: high = '1 V' is in V"),
        ("[plan\n", "line 1"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_with_its_line_and_told_once(text: str, says: str, board: Board) -> None:
    (mistake,) = _mistakes(text, board)
    assert says in mistake


def test_a_point_that_is_named_twice_is_refused_with_both_lines(board: Board) -> None:
    text = '[plan]\nboard = "demo"\n[[point]]\nnet = "GND"\nhigh = "5 ohm"\n[[point]]\npoint = "TP1"\nhigh = "5 ohm"\n'
    assert _mistakes(text, board) == ["line 6: TP1 is tested by continuity already, in line 3"]


def test_mistakes_of_a_csv_have_the_line_of_the_file(board: Board) -> None:
    text = "# board: demo\n\npoint,high\nTP1,5 ohm\nTP9,5 ohm\nTP3,5\n"
    first, second = _mistakes(text, board, "csv")
    assert first.startswith("line 5: board demo has no test point TP9")
    assert second.startswith("line 6: high = '5' has no unit")


def test_the_hash_is_of_what_is_tested_and_of_nothing_else(board: Board) -> None:
    plan = read_plan(GOOD, "toml", board, "p")
    same = read_plan(GOOD.replace("power", "other").replace("the regulator's", "U3's"), "toml", board, "p")
    tighter = read_plan(GOOD.replace("3.4 V", "3.35 V"), "toml", board, "p")
    assert plan.hash == same.hash
    assert plan.hash != tighter.hash
    assert Plan.model_validate_json(plan.model_dump_json()).hash == plan.hash
