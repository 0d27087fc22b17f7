"""How high a surface lies follows from how far the pin was pushed, whatever the picture's scale of a push is."""

import json

import numpy as np
import pytest

from daemon.domain.errors import Fault
from daemon.procedures.surface_touch import Push, heights_um
from drivers.gantry import Position
from tests.daemon.tools.report.synthetic import map_record
from vision.geometry.pose_map import PoseMap

PRESS_UM = 200.0
PLACE = Position(1000.0, 2000.0, 5200.0, 0.0)


@pytest.fixture(scope="module")
def pose_map() -> PoseMap:
    return PoseMap.from_json(json.dumps(map_record().pose_map))


def _push(pose_map: PoseMap, height_um: float, scale: float, half_free: bool = False) -> Push:
    """Return what the camera sees of a surface so high, TEDA seeing `scale` times the push."""
    px_per_um = -np.array(pose_map.below_tip_px) / pose_map.hover_um * scale
    half_um = 0.0 if half_free else height_um + PRESS_UM / 2
    return Push(PLACE, half_um * px_per_um, (height_um + PRESS_UM) * px_per_um)


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.09, 1.3])
def test_heights_come_out_whatever_a_push_looks_like(pose_map: PoseMap, scale: float) -> None:
    true_um = [-60.0, 0.0, 45.0]
    found = heights_um([_push(pose_map, h, scale) for h in true_um], pose_map, PRESS_UM)
    assert found == pytest.approx(true_um, abs=0.01)


def test_a_touch_that_met_nothing_is_refused_with_its_place(pose_map: PoseMap) -> None:
    pushes = [_push(pose_map, 0.0, 1.0), _push(pose_map, -150.0, 1.0, half_free=True)]
    with pytest.raises(Fault, match=r"no surface at X 1\.00 mm, Y 2\.00 mm"):
        heights_um(pushes, pose_map, PRESS_UM)


def test_a_pin_that_sticks_is_refused(pose_map: PoseMap) -> None:
    with pytest.raises(Fault, match="times as far"):
        heights_um([_push(pose_map, 0.0, 0.4)], pose_map, PRESS_UM)
