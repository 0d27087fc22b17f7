"""A run tests what has no verdict, in the order given or the shortest, and leaves what it did to be gone on with."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from daemon.cli.formatting import as_commands
from daemon.config.sections.meter import MeterSection
from daemon.config.sections.touching import ReferenceSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.plan import Plan
from daemon.domain.point_test import Limits, PointRecord, PointTest, PointVerdict
from daemon.domain.states import Event
from daemon.jobs.context import JobContext, StationContext, Touching
from daemon.jobs.held_touch import HeldTouch
from daemon.procedures.registry import PROCEDURES
from daemon.procedures.tare import what_was_read
from daemon.station.needle_health import NeedleHealth
from daemon.storage.journal import Journal
from daemon.storage.plan_store import PlanStore, plans_folder
from tests.daemon.domain.test_board_run import a_record
from tests.daemon.procedures.fake_station import Ran, World, a_board, begin, run

NAMES = ("A", "B", "C", "D", "E", "F")
X_UM = {"A": 5_000.0, "B": 30_000.0, "C": 8_000.0, "D": 27_000.0, "E": 11_000.0, "F": 24_000.0}
SHORTEST = ["A", "C", "E", "F", "D", "B"]


class Prober:
    """Stands for the test of one point: gives each the verdict that the test of this file wants."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.verdicts: dict[str, PointVerdict] = {}
        self.before: Callable[[str], Any] = lambda _name: None
        """Called before a point is tested; what it returns is waited for."""
        self.tested: list[PointTest] = []
        self.admitted: list[str | None] = []
        self.not_admitted: Fault | None = None
        self.angles: list[float | None] = []

    async def admit(self, _job: JobContext, _context: StationContext, board_id: str | None, *, tester: bool) -> None:
        assert not tester
        self.admitted.append(board_id)
        if self.not_admitted is not None:
            raise self.not_admitted

    async def probe(
        self,
        job: JobContext,
        _context: StationContext,
        test: PointTest,
        board_id: str | None,
        *,
        run: str,
        at_deg: float | None,
        plan_hash: str,
        done: Mapping[str, PointVerdict],
        **_known: Any,
    ) -> PointRecord:
        assert test.point not in done
        self.done = done
        self.angles.append(at_deg)
        job.fire(Event.OFF_TARGET if job.moves else Event.SEEN)
        job.moves += 1
        self.tested.append(test)
        waited = self.before(test.point)
        if waited is not None:
            await waited
        verdict = self.verdicts.get(test.point, PointVerdict.PASS_FIRST)
        record = a_record(test.point, verdict, board_id=board_id, run=run, method=test.method, net=test.net)
        record = record.model_copy(update={"plan_hash": plan_hash})
        await self._journal.add_point(job.request.id, record)
        job.fire(Event.ARRIVED)
        return record

    @property
    def names(self) -> list[str]:
        return [test.point for test in self.tested]


