"""The judge of the fault campaign finds each kind of violation in records made by hand, and none in clean ones."""

from __future__ import annotations

import json
import random
import threading
from contextlib import nullcontext
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from tests.bench.faults import campaign, fuzz, judge, matrix
from tests.bench.faults.__main__ import arguments
from tests.bench.faults.campaign import PARTS, Plan
from tests.bench.faults.messages import messages
from tests.bench.faults.records import Glance, Job, Ledger, Truth, Violation
from tests.bench.faults.station import read_stops
from tests.bench.faults.table import complete, show

UP = Truth(t_s=10.0, x_um=60_000.0, y_um=40_000.0, z_um=5_600.0, theta_deg=60.0, pressed_um=0.0)
PRESSED = replace(UP, z_um=4_900.0, pressed_um=100.0)
IDLE: dict[str, Any] = {
    "lifecycle": "ready", "state": "idle", "fault": None, "running": None, "queued": 0, "needle": {"place": "up"},
}  # fmt: skip
RESULT: dict[str, Any] = {
    "id": "a", "op": "place", "ok": True, "seq": 7, "station": "s", "finished_at": "2025-03-04T09:30:12.345+00:00",
    "outcome": "placed",
}  # fmt: skip
FAILED = {**RESULT, "ok": False, "outcome": "failed"}
PLACE_UM = (1_000.0, 2_000.0)
OFFSET_UM = (51_000.0, 27_000.0)
THERE = replace(UP, x_um=52_000.0, y_um=29_000.0)


def in_fault(name: str, needle: str = "up") -> dict[str, Any]:
    return {**IDLE, "state": "fault", "fault": {"name": name}, "needle": {"place": needle}}


def glance(truth: Truth, status: dict[str, Any] = IDLE, at_s: float = 0.0, held: tuple[str, ...] = ()) -> Glance:
    return Glance(at_s, truth, status, truth, held)


def accepted(*results: tuple[str, dict[str, Any]]) -> list[Job]:
    ledger = Ledger()
    ledger.ask(Job("a", "kills:3", "place", PLACE_UM, undisturbed=True))
    ledger.answered({"ok": True, "accepted": True, "id": "a"}, "kills:3")
    for source, result in results:
        ledger.said(source, result, "kills:3")
    return ledger.jobs()


def kinds(found: list[Violation]) -> list[str]:
    return [violation.kind for violation in found]


def test_clean_records_are_no_violation() -> None:
    jobs = accepted(("answer", RESULT), ("event", {**RESULT, "topic": "result", "time": "now"}), ("journal", RESULT))
    assert judge.lost(jobs, {"a": RESULT}) == []
    assert judge.contradictory(jobs) == []
    assert judge.moved(jobs, [UP, THERE, replace(THERE, x_um=52_008.0), UP], OFFSET_UM) == []
    assert judge.sideways([PRESSED, replace(PRESSED, t_s=10.1, x_um=60_005.0), replace(UP, t_s=10.15)], "i") == []
    assert judge.sideways_stops([PRESSED, UP, replace(PRESSED, x_um=0.0)], lambda _t_s: "i") == []
    assert judge.pressed_at_rest([glance(UP)], "i") == []
    assert judge.lights_at_rest([glance(UP, at_s=at_s) for at_s in (0.0, 2.0)], "i") == []
    assert judge.incoherent([glance(UP), glance(UP, in_fault("link_lost"))], "i") == []


def test_an_accepted_id_without_a_result_is_lost_and_one_that_was_refused_is_not() -> None:
    assert kinds(judge.lost(accepted())) == ["lost"]
    assert judge.lost([Job("b", "kills:3")]) == []


@pytest.mark.parametrize("journal", [{}, {"a": None}])
def test_an_answered_id_without_a_result_in_the_journal_is_lost(journal: dict[str, Any]) -> None:
    assert kinds(judge.lost(accepted(("answer", RESULT)), journal)) == ["lost"]


def test_two_results_of_one_id_that_differ_in_anything_are_contradictory() -> None:
    assert kinds(judge.contradictory(accepted(("event", RESULT), ("journal", FAILED)))) == ["contradictory"]
    assert kinds(judge.contradictory(accepted(("event", RESULT), ("event", {**RESULT, "seq": 8})))) == ["contradictory"]


