"""Live picture of a simulated station: what the last look showed in it, and a camera that fails while it is seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from daemon.client import Client
from tests.page.conftest import PageProcess, state_is
from tests.station.rig import EVENTUALLY_S

pytestmark = pytest.mark.timeout(600)
LIVE = "() => document.querySelector('section:not(.old) > canvas.live')?.width > 300"
"""A picture of the camera is drawn, and it is not an old one."""
NONE = "() => document.querySelector('.old > canvas.live')?.parentElement.textContent.includes('No picture')"
HEADER = (
    """async () => { const next = await fetch('/frame.jpg?after=0'); return JSON.parse(next.headers.get('x-frame')) }"""
)


@pytest.fixture
def client(shown: PageProcess) -> Iterator[Client]:
    with shown.rig.client() as connected:
        yield connected


def _header_when(tab: Any, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Wait until what stands beside the newest picture is so, and return it; a result is told before the next one."""
    give_up_s = time.monotonic() + EVENTUALLY_S
    while not holds(header := tab.evaluate(HEADER)):
        assert time.monotonic() < give_up_s, header
    return dict(header)


def test_the_picture_says_how_far_the_target_is_until_the_head_moves(shown: PageProcess, client: Client) -> None:
    point = shown.rig.board.point("TP3")
    assert client.job("place", board_um=[point.x_um + 80.0, point.y_um]).ok
    tab = shown.tab("Kim")
    tab.wait_for_function(LIVE)
    assert tab.evaluate(HEADER)["aim"] is None
    result = client.job("correct", test_point="TP3")
    aim = _header_when(tab, lambda header: header["aim"] is not None)["aim"]
    assert aim["off_um"] == pytest.approx(result.error_after_um, abs=0.06)
    tab.wait_for_function("() => document.querySelector('canvas.live').parentElement.textContent.includes('µm away')")
    assert client.job("place", test_point="TP3").ok
    _header_when(tab, lambda header: header["aim"] is None)
    tab.wait_for_function("() => !document.querySelector('canvas.live').parentElement.textContent.includes('µm away')")


@pytest.mark.parametrize("fault", ["frozen", "torn", "silent", "unplugged"])
def test_17_a_camera_that_fails_is_said_at_once_and_shown_again_when_it_is_back(
    shown: PageProcess, client: Client, fault: str
) -> None:
    tab = shown.tab("Lee")
    complaints: list[str] = []
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.wait_for_function(LIVE)
    with shown.rig.fault(fault):
        tab.wait_for_function(NONE)
        assert tab.locator("#banner").is_hidden(), "the station itself is there"
    _leave_fault(client)
    tab.wait_for_function(LIVE)
    state_is(tab, "READY")
    assert complaints == []


def _leave_fault(client: Client) -> None:
    """Reset a station that has noticed its camera's trouble."""
    if client.request("status")["fault"]:
        client.request("reset")


def test_a_lamp_of_a_person_lights_the_picture(shown: PageProcess) -> None:
    tab = shown.tab("Kim")
    tab.wait_for_function(LIVE)
    state_is(tab, "READY")
    tab.get_by_role("button", name="White light").click()
    tab.wait_for_function(BRIGHT)


BRIGHT: Any = """() => {
  const canvas = document.querySelector('section:not(.old) > canvas.live');
  if (!(canvas?.width > 300)) return false;
  const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let sum = 0;
  for (let n = 0; n < pixels.length; n += 400) sum += pixels[n];
  return sum > 30 * (pixels.length / 400);
}"""
