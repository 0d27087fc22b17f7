"""A correction and a place go no higher than what a look has shown allows; without that they go at the safe height."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.config.sections.motion import ClearanceSection
from daemon.procedures.registry import PROCEDURES
from daemon.station.station import LookResult
from daemon.storage.calibration_records import Aligned, Seat, SurfaceRecord, Touch
from tests.daemon.procedures.cad_board import cad_board, cad_pad
from tests.daemon.procedures.fake_station import World, run
from vision.geometry import fit_plane
from vision.registration import NotRegistered, Refusal

PAD, OTHER = cad_pad("R1.1", 15_000.0, 12_000.0), cad_pad("R1.2", 17_000.0, 12_000.0)
CORRECT = {"op": "correct", "test_point": "R1.1"}
SECTION = ClearanceSection(bare=True, barrel_from_um=8_000.0, head_from_um=9_000.0)
FREE_UM = 5_000.0 + 300.0


def _ready(folder: Path, section: ClearanceSection | None) -> World:
    world = World(folder, cad_board(PAD, OTHER), {})
    world.config = world.config.model_copy(update={"clearance": section})
    world.context.config = world.config
    world.teach().with_map().with_head(world.true_head)
    pose = world.config.board.pose()
    corners = [(x, y) for x in (2_000.0, 38_000.0) for y in (2_000.0, 28_000.0)]
    seen = tuple(
        Aligned(name=str(k), board_um=at, robot_um=tuple(pose.apply(at)), residual_um=(0.0, 0.0), views=1)
        for k, at in enumerate(corners)
    )
    world.with_alignment(pose, seat=Seat(verified=True, places=4, agreement=0.9))
    record = world.calibrations.records["alignment"]
    world.calibrations.store(record.model_copy(update={"fiducials": seen}))
    places = [pose.apply(at) for at in corners]
    whole = world.made() | {
        "touches": tuple(Touch(x_um=x, y_um=y, height_um=0.0) for x, y in places), "residuals_um": (0.0,) * 4,
        "surface": fit_plane(np.array(places), np.zeros(4)).to_dict(), "flatness_um": 0.0, "rms_um": 0.0,
        "limit_um": 50.0, "planar": True,
    }  # fmt: skip
    world.calibrations.store(SurfaceRecord(**whole))
    return world


async def test_a_correction_hops_by_the_clearance_and_the_place_after_it_too(tmp_path: Path) -> None:
    world = _ready(tmp_path, SECTION)
    world.put_beside("R1.1", (40.0, -30.0))
    await run(world, PROCEDURES["correct"], CORRECT)
    assert world.gantry.clear_um == [pytest.approx(FREE_UM)]
    await run(world, PROCEDURES["place"], {"op": "place", "board_um": (17_000.0, 12_000.0), "theta_deg": 0.0})
    assert world.gantry.clear_um[1] == pytest.approx(FREE_UM)


async def test_a_place_that_no_look_came_before_is_not_known_to_be_clear(tmp_path: Path) -> None:
    world = _ready(tmp_path, SECTION)
    await run(world, PROCEDURES["place"], {"op": "place", "test_point": "R1.1", "theta_deg": 0.0})
    assert world.gantry.clear_um == [None]
    assert world.station.needle.board.is_recognised, "its own look has shown the board"


async def test_a_board_that_only_its_seat_told_is_not_recognised(tmp_path: Path) -> None:
    """It should take a look that left open where the board lies for no proof that it is this one."""
    world = _ready(tmp_path, SECTION)

    def edit(look: LookResult) -> LookResult:
        if look.board is None:
            return look  # at the needle alone
        tie = NotRegistered(Refusal.AMBIGUOUS, "two places look the same", None)
        return replace(look, board=replace(look.board, left_open=tie))

    world.station.always = edit
    await run(world, PROCEDURES["place"], {"op": "place", "test_point": "R1.1", "theta_deg": 0.0})
    assert not world.station.needle.board.is_recognised


async def test_without_figures_of_the_head_nothing_is_known(tmp_path: Path) -> None:
    world = _ready(tmp_path, None)
    world.put_beside("R1.1", (40.0, -30.0))
    await run(world, PROCEDURES["correct"], CORRECT)
    assert world.gantry.clear_um[-1] is None


async def test_a_step_aside_is_taken_at_the_safe_height(tmp_path: Path) -> None:
    """It should go by no look that could not be believed; the step after one that was may hop."""
    world = _ready(tmp_path, SECTION)
    world.put_beside("R1.1", (40.0, -30.0))

    def hide(look: LookResult) -> LookResult:
        assert look.board is not None
        hidden = NotRegistered(Refusal.TARGET_NOT_CONFIRMED, "hidden", None)
        return replace(look, board=replace(look.board, found=hidden))

    world.station.script[1] = hide
    await run(world, PROCEDURES["correct"], CORRECT)
    assert world.gantry.clear_um == [None, pytest.approx(FREE_UM)]