def test_a_status_that_names_a_fault_and_is_in_none_is_contradictory() -> None:
    assert kinds(judge.incoherent([glance(UP, {**IDLE, "state": "fault"})], "i")) == ["contradictory"]
    assert kinds(judge.incoherent([glance(UP, {**in_fault("link_lost"), "state": "idle"})], "i")) == ["contradictory"]


def test_an_id_that_came_down_at_its_place_twice_is_doubled() -> None:
    jobs = accepted(("answer", RESULT))
    assert kinds(judge.moved(jobs, [THERE, UP, THERE], OFFSET_UM)) == ["doubled"]
    assert kinds(judge.moved(jobs, [THERE, replace(THERE, z_um=12_000.0), THERE], OFFSET_UM)) == ["doubled"]


def test_an_id_that_says_placed_and_never_came_down_there_is_contradictory() -> None:
    passed_over = [UP, replace(THERE, z_um=12_000.0)]
    assert kinds(judge.moved(accepted(("answer", RESULT)), passed_over, OFFSET_UM)) == ["contradictory"]
    assert judge.moved(accepted(("answer", FAILED)), passed_over, OFFSET_UM) == []


def test_what_moves_or_has_moved_is_stirred() -> None:
    assert not judge.stirred(UP, replace(UP, t_s=99.0, x_um=60_008.0))
    for after in (replace(UP, moving=True), replace(UP, z_um=12_000.0), replace(UP, theta_deg=90.0)):
        assert judge.stirred(UP, after)


@pytest.mark.parametrize("status", [IDLE, in_fault("link_lost"), in_fault("not_homed")])
def test_a_pin_pressed_in_idle_or_in_another_fault_is_pressed_at_rest(status: dict[str, Any]) -> None:
    assert kinds(judge.pressed_at_rest([glance(PRESSED, status)], "i")) == ["pressed at rest"]


@pytest.mark.parametrize(
    "status",
    [
        in_fault("needle_down", "down"),
        in_fault("link_lost", "unknown"),
        {**IDLE, "state": "verify", "running": {"id": "a"}},
        {**in_fault("not_homed"), "lifecycle": "opening"},
    ],
)
def test_a_pin_pressed_in_a_job_or_known_not_to_be_up_is_not_pressed_at_rest(status: dict[str, Any]) -> None:
    assert judge.pressed_at_rest([glance(PRESSED, status)], "i") == []


@pytest.mark.parametrize("moved", [{"x_um": 60_030.0}, {"y_um": 39_970.0}, {"theta_deg": 60.5}])
def test_a_pin_that_is_carried_aside_while_pressed_is_found(moved: dict[str, Any]) -> None:
    aside = replace(PRESSED, t_s=10.05, **moved)
    assert kinds(judge.sideways([PRESSED, aside], "i")) == ["sideways while pressed"]
    assert kinds(judge.sideways_stops([PRESSED, aside], lambda _t_s: "i")) == ["sideways while pressed"]
    assert judge.sideways([PRESSED, replace(aside, slipped=True)], "i") == []


@pytest.mark.parametrize("status", [IDLE, in_fault("not_homed")])
def test_a_lamp_that_is_on_a_second_after_idle_is_found_and_one_that_goes_out_is_not(status: dict[str, Any]) -> None:
    lit = replace(UP, light=0.4)
    staying = [glance(lit, status, at_s=at_s) for at_s in (0.0, 0.6, 1.2)]
    assert kinds(judge.lights_at_rest(staying, "i")) == ["lights on at rest"]
    assert judge.lights_at_rest([*staying[:2], glance(UP, status, at_s=1.2)], "i") == []
    looking = {**IDLE, "state": "look", "running": {"id": "a"}}
    assert judge.lights_at_rest([staying[0], glance(lit, looking, at_s=0.6), *staying[2:]], "i") == []


def test_the_truth_log_tells_where_the_station_stopped_and_when_it_slipped_by_itself(tmp_path: Path) -> None:
    stop = {
        "event": "settled",
        "t_s": 1.0,
        "axes": {"x_um": 1.0, "y_um": 2.0, "z_um": 3.0, "theta_deg": 4.0},
        "pressed_um": 5.0,
    }
    slips = [{"event": "fault", "name": "slip", "on": on} for on in (True, False)]
    log = tmp_path / "truth.jsonl"
    log.write_text("\n".join(json.dumps(line) for line in ({"event": "start"}, stop, slips[0], stop, slips[1], stop)))
    stops = read_stops(log)
    assert [s.slipped for s in stops] == [False, True, False]
    assert stops[0] == Truth(t_s=1.0, x_um=1.0, y_um=2.0, z_um=3.0, theta_deg=4.0, pressed_um=5.0)


