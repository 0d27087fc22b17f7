"""A point is probed to the verdict that is true of it, by the simulated meter; judged by the truth log."""

from __future__ import annotations

import json
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from daemon.client import Client, Subscription
from daemon.domain.results import JobResult
from daemon.tools.demo.fixture import Fixture
from daemon.tools.demo.truth_log import Stretch
from tests.station.rig import EVENTUALLY_S, FAST, ROOT, Rig, running_rig

SITE, SMALL, SITES = "TP7", "TP3", ("TP5", "TP4", "TP9", "TP8")
"""Of the demonstration board: pads of 450 um, but for the second, a via of 150 um."""
FASTEST_UM_S = 2500.0
PRESSES_MOST = 8
HELD_STILL_UM = 2.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station with a meter that is calibrated and aligned; tests leave it idle."""
    with running_rig(tmp_path_factory.mktemp("probe"), arguments=FAST, reply_ms=1000.0, electric=True) as running:
        running.bench.ask("set", name="drive_boot_s", value=0.0)
        with running.client() as client:
            running.session(client).set_up()
            _must(client, "align", timeout_s=600.0)
            _must(client, "calibrate", what="surface", places=12, timeout_s=600.0)
        yield running


@pytest.fixture
def client(rig: Rig) -> Iterator[Client]:
    """A tester's connection; afterwards the station is idle and whole, and what is forbidden has not happened."""
    before = len(_log(rig, "touch_down"))
    with rig.client() as connected:
        yield connected
    for name in ("harness_open", "meter_silent", "meter_slow", "meter_garbage", "meter_stuck"):
        rig.bench.ask("fault", name=name, on=False)
    with rig.client() as janitor:
        janitor.raw(b'{"op": "cancel"}')
        janitor.raw(b'{"op": "reset"}', timeout_s=60.0)
    _until_the_meter_answers(rig)
    rig.until(_free, "the needle was left down")
    assert not _log(rig, "dent", "scratch")
    for down in _log(rig, "touch_down")[before:]:
        assert down["speed_um_s"] <= FASTEST_UM_S
    for lifted in _log(rig, "lift_off")[before:]:
        assert lifted["dragged_um"] <= HELD_STILL_UM


def _until_the_meter_answers(rig: Rig) -> None:
    """Wait until it has worked off what it was asked while it was slow."""
    host, port = rig.meter.rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=60.0) as line, line.makefile("rwb") as text:
        text.write(b"*IDN?\n")
        text.flush()
        assert text.readline()


def _must(client: Client, op: str, **fields: Any) -> JobResult:
    result = client.job(op, **fields)
    assert result.ok, result.error
    return result


def _log(rig: Rig, *events: str) -> list[dict[str, Any]]:
    rig.truth()  # what the needle did is worked off when somebody asks
    lines = (rig.places.out / "truth.jsonl").read_text().splitlines()
    return [told for line in lines if (told := json.loads(line)).get("event") in events]


def _free(truth: dict[str, Any]) -> bool:
    return bool(truth["pressed_um"] == 0.0)


@contextmanager
def _knob(rig: Rig, name: str, value: float, after: float = 0.0) -> Iterator[None]:
    rig.bench.ask("set", name=name, value=value)
    try:
        yield
    finally:
        rig.bench.ask("set", name=name, value=after)


def _record(result: JobResult) -> dict[str, Any]:
    assert result.ok, result.error
    record: dict[str, Any] = result.detail["record"]
    return record


def _net(rig: Rig, point: str) -> str:
    net = next(one.net for one in rig.board.points if one.name == point)
    assert net is not None
    return net


def _stands(rig: Rig, before: int) -> list[dict[str, Any]]:
    """Return the touches since, on the board alone: those of coin and brush have nets of their own."""
    return [down for down in _log(rig, "touch_down")[before:] if "REFERENCE COIN" not in down["nets"]]


