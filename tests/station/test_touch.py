"""A touch holds the needle down while somebody measures, and whatever ends it lifts; judged by the truth log."""

from __future__ import annotations

import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq

from daemon.client import Client, Refused, Subscription
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import Process
from tests.station.rig import EVENTUALLY_S, FAST, Rig, running_rig

POINT, OTHER = "TP7", "TP8"
FASTEST_UM_S = 2500.0
PRELOAD_N, RATE_N_PER_MM = 0.3, 0.6
"""Of the pin, by its data sheet."""
TOUCH_SENSE = '[sense]\nkind = "drive_input"\n'


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station with a map, a surface and a touch sense; tests leave it idle."""
    with running_rig(
        tmp_path_factory.mktemp("touch"), arguments=FAST, reply_ms=1000.0, more_settings=TOUCH_SENSE
    ) as running:
        running.bench.ask("set", name="drive_boot_s", value=0.0)
        with running.client() as client:
            running.session(client).set_up()
            _must(client, "calibrate", what="surface", places=4, timeout_s=600.0)
        yield running


@pytest.fixture
def client(rig: Rig) -> Iterator[Client]:
    """A tester's connection; afterwards the station is idle, homed, and the needle is up."""
    with rig.client() as connected:
        yield connected
    for name in ("silent", "estop"):
        rig.bench.ask("fault", name=name, on=False)
    with rig.client() as janitor:
        janitor.raw(b'{"op": "cancel"}')
        janitor.raw(b'{"op": "reset"}', timeout_s=60.0)
        if janitor.request("status")["state"] != "idle":
            janitor.job("home")


def _must(client: Client, op: str, **fields: Any) -> JobResult:
    result = client.job(op, **fields)
    assert result.ok, result.error
    return result


def _over(client: Client, point: str = POINT, theta_deg: float = 0.0) -> None:
    """Put the tip over a point, seen to be there."""
    _must(client, "place", test_point=point, theta_deg=theta_deg)
    _must(client, "correct", test_point=point)


def _log(rig: Rig, *events: str) -> list[dict[str, Any]]:
    rig.truth()  # what the needle did is worked off when somebody asks
    lines = (rig.places.out / "truth.jsonl").read_text().splitlines()
    return [told for line in lines if (told := json.loads(line)).get("event") in events]


def _pressed(truth: dict[str, Any]) -> bool:
    return bool(truth["pressed_um"] > 20.0)


def _free(truth: dict[str, Any]) -> bool:
    return bool(truth["pressed_um"] == 0.0)


def _result(client: Client, job_id: str) -> JobResult:
    give_up_s = time.monotonic() + EVENTUALLY_S
    while (told := client.request("result", id=job_id)["result"]) is None:
        assert time.monotonic() < give_up_s, "it never ended"
        time.sleep(0.01)
    return JobResult.model_validate(told)


def _error(result: JobResult) -> str:
    assert result.error is not None, result
    return result.error.name


def _rows(rig: Rig, job_id: str) -> list[tuple[Any, ...]]:
    db = sqlite3.connect(f"file:{rig.places.out}/station/journal.sqlite?mode=ro", uri=True)
    sql = "SELECT point, pressed_um, force_n, ended_by, verdict, value, unit FROM touches WHERE job=?"
    rows = db.execute(sql, (job_id,)).fetchall()
    db.close()
    return rows


def _until_it_answers(process: Process, control: str) -> None:
    give_up_s = time.monotonic() + EVENTUALLY_S
    with Client(control, timeout_s=EVENTUALLY_S) as client:
        while client.request("status")["lifecycle"] != "ready":
            assert time.monotonic() < give_up_s, process.last_words()
            time.sleep(0.02)