def test_a_needle_that_is_let_down_by_small_steps_was_sent_there_once_and_one_that_comes_down_again_twice() -> None:
    def stops(*heights_um: float) -> list[Truth]:
        return [Truth(float(n), 10.0, 20.0, z_um, 60.0, 0.0) for n, z_um in enumerate(heights_um)]

    steps = [12_000.0 - 450.0 * n for n in range(15)]
    assert steps[-1] < judge.LOW_UM
    assert judge.arrivals((10.0, 20.0), stops(12_000.0, 5_200.0, *steps)) == 1
    assert judge.arrivals((10.0, 20.0), stops(12_000.0, 5_200.0, 12_000.0, 5_200.0)) == 2
    assert judge.arrivals((10.0, 20.0), stops(12_000.0, 5_200.0, 7_100.0, 5_200.0)) == 2


def test_the_campaign_has_its_full_size_and_every_row_of_the_matrix_once() -> None:
    asked = arguments([])
    assert [getattr(asked, part) for part in PARTS] == [200, 50, 30, 20, 12, 6, 8, 256, 100_000]
    chosen = [matrix.title(row) for row in matrix.rows(1, 256)]
    assert len(set(chosen)) == 256
    assert chosen != [matrix.title(row) for row in matrix.rows(2, 256)]


def test_the_stations_share_all_items_and_one_item_can_be_repeated_alone() -> None:
    counts = dict.fromkeys(PARTS, 0) | {"kills": 5, "resets": 2, "rows": 9, "messages": 4_000}
    plan = Plan(1, counts, stations=3, workers=1, speed=5.0)
    shares = [*plan.anybodys(), *(item for number in range(3) for item in plan.share(number))]
    assert len(shares) == len(set(shares)) == 5 + 2 + 9 + 2
    again = plan.repeat(Violation("lost", "rows:4", "x"))
    assert again.endswith("--only rows:4")
    only = replace(plan, only="rows:4")
    assert [only.share(number) for number in range(3)] == [[], [("rows", 4)], []]
    assert only.anybodys() == []


def test_what_any_station_may_do_is_done_once_by_whoever_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of two stations is held up at its first item until all else is done; items are doubles."""
    done, rest = [], threading.Event()
    expected = 2 + 10

    def item(_plan: Plan, _station: object, part: str, n: int) -> None:
        if (part, n) == ("kills", 0):
            assert rest.wait(60.0)
        done.append((part, n))
        if len(done) == expected - 1:
            rest.set()

    monkeypatch.setattr(
        campaign, "running_station", lambda *_: nullcontext(SimpleNamespace(violations=[], ledger=Ledger()))
    )
    monkeypatch.setattr(campaign, "_item", item)
    counts = dict.fromkeys(PARTS, 0) | {"kills": 2, "messages": 10 * fuzz.BATCH}
    plan = Plan(1, counts, stations=2, workers=2, speed=5.0)
    tally = campaign.run(plan, lambda _text: None)
    assert len(done) == len(set(done)) == expected
    assert tally.done == {"kills": 2, "messages": 10}
    assert complete(plan, tally)


def test_a_campaign_that_is_ended_tells_what_it_did_and_is_not_good(monkeypatch: pytest.MonkeyPatch) -> None:
    """After two items of one station; stations and items are doubles."""
    enough, began = threading.Event(), []
    monkeypatch.setattr(
        campaign, "running_station", lambda *_: nullcontext(SimpleNamespace(violations=[], ledger=Ledger()))
    )
    monkeypatch.setattr(campaign, "_item", lambda *_: began.append(1) or (len(began) == 2 and enough.set()))
    plan = Plan(1, dict.fromkeys(PARTS, 0) | {"kills": 5, "resets": 2}, stations=2, workers=1, speed=5.0)
    tally = campaign.run(plan, lambda _text: None, enough)
    assert tally.done == {"kills": 2}
    assert not complete(plan, tally)
    assert not show(Console(quiet=True), plan, tally)


def test_the_fuzzed_messages_are_the_same_for_the_same_seed() -> None:
    def made(seed: int) -> list[bytes]:
        return list(islice(messages(random.Random(seed), lambda op: {"op": op, "id": "j"}), 300))

    assert made(1) == made(1) != made(2)
    assert any(b'"id": "j"' in message for message in made(3) + made(4) + made(5))
