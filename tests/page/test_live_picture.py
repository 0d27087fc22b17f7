"""What is drawn on the live picture: the way from the needle to the target, and the tolerance about it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.page.conftest import PageProcess
from tests.page.played import PlayedStation

pytestmark = pytest.mark.timeout(600)
COUNTED = """() => {
  const canvas = document.querySelector('section:not(.old) > canvas.live');
  if (canvas?.width !== 640) return null;
  const data = canvas.getContext('2d').getImageData(0, 0, 640, 480).data, found = { amber: 0, white: 0, dark: 0 };
  for (let n = 0; n < data.length; n += 4) {
    const [r, g, b] = data.slice(n, n + 3);
    if (r > 220 && g > 150 && g < 200 && b < 80) found.amber += 1;
    if (r > 240 && g > 240 && b > 240) found.white += 1;
    if (r < 20 && g < 20 && b < 20) found.dark += 1;
  }
  return found;
}"""


@pytest.mark.parametrize(("off_px", "arrow"), [(8.0, "amber"), (0.5, "white")], ids=["beside", "landed"])
def test_the_way_to_the_target_is_drawn_and_amber_only_outside_the_tolerance(
    station: PlayedStation, page: PageProcess, off_px: float, arrow: str
) -> None:
    grey = bytes(cv2.imencode(".jpg", np.full((480, 640), 128, np.uint8))[1])
    aim = {"at_px": [300.0 - off_px, 200.0], "target_px": [300.0, 200.0], "tolerance_px": 1.5, "off_um": 13 * off_px}
    header = {"exposed_at": station.now, "width_px": 640, "height_px": 480, "state": "idle", "tip_px": None}
    tab = page.tab("Eve")
    found: dict[str, dict[str, int]] = {}
    n = 0
    for name, told in (("nothing", None), ("aim", aim)):
        found[name] = {}
        while not found[name] or (told and not found[name]["dark"]):  # the test's own time-out ends it
            n += 1
            station.show(grey, n=n, aim=told, **header)
            found[name] = tab.evaluate(COUNTED) or {}
            tab.wait_for_timeout(50)
    assert found["nothing"] == {"amber": 0, "white": 0, "dark": 0}
    assert found["aim"]["white"] > 100, "the circle, and the frame of the magnified part"
    assert (found["aim"]["amber"] > 20) == (arrow == "amber")
