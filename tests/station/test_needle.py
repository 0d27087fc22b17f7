"""The needle is up after every end of a job, and where it cannot be raised that is said; judged by the truth log."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from daemon.client import Client, Refused
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import Process
from tests.station.rig import EVENTUALLY_S, Rig, running_rig

SAFE_UM, WORK_UM = 12_000.0, 5_200.0
REAL_TIME = ("--unpaced", "--speed", "1")
"""The pin stays pressed for as long as two looks take, so that a stop falls into that time."""
SURFACE: dict[str, Any] = {"what": "surface", "places": 4}
FAR: dict[str, Any] = {"board_um": [39_000.0, 29_000.0], "theta_deg": 90.0}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with running_rig(tmp_path_factory.mktemp("rig"), arguments=REAL_TIME, reply_ms=1000.0) as running:
        running.bench.ask("set", name="drive_boot_s", value=0.0)
        with running.client() as client:
            running.session(client).set_up()
        yield running


@pytest.fixture(autouse=True)
def left_idle(rig: Rig) -> Iterator[None]:
    """Leave the station idle, homed and with the needle up, also when a test failed in the middle."""
    yield
    for name in ("silent", "estop", "cable_out", "stall"):
        rig.bench.ask("fault", name=name, on=False)
    with rig.client() as client:
        client.raw(b'{"op": "cancel"}')
        client.raw(b'{"op": "reset"}', timeout_s=60.0)
        if client.request("status")["state"] != "idle":
            client.job("home")


def _pressed(truth: dict[str, Any]) -> bool:
    return bool(truth["pressed_um"] > 20.0)


def _up(truth: dict[str, Any]) -> bool:
    return bool(truth["pressed_um"] == 0.0 and truth["axes"]["z_um"] > SAFE_UM - 100.0)


def _press(rig: Rig, client: Client, job_id: str, **fields: Any) -> None:
    """Begin to measure the surface, and wait until the pin is pressed."""
    client.request("calibrate", id=job_id, **SURFACE, **fields)
    rig.until(_pressed, "it never pressed")


def _result(client: Client, job_id: str) -> JobResult:
    return _eventually(lambda: client.request("result", id=job_id)["result"], JobResult.model_validate)


def _eventually(ask: Callable[[], Any], then: Callable[[Any], JobResult]) -> JobResult:
    give_up_s = time.monotonic() + EVENTUALLY_S
    while (got := ask()) is None:
        assert time.monotonic() < give_up_s, "it never ended"
        time.sleep(0.01)
    return then(got)


def _error(result: JobResult) -> str:
    assert result.error is not None, result
    return result.error.name


def _reset(client: Client) -> None:
    """Reset until the camera has come back."""
    give_up_s = time.monotonic() + EVENTUALLY_S
    while not client.raw(b'{"op": "reset"}', timeout_s=60.0)["ok"]:
        assert time.monotonic() < give_up_s, "it stays in fault"


def _until_it_answers(process: Process, control: str) -> None:
    """Wait for a daemon that has opened its devices, whatever it found."""
    give_up_s = time.monotonic() + EVENTUALLY_S
    with Client(control, timeout_s=EVENTUALLY_S) as client:
        while client.request("status")["lifecycle"] != "ready":
            assert process.pid
            assert time.monotonic() < give_up_s, process.last_words()
            time.sleep(0.02)


def _needle(client: Client) -> str:
    return str(client.request("status")["needle"]["place"])


def test_a_cancelled_press_leaves_the_needle_up(rig: Rig) -> None:
    with rig.client() as client:
        _press(rig, client, "cancelled")
        client.request("cancel")
        assert _error(_result(client, "cancelled")) == "cancelled"
        assert _up(rig.truth()), rig.truth()
        assert client.request("status")["state"] == "idle"
        assert _needle(client) == "up"


def test_a_press_that_runs_out_of_time_leaves_the_needle_up(rig: Rig) -> None:
    """A silent camera holds the job where it is; tried with several deadlines, for the station has its own pace."""
    with rig.client() as client:
        for tried, deadline_ms in enumerate((5_000.0, 4_000.0, 6_000.0, 7_000.0, 9_000.0, 12_000.0)):
            job_id = f"late-{tried}"
            client.request("calibrate", id=job_id, **SURFACE, deadline_ms=deadline_ms)
            while client.request("result", id=job_id)["result"] is None and not _pressed(rig.truth()):
                time.sleep(0.01)
            with rig.fault("silent"):
                pressed = _pressed(rig.truth())
                error = _error(_result(client, job_id))
            truth = rig.truth()
            assert truth["pressed_um"] == 0.0
            assert truth["axes"]["z_um"] > WORK_UM - 10.0, "it is below the height of looks"
            assert _needle(client) == "up"
            if pressed and error == "deadline_missed":
                assert _up(truth), truth
                assert client.request("status")["state"] == "idle"
                return
            _reset(client)
    raise AssertionError("no deadline came while the pin was pressed")


def test_a_camera_that_goes_silent_over_a_pressed_pin_leaves_the_needle_up(rig: Rig) -> None:
    with rig.client() as client:
        _press(rig, client, "blind")
        with rig.fault("silent"):
            assert _error(_result(client, "blind")) == "camera_failed"
            assert _up(rig.truth()), rig.truth()
        assert client.request("status")["fault"]["name"] == "camera_failed"
        _reset(client)


def test_a_daemon_killed_over_a_pressed_pin_says_so_and_moves_nothing_until_it_is_told_to_lift(rig: Rig) -> None:
    with rig.client() as client:
        _press(rig, client, "killed")
    rig.daemon.kill()
    rig.until(lambda truth: not truth["moving"], "it went on moving")
    before = rig.truth()
    assert before["axes"]["z_um"] < WORK_UM
    rig.start_daemon(_until_it_answers)
    with rig.client() as client:
        status = client.request("status")
        assert (status["state"], status["fault"]["name"], status["fault"]["code"]) == ("fault", "needle_down", 5107)
        assert status["needle"] == {"place": "down", "z_um": pytest.approx(before["axes"]["z_um"], abs=10.0)}
        for op, fields in (("place", FAR), ("look", {}), ("calibrate", {"what": "tip", "tip_px": [800.0, 600.0]})):
            with pytest.raises(Refused) as refused:
                client.job(op, **fields)
            assert refused.value.error["detail"]["first_cause"]["name"] == "needle_down"
        with pytest.raises(Refused) as still:
            client.request("reset", timeout_s=60.0)
        assert still.value.error["name"] == "needle_down"
        assert rig.truth()["axes"] == before["axes"], "it moved by itself"
        lifted = client.job("lift")
        assert (lifted.ok, lifted.outcome) == (True, "lifted"), lifted.error
        assert _up(rig.truth())
        truth = rig.truth()["axes"]
        assert [truth[name] for name in ("x_um", "y_um")] == [before["axes"][name] for name in ("x_um", "y_um")]
        assert (client.request("status")["state"], _needle(client)) == ("idle", "up")
        assert client.job("place", **FAR).ok


def test_after_a_kill_over_a_pressed_pin_a_z_that_only_counts_its_lift_drags_nothing(rig: Rig) -> None:
    """Nobody is left who saw where the free tip stood: it is looked for where it was taught."""
    with rig.client() as client:
        _press(rig, client, "killed-and-stalled")
        rig.until(lambda truth: truth["pressed_um"] > 120.0, "it never pressed deeply")
    # Z stalls first: an order that is still on its way to the drive at the kill would lift the needle afterwards.
    with rig.fault("stall", axis="z", detected=False):
        rig.daemon.kill()
        rig.until(lambda truth: not truth["moving"], "it went on moving")
        before = rig.truth()
        assert before["pressed_um"] > 120.0
        rig.start_daemon(_until_it_answers)
        with rig.client() as client:
            lifted = client.job("lift")
            assert (lifted.ok, lifted.outcome) == (True, "lifted"), lifted.error
            refused = client.job("place", **FAR)
            assert _error(refused) == "axis_stalled"
            assert rig.truth()["axes"] == before["axes"], "the pin was dragged"
    with rig.client() as client:
        client.raw(b'{"op": "reset"}', timeout_s=60.0)  # it answers that homing is left to do
        assert client.job("home").ok
        assert client.job("place", **FAR).ok


def test_an_emergency_stop_over_a_pressed_pin_moves_nothing_and_is_cured_by_homing_alone(rig: Rig) -> None:
    with rig.client() as client:
        _press(rig, client, "stopped")
        with rig.fault("estop"):
            assert _error(_result(client, "stopped")) == "emergency_stop"
            assert client.request("status")["fault"]["name"] == "emergency_stop"
            assert _needle(client) == "unknown"
            with pytest.raises(Refused):
                client.job("lift")
        with pytest.raises(Refused) as asked:
            client.request("reset", timeout_s=60.0)
        assert asked.value.error["name"] == "not_homed"
        with pytest.raises(Refused) as refused:
            client.job("lift")
        assert refused.value.error["detail"]["first_cause"]["name"] == "not_homed"
        assert not _up(rig.truth())
        assert client.job("home").ok
        assert (client.request("status")["state"], _needle(client)) == ("idle", "up")
        assert _up(rig.truth())


def test_the_daemon_counts_its_own_touches(rig: Rig) -> None:
    with rig.client() as client:
        before = client.request("snapshot")["touches"]
        assert client.job("calibrate", **SURFACE).ok
        assert client.request("snapshot")["touches"] == before + SURFACE["places"]
        client.request("report", touches=2)
        assert client.request("snapshot")["touches"] == before + SURFACE["places"] + 2


def test_a_lift_goes_straight_up_from_wherever_the_needle_is(rig: Rig) -> None:
    with rig.client() as client:
        assert client.job("place", board_um=[0.0, 0.0]).ok
        before = rig.truth()["axes"]
        assert client.job("lift").ok
        after = rig.truth()["axes"]
        assert after["z_um"] > SAFE_UM - 100.0
        assert {name: after[name] for name in after if name != "z_um"} == {
            name: before[name] for name in before if name != "z_um"
        }