class Meter:
    """The simulated meter as a tester's own program asks it: text over TCP."""

    def __init__(self, rig: Rig) -> None:
        host, port = rig.meter.rsplit(":", 1)
        self._socket = socket.create_connection((host, int(port)), timeout=EVENTUALLY_S)
        self._file = self._socket.makefile("rwb")
        self._harness = rig.bench.ask("circuit")["harness"]

    def tell(self, text: str) -> None:
        self._file.write(text.encode() + b"\n")
        self._file.flush()

    def ohms(self, net: str) -> float:
        channel = next(channel for channel, name in self._harness.items() if name == net)
        self.tell("ROUT:OPEN:ALL")
        self.tell(f"ROUT:CLOS (@{channel})")
        self.tell("CONF:RES")
        self.tell("READ?")
        return float(self._file.readline())

    def close(self) -> None:
        self._file.close()
        self._socket.close()


def _ask(tester: zmq.Socket[bytes], **request: Any) -> dict[str, Any]:
    tester.send_json({"v": 1, **request})
    assert tester.poll(60_000), "no answer"
    reply: dict[str, Any] = tester.recv_json()  # type: ignore[assignment]  # an object, as the wire says
    assert reply["ok"], reply
    return reply


def _measured_in_three_frames(rig: Rig, job_id: str) -> tuple[float, dict[str, Any]]:
    """Touch, measure and lift as a program in any language does; return the ohms and the result."""
    net = next(point.net for point in rig.board.points if point.name == POINT)
    assert net is not None
    meter = Meter(rig)
    with zmq.Context() as context, context.socket(zmq.REQ) as tester:
        tester.connect(rig.control)
        stands = _ask(tester, op="touch", id=job_id, test_point=POINT, hold_ms=20_000, lease_ms=20_000, wait="contact")
        assert stands["contact"]["pressed_um"] == pytest.approx(300.0, abs=15.0)
        ohms = meter.ohms(net)
        is_open = ohms > 1e9
        said = {"verdict": "open"} if is_open else {"verdict": "pass", "value": ohms, "unit": "ohm"}
        done = _ask(tester, op="lift", id=job_id, **said)
        assert _ask(tester, op="lift", id=job_id)["result"] == done["result"], "asked again, it answers the same"
    meter.close()
    return ohms, done["result"]


def test_a_plain_client_measures_a_sound_net_in_three_frames(rig: Rig, client: Client) -> None:
    _over(client)
    before = len(_log(rig, "touch_down"))
    ohms, result = _measured_in_three_frames(rig, "sound")
    assert 0.05 < ohms < 5.0
    assert (result["outcome"], result["detail"]["ended_by"]) == ("touched", "lift")
    assert result["detail"]["measured"] == {"verdict": "pass", "value": ohms, "unit": "ohm"}
    (down,) = _log(rig, "touch_down")[before:]
    assert down["target"] == POINT
    assert 0.0 < down["speed_um_s"] <= FASTEST_UM_S
    asked_n = PRELOAD_N + RATE_N_PER_MM * 0.3
    assert down["force_n"] == pytest.approx(asked_n, rel=0.10)
    lifted = _log(rig, "lift_off")[-1]
    assert lifted["presses"] == 1
    assert lifted["dragged_um"] <= 2.0
    assert not _log(rig, "dent", "scratch")
    ((point, pressed_um, force_n, *rest),) = _rows(rig, "sound")
    assert (point, rest) == (POINT, ["lift", "pass", ohms, "ohm"])
    assert pressed_um == pytest.approx(down["pressed_um"], abs=30.0)
    assert force_n == pytest.approx(asked_n, rel=0.05)


def test_a_plain_client_reads_a_broken_net_as_open(rig: Rig, client: Client) -> None:
    _over(client)
    rig.bench.ask("set", name="open_share", value=1.0)
    try:
        ohms, result = _measured_in_three_frames(rig, "broken")
    finally:
        rig.bench.ask("set", name="open_share", value=0.0)
    assert ohms > 1e9
    assert result["detail"]["measured"] == {"verdict": "open"}
    assert _rows(rig, "broken")[0][3:] == ("lift", "open", None, None)


