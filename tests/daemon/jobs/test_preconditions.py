"""What is refused before it is queued, and with which fault."""

from __future__ import annotations

import pytest

from daemon.domain.board import Board, BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.preconditions import (
    refuse_in_fault,
    refuse_other_request,
    refuse_unknown_point,
    refuse_with_needle_down,
)
from daemon.station.needle import Needle
from daemon.wire.operations.jobs import Align, AnyJob, Correct, Home, Look, Place
from drivers.gantry import Position

BOARD = Board(
    name="b",
    side="top",
    width_um=60000.0,
    height_um=40000.0,
    points=(
        BoardPoint(name="TP1", kind="site", x_um=1000.0, y_um=2000.0, diameter_um=800.0),
        *(
            BoardPoint(name=f"F{n}", kind="fiducial", x_um=n, y_um=n, diameter_um=1000.0, why_not="it is a fiducial")
            for n in (1, 2, 3)
        ),
    ),
)
HOME = Home(op="home", id="h")
CORRECT = Correct(op="correct", id="c", test_point="TP1")


def test_without_a_latched_fault_everything_is_let_in() -> None:
    refuse_in_fault(None)


def test_a_fault_refuses_and_names_its_first_cause() -> None:
    latched = Fault(FaultCode.AXIS_STALLED, "z stands still", advice="free it")
    with pytest.raises(Fault, match="the daemon is in fault: z stands still") as caught:
        refuse_in_fault(latched)
    assert caught.value.kind is FaultCode.IN_FAULT
    assert caught.value.advice == "free it, then `reset` and `home`"
    assert caught.value.detail["first_cause"]["code"] == FaultCode.AXIS_STALLED.code


@pytest.mark.parametrize(
    "request_",
    [
        CORRECT,
        Look(op="look", id="l", test_point="F1"),
        Look(op="look", id="l"),
        Place(op="place", id="p", test_point="F1"),
        Place(op="place", id="p", board_um=(1.0, 2.0)),
        Align(op="align", id="a", fiducials=("F1", "F2", "F3")),
        Align(op="align", id="a"),
        HOME,
    ],
    ids=lambda request: request.model_dump_json(exclude_defaults=True),
)
def test_what_the_board_has_may_be_seen_and_what_names_no_point_is_let_in(request_: AnyJob) -> None:
    refuse_unknown_point(request_, BOARD)


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (Correct(op="correct", id="c", test_point="F1"), "F1 cannot be probed: it is a fiducial"),
        (Correct(op="correct", id="c", test_point="TP9"), "no test point TP9"),
        (Look(op="look", id="l", test_point="TP9"), "no test point TP9"),
        (Place(op="place", id="p", test_point="TP9"), "no test point TP9"),
        (Align(op="align", id="a", fiducials=("F1", "F2", "F9")), "no test point F9"),
    ],
    ids=["a fiducial is no target", "correct", "look", "place", "align"],
)
def test_a_point_the_board_has_not_is_refused_and_so_is_a_correction_of_what_must_not_be_touched(
    request_: AnyJob, why: str
) -> None:
    with pytest.raises(Fault, match=why) as caught:
        refuse_unknown_point(request_, BOARD)
    assert caught.value.kind is FaultCode.UNKNOWN_TEST_POINT


def test_an_id_may_be_sent_again_for_the_same_request_only() -> None:
    refuse_other_request("j1", '{"op":"home"}', '{"op":"home"}')
    with pytest.raises(Fault, match="'j1' was used for a different request") as caught:
        refuse_other_request("j1", '{"op":"home"}', '{"op":"look"}')
    assert caught.value.kind is FaultCode.ID_REUSED
    assert caught.value.detail["id"] == "j1"


def test_a_request_written_before_a_field_was_added_is_the_same_request() -> None:
    asked = '{"op":"correct","id":"a","test_point":"TP1","board_id":null}'
    refuse_other_request("a", asked, '{"op":"correct","id":"a","test_point":"TP1"}')
    with pytest.raises(Fault):
        refuse_other_request("a", asked.replace("null", '"SN-1"'), '{"op":"correct","id":"a","test_point":"TP1"}')


@pytest.mark.parametrize(
    ("op", "z_um", "refused"),
    [
        ("place", 5_200.0, False),
        ("place", 5_000.0, True),
        ("calibrate", 5_000.0, True),
        ("lift", 5_000.0, False),
        ("home", 5_000.0, False),
        ("place", None, True),
        ("lift", None, False),
    ],
)
def test_nothing_begins_with_the_needle_down_but_what_raises_it(op: str, z_um: float | None, *, refused: bool) -> None:
    needle = Needle()
    needle.adopt(lambda _at: 5_200.0, lambda _at: 5_000.0)
    if z_um is not None:
        needle.reported(Position(0.0, 0.0, z_um, 0.0))
    if not refused:
        refuse_with_needle_down(op, needle)
        return
    with pytest.raises(Fault) as caught:
        refuse_with_needle_down(op, needle)
    assert caught.value.kind is FaultCode.NEEDLE_DOWN
