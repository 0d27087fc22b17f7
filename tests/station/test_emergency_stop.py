"""An emergency stop is named as one wherever it shows, with axis and drive code, and homing is asked for after.

The station's time is not hurried here, so that a stop falls into the phase of a move it is meant for.
"""

from __future__ import annotations

import json
import os
import signal
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from daemon.client import Client, Refused
from tests.station.rig import EVENTUALLY_S, Rig, in_fault, running_rig

UNDER_VOLTAGE = 0x3220
"""What 603Fh of the simulated drives says while their motor supply is cut, and after, until the fault is reset."""
REAL_TIME = ("--unpaced", "--speed", "1")
NEAR: dict[str, Any] = {"board_um": [0.0, 0.0], "theta_deg": 10.0}
FAR: dict[str, Any] = {"board_um": [39_000.0, 29_000.0], "theta_deg": 90.0}
SAFE_Z_UM, WORK_Z_UM = 12_000.0, 5_200.0
Axes = dict[str, float]
CATCHES = 10


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station that is homed and nothing more; drives whose power was cut answer again at once."""
    with running_rig(tmp_path_factory.mktemp("rig"), arguments=REAL_TIME, reply_ms=1000.0) as running:
        running.bench.ask("set", name="drive_boot_s", value=0.0)
        with running.client() as client:
            assert client.job("home").ok
        yield running


@pytest.fixture(autouse=True)
def left_idle(rig: Rig) -> Iterator[None]:
    """Leave the station idle and homed also when a test failed in the middle."""
    yield
    release(rig)
    with rig.client() as client:
        _reset(client)
        if client.request("status")["state"] != "idle":
            client.job("home")


# --- what happens to the station

Press = Callable[[Rig], None]


def press(rig: Rig) -> None:
    rig.bench.ask("fault", name="estop", on=True)


def release(rig: Rig) -> None:
    rig.bench.ask("fault", name="estop", on=False)


def press_and_release(rig: Rig) -> None:
    """Between two looks of the daemon at the drives; they keep their logic supply."""
    press(rig)
    release(rig)


def cut_all_power(rig: Rig) -> None:
    """A button that cuts the drives' logic supply too, pressed and released: they restart without a reference."""
    rig.bench.ask("power_cycle")


STOPS = pytest.mark.parametrize("stop", [press, press_and_release, cut_all_power])


# --- what the daemon says of it


def _is_emergency_stop(error: dict[str, Any], stop: Press = press) -> None:
    """The code, the axis, and the drive's own code: none where the drives have restarted and know nothing of it."""
    assert (error["code"], error["name"]) == (5105, "emergency_stop"), error
    assert error["detail"]["axis"] in ("x", "y", "z", "theta")
    assert error["detail"].get("drive_code") == (None if stop is cut_all_power else UNDER_VOLTAGE)


def _error_of(client: Client, op: str, **fields: Any) -> dict[str, Any]:
    """Why a job failed, or why it was not taken or not begun: then the idle check was faster than the job."""
    try:
        result = client.job(op, **fields)
    except Refused as refused:
        return _first_cause(refused.error)
    assert result.error is not None, f"{op} was done"
    return _first_cause(result.error.model_dump())


def _first_cause(error: dict[str, Any]) -> dict[str, Any]:
    cause: dict[str, Any] = error["detail"]["first_cause"] if error["name"] == "in_fault" else error
    return cause


def _fault(client: Client) -> dict[str, Any]:
    """The fault that the daemon comes to by itself."""
    give_up_s = time.monotonic() + EVENTUALLY_S
    while (fault := client.request("status")["fault"]) is None:
        assert time.monotonic() < give_up_s, "it stayed idle"
        time.sleep(0.02)
    assert isinstance(fault, dict)
    return fault


def _reset(client: Client) -> dict[str, Any] | None:
    error: dict[str, Any] | None = client.raw(b'{"op": "reset"}', timeout_s=60.0).get("error")
    return error


def _recovers_by_homing(rig: Rig, client: Client) -> None:
    """Released and reset it is not idle: it asks for homing, and works after that."""
    release(rig)
    error = _reset(client)
    assert error is not None, "reset alone brought it back"
    assert (error["code"], error["name"]) == (5101, "not_homed"), error
    status = client.request("status")
    assert (status["state"], status["fault"]["code"]) == ("fault", 5101)
    assert client.job("home").ok
    assert client.request("status")["state"] == "idle"


# --- at rest


@STOPS
def test_while_nothing_runs(rig: Rig, client: Client, stop: Press) -> None:
    assert client.job("place", **NEAR).ok
    stop(rig)
    _is_emergency_stop(_fault(client), stop)
    _recovers_by_homing(rig, client)


@STOPS
def test_between_two_jobs_before_anybody_looked(rig: Rig, client: Client, stop: Press) -> None:
    assert client.job("place", **NEAR).ok
    before = rig.truth()["axes"]
    stop(rig)
    _is_emergency_stop(_error_of(client, "place", **FAR), stop)
    assert rig.truth()["axes"] == before, "nothing moved"
    _is_emergency_stop(_fault(client), stop)
    _recovers_by_homing(rig, client)


def test_a_job_of_the_camera_alone_does_not_hide_it(rig: Rig, client: Client) -> None:
    assert client.job("place", **NEAR).ok
    press(rig)
    try:
        assert client.job("look").ok, "nothing of it needs the motors"
    except Refused as refused:  # the idle check was faster
        _is_emergency_stop(refused.error["detail"]["first_cause"])
    _is_emergency_stop(_error_of(client, "place", **FAR))
    _recovers_by_homing(rig, client)