def test_the_pin_is_pushed_in_as_far_as_was_asked(rig: Rig, client: Client) -> None:
    _over(client, OTHER, 40.0)
    result = _must(client, "touch", test_point=OTHER, press_um=150.0)
    assert result.detail["ended_by"] == "at_once"
    down = _log(rig, "touch_down")[-1]
    assert down["force_n"] == pytest.approx(PRELOAD_N + RATE_N_PER_MM * 0.15, rel=0.10)
    assert down["speed_um_s"] <= FASTEST_UM_S
    assert _free(rig.truth())


def test_a_held_needle_is_a_busy_machine_that_everybody_is_told_of(rig: Rig, client: Client) -> None:
    _over(client)
    with Subscription(rig.events, topics=("contact",)) as heard:
        while heard.next(0.05) is not None:
            pass
        contact = client.touch(POINT, job_id="told", lease_ms=20_000.0)
        assert _pressed(rig.truth())
        made = heard.next(EVENTUALLY_S)
        with rig.client() as joiner:
            late = joiner.request("snapshot")
            assert (late["state"], late["contact"], late["needle"]["place"]) == ("verify", contact, "down")
            with pytest.raises(Refused) as busy:
                joiner.request("reset")
            assert busy.value.error["name"] == "busy"
        client.lift("told")
        lifted = heard.next(EVENTUALLY_S)
    assert made is not None
    assert lifted is not None
    assert (made["change"], lifted["change"]) == ("made", "lifted")
    assert (made["job"], made["pressed_um"]) == ("told", contact["pressed_um"])
    after = client.request("snapshot")
    assert (after["state"], after["contact"], after["needle"]["place"]) == ("idle", None, "up")


def test_a_needle_stays_down_as_long_as_it_is_held_and_no_longer(rig: Rig, client: Client) -> None:
    _over(client)
    client.touch(POINT, job_id="leased", lease_ms=600.0, hold_ms=60_000.0)
    until_s = time.monotonic() + 2.0
    while time.monotonic() < until_s:
        assert 0.0 < client.hold("leased", lease_ms=600.0)["until_ms"] <= 600.0
        time.sleep(0.1)
        assert _pressed(rig.truth())
    rig.until(_free, "the tester is dead and the needle stays down")
    assert _error(_result(client, "leased")) == "lease_expired"
    assert client.request("status")["state"] == "idle"
    with pytest.raises(Refused) as late:
        client.hold("leased")
    assert late.value.error["name"] == "unknown_job"
    assert _error(client.lift("leased", verdict="pass")) == "lease_expired", "what was measured too late does not count"
    assert _rows(rig, "leased")[0][3:] == ("lease_expired", None, None, None)


def test_hold_ms_ends_a_touch_that_nobody_lifts(rig: Rig, client: Client) -> None:
    _over(client)
    result = _must(client, "touch", test_point=POINT, hold_ms=300.0)
    assert result.detail["ended_by"] == "hold_ms"
    assert _free(rig.truth())


def test_anybody_may_cancel_a_held_touch(rig: Rig, client: Client) -> None:
    _over(client)
    client.touch(POINT, job_id="cancelled", lease_ms=20_000.0)
    with rig.client() as other:
        other.request("cancel")
    assert _error(_result(client, "cancelled")) == "cancelled"
    assert _free(rig.truth())
    assert client.request("snapshot")["contact"] is None


def test_a_point_is_pressed_again_only_after_it_was_seen_again(rig: Rig, client: Client) -> None:
    _over(client)
    _must(client, "touch", test_point=POINT)
    count = len(_log(rig, "touch_down"))
    again = client.job("touch", test_point=POINT)
    assert _error(again) == "look_needed"
    _must(client, "place", test_point=POINT)
    assert _error(client.job("touch", test_point=POINT)) == "look_needed", "to put the head there is no look"
    assert len(_log(rig, "touch_down")) == count
    _must(client, "correct", test_point=POINT)
    _must(client, "touch", test_point=POINT)
    assert len(_log(rig, "touch_down")) == count + 1


