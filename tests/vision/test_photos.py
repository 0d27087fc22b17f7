"""Real pads on a real board: phone photographs, scaled so that the rings are as large as the station sees a site."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from vision import NotFound, find_test_points

PHOTOS = Path(__file__).parents[3] / "shared" / "photos"
pytestmark = pytest.mark.skipif(not PHOTOS.exists(), reason="the photographs do not lie beside the project")


@pytest.mark.parametrize("ring_px", [14.5, 17.0, 20.0])
def test_rings_on_photographs_are_found_where_a_person_marked_them(ring_px: float) -> None:
    rng = np.random.default_rng(1)
    found = 0
    for side in ("back", "front"):
        marks = json.loads((PHOTOS / f"picoice/pico_ice_{side}.json").read_text())
        photo = cv2.imread(str(PHOTOS / marks["image"]))
        for mark in marks["features"]:
            scale = ring_px / mark["r"]
            picture = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            x, y = ((mark[axis] + 0.5) * scale - 0.5 for axis in ("cx", "cy"))
            angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0, 8)
            seen = find_test_points(picture, (x + away * np.cos(angle), y + away * np.sin(angle)), 30)
            if isinstance(seen.nearest, NotFound):
                continue
            assert np.hypot(seen.nearest.x_px - x, seen.nearest.y_px - y) < 2.0, (side, mark["name"])
            found += 1
    assert found >= 27
