"""A map that a needle must not be trusted to is refused, with what to do."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from daemon.procedures.calibrate.pose_map import MAX_RESIDUAL_UM, refuse_bad_map
from vision.geometry.pose_map import MapPoint, PoseMap, fit_pose_map

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


def _refuse(pose_map: PoseMap, sightings: list[MapPoint]) -> None:
    # Of a walk the judgement asks for no more than these two.
    refuse_bad_map(pose_map, cast("Any", SimpleNamespace(sightings=sightings, tip_px=GIVEN["tip_px"])))


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


def test_a_map_by_which_corrections_would_leave_the_error_is_refused() -> None:
    """The sightings are of two places at once: each is corrected by the others to somewhere else."""
    sightings = _sightings()
    moved = [replace(s, x_um=s.x_um + (900.0 if k % 2 else 0.0)) for k, s in enumerate(sightings)]
    with pytest.raises(ValueError, match="would leave"):
        _refuse(fit_pose_map(sightings, **GIVEN), moved)