def test_a_sound_net_passes_at_the_first_touch_and_the_record_says_what_was_read(rig: Rig, client: Client) -> None:
    before = len(_log(rig, "touch_down"))
    with Subscription(rig.events, topics=("point",)) as heard:
        while heard.next(0.05) is not None:
            pass
        result = client.job("probe", job_id="sound", test_point=SITE, limits={"high": 5.0, "unit": "ohm"})
        told = heard.next(EVENTUALLY_S)
    record = _record(result)
    assert (result.outcome, record["verdict"], record["net"]) == ("pass_first", "pass_first", _net(rig, SITE))
    (down,) = _stands(rig, before)
    assert down["nets"] == [_net(rig, SITE)]
    assert record["readings"][0]["force_n"] == pytest.approx(down["force_n"], rel=0.1)
    assert told is not None
    assert {name: told[name] for name in record} == record
    assert told["job"] == "sound"
    assert _points(rig, "sound") == [(SITE, "pass_first")]


def test_a_point_that_the_head_missed_by_far_is_recovered_by_the_eye(rig: Rig, client: Client) -> None:
    with _knob(rig, "misplaced_um", 300.0, 400.0), _knob(rig, "misplaced_share", 1.0):
        before, missed = len(_log(rig, "touch_down")), 0
        for n, point in enumerate(SITES):
            client.request("probe", id=f"missed-{n}", test_point=point)
            rig.until(lambda truth: truth["pressed_um"] > 0.0, "it never touched")
            rig.bench.ask("set", name="misplaced_share", value=0.0)
            record = _record(_result(client, f"missed-{n}"))
            rig.bench.ask("set", name="misplaced_share", value=1.0)
            downs = _stands(rig, before)
            before = len(_log(rig, "touch_down"))
            on_metal = [_net(rig, point) in down["nets"] for down in downs]
            if not on_metal[0]:
                missed += 1
                assert (record["verdict"], record["recovered_by"]) == ("pass_recovered", "look"), record
                assert on_metal[1:] == [True], "no press went off the metal after the eye had looked"
                assert record["error_um"] > 150.0
    assert missed >= 1
    assert client.request("status")["calibration"]["aligned"]


def test_an_oxide_is_recovered_by_pressing_again_on_metal_that_was_seen(rig: Rig, client: Client) -> None:
    recovered = []
    with _knob(rig, "oxide_share", 1.0):
        for point in ("J1.4", "U1.15", "U1.14", "TP6", "TP10", "TP2"):
            before = len(_log(rig, "touch_down", "press"))
            record = _record(client.job("probe", test_point=point))
            presses = [one for one in _log(rig, "touch_down", "press")[before:] if "COIN" not in str(one["nets"])]
            assert len(presses) == record["presses"] <= PRESSES_MOST
            assert record["verdict"] in ("pass_first", "pass_recovered"), record
            recovered += [record["cause"]] if record["verdict"] == "pass_recovered" else []
    assert recovered
    assert set(recovered) == {"film"}


def test_a_broken_net_is_confirmed_open_and_a_sound_one_never(rig: Rig, client: Client) -> None:
    verdicts = []
    with _knob(rig, "open_share", 1.0):
        broken, truth = set(rig.bench.ask("circuit")["open_nets"]), Fixture(rig.bench)
        for point in (SMALL, *SITES, "J1.1"):
            record = _record(client.job("probe", test_point=point))
            sound = truth.is_sound(rig.board.point(point), Stretch())
            verdicts.append((sound, record["verdict"]))
            if sound:
                continue
            assert _net(rig, point) in broken
            proofs = [one["contact_ohm"] for one in record["readings"] if one["proof"]]
            assert _is_proved_twice(record)
            assert point != SMALL or len(proofs) == 2, "it was pressed before, so that it is seen first"
            assert max(proofs) < 1.0
            if record["verdict"] != "open_confirmed":
                assert "net or harness" in record["reason"]
    assert {verdict for sound, verdict in verdicts if sound} <= {"pass_first", "pass_recovered"}
    assert {verdict for sound, verdict in verdicts if not sound} <= {"open_confirmed", "contact_not_made"}
    assert (False, "open_confirmed") in verdicts, verdicts


def _is_proved_twice(record: dict[str, Any]) -> bool:
    """Whether contact was proved in two presses below the eye, and in no more.

    A first touch comes before any look; it counts where the look after it shows that it stood on the pad.
    """
    proofs = [one for one in record["readings"] if one["proof"]]
    return len(proofs) == 2 or (len(proofs) == 3 and not proofs[0]["seen"])