def test_an_id_never_touches_twice(rig: Rig, client: Client) -> None:
    _over(client)
    first = _must(client, "touch", test_point=POINT, job_id="once")
    _over(client)
    count = len(_log(rig, "touch_down"))
    assert client.job("touch", test_point=POINT, job_id="once") == first
    assert len(_log(rig, "touch_down")) == count


def test_nothing_is_lowered_where_the_head_was_not_put(rig: Rig, client: Client) -> None:
    _over(client)
    count = len(_log(rig, "touch_down"))
    assert _error(client.job("touch", test_point=OTHER)) == "not_at_test_point"
    _must(client, "place", board_um=[1000.0, 1000.0])
    assert _error(client.job("touch", test_point=POINT)) == "not_at_test_point"
    assert len(_log(rig, "touch_down")) == count


def test_a_board_that_was_changed_for_a_higher_one_is_not_pressed_further(rig: Rig, client: Client) -> None:
    _over(client)
    rig.bench.ask("set", name="board_dz_um", value=400.0)
    try:
        pushed_um = rig.truth()["pressed_um"]
        assert pushed_um > 100.0, "the board pushes the pin in where it should hover"
        assert _error(client.job("touch", test_point=POINT, job_id="higher")) == "wrong_height"
        assert _free(rig.truth())
        assert _log(rig, "lift_off")[-1]["most_force_n"] <= PRELOAD_N + RATE_N_PER_MM * pushed_um / 1e3 + 0.03
        assert _rows(rig, "higher") == []
    finally:
        rig.bench.ask("set", name="board_dz_um", value="none")


def test_a_daemon_that_is_told_to_stop_lifts_first(rig: Rig, client: Client) -> None:
    _over(client)
    client.touch(POINT, job_id="stopped", lease_ms=20_000.0)
    rig.daemon.end()
    assert _free(rig.truth())
    assert rig.truth()["axes"]["z_um"] > 5_300.0
    rig.start_daemon()
    assert _error(_result(client, "stopped")) == "shutting_down"


def test_an_emergency_stop_while_holding_moves_nothing_and_asks_for_homing(rig: Rig, client: Client) -> None:
    _over(client)
    client.touch(POINT, job_id="estop", lease_ms=20_000.0)
    with rig.fault("estop"):
        assert _error(_result(client, "estop")) == "emergency_stop"
        status = client.request("snapshot")
        assert (status["contact"], status["needle"]["place"]) == (None, "unknown")
        with pytest.raises(Refused):
            client.job("lift")
    with pytest.raises(Refused) as asked:
        client.request("reset", timeout_s=60.0)
    assert asked.value.error["name"] == "not_homed"
    _must(client, "home")


def test_a_killed_daemon_finds_the_needle_down_and_does_not_touch_again(rig: Rig, client: Client) -> None:
    _over(client)
    client.touch(POINT, job_id="killed", lease_ms=20_000.0)
    count = len(_log(rig, "touch_down"))
    rig.daemon.kill()
    rig.start_daemon(_until_it_answers)
    status = client.request("status")
    assert (status["fault"]["name"], status["needle"]["place"]) == ("needle_down", "down")
    assert _pressed(rig.truth()), "it moved by itself"
    assert _error(client.lift("killed", verdict="pass")) == "interrupted"
    assert _pressed(rig.truth()), "only a lift of its own raises it"
    _must(client, "lift")
    assert _free(rig.truth())
    assert _error(client.job("touch", test_point=POINT, job_id="killed", hold_ms=10_000.0, lease_ms=20_000.0)) == (
        "interrupted"
    )
    assert len(_log(rig, "touch_down")) == count
    _must(client, "place", test_point=POINT)
    assert _error(client.job("touch", test_point=POINT)) == "look_needed", "the journal knows of the press"


# --- clients --------------------------------------------------------------------------------------------------------