@pytest.fixture
def prober(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> Prober:
    prober = Prober(journal)
    monkeypatch.setattr("daemon.procedures.run.probe_point", prober.probe)
    monkeypatch.setattr("daemon.procedures.run.admit_probing", prober.admit)
    return prober


@pytest.fixture
def world(tmp_path: Path) -> World:
    board = a_board(*((name, X_UM[name], 15_000.0) for name in NAMES))
    world = World(tmp_path / "calibration", board, {"station": {"data_dir": tmp_path}})
    world.put_tip(world.pad_um("A"))
    return world


def _plan(world: World, names: tuple[str, ...] = NAMES, high: float = 5.0, **more: Any) -> Plan:
    limits = Limits(high=high, unit="ohm")
    tests = tuple(PointTest(point=name, method="continuity", limits=limits) for name in names)
    return Plan(name="six", board=world.board.name, board_revision=world.board.revision, tests=tests, **more)


def _store(world: World, plan: Plan) -> PlanStore:
    store = PlanStore(plans_folder(world.config.station.data_dir))
    store.store(plan, "ada")
    return store


async def _run(world: World, journal: Journal, job_id: str = "run-1", **fields: Any) -> Ran:
    """Run a job to its end; what it raises comes with its partial outcome."""
    asked = {"op": "run", "id": job_id, "board_id": "b17", **fields}
    touching = Touching(HeldTouch(job_id, ""), "", journal, lambda: None, runs=journal.runs)
    return await run(world, PROCEDURES["run"], {}, begin(asked, touching))


async def _refused(world: World, journal: Journal, **fields: Any) -> Fault:
    with pytest.raises(Fault) as caught:
        await _run(world, journal, **fields)
    return caught.value


async def test_a_plan_is_walked_point_by_point_and_told_in_figures(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    prober.verdicts["C"] = PointVerdict.FAIL
    ran = await _run(world, journal, plan="six", order="given")
    assert prober.names == list(NAMES)
    assert ran.got.outcome == "run_done"
    summary = ran.got.detail["summary"]
    assert (summary["points"], summary["done"], summary["passed_first"], summary["failed"]) == (6, 6, 5, 1)
    stored = await journal.runs.find("run-1")
    assert stored is not None
    assert (stored.state, stored.plan_hash, stored.plan_version) == ("done", _plan(world).hash, 1)
    assert stored.summary is not None
    assert stored.summary.done == 6
    assert [done for done, _, _ in ran.progress] == [0, 0, 1, 2, 3, 4, 5, 6]


async def test_the_shortest_way_is_walked_unless_the_given_order_is_asked_for(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    await _run(world, journal, plan="six")
    assert prober.names == SHORTEST
    assert set(prober.angles) == {0.0}
    assert {test.theta_deg for test in prober.tested} == {None}, "what no test asks for may be turned for another view"


async def test_a_list_of_points_asks_only_for_contact(world: World, journal: Journal, prober: Prober) -> None:
    ran = await _run(world, journal, points=["B", "A"], order="given")
    assert [(test.point, test.method, test.limits) for test in prober.tested] == [
        ("B", "contact", None), ("A", "contact", None),
    ]  # fmt: skip
    assert ran.got.detail["plan"] == "points"


async def _stopped_at(world: World, journal: Journal, prober: Prober, name: str, why: Exception) -> None:
    """Begin a run that ends in trouble before a point has its verdict."""

    def trouble(at: str) -> None:
        if at == name:
            raise why

    prober.before = trouble
    with pytest.raises(type(why)):
        await _run(world, journal, plan="six", order="given")
    prober.before = lambda _name: None
    prober.tested.clear()


@pytest.mark.parametrize(
    "why",
    [Fault(FaultCode.CANCELLED), Fault(FaultCode.PROBE_BAD), Fault(FaultCode.JOURNAL_FAILED), ConnectionError("line")],
)
async def test_a_run_that_was_stopped_is_gone_on_with_where_it_was(
    why: Exception, world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    await _stopped_at(world, journal, prober, "D", why)
    left = await journal.runs.find("run-1")
    assert left is not None
    assert (left.state, left.summary and left.summary.done) == ("unfinished", 3)
    assert left.stopped_by
    ran = await _run(world, journal, "run-2", resume=True)
    assert prober.names == ["D", "E", "F"]
    assert (ran.got.detail["run"], ran.got.detail["summary"]["done"]) == ("run-1", 6)
    assert ran.progress[0][:2] == (3, 6)
    done = await journal.runs.find("run-2")
    assert done is not None
    assert (done.id, done.state, done.jobs, done.stopped_by) == ("run-1", "done", ("run-1", "run-2"), "")


async def test_a_paused_run_ends_after_its_point_and_is_gone_on_with(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    touching = Touching(HeldTouch("run-1", ""), "", journal, lambda: None, runs=journal.runs)
    ran = begin({"op": "run", "id": "run-1", "board_id": "b17", "plan": "six", "order": "given"}, touching)

    def pause(name: str) -> None:
        ran.job.pausing = name == "C"

    prober.before = pause
    await run(world, PROCEDURES["run"], {}, ran)
    assert prober.names == ["A", "B", "C"]
    assert (ran.got.outcome, ran.got.detail["state"]) == ("run_stopped", "unfinished")
    assert ran.got.detail["stopped_by"] == "paused by a person"
    await _run(world, journal, "run-2", resume=True)
    assert prober.names == list(NAMES)


async def test_a_pause_that_comes_at_the_last_point_leaves_nothing_unfinished(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    touching = Touching(HeldTouch("run-1", ""), "", journal, lambda: None, runs=journal.runs)
    ran = begin({"op": "run", "id": "run-1", "board_id": "b17", "plan": "six", "order": "given"}, touching)

    def pause(name: str) -> None:
        ran.job.pausing = name == NAMES[-1]

    prober.before = pause
    await run(world, PROCEDURES["run"], {}, ran)
    assert ran.got.outcome == "run_done"


async def test_a_kill_between_two_points_loses_none(world: World, journal: Journal, prober: Prober) -> None:
    """What was begun and has no end in the journal is what a kill leaves."""
    _store(world, _plan(world))
    reached, forever = asyncio.Event(), asyncio.Event()

    def hang(name: str) -> Any:
        if name == "C":
            reached.set()
            return forever.wait()
        return None

    prober.before = hang
    touching = Touching(HeldTouch("run-1", ""), "", journal, lambda: None, runs=journal.runs)
    ran = begin({"op": "run", "id": "run-1", "board_id": "b17", "plan": "six", "order": "given"}, touching)
    killed = asyncio.ensure_future(PROCEDURES["run"](ran.job, world.context))
    await reached.wait()
    left = await journal.runs.unfinished("b17")
    assert left is not None
    assert len(await journal.runs.records_of("run-1")) == 2
    killed.cancel()
    await asyncio.gather(killed, return_exceptions=True)
    await ran.job.settle()
    prober.before, prober.tested = (lambda _name: None), []
    await _run(world, journal, "run-2", resume=True, plan="six")
    assert prober.names == ["C", "D", "E", "F"]


async def test_another_run_of_a_board_is_refused_while_one_is_unfinished_and_told_how_to_go_on(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    await _stopped_at(world, journal, prober, "D", Fault(FaultCode.CANCELLED))
    fault = await _refused(world, journal, job_id="run-2", plan="six")
    assert fault.kind is FaultCode.RUN_UNFINISHED
    assert "run run-1 of board b17 is unfinished: 3 of 6 points have a verdict" in fault.message
    assert "`reprobe run --resume --board-id b17`" in fault.advice
    assert (fault.detail["run"], fault.detail["done"]) == ("run-1", 3)
    assert prober.tested == []
    await _run(world, journal, "run-3", plan="six", board_id="b18")  # another board has nothing to do with it
    assert len(prober.tested) == 6


async def test_an_unfinished_run_is_abandoned_when_that_is_said(world: World, journal: Journal, prober: Prober) -> None:
    _store(world, _plan(world))
    await _stopped_at(world, journal, prober, "D", Fault(FaultCode.CANCELLED))
    await _run(world, journal, "run-2", plan="six", abandon=True)
    assert len(prober.tested) == 6
    old, new = await journal.runs.find("run-1"), await journal.runs.find("run-2")
    assert old is not None
    assert new is not None
    assert (old.state, new.state) == ("abandoned", "done")
    assert old.summary is not None
    assert old.summary.done == 3
    fault = await _refused(world, journal, job_id="run-3", resume=True)
    assert fault.kind is FaultCode.UNKNOWN_RUN


async def test_a_run_is_gone_on_with_by_the_plan_it_began_with(world: World, journal: Journal, prober: Prober) -> None:
    store = _store(world, _plan(world))
    await _stopped_at(world, journal, prober, "D", Fault(FaultCode.CANCELLED))
    store.store(_plan(world, high=1.0), "bob")
    assert (await _refused(world, journal, job_id="r2", resume=True, plan="six", version=2)).kind is (
        FaultCode.RUN_UNFINISHED
    )
    assert "by plan six" in (await _refused(world, journal, job_id="r3", resume=True, points=["A"])).message
    await _run(world, journal, "run-4", plan="six", resume=True)
    assert {test.limits for test in prober.tested} == {Limits(high=5.0, unit="ohm")}


async def test_points_without_contact_one_after_the_other_stop_the_run(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    prober.verdicts = dict.fromkeys("ACDE", PointVerdict.CONTACT_NOT_MADE)
    ran = await _run(world, journal, plan="six", order="given", stop={"contact_not_made": 2})
    assert prober.names == ["A", "B", "C", "D"]
    assert (ran.got.outcome, ran.got.detail["state"]) == ("run_stopped", "unfinished")
    assert ran.got.detail["stopped_by"] == "2 points one after the other without contact (stop.contact_not_made)"


async def test_points_that_fail_stop_the_run_when_that_is_asked_for(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    prober.verdicts = {"A": PointVerdict.FAIL, "C": PointVerdict.OPEN_CONFIRMED, "D": PointVerdict.FAIL}
    ran = await _run(world, journal, plan="six", order="given", stop={"failed": 2})
    assert prober.names == ["A", "B", "C"]
    assert ran.got.detail["stopped_by"] == "2 points failed or are open (stop.failed)"


async def test_what_stopped_a_run_does_not_stop_whoever_goes_on_with_it(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    prober.verdicts = {"A": PointVerdict.FAIL, "B": PointVerdict.FAIL, "D": PointVerdict.CONTACT_NOT_MADE}
    stop = {"failed": 2, "contact_not_made": 2}
    assert (await _run(world, journal, plan="six", order="given", stop=stop)).got.outcome == "run_stopped"
    ran = await _run(world, journal, "run-2", resume=True, stop=stop)
    assert (ran.got.outcome, prober.names) == ("run_done", list(NAMES))


async def test_a_point_that_takes_too_long_stops_the_run_and_all_motion(
    world: World, journal: Journal, prober: Prober
) -> None:
    world.context.config = world.config.model_copy(
        update={"servo": world.config.servo.model_copy(update={"job_timeout_s": 0.05})}
    )
    _store(world, _plan(world))
    prober.before = lambda name: asyncio.Event().wait() if name == "B" else None
    fault = await _refused(world, journal, plan="six", order="given")
    assert fault.kind is FaultCode.DEADLINE_MISSED
    assert fault.message.startswith("B took longer")
    assert world.gantry.stopped == 1


async def test_a_plan_for_another_board_or_revision_is_refused_and_nothing_is_touched(
    world: World, journal: Journal, prober: Prober
) -> None:
    store = PlanStore(plans_folder(world.config.station.data_dir))
    store.store(_plan(world).model_copy(update={"name": "other", "board": "c"}), "ada")
    store.store(_plan(world).model_copy(update={"name": "old", "board_revision": "x"}), "ada")
    for name in ("other", "old"):
        fault = await _refused(world, journal, job_id=name, plan=name)
        assert fault.kind is FaultCode.WRONG_PLAN
    assert prober.tested == prober.admitted == []


async def test_learned_limits_are_not_used_before_a_person_approved_them(
    world: World, journal: Journal, prober: Prober
) -> None:
    store = _store(world, _plan(world, learned_from=("run-0",)))
    assert (await _refused(world, journal, plan="six")).kind is FaultCode.PLAN_NOT_APPROVED
    store.approve("six", None, "M. Weber")
    assert (await _run(world, journal, "run-2", plan="six")).got.outcome == "run_done"


async def test_what_is_not_admitted_begins_no_run(world: World, journal: Journal, prober: Prober) -> None:
    _store(world, _plan(world))
    prober.not_admitted = Fault(FaultCode.NOT_ALIGNED)
    assert (await _refused(world, journal, plan="six")).kind is FaultCode.NOT_ALIGNED
    assert await journal.runs.unfinished("b17") is None


@pytest.mark.parametrize(
    ("lacking", "kind"),
    [
        ("tip", FaultCode.NOT_CALIBRATED), ("map", FaultCode.NOT_CALIBRATED), ("surface", FaultCode.SURFACE_UNKNOWN),
        ("surface of this board", FaultCode.SURFACE_UNKNOWN), ("alignment", FaultCode.NOT_ALIGNED),
    ],
)  # fmt: skip
async def test_what_no_point_could_be_tested_without_is_refused_before_the_first_one(
    world: World, journal: Journal, lacking: str, kind: FaultCode
) -> None:
    """One refusal with its cure, and not a page of points that were not tested; nothing moves."""
    _store(world, _plan(world))
    if lacking != "tip":
        world.teach()
    if lacking not in ("tip", "map"):
        world.with_map()
    if lacking == "surface of this board":
        world.with_surface(made_at="2026-03-01T10:00:00.000+00:00")
    if lacking != "alignment":
        world.with_alignment(world.true_pose, board_id="b17")
    fault = await _refused(world, journal, plan="six")
    assert (fault.kind, world.gantry.moves) == (kind, [])
    cure = "align" if lacking == "alignment" else "calibrate"
    assert f"`reprobe {cure}" in as_commands(fault.advice)
    assert await journal.runs.unfinished("b17") is None


async def test_a_run_whose_points_all_lie_far_from_what_was_measured_is_refused_before_the_first_one(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    world.teach().with_map().with_alignment(world.true_pose, board_id="b17").with_surface()
    fault = await _refused(world, journal, plan="six")
    assert (fault.kind, world.gantry.moves) == (FaultCode.SURFACE_UNKNOWN, [])
    assert "10 mm from every point" in fault.message
    assert await journal.runs.unfinished("b17") is None


async def test_a_test_that_waits_for_a_tester_is_no_part_of_a_run(
    world: World, journal: Journal, prober: Prober
) -> None:
    insert = PointTest(point="A", method="insert")
    _store(world, _plan(world).model_copy(update={"tests": (insert,)}))
    assert "insert" in (await _refused(world, journal, plan="six")).message


async def test_a_point_out_of_reach_keeps_no_other_from_its_test(
    world: World, journal: Journal, prober: Prober
) -> None:
    limits = {"maximum": float(world.pad_um("E")[0]) - world.true_head.tip_offset_um(0.0)[0] + 1000.0}
    axes = world.config.axes
    theta = axes.theta.model_copy(update={"minimum": -1.0, "maximum": 1.0})
    narrow = axes.model_copy(update={"x": axes.x.model_copy(update=limits), "theta": theta})
    world.gantry.config = world.config.model_copy(update={"axes": narrow})
    _store(world, _plan(world))
    await _run(world, journal, plan="six")
    assert sorted(prober.names) == list(NAMES)
    found = await journal.runs.find("run-1")
    assert found is not None
    assert [place.theta_deg for place in found.places] == [0.0, None, 0.0, None, 0.0, None]


def test_the_example_of_a_run_is_read_again_from_its_row() -> None:
    from daemon.domain.board_run import BoardRun
    from daemon.wire.example_runs import RUN

    told = BoardRun.model_validate(RUN)
    assert BoardRun.model_validate(json.loads(told.model_dump_json())) == told


@pytest.mark.parametrize(("tare_s", "asked"), [(900.0, 2), (1e-9, 2 + len(NAMES))])
async def test_a_tare_that_ages_in_a_run_is_read_anew(
    world: World, journal: Journal, prober: Prober, monkeypatch: pytest.MonkeyPatch, tare_s: float, asked: int
) -> None:
    times = []

    async def check(_job: Any, context: Any, _meter: Any, health: NeedleHealth) -> bool:
        times.append(len(prober.tested))
        health.read(0.2, good=True, of=what_was_read(context))
        return False

    monkeypatch.setattr("daemon.procedures.run.check_needle", check)
    sections: Any = {
        "meter": MeterSection(kind="scpi", address="127.0.0.1:1"),
        "reference": ReferenceSection(x_um=0.0, y_um=0.0, tare_s=tare_s),
    }
    world.context.config = world.context.config.model_copy(update=sections)
    meter: Any = object()
    world.station.fit(meter)
    _store(world, _plan(world))
    await _run(world, journal, plan="six")
    assert len(times) == asked
    assert (times[0], times[-1]) == (0, len(NAMES))


async def test_each_test_is_told_which_points_have_their_verdict(
    world: World, journal: Journal, prober: Prober
) -> None:
    _store(world, _plan(world))
    await _run(world, journal, plan="six")
    assert len(prober.done) == len(NAMES) - 1


async def test_each_record_names_the_plan_it_was_tested_by(world: World, journal: Journal, prober: Prober) -> None:
    plan = _plan(world)
    _store(world, plan)
    await _run(world, journal, plan="six")
    assert [record.plan_hash for record in await journal.runs.records_of("run-1")] == [plan.hash] * len(NAMES)
