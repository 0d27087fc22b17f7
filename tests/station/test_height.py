"""Height on the simulated station, judged by its truth: how far the pin is pushed in, how fast it met the board."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest

from daemon.client import Client, Refused
from daemon.domain.results import JobResult
from tests.station.rig import Rig, running_rig

SPEED = 5.0
LEVEL = ("board_dz_um=0", "board_tilt_x_um_per_mm=0", "board_tilt_y_um_per_mm=0")
LONG = {"timeout_s": 300.0, "deadline_ms": 300e3}
REPLY_MS = 1000.0
"""The looks at the truth keep the simulated station busy."""
FASTEST_UM_S = 2500.0
PATIENCE_S = 240.0
Truth = dict[str, Any]


@pytest.fixture
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station with a map, made on a level board at its nominal height; no surface was measured."""
    turned = [word for knob in LEVEL for word in ("--set", knob)]
    out = tmp_path_factory.mktemp("height")
    arguments = ("--unpaced", "--speed", str(SPEED), *turned)
    with running_rig(out, arguments=arguments, waits_for_speed=SPEED, reply_ms=REPLY_MS) as running:
        with running.client() as client:
            running.session(client).set_up()
        yield running


def _lay_in(rig: Rig, height_um: float) -> None:
    rig.bench.ask("set", name="board_dz_um", value=height_um)


def _watched(
    rig: Rig, client: Client, op: str, seen: Callable[[Truth], None] = lambda _truth: None, **fields: Any
) -> tuple[JobResult, list[Truth]]:
    """Run a job and look at the truth all the while; return its result and what was true."""
    job = f"watched-{time.monotonic_ns()}"
    client.request(op, id=job, deadline_ms=300e3, **fields)
    truths, give_up_s = [], time.monotonic() + PATIENCE_S
    while client.request("result", id=job).get("result") is None:
        assert time.monotonic() < give_up_s, "the job never ended"
        for _ in range(20):
            truths.append(rig.truth())
            seen(truths[-1])
    return JobResult.model_validate(client.request("result", id=job)["result"]), truths


def _touch_downs(rig: Rig) -> list[Truth]:
    """Return what the truth log has of each time that the pin met the board: looks at the truth may be far apart."""
    rig.truth()  # what the needle did is worked off when somebody asks
    lines = map(json.loads, (rig.places.out / "truth.jsonl").read_text().splitlines())
    return [told for told in lines if told.get("event") == "touch_down"]


def _dragged_um(truths: list[Truth]) -> float:
    """Return how far X or Y moved at most between two moments at which the pin was pushed in."""
    return max(
        (
            abs(after["axes"][axis] - before["axes"][axis])
            for before, after in pairwise(truths)
            if min(before["pressed_um"], after["pressed_um"]) > 1.0
            for axis in ("x_um", "y_um")
        ),
        default=0.0,
    )


@pytest.mark.parametrize("height_um", [300.0, -80.0])
def test_a_board_that_lies_elsewhere_is_respected_before_and_after_its_surface_is_measured(
    rig: Rig, height_um: float
) -> None:
    _lay_in(rig, height_um)
    with rig.client() as client:
        placed, before = _watched(rig, client, "place", test_point="TP8", theta_deg=30.0)
        assert placed.error is None, placed.error
        assert placed.detail["height"] == "unknown"
        assert placed.detail["parallax_um"] > 0.0
        corrected, during = _watched(rig, client, "correct", test_point="TP8")
        assert corrected.detail.get("height") == "unknown"
        assert max(t["pressed_um"] for t in (*before, *during, rig.truth())) == 0.0

        assert not _touch_downs(rig)
        surface, touching = _watched(rig, client, "calibrate", what="surface", places=4)
        assert surface.error is None, surface.error
        assert surface.detail["height_um"] == pytest.approx(height_um, abs=15.0)
        assert 100.0 < max(t["pressed_um"] for t in touching) < 210.0
        downs = _touch_downs(rig)
        assert len(downs) == 4
        assert max(down["speed_um_s"] for down in downs) < FASTEST_UM_S
        assert _dragged_um(touching) < 2.0

        placed, after = _watched(rig, client, "place", test_point="TP8", theta_deg=30.0)
        assert placed.detail["height_um"] == pytest.approx(height_um, abs=15.0)
        assert max(t["pressed_um"] for t in after) == 0.0
        assert rig.truth()["tip_um"][2] == pytest.approx(200.0, abs=25.0), "above the real surface"