def _reprobe(*words: str) -> subprocess.Popen[str]:
    """Start a command as a shell does that has no terminal."""
    command = [sys.executable, "-m", "daemon.cli", *words]
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def _said(command: subprocess.Popen[str]) -> dict[str, Any]:
    """Return the next line of JSON that a command prints."""
    assert command.stdout is not None
    line = command.stdout.readline()
    assert line.startswith("{"), line + command.stdout.read()
    told: dict[str, Any] = json.loads(line)
    return told


@contextmanager
def _holding(rig: Rig) -> Iterator[subprocess.Popen[str]]:
    """Run `reprobe touch --hold` until the needle stands; end it afterwards."""
    command = _reprobe("touch", POINT, "--hold", "--json", "--endpoint", rig.control)
    try:
        assert _said(command)["contact"]["test_point"] == POINT
        assert _pressed(rig.truth())
        yield command
    finally:
        command.kill()
        command.wait(EVENTUALLY_S)
        if command.stdout is not None:
            command.stdout.close()


def test_a_shell_holds_the_needle_down_by_one_command_and_lifts_it_by_another(rig: Rig, client: Client) -> None:
    _over(client)
    with _holding(rig) as command:
        lifted = _reprobe(
            "lift", "--verdict", "pass", "--value", "0.4", "--unit", "ohm", "--json", "--endpoint", rig.control
        )
        out, _ = lifted.communicate(timeout=EVENTUALLY_S)
        assert lifted.returncode == 0, out
        assert _free(rig.truth())
        result = json.loads(out)
        assert result["detail"]["measured"] == {"verdict": "pass", "value": 0.4, "unit": "ohm"}
        assert _said(command) == result, "who held it hears how it ended"
        assert command.wait(EVENTUALLY_S) == 0


def test_a_person_who_lifts_reads_what_was_noted(rig: Rig, client: Client) -> None:
    _over(client)
    with _holding(rig) as command:
        lifted = _reprobe("lift", "--verdict", "fail", "--value", "42", "--unit", "ohm", "--endpoint", rig.control)
        out, _ = lifted.communicate(timeout=EVENTUALLY_S)
        assert lifted.returncode == 0, out
        assert out.splitlines()[-1] == "noted: fail 42.0 ohm"
        assert "\ntook " in out
        assert command.wait(EVENTUALLY_S) == 0


def test_a_command_that_is_told_to_end_lifts_first(rig: Rig, client: Client) -> None:
    _over(client)
    with _holding(rig) as command:
        command.send_signal(signal.SIGTERM)
        assert command.stdout is not None
        told = command.stdout.read()
        assert json.loads(told.splitlines()[-1])["detail"]["ended_by"] == "lift", told
        assert command.wait(EVENTUALLY_S) == 0
        assert _free(rig.truth())


def test_a_command_that_is_killed_leaves_the_needle_up_by_the_end_of_its_lease(rig: Rig, client: Client) -> None:
    _over(client)
    with _holding(rig) as command:
        os.kill(command.pid, signal.SIGKILL)
        rig.until(_free, "the tester is dead and the needle stays down")
    give_up_s = time.monotonic() + EVENTUALLY_S
    while (last := client.request("snapshot")["last_result"])["op"] != "touch":
        assert time.monotonic() < give_up_s, last
        time.sleep(0.01)
    assert last["error"]["name"] == "lease_expired"


def _key(rig: Rig, name: str) -> Path:
    """Let a client in and return its key."""
    path = rig.places.out / f"{name}.key"
    made = _reprobe(
        "keys", "new", name, "--role", "operate", "--keys", str(rig.places.out / "keys"), "--out", str(path)
    )
    out, _ = made.communicate(timeout=EVENTUALLY_S)
    assert made.returncode == 0, out
    return path


