"""A map that a needle must not be trusted to is refused, with what to do."""

import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.procedures.calibrate import pose_map
from daemon.procedures.calibrate.pose_map import MAX_RESIDUAL_UM, refuse_bad_map
from daemon.procedures.registry import PROCEDURES
from tests.daemon.procedures.fake_station import World, a_board, run
from vision.geometry.pose_map import MapPoint, PoseMap, fit_pose_map, worst_shrink

GIVEN = {"tip_px": (428.0, 620.0), "below_tip_px": (3.9, 7.7), "work_z_um": 5200.0, "hover_um": 200.0}
MARK_UM = np.array((1000.0, 2000.0))


def _sightings(*, flipped: bool = False, noise_um: float = 5.0) -> list[MapPoint]:
    """Return what an unflipped camera above the board sees, 12 um a pixel: right is +x, up is +y."""
    rng = np.random.default_rng(3)
    seen = []
    for head_um in MARK_UM + rng.uniform(-700.0, 700.0, (20, 2)):
        right, up = (MARK_UM - head_um) / 12.0
        x_px, y_px = 428.0 + right, 620.0 - up
        at = head_um + rng.normal(0.0, noise_um, 2)
        seen.append(MapPoint((1599.0 - x_px if flipped else x_px, y_px), float(at[0]), float(at[1]), 0.0))
    return seen


def _refuse(fitted: PoseMap, sightings: list[MapPoint]) -> None:
    # Of an acquisition the judgement asks for no more than these two.
    refuse_bad_map(fitted, cast("Any", SimpleNamespace(sightings=sightings, tip_px=GIVEN["tip_px"])))


def test_a_good_map_is_taken() -> None:
    sightings = _sightings()
    _refuse(fit_pose_map(sightings, **GIVEN), sightings)


def test_a_mirrored_picture_is_told_from_the_map_alone() -> None:
    sightings = _sightings(flipped=True)
    with pytest.raises(ValueError, match="mirrored"):
        _refuse(fit_pose_map(sightings, **GIVEN), sightings)


def test_a_map_that_does_not_fit_its_own_sightings_is_refused() -> None:
    sightings = _sightings()
    loose = replace(fit_pose_map(sightings, **GIVEN), residual_um=MAX_RESIDUAL_UM + 1.0)
    with pytest.raises(ValueError, match="residual"):
        _refuse(loose, sightings)


def test_the_residual_is_allowed_up_to_its_limit_and_no_farther() -> None:
    assert MAX_RESIDUAL_UM == 15.0
    sightings = _sightings()
    _refuse(replace(fit_pose_map(sightings, **GIVEN), residual_um=MAX_RESIDUAL_UM), sightings)
    with pytest.raises(ValueError, match="the residual is 15 um, more than 15 um"):
        _refuse(replace(fit_pose_map(sightings, **GIVEN), residual_um=MAX_RESIDUAL_UM + 0.01), sightings)


def test_what_a_correction_may_leave_is_less_than_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    assert pose_map.MAX_LEFT == 0.5
    sightings = _sightings()
    fitted = fit_pose_map(sightings, **GIVEN)
    left = worst_shrink(sightings, **GIVEN)
    monkeypatch.setattr(pose_map, "MAX_LEFT", left * 1.001)
    _refuse(fitted, sightings)
    monkeypatch.setattr(pose_map, "MAX_LEFT", left)
    with pytest.raises(ValueError, match="would leave"):
        _refuse(fitted, sightings)


async def test_a_bad_map_is_a_fault_and_the_old_one_stays(tmp_path: Path) -> None:
    """The camera's picture is mirrored since the probe was taught."""
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}).teach().with_map()
    before = world.calibrations.records["map"]
    flipped = world.true_map.homography @ np.array([[-1.0, 0.0, 2 * 800.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    world.true_map = replace(world.true_map, homography=flipped / flipped[2, 2])
    with pytest.raises(Fault) as caught:
        await run(world, PROCEDURES["calibrate"], {"op": "calibrate", "what": "map", "test_point": "A"})
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert "the map cannot be fitted: the picture is mirrored" in caught.value.message
    assert world.calibrations.records["map"] == before


async def test_stops_that_scatter_too_much_give_no_map(tmp_path: Path) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}).teach()
    rng = np.random.default_rng(2)
    world.gantry.scatter_um = lambda: (float(rng.normal(0, 25.0)), float(rng.normal(0, 25.0)))
    with pytest.raises(Fault, match="more than 15 um"):
        await run(world, PROCEDURES["calibrate"], {"op": "calibrate", "what": "map", "test_point": "A"})
    assert world.calibrations.pose_map is None


def test_a_map_by_which_corrections_would_leave_the_error_is_refused() -> None:
    """The sightings are of two places at once: each is corrected by the others to somewhere else."""
    sightings = _sightings()
    moved = [replace(s, x_um=s.x_um + (900.0 if k % 2 else 0.0)) for k, s in enumerate(sightings)]
    with pytest.raises(ValueError, match="would leave"):
        _refuse(fit_pose_map(sightings, **GIVEN), moved)


async def test_a_map_is_judged_beside_the_event_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is fitted again without each of its sightings: that takes tenths of a second, and long on a slow core."""
    judged_in: list[int] = []

    def judge(fitted: PoseMap, acquisition: Any) -> None:
        judged_in.append(threading.get_ident())
        refuse_bad_map(fitted, acquisition)

    monkeypatch.setattr(pose_map, "refuse_bad_map", judge)
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {}).teach()
    await run(world, PROCEDURES["calibrate"], {"op": "calibrate", "what": "map", "test_point": "A"})
    (thread,) = judged_in
    assert thread != threading.get_ident()
