"""The V4L2 driver of the installed package on a real kernel's video device that breaks on demand (vivid)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.vm.station import OTHER_CAMERA, PYTHON, Station

pytestmark = pytest.mark.timeout(1800)
TRIALS = Path(__file__).with_name("trials.py")
ANSWER = "/root/trials.json"
SLACK_S = 5.0
"""How late an error may come by the clock of a machine that is emulated and busy."""
Facts = dict[str, Any]
LACKING = ("exposure_us", "focus", "white_balance_k", "auto_exposure", "auto_white_balance", "auto_focus")


@pytest.fixture(scope="module")
def told(stand: Station) -> dict[str, Facts]:
    """What happened in each trial."""
    stand.vm.put("/root/trials.py", TRIALS.read_bytes())
    stand.vm.run(PYTHON, "/root/trials.py", OTHER_CAMERA, ANSWER, within_s=900.0)
    trials: dict[str, Facts] = json.loads(stand.vm.get(ANSWER))
    return trials


@pytest.fixture
def facts(told: dict[str, Facts], request: pytest.FixtureRequest) -> Facts:
    """What happened in the trial that the test names by its parameter, which came to its end."""
    trial = told[request.param]
    assert "ended_by" not in trial, trial["ended_by"]
    return trial


def of(*names: str) -> pytest.MarkDecorator:
    """Name the trials a test is about."""
    return pytest.mark.parametrize("facts", names, indirect=True)


@of("raw_pictures")
def test_pictures_have_the_size_asked_for_and_are_exposed_after_the_wanted_instant(facts: Facts) -> None:
    assert (facts["settings"]["width_px"], facts["settings"]["height_px"]) == (1600.0, 1200.0)
    assert (facts["shape"], facts["type"]) == ([1200, 1600, 3], "uint8")
    assert facts["spread"] > 30.0, "colour bars are no empty picture"
    assert facts["numbers"][1] > facts["numbers"][0]
    assert facts["after_asked_s"] >= 0.0
    assert facts["age_s"] > 0.0, "the kernel's time stamp is on the same clock and not from the future"


@of("a_size_it_lacks")
def test_another_size_than_was_asked_for_is_refused_by_name(facts: Facts) -> None:
    assert facts["kind"] == "CameraError"
    assert "instead of 16400x1200" in facts["says"]


@of("a_format_it_lacks")
def test_another_format_than_was_asked_for_is_refused_by_name(facts: Facts) -> None:
    assert facts["kind"] == "CameraError"
    assert "instead of MJPG" in facts["says"]


@of("controls")
def test_a_control_is_set_and_read_back_and_those_it_lacks_are_told(facts: Facts) -> None:
    assert facts["settings"]["gain"] == facts["device"] == 77
    assert {name: facts["settings"][name] for name in LACKING} == dict.fromkeys(LACKING)


@of("in_use")
def test_a_device_in_use_is_refused(facts: Facts) -> None:
    assert facts["kind"] == "CameraError"
    assert "cannot be opened" in facts["says"]


@of("some_buffers_dropped")
def test_dropped_buffers_only_cost_time(facts: Facts) -> None:
    assert facts["numbers"] == sorted(set(facts["numbers"]))
    assert facts["outages"] == []


@of("all_buffers_dropped", "unplugged")
def test_a_camera_without_pictures_is_an_error_by_the_deadline_that_says_why(facts: Facts) -> None:
    assert facts["kind"] == "CameraTimeout"
    assert facts["took_s"] <= facts["allowed_s"] + SLACK_S
    assert ("cannot be opened" if "gone" in facts else "no picture within 3 s") in facts["says"]


@of("unplugged")
def test_a_plug_that_is_drawn_takes_the_device_node_with_it(facts: Facts) -> None:
    assert facts["gone"]


@of("a_fatal_streaming_error", "disconnected_and_back", "unplugged")
def test_a_stream_that_breaks_is_called_broken_and_not_slow(facts: Facts) -> None:
    assert "gives no more pictures" in facts["outages"][0]


@of("all_buffers_dropped", "a_fatal_streaming_error", "disconnected_and_back", "unplugged")
def test_a_camera_that_was_lost_is_opened_again_by_itself(facts: Facts) -> None:
    afterwards = facts["afterwards"]
    assert afterwards["reopened"] >= 1
    assert afterwards["shape"] == [1200, 1600, 3]
    assert afterwards["after_asked_s"] >= 0.0


@of("a_damaged_buffer", "no_buffers_to_be_had", "no_start_of_the_stream")
def test_what_fails_once_is_got_over(facts: Facts) -> None:
    assert facts["afterwards"]["shape"] == [1200, 1600, 3]
    assert facts["afterwards"]["after_asked_s"] >= 0.0