@contextmanager
def _with_keys(rig: Rig, key: Path) -> Iterator[None]:
    """Have every client come with a key for a while."""
    settings = rig.places.out / "station.toml"
    before = settings.read_text()
    rig.daemon.end()
    settings.write_text(before.replace("[api]\n", '[api]\ncurve = true\nkeys_dir = "keys"\n'))

    def wait(process: Process, control: str) -> None:
        with Client(control, timeout_s=EVENTUALLY_S, keys=key) as client:
            while client.request("status")["lifecycle"] != "ready":
                assert process.alive(), process.last_words()
                time.sleep(0.02)

    try:
        rig.start_daemon(wait)
        yield
    finally:
        rig.daemon.end()
        settings.write_text(before)
        rig.start_daemon()


def test_of_two_testers_only_the_one_that_put_the_head_there_touches_holds_and_lifts(rig: Rig) -> None:
    mine, others = _key(rig, "mine"), _key(rig, "others")
    with (
        _with_keys(rig, mine),
        Client(rig.control, timeout_s=EVENTUALLY_S, keys=mine) as tester,
        Client(rig.control, timeout_s=EVENTUALLY_S, keys=others) as stranger,
    ):
        _over(tester)
        count = len(_log(rig, "touch_down"))
        assert _error(stranger.job("touch", test_point=POINT)) == "not_at_test_point"
        assert len(_log(rig, "touch_down")) == count
        tester.touch(POINT, job_id="owned", lease_ms=20_000.0)
        for ask in (lambda: stranger.hold("owned"), lambda: stranger.lift("owned", verdict="pass")):
            with pytest.raises(Refused) as refused:
                ask()
            assert refused.value.error["name"] == "not_the_holder"
        assert _pressed(rig.truth())
        assert tester.hold("owned", 20_000.0)["until_ms"] > 0.0
        stranger.request("cancel")
        assert _error(_result(tester, "owned")) == "cancelled"
        assert _free(rig.truth())


def test_a_touch_sense_that_is_closed_before_the_descent_lowers_nothing(rig: Rig, client: Client) -> None:
    _over(client)
    z_um = rig.truth()["axes"]["z_um"]
    before = len(_log(rig, "touch_down"))
    with rig.fault("sense_stuck", closed=True):
        refused = client.job("touch", test_point=POINT)
    assert refused.error is not None
    assert refused.error.name == "contact_before_descent"
    assert len(_log(rig, "touch_down")) == before
    came_back_um = 5.0  # the lift that tells a stuck sense from a board that came up ends where it began
    assert rig.truth()["axes"]["z_um"] == pytest.approx(z_um, abs=came_back_um)
    assert _must(client, "touch", test_point=POINT).outcome == "touched"


def test_a_board_that_came_up_since_it_was_measured_is_felt_before_it_is_pressed(rig: Rig, client: Client) -> None:
    """The eye looks at the free tip 200 um above the surface; the board rises by 150 um after that."""
    _over(client)
    rig.bench.ask("set", name="board_dz_um", value=150.0)
    try:
        before = len(_log(rig, "touch_down"))
        refused = client.job("touch", test_point=POINT)
        downs = _log(rig, "touch_down")[before:]
    finally:
        rig.bench.ask("set", name="board_dz_um", value=None)
    assert refused.error is not None
    assert refused.error.name == "wrong_height"
    assert [down["pressed_um"] < 100.0 for down in downs] == [True]
    rig.until(_free, "the needle was not lifted")


def test_a_needle_against_which_a_board_came_up_is_lifted_off_it(rig: Rig, client: Client) -> None:
    """The board comes up until it pushes the pin in by less than a picture tells for sure."""
    _over(client)
    try:
        for dz_um in range(150, 400, 10):
            rig.bench.ask("set", name="board_dz_um", value=float(dz_um))
            if rig.truth()["pressed_um"] > 22.0:
                break
        assert 22.0 < rig.truth()["pressed_um"] < 40.0
        refused = client.job("touch", test_point=POINT)
        assert refused.error is not None
        assert refused.error.name == "wrong_height"
        assert rig.truth()["tip_um"][2] >= 100.0
        assert client.request("status")["needle"]["place"] == "up"
    finally:
        rig.bench.ask("set", name="board_dz_um", value=None)