@STOPS
def test_while_another_fault_stands(rig: Rig, client: Client, stop: Press) -> None:
    """The first cause keeps its name; but clearing it must not bring the station back without homing."""
    assert client.job("place", **NEAR).ok
    with rig.fault("silent"):
        assert _error_of(client, "look")["name"] == "camera_failed"
        stop(rig)
    _recovers_by_homing(rig, client)


# --- in a move


def _retracting(start: Axes, now: Axes) -> bool:
    return WORK_Z_UM + 500.0 < now["z_um"] < SAFE_Z_UM - 500.0 and abs(now["x_um"] - start["x_um"]) < 100.0


def _accelerating(start: Axes, now: Axes) -> bool:
    return 100.0 < now["x_um"] - start["x_um"] < 5_000.0


def _crossing(start: Axes, now: Axes) -> bool:
    return now["x_um"] - start["x_um"] > 10_000.0


def _turning_on(start: Axes, now: Axes) -> bool:
    """X has all but arrived; theta, which takes longest, is still on its way."""
    return now["x_um"] - start["x_um"] > 35_000.0 and now["theta_deg"] < 85.0


def _lowering(start: Axes, now: Axes) -> bool:
    return now["theta_deg"] > 89.0 and now["z_um"] < SAFE_Z_UM - 500.0


def _caught_in(phase: Callable[[Axes, Axes], bool], rig: Rig, client: Client) -> str:
    """Move until a phase of the move is seen, and return the job; one that a busy computer lets pass is moved again."""
    for _ in range(CATCHES):
        assert client.job("place", **NEAR).ok
        start = rig.truth()["axes"]
        job = f"cut-{phase.__name__}-{uuid.uuid4().hex[:6]}"
        client.request("place", id=job, **FAR)
        while not client.request("result", id=job)["done"]:
            if phase(start, rig.truth()["axes"]):
                return job
    raise AssertionError(f"{phase.__name__} passed unseen {CATCHES} times")


@pytest.mark.parametrize(
    ("phase", "stop"),
    [
        (_retracting, press_and_release),
        (_accelerating, press),
        (_crossing, press_and_release),
        (_crossing, cut_all_power),
        (_turning_on, press),
        (_lowering, press_and_release),
        (_lowering, cut_all_power),
    ],
)
def test_in_a_move(rig: Rig, client: Client, phase: Callable[[Axes, Axes], bool], stop: Press) -> None:
    job = _caught_in(phase, rig, client)
    stop(rig)
    _is_emergency_stop(_error_of(client, "place", job_id=job, **FAR), stop)
    assert rig.truth()["moving"] is False
    _is_emergency_stop(_fault(client), stop)
    _recovers_by_homing(rig, client)


# --- homing and reset


def test_reset_and_homing_while_it_is_held(rig: Rig, client: Client) -> None:
    press(rig)
    _is_emergency_stop(_fault(client))
    for _ in range(2):
        error = _reset(client)
        assert error is not None, "not while it is pressed"
        _is_emergency_stop(error)
        _is_emergency_stop(client.request("status")["fault"])
    release(rig)
    assert (_reset(client) or {})["name"] == "not_homed"
    press(rig)
    _is_emergency_stop(_error_of(client, "home"))
    _recovers_by_homing(rig, client)


@pytest.mark.parametrize(
    ("axis", "stop"), [("z_um", press), ("z_um", press_and_release), ("x_um", press), ("x_um", cut_all_power)]
)
def test_while_homing(rig: Rig, client: Client, axis: str, stop: Press) -> None:
    """Z homes first, alone; X and Y last, together."""
    assert client.job("place", **FAR).ok
    start = rig.truth()["axes"][axis]
    job = f"home-{axis}-{stop.__name__}"
    client.request("home", id=job)
    rig.until(lambda truth: abs(truth["axes"][axis] - start) > 1_000.0, "it never moved")
    stop(rig)
    _is_emergency_stop(_error_of(client, "home", job_id=job), stop)
    _recovers_by_homing(rig, client)


# --- a daemon that starts


@pytest.mark.parametrize("stop", [press, press_and_release])
def test_a_daemon_that_starts_on_it(rig: Rig, client: Client, stop: Press) -> None:
    """Pressed before, held or not: the drives still stand in the fault it put them in."""
    assert rig.daemon.end() == 0
    stop(rig)
    rig.start_daemon(in_fault)
    with rig.client() as again:
        _is_emergency_stop(again.request("status")["fault"])
        _recovers_by_homing(rig, again)


def test_a_daemon_that_was_killed_in_it_does_not_believe_the_reference(rig: Rig, client: Client) -> None:
    assert client.job("place", **NEAR).ok
    client.request("place", id="killed-too", **FAR)
    rig.until(lambda truth: truth["moving"], "it never moved")
    press(rig)
    os.kill(rig.daemon.pid, signal.SIGKILL)
    rig.daemon.end()
    rig.start_daemon(in_fault)
    with rig.client() as again:
        _is_emergency_stop(again.request("status")["fault"])
        cut = again.raw(json.dumps({"op": "result", "id": "killed-too"}).encode())
        assert cut["result"]["error"]["name"] == "interrupted"
        _recovers_by_homing(rig, again)