def test_another_board_than_was_measured_is_found_out_and_the_needle_lifted(rig: Rig) -> None:
    with rig.client() as client:
        assert client.job("calibrate", what="surface", places=4, **LONG).ok
        before = len(_touch_downs(rig))
        _lay_in(rig, 300.0)
        placed = client.job("place", test_point="TP8", theta_deg=30.0, **LONG)
        (down,) = _touch_downs(rig)[before:]
        assert down["speed_um_s"] < FASTEST_UM_S
        assert placed.error is not None
        assert placed.error.name == "wrong_height"
        assert rig.truth()["pressed_um"] == 0.0
        assert client.request("status")["state"] == "idle"


def test_a_z_that_loses_steps_on_its_way_up_rests_on_no_board(rig: Rig) -> None:
    """The drive counts on, so that the next way down ends too deep, where no board should be reached at all."""
    with rig.client() as client:
        assert client.job("place", test_point="TP1").ok
        low_um = rig.truth()["axes"]["z_um"]
        stalled: list[bool] = []

        def stall_on_the_way_up(truth: Truth) -> None:
            if not stalled and truth["axes"]["z_um"] > low_um + 500.0:
                stalled.append(True)
                rig.bench.ask("fault", name="stall", on=True, axis="z", detected=False)
            elif stalled == [True] and truth["axes"]["x_um"] > x_um + 500.0:
                stalled.append(False)
                rig.bench.ask("fault", name="stall", on=False)

        x_um = rig.truth()["axes"]["x_um"]
        placed, truths = _watched(rig, client, "place", stall_on_the_way_up, test_point="TP8")
        assert stalled == [True, False], "it did not stall, or not on the way up"
        assert max(truth["pressed_um"] for truth in truths) > 100.0, "nothing was lost"
        assert placed.error is not None
        assert placed.error.name == "axis_stalled"
        assert rig.truth()["pressed_um"] == 0.0
        assert _dragged_um(truths) < 2.0
        assert client.request("status")["fault"]["name"] == "axis_stalled"
        client.raw(b'{"op": "reset"}', timeout_s=60.0)  # it answers that homing is left to do
        assert client.job("home").ok
        assert client.job("place", test_point="TP8").ok


def test_a_z_that_loses_steps_while_pressed_drags_nothing_over_the_board(rig: Rig) -> None:
    """The drive counts on; only the picture shows that the needle did not lift."""
    stalled: list[float] = []

    def stall_pressed(truth: Truth) -> None:
        if not stalled and truth["pressed_um"] > 20.0:
            stalled.append(truth["pressed_um"])
            rig.bench.ask("fault", name="stall", on=True, axis="z", detected=False)

    with rig.client() as client:
        surface, truths = _watched(rig, client, "calibrate", stall_pressed, what="surface", places=4)
        assert stalled, "no press was seen"
        assert surface.error is not None
        assert surface.error.name == "axis_stalled"
        assert _dragged_um(truths) < 2.0
        with pytest.raises(Refused, match="did not lift"):
            client.job("place", test_point="TP8")
        rig.bench.ask("fault", name="stall", on=False)
        with pytest.raises(Refused, match="not homed"):
            client.request("reset")
        assert client.job("home").ok
        assert rig.truth()["pressed_um"] == 0.0
        assert client.job("place", test_point="TP8").ok
