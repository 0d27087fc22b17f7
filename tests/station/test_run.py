"""A run over a board survives a kill: it is gone on with, and no point is touched again after its verdict."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.client import Client, Refused
from daemon.domain.results import JobResult
from tests.station.rig import EVENTUALLY_S, FAST, Rig, answering, running_rig

BOARD_ID, POINTS = "SN-0042", 6
DONE_BEFORE = 2
LONG_S = 300.0
pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station with a meter, that knows where this board lies and how high; its plan has a point of six nets each."""
    with running_rig(tmp_path_factory.mktemp("run"), arguments=FAST, reply_ms=1000.0, electric=True) as running:
        running.bench.ask("set", name="drive_boot_s", value=0.0)
        with running.client() as client:
            running.session(client).set_up()
            _must(client, "align", board_id=BOARD_ID, timeout_s=LONG_S)
            _must(client, "calibrate", what="surface", places=4, timeout_s=LONG_S)
            client.request("plan", action="store", text=_plan(running), name="six")
        yield running


def _plan(rig: Rig) -> str:
    nets = sorted({point.net for point in rig.board.test_points() if point.net})[:POINTS]
    head = f'[plan]\nboard = "{rig.board.name}"\nnets = {json.dumps(nets)}\n'
    return f'{head}[defaults]\nhigh = "5 ohm"\n'


def _must(client: Client, op: str, **fields: Any) -> JobResult:
    result = client.job(op, **fields)
    assert result.ok, result.error
    return result


def _records(client: Client, run: str) -> list[dict[str, Any]]:
    asked = client.raw(json.dumps({"op": "points", "run": run}).encode())
    assert asked["ok"] or asked["error"]["name"] == "unknown_run"  # it has not begun
    points: list[dict[str, Any]] = asked.get("points", [])
    return points


def _touched(rig: Rig) -> list[str]:
    """Return the net of every touch of the board so far, by the truth log."""
    rig.truth()  # what the needle did is worked off when somebody asks
    lines = [json.loads(line) for line in (rig.places.out / "truth.jsonl").read_text().splitlines()]
    return [line["net"] for line in lines if line.get("event") == "touch_down" and line.get("net")]


def _killed_in_the_middle(rig: Rig, run: str) -> set[str]:
    """Kill the daemon while the needle stands on a point after some have a verdict; return the nets of those."""
    with rig.client() as client:
        client.request("run", id=run, plan="six", board_id=BOARD_ID)
        give_up_s = time.monotonic() + LONG_S
        while len(_records(client, run)) < DONE_BEFORE:
            assert time.monotonic() < give_up_s, "it never came so far"
            time.sleep(0.01)
        done = {record["net"] for record in _records(client, run)}
        rig.until(lambda truth: truth["pressed_um"] > 20.0, "no further point was touched")
        rig.daemon.kill()
    rig.start_daemon(answering)
    with rig.client() as client:
        give_up_s = time.monotonic() + EVENTUALLY_S
        while client.request("status")["lifecycle"] != "ready":
            assert time.monotonic() < give_up_s
            time.sleep(0.02)
        kept = {record["net"] for record in _records(client, run)}
        assert done <= kept, "a verdict that was told is gone"
        _must(client, "lift")
    return kept


def test_a_killed_run_is_resumed_and_touches_nothing_again_that_has_a_verdict(rig: Rig) -> None:
    done = _killed_in_the_middle(rig, "run-1")
    assert DONE_BEFORE <= len(done) < POINTS
    before = len(_touched(rig))
    with rig.client() as client:
        another = client.job("run", plan="six", board_id=BOARD_ID, timeout_s=LONG_S)
        assert another.error is not None
        assert (another.error.name, another.error.detail["run"]) == ("run_unfinished", "run-1")
        assert "--resume" in another.error.advice
        assert len(_touched(rig)) == before, "what was refused lowered the needle"
        resumed = _must(client, "run", resume=True, board_id=BOARD_ID, timeout_s=LONG_S)
        assert (resumed.outcome, resumed.detail["run"]) == ("run_done", "run-1")
        records = _records(client, "run-1")
        run = client.request("points", run=resumed.id, limit=1)["run"]
    assert len({record["net"] for record in records}) == len(records) == POINTS
    assert not done & set(_touched(rig)[before:]), "touched again after its verdict"
    assert (run["state"], run["jobs"]) == ("done", ["run-1", resumed.id])
    summary = resumed.detail["summary"]
    assert (summary["points"], summary["done"]) == (POINTS, POINTS)
    assert 0.0 < summary["reference_first_ohm"] < 1.0


def _reprobe(rig: Rig, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command as a person does."""
    return subprocess.run(
        [sys.executable, "-m", *rig.program, *arguments], capture_output=True, text=True, check=False, timeout=LONG_S
    )


def test_a_person_runs_a_plan_from_its_file_and_has_it_reported(rig: Rig, tmp_path: Path) -> None:
    with rig.client() as client:
        record = _records(client, "run-1")[0]
    plan = tmp_path / "one.csv"
    plan.write_text(f"# board: {rig.board.name}\npoint,high\n{record['point']},5 ohm\n")
    told = _reprobe(rig, "run", str(plan), "--board-id", BOARD_ID, "--endpoint", rig.control)
    assert told.returncode == 0, told.stderr
    line, summary, *_ = told.stdout.splitlines()
    assert line.startswith(f"1/1 {record['point']} ({record['net']}) pass first: ")
    assert "1 of 1 points, 1 passed at the first touch" in summary
    config = str(rig.places.out / "station.toml")
    drawn = _reprobe(rig, "board-report", "last", "--config", config, "-o", str(tmp_path / "out"))
    assert drawn.returncode == 0, drawn.stderr
    (row,) = csv.DictReader((tmp_path / "out" / "points.csv").read_text().splitlines())
    assert (row["run"] in summary, row["point"], row["plan"]) == (True, record["point"], "one")
    assert record["point"] in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"plan": "other", "board_id": BOARD_ID}, "unknown_plan"),
        ({"resume": True, "board_id": BOARD_ID}, "unknown_run"),
        ({"points": ["TP999"], "board_id": BOARD_ID}, "unknown_test_point"),
        ({"plan": "six", "board_id": "SN-9999"}, "not_aligned"),
    ],
)
def test_a_run_that_cannot_be_lowers_nothing_and_is_refused_by_name(
    fields: dict[str, Any], name: str, rig: Rig
) -> None:
    before = len(_touched(rig))
    with rig.client() as client:
        refused = client.job("run", **fields)
        assert refused.error is not None
        assert refused.error.name == name
        with pytest.raises(Refused) as nobodys:
            client.job("run", plan="six")
    assert "a run needs board_id" in nobodys.value.error["detail"]["fields"][0]["problem"]
    assert len(_touched(rig)) == before