@pytest.mark.parametrize("broken", ["a wire", "all wires", "its plug"])
def test_a_broken_harness_accuses_no_net(rig: Rig, client: Client, broken: str) -> None:
    harness = rig.bench.ask("circuit")["harness"]
    own = next(int(channel) for channel, net in harness.items() if net == _net(rig, SMALL))
    with ExitStack() as trouble:
        if broken == "its plug":
            trouble.enter_context(_knob(rig, "harness_ohm", 47.0))
        else:
            rig.bench.ask("fault", name="harness_open", on=True, channel=own if broken == "a wire" else 0)
        record = _record(client.job("probe", test_point=SMALL))
    assert record["verdict"] == "contact_not_made", record
    assert "net or harness" in record["reason"]
    assert _is_proved_twice(record)


def test_a_pad_under_flux_is_no_open_but_a_contact_that_was_not_made(rig: Rig, client: Client) -> None:
    verdicts = []
    with _knob(rig, "stubborn_share", 1.0):
        for point in ("U1.11", "U1.12", "U1.13"):
            record = _record(client.job("probe", test_point=point))
            verdicts.append(record["verdict"])
            assert record["verdict"] != "open_confirmed"
            assert record["presses"] <= PRESSES_MOST
            if record["verdict"] == "contact_not_made":
                assert not any(one["proof"] for one in record["readings"])
    assert "contact_not_made" in verdicts


@pytest.mark.parametrize(
    ("fault", "parameters"), [("meter_silent", {}), ("meter_slow", {"delay_s": 12.0}), ("meter_garbage", {})]
)
def test_a_meter_that_fails_while_the_needle_stands_brings_it_up_with_its_cause(
    rig: Rig, client: Client, fault: str, parameters: dict[str, Any]
) -> None:
    client.request("probe", id=f"dead-{fault}", test_point=_fresh(rig))
    rig.until(lambda truth: truth["pressed_um"] > 0.0, "it never touched")
    with rig.fault(fault, **parameters):
        result = _result(client, f"dead-{fault}")
        rig.until(_free, "the needle stayed down")
    if result.ok:
        pytest.skip("the reading was over before the fault began")
    assert result.error is not None
    assert result.error.name == "meter_failed"
    assert client.request("status")["needle"]["place"] == "up"


def test_a_meter_that_is_dead_beforehand_lowers_nothing(rig: Rig, client: Client) -> None:
    before = len(_log(rig, "touch_down"))
    with rig.fault("meter_silent"):
        result = client.job("probe", test_point=_fresh(rig))
    assert result.error is not None
    assert (result.error.name, result.error.code) == ("meter_failed", 6106)
    assert len(_log(rig, "touch_down")) == before
    assert _record(client.job("probe", test_point=_fresh(rig)))["verdict"] == "pass_first"


def test_a_meter_that_reads_current_before_the_needle_stands_lowers_nothing(rig: Rig, client: Client) -> None:
    _must(client, "probe", test_point=_fresh(rig))
    before = len(_log(rig, "touch_down"))
    with rig.fault("meter_stuck", at="zero"):
        result = client.job("probe", test_point=_fresh(rig))
    assert result.error is not None
    assert result.error.name == "contact_before_descent"
    assert len(_log(rig, "touch_down")) == before


def test_a_meter_that_reads_no_current_anywhere_accuses_no_net_but_the_needle(rig: Rig, client: Client) -> None:
    _must(client, "probe", test_point=_fresh(rig))
    with rig.fault("meter_stuck", at="overload"):
        result = client.job("probe", test_point=_fresh(rig))
    assert result.error is not None
    assert result.error.name == "probe_bad"
    assert client.request("status")["needle"]["place"] == "up"


