"""Plans over the wire: kept by version, refused with every mistake, learned from runs, approved by a person."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daemon.config.current import CurrentSettings
from daemon.config.model import load_config
from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_run import BoardRun
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import Limits, PointVerdict
from daemon.domain.roles import Caller
from daemon.server.plan_desk import PlanDesk
from daemon.storage.journal import Journal
from daemon.wire.operations.runs import PlanReply, PlanRequest, Points, PointTests
from tests.daemon.domain.test_board_run import a_record, a_run
from tests.daemon.procedures.fake_station import EXAMPLE

CALLER = Caller("tester-1", "maintain", "tester-1")
TEXT = '[plan]\nboard = "demo"\n[[point]]\nnet = "VCC"\nhigh = "5 ohm"\n'


@pytest.fixture
def board() -> Board:
    points = tuple(
        BoardPoint(name=name, kind="site", x_um=x_um, y_um=2000.0, diameter_um=400.0, net=net)
        for name, x_um, net in (("TP1", 1000.0, "VCC"), ("TP2", 3000.0, "GND"))
    )
    return Board(name="demo", side="top", width_um=50_000.0, height_um=40_000.0, points=points)


@pytest.fixture
def desk(journal: Journal, board: Board, tmp_path: Path) -> PlanDesk:
    config = load_config(EXAMPLE)
    kept = config.station.model_copy(update={"data_dir": tmp_path})
    return PlanDesk(CurrentSettings(config.model_copy(update={"station": kept}), board), journal)


async def _ask(desk: PlanDesk, action: str, **fields: Any) -> PlanReply:
    return await desk.plan(PlanRequest.model_validate({"op": "plan", "action": action, **fields}), CALLER)


async def test_a_plan_is_stored_listed_and_shown(desk: PlanDesk, board: Board) -> None:
    stored = (await _ask(desk, "store", name="power", text=TEXT)).plan
    assert stored is not None
    assert (stored.version, stored.stored_by, stored.plan.board_revision) == (1, "tester-1", board.revision)
    await _ask(desk, "store", name="power", text=TEXT.replace("5 ohm", "2 ohm"))
    (facts,) = (await _ask(desk, "list")).plans or []
    assert (facts.name, facts.version, facts.fits, facts.learned) == ("power", 2, True, False)
    assert (await _ask(desk, "show", name="power", version=1)).plan == stored


async def test_an_operator_reads_plans_and_changes_none(desk: PlanDesk) -> None:
    await _ask(desk, "store", name="power", text=TEXT)
    operator = Caller("page", "operate", "page")

    async def ask(**fields: Any) -> PlanReply:
        return await desk.plan(PlanRequest.model_validate({"op": "plan", **fields}), operator)

    assert [plan.name for plan in (await ask(action="list")).plans or []] == ["power"]
    assert (await ask(action="show", name="power")).plan is not None
    assert (await ask(action="check", text=TEXT)).plan is not None
    for change in ({"action": "store", "text": TEXT}, {"action": "approve", "name": "power", "by": "Kim"},
                   {"action": "learn", "name": "power", "learn_from": ["r"]}):  # fmt: skip
        with pytest.raises(Fault) as caught:
            await ask(**change)
        assert caught.value.kind is FaultCode.NOT_ALLOWED
    assert len((await _ask(desk, "list")).plans or []) == 1


async def test_the_tests_of_a_point_are_told_over_boards_newest_first(desk: PlanDesk, journal: Journal) -> None:
    for board_id, pictures in (("b17", None), ("b18", "/pictures"), ("b17", "/pictures")):
        record = a_record("TP1", PointVerdict.PASS_FIRST, board_id=board_id, run="run-1", net="VCC")
        await journal.add_point(f"job-{board_id}", record.model_copy(update={"pictures": pictures}))
    await journal.add_point("other", a_record("TP2", PointVerdict.PASS_FIRST, board_id="b17", run="run-1", net="GND"))

    async def ask(**fields: Any) -> Any:
        return await desk.tests(PointTests.model_validate({"op": "point", "test_point": "TP1", **fields}))

    told = await ask()
    assert [(one.board_id, one.pictures_id) for one in told.tests] == [
        ("b17", "job-b17.TP1"), ("b18", "job-b18.TP1"), ("b17", None),
    ]  # fmt: skip
    assert not told.more
    first = await ask(limit=1)
    assert first.more
    assert [one.n for one in (await ask(before=first.tests[0].n)).tests] == [one.n for one in told.tests[1:]]
    assert [one.board_id for one in (await ask(board_id="b18")).tests] == ["b18"]
    assert (await ask(test_point="nobody")).tests == []


async def test_the_name_in_the_file_comes_before_the_one_it_is_sent_under(desk: PlanDesk) -> None:
    text = TEXT.replace("[[point]]", 'name = "own"\n[[point]]')
    stored = (await _ask(desk, "store", name="sent", text=text)).plan
    assert stored is not None
    assert stored.plan.name == "own"


async def test_what_is_checked_is_not_stored(desk: PlanDesk) -> None:
    checked = (await _ask(desk, "check", text=TEXT)).plan
    assert checked is not None
    assert checked.version == 0
    assert (await _ask(desk, "list")).plans == []


async def test_all_mistakes_come_in_one_refusal_and_nothing_is_stored(desk: PlanDesk) -> None:
    text = TEXT.replace("VCC", "VCCC").replace("5 ohm", "5") + '[[point]]\npoint = "TP9"\nhigh = "5 ohm"\n'
    with pytest.raises(Fault) as caught:
        await _ask(desk, "store", name="power", text=text)
    assert caught.value.kind is FaultCode.INVALID_PLAN
    assert [one["line"] for one in caught.value.detail["mistakes"]] == [4, 5, 7]
    assert caught.value.detail["count"] == 3
    assert "and 2 more mistakes" in caught.value.message
    assert (await _ask(desk, "list")).plans == []


async def _golden(journal: Journal, board: Board, run_id: str) -> BoardRun:
    """Keep a finished run of a good board."""
    run = a_run(("TP1", "TP2"), id=run_id, jobs=(run_id,))
    plan = run.plan.model_copy(update={"board_revision": board.revision})
    run = run.model_copy(update={"plan": plan})
    await journal.runs.begin(run)
    for point in ("TP1", "TP2"):
        await journal.add_point(run_id, a_record(point, PointVerdict.PASS_FIRST, run=run_id))
    return run


async def test_limits_are_learned_from_good_boards_and_wait_for_a_person(
    desk: PlanDesk, journal: Journal, board: Board
) -> None:
    for run_id in ("run-1", "run-2"):
        await _golden(journal, board, run_id)
    learned = (await _ask(desk, "learn", name="golden", learn_from=["run-1", "run-2"], by="ada")).plan
    assert learned is not None
    assert (learned.plan.learned_from, learned.approved, learned.stored_by) == (("run-1", "run-2"), None, "ada")
    assert [test.limits for test in learned.plan.tests] == [Limits(high=0.7, unit="ohm")] * 2
    approved = (await _ask(desk, "approve", name="golden", by="M. Weber")).plan
    assert approved is not None
    assert approved.approved is not None
    assert approved.approved.by == "M. Weber"


async def test_nothing_is_learned_from_a_run_that_is_not_there_or_of_another_board(
    desk: PlanDesk, journal: Journal, board: Board
) -> None:
    with pytest.raises(Fault, match="no run 'run-9'"):
        await _ask(desk, "learn", name="golden", learn_from=["run-9"])
    await journal.runs.begin(a_run(("TP1",)))  # its board file is another one
    with pytest.raises(Fault) as caught:
        await _ask(desk, "learn", name="golden", learn_from=["run-1"])
    assert caught.value.kind is FaultCode.WRONG_PLAN


async def test_records_come_page_by_page_by_the_run_or_any_of_its_jobs(
    desk: PlanDesk, journal: Journal, board: Board
) -> None:
    run = await _golden(journal, board, "run-1")
    await journal.runs.go_on(run, 'job "%_2"')
    first = await desk.points(Points(op="points", run="run-1", limit=1))
    assert [record.point for record in first.points] == ["TP1"]
    rest = await desk.points(Points(op="points", run='job "%_2"', since=first.points[-1].n + 1))
    assert [record.point for record in rest.points] == ["TP2"]
    assert rest.run.jobs == ("run-1", 'job "%_2"')
    assert (await desk.points(Points(op="points", run="last"))).run.id == "run-1"
    for unknown in ("%", "run-_", "job"):
        with pytest.raises(Fault, match="no run"):
            await desk.points(Points(op="points", run=unknown))