def test_the_tester_measures_press_after_press_until_it_is_content(rig: Rig, client: Client) -> None:
    stood: list[dict[str, Any]] = []

    def measure(contact: dict[str, Any]) -> dict[str, str]:
        assert rig.truth()["pressed_um"] > 200.0
        stood.append(contact)
        return {"verdict": "open" if len(stood) == 1 else "pass"}

    result = client.probe(_fresh(rig), measure=measure, job_id="tester", lease_ms=20_000.0)
    assert (result.outcome, len(stood)) == ("pass_recovered", 2)
    assert [one["said"] for one in _record(result)["readings"]] == ["open", "pass"]


def test_the_command_tells_the_verdict_and_exits_by_it(rig: Rig, client: Client) -> None:
    passed = _command(rig, "probe", "--net", _net(rig, SITE))
    assert passed.returncode == 0, passed.stderr
    assert "pass" in passed.stdout
    assert "ohm" in passed.stdout
    floating = ("--method", "voltage", "--low", "1", "--unit", "V", "--touches", "1", "--json")
    not_tested = _command(rig, "probe", _fresh(rig), *floating)
    told = json.loads(not_tested.stdout)
    assert not_tested.returncode == (3 if told["outcome"] in ("contact_not_made", "not_tested") else 1)
    usage = _command(rig, "probe", SITE, "--net", "CLK")
    assert usage.returncode == 2
    assert "Traceback" not in usage.stderr


def test_by_the_command_the_tester_measures_and_is_held_for(rig: Rig, client: Client) -> None:
    words = [sys.executable, "-m", "daemon.cli", "probe", _fresh(rig), "--measure", "tester", "--json"]
    command = subprocess.Popen(
        [*words, "--endpoint", rig.control], cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with command:
        assert command.stdin is not None
        assert command.stdout is not None
        for number, said in ((1, "open"), (2, "pass")):
            contact = json.loads(command.stdout.readline())["contact"]
            assert contact["press"] == number
            if number == 1:  # longer than the lease: it is renewed
                time.sleep(3.0)
            assert rig.truth()["pressed_um"] > 200.0
            command.stdin.write(f"{said}\n")
            command.stdin.flush()
        told = json.loads(command.stdout.readline())
        assert command.wait(EVENTUALLY_S) == 0
    assert [one["said"] for one in told["detail"]["record"]["readings"]] == ["open", "pass"]


def test_budgets_of_a_board_hold_over_visits_by_the_truth_log(rig: Rig, client: Client) -> None:
    _must(client, "align", board_id="worn", timeout_s=600.0)
    _must(client, "calibrate", what="surface", places=12, timeout_s=600.0)
    before = len(_log(rig, "touch_down", "press"))
    with _knob(rig, "stubborn_share", 1.0):
        results = [client.job("probe", test_point="TP1", board_id="worn") for _ in range(4)]
    verdicts = [_record(result)["verdict"] for result in results]
    assert verdicts[-1] == "not_tested"
    on_pad = [one for one in _log(rig, "touch_down", "press")[before:] if one["target"] == "TP1"]
    assert 0 < len(on_pad) <= PRESSES_MOST


def _command(rig: Rig, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "daemon.cli", *arguments, "--endpoint", rig.control]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=100, cwd=ROOT)


def _fresh(rig: Rig) -> str:
    """Return a pin of a part that nothing has touched yet; the test points are left to the tests that name them."""
    db = sqlite3.connect(f"file:{rig.places.out}/station/journal.sqlite?mode=ro", uri=True)
    touched = {row[0] for row in db.execute("SELECT point FROM touches")}
    db.close()
    offered = (one.name for one in rig.board.test_points() if one.net and not one.name.startswith("TP"))
    return next(name for name in offered if name not in touched)


def _points(rig: Rig, job_id: str) -> list[tuple[Any, ...]]:
    db = sqlite3.connect(f"file:{rig.places.out}/station/journal.sqlite?mode=ro", uri=True)
    rows = db.execute("SELECT point, verdict FROM points WHERE job=?", (job_id,)).fetchall()
    db.close()
    return rows


def _result(client: Client, job_id: str) -> JobResult:
    give_up_s = time.monotonic() + 60.0
    while (told := client.request("result", id=job_id)["result"]) is None:
        assert time.monotonic() < give_up_s, "it never ended"
        time.sleep(0.01)
    return JobResult.model_validate(told)
