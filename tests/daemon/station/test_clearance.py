"""How low the head may go sideways: by what is known, and no lower than the safe height where anything is in doubt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.config.sections.motion import ClearanceSection
from daemon.config.sections.touching import BrushSection, ReferenceSection
from daemon.domain.board import Board
from daemon.domain.board_layers import BoardLayers, Body, Painting, SideShapes
from daemon.station.board_trust import BoardTrust
from daemon.station.clearance import Clearance
from daemon.station.free_pin import FLEX_WITHIN_UM
from daemon.station.kinematics import Geometry
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_records import Aligned, AlignmentRecord, Seat, SurfaceRecord, Touch
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import World
from vision.geometry import fit_plane
from vision.head.model import CircleHead

TOUCH_UM, SAFE_UM, SURFACE_UM, CLEAR_UM = 5_000.0, 12_000.0, 40.0, 300.0
SECTION = ClearanceSection(
    clear_um=CLEAR_UM, needle_radius_um=250.0, barrel_from_um=4_000.0, barrel_radius_um=400.0, head_from_um=8_000.0,
    head_box_um=(-20_000.0, -20_000.0, 20_000.0, 20_000.0), outline_um=0.0, heights_um={"C": 800.0},
)  # fmt: skip
EDGE = (0, 0, 40_000, 0, 40_000, 30_000, 0, 30_000)
CHIP = (9_500, 9_750, 10_500, 9_750, 10_500, 10_250, 9_500, 10_250)
TOWER = (24_000, 9_000, 26_000, 9_000, 26_000, 11_000, 24_000, 11_000)
SEAT = Seat(verified=True, places=3, agreement=0.9)
CORNERS = [(x, y) for x in (2_000.0, 38_000.0) for y in (2_000.0, 28_000.0)]


class Scene:
    """A calibrated board with a chip of known height at (10, 10) mm and a tower of unknown height at (25, 10) mm."""

    def __init__(
        self, folder: Path, section: ClearanceSection | None = SECTION, more: dict[str, Any] | None = None
    ) -> None:
        self.section = section
        bodies = (Body(outline=CHIP, part="C1"), Body(outline=TOWER, part="J1"))
        top = SideShapes(outline=Painting(outlines=(EDGE,)), bodies=bodies)
        board = Board(
            name="b",
            side="top",
            width_um=4e4,
            height_um=3e4,
            points=(),
            layers=BoardLayers(top=top, bottom=SideShapes()),
        )
        self.world = World(folder, board, {}).teach()
        self.now_s = 0.0
        self.trust = BoardTrust(lambda: self.now_s)
        self.world.with_head(CircleHead(14_938.26, -3.054))
        self.align()
        self.measure()
        self.recognise()
        config = self.world.config.model_copy(update={"clearance": section} | (more or {}))
        self.geometry = Geometry(config, board, self.world.calibrations, self.trust)
        self.clearance = Clearance(config, board, self.world.calibrations, self.geometry, self.trust)

    def align(self, seat: Seat | None = SEAT, rms_um: float = 5.0, count: int = 4) -> None:
        pose = self.world.config.board.pose()
        fiducials = tuple(
            Aligned(name=f"F{k}", board_um=at, robot_um=tuple(pose.apply(at)), residual_um=(0.0, 0.0), views=1)
            for k, at in enumerate(CORNERS[:count])
        )
        record = self.world.made() | {
            "board": "b", "side": "top", "theta_deg": pose.theta_deg, "scale": 1.0, "tx_um": pose.tx_um,
            "ty_um": pose.ty_um, "rms_um": rms_um, "seat": seat, "fiducials": fiducials,
        }  # fmt: skip
        self.world.calibrations.store(AlignmentRecord(**record))

    def measure(self, corners: list[tuple[float, float]] = CORNERS) -> None:
        places = np.array([self.world.config.board.pose().apply(at) for at in corners])
        plane = fit_plane(places, np.full(len(corners), SURFACE_UM))
        touches = tuple(Touch(x_um=x, y_um=y, height_um=SURFACE_UM) for x, y in places)
        record = self.world.made() | {
            "touches": touches, "residuals_um": (0.0,) * len(corners), "surface": plane.to_dict(), "flatness_um": 0.0,
            "rms_um": 0.0, "limit_um": 50.0, "planar": True,
        }  # fmt: skip
        self.world.calibrations.store(SurfaceRecord(**record))

    def recognise(self) -> None:
        self.trust.seen_free()
        self.trust.recognised()

    def way(self, *board_um: tuple[float, float], theta_deg: float = 0.0) -> list[Position]:
        return [self.geometry.position_over(at, theta_deg) for at in board_um]

    async def clear_um(self, *board_um: tuple[float, float]) -> float | None:
        return (await self.clearance.by_calibration())(self.way(*board_um))

    async def seen_um(self, *board_um: tuple[float, float], shift_um: tuple[float, float] = (0.0, 0.0)) -> float | None:
        return (await self.clearance.as_seen(shift_um))(self.way(*board_um))


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


BARE = (17_000.0, 20_000.0), (17_050.0, 20_030.0)
FREE_UM = TOUCH_UM + SURFACE_UM + CLEAR_UM


async def test_over_bare_board_it_goes_by_the_clearance_above_the_measured_surface(scene: Scene) -> None:
    assert await scene.clear_um(*BARE) == pytest.approx(FREE_UM)
    assert await scene.seen_um(*BARE) == pytest.approx(FREE_UM)


async def test_over_a_part_of_known_height_it_goes_by_the_clearance_above_that(scene: Scene) -> None:
    assert await scene.clear_um((8_000.0, 10_000.0), (12_000.0, 10_000.0)) == pytest.approx(FREE_UM + 800.0)


async def test_over_what_is_not_known_it_goes_at_the_safe_height_and_the_barrel_beside_it_lower(scene: Scene) -> None:
    assert await scene.clear_um((22_000.0, 10_000.0), (28_000.0, 10_000.0)) == pytest.approx(SAFE_UM)
    # 1 mm beside the tower the needle (250 um) passes, its barrel (400 um) may not: as far off as can be corrected
    assert await scene.clear_um((23_000.0, 12_000.0), (27_000.0, 12_000.0)) == pytest.approx(SAFE_UM - 4_000.0)
    assert await scene.clear_um((23_000.0, 12_500.0), (27_000.0, 12_500.0)) == pytest.approx(FREE_UM)


async def test_the_head_counts_at_its_angle(tmp_path: Path) -> None:
    """It should be free of the tower at one angle, and stand over it at another."""
    arm = SECTION.model_copy(update={"head_from_um": 5_000.0, "head_box_um": (-500.0, -500.0, 9_000.0, 500.0)})
    scene = Scene(tmp_path, arm)
    clear = await scene.clearance.by_calibration()
    places = (17_000.0, 10_000.0), (17_050.0, 10_000.0)
    assert clear(scene.way(*places, theta_deg=0.0)) == pytest.approx(SAFE_UM - 5_000.0)
    assert clear(scene.way(*places, theta_deg=-90.0)) == pytest.approx(FREE_UM)
    over, turned = scene.way(places[0])[0], scene.way(places[0], theta_deg=-90.0)[0]
    assert clear([turned, over]) == pytest.approx(SAFE_UM), "between both the tip may be anywhere on its circle"


async def test_beyond_the_edge_it_goes_at_the_safe_height(scene: Scene) -> None:
    assert await scene.clear_um((1_000.0, 15_000.0), (500.0, 15_000.0)) == pytest.approx(SAFE_UM)
    assert await scene.clear_um((1_000.0, 15_000.0), (-900.0, 15_000.0)) == pytest.approx(SAFE_UM)


async def test_what_a_look_saw_off_its_place_widens_the_way(scene: Scene) -> None:
    beside = (10_900.0, 10_000.0), (10_950.0, 10_000.0)
    assert await scene.seen_um(*beside) == pytest.approx(FREE_UM)
    assert await scene.seen_um(*beside, shift_um=(0.0, 60.0)) == pytest.approx(FREE_UM + 800.0)


def _later(scene: Scene) -> None:
    scene.now_s += 60.0


def _only_free(scene: Scene) -> None:
    scene.trust.end()
    scene.trust.seen_free()


DOUBTS: dict[str, Callable[[Scene], None]] = {
    "nobody has looked for a while": _later,
    "the pin was seen free over any board": _only_free,
    "a fault came": lambda scene: scene.trust.end(),
    "the seat is not verified": lambda scene: (scene.align(replace_seat(False)), scene.measure())[0],
    "the seat was never looked at": lambda scene: (scene.align(None), scene.measure())[0],
    "the targets do not tell how it is turned": lambda scene: (scene.align(rms_um=900.0), scene.measure())[0],
    "one target tells nothing of a turn": lambda scene: (scene.align(count=1), scene.measure())[0],
    "the surface is of the board before": lambda scene: scene.align(),
    "the alignment is void": lambda scene: scene.world.calibrations.void_alignment(Void("moved")),
}


def replace_seat(verified: bool) -> Seat:
    return SEAT.model_copy(update={"verified": verified})


@pytest.mark.parametrize("doubt", DOUBTS)
async def test_in_doubt_nothing_is_known(scene: Scene, doubt: str) -> None:
    assert await scene.clear_um(*BARE) is not None
    DOUBTS[doubt](scene)
    assert await scene.clear_um(*BARE) is None


@pytest.mark.parametrize("doubt", [_later, _only_free, DOUBTS["the surface is of the board before"]])
async def test_a_look_is_no_help_where_board_or_surface_are_in_doubt(
    scene: Scene, doubt: Callable[[Scene], None]
) -> None:
    doubt(scene)
    assert await scene.seen_um(*BARE) is None


async def test_a_way_that_leaves_the_measured_surface_is_not_known(scene: Scene) -> None:
    scene.measure([(3_000.0, 3_000.0), (5_000.0, 3_000.0), (3_000.0, 5_000.0), (5_000.0, 5_000.0)])
    assert await scene.clear_um((8_000.0, 8_000.0), (9_000.0, 8_000.0)) is not None
    assert await scene.clear_um((8_000.0, 8_000.0), (30_000.0, 20_000.0)) is None


@pytest.mark.parametrize("section", [None, SECTION.model_copy(update={"clear_um": 6_999.0})])
async def test_without_figures_nothing_is_known_and_with_wild_ones_no_more_than_the_safe_height(
    tmp_path: Path, section: ClearanceSection | None
) -> None:
    scene = Scene(tmp_path, section)
    assert await scene.clear_um(*BARE) == (None if section is None else SAFE_UM)
    assert await scene.seen_um(*BARE) == (None if section is None else SAFE_UM)


async def test_without_a_calibrated_head_only_what_a_look_saw_is_known(tmp_path: Path) -> None:
    world = Scene(tmp_path).world
    (tmp_path / "rotation.json").unlink()
    world.calibrations.load()
    scene = Scene.__new__(Scene)
    scene.world, scene.now_s, scene.trust = world, 0.0, BoardTrust(lambda: 0.0)
    config = world.config.model_copy(update={"clearance": SECTION})
    scene.geometry = Geometry(config, world.board, world.calibrations, scene.trust)
    scene.clearance = Clearance(config, world.board, world.calibrations, scene.geometry, scene.trust)
    scene.recognise()
    assert world.calibrations.head is None
    assert await scene.clear_um(*BARE) is None
    assert await scene.seen_um(*BARE) == pytest.approx(FREE_UM)


@pytest.mark.parametrize("name", ["reference", "brush"])
async def test_over_a_pad_that_is_told_to_stand_higher_than_the_nest_it_goes_above_that(
    tmp_path: Path, name: str
) -> None:
    """It should believe of two figures the higher one: the block stands beside the board, where nothing was to be."""
    scene = Scene(tmp_path, SECTION.model_copy(update={"nest_um": 0.0}))
    way = (17_000.0, 1_500.0), (17_000.0, -4_000.0)
    assert await scene.clear_um(*way) == pytest.approx(FREE_UM)
    x_um, y_um = scene.world.config.board.pose().apply((17_000.0, -6_000.0))
    made = {"reference": ReferenceSection, "brush": BrushSection}[name]
    scene = Scene(tmp_path / "with", scene.section, {name: made(x_um=x_um, y_um=y_um, z_um=8_000.0)})
    assert await scene.clear_um(*way) == pytest.approx(8_000.0 + CLEAR_UM)
    assert await scene.seen_um(*way) == pytest.approx(8_000.0 + CLEAR_UM)
    assert await scene.clear_um(*BARE) == pytest.approx(FREE_UM)


async def test_the_head_counts_over_a_pad_too(tmp_path: Path) -> None:
    """It should go higher where the needle is far from the block and what hangs beside it is not."""
    box_um = (-1_000.0, -20_000.0, 1_000.0, 20_000.0)
    section = SECTION.model_copy(update={"nest_um": 0.0, "head_from_um": 5_000.0, "head_box_um": box_um})
    way = (17_000.0, 9_000.0), (17_050.0, 9_000.0)
    scene = Scene(tmp_path, section)
    assert await scene.clear_um(*way) == pytest.approx(FREE_UM)
    x_um, y_um = scene.world.config.board.pose().apply((17_000.0, -6_000.0))
    block = ReferenceSection(x_um=x_um, y_um=y_um, z_um=11_000.0)
    scene = Scene(tmp_path / "with", section, {"reference": block})
    assert await scene.clear_um(*way) == pytest.approx(11_000.0 + CLEAR_UM - 5_000.0)


@pytest.mark.parametrize("clear_um", [150.0, CLEAR_UM])
async def test_a_way_from_where_a_look_was_taken_is_higher_by_what_a_look_may_hide(
    tmp_path: Path, clear_um: float
) -> None:
    """The pin may be pushed in there by as much as the stops flex: then it would be dragged over the board."""
    scene = Scene(tmp_path, SECTION.model_copy(update={"clear_um": clear_um}))
    looked_um = scene.way(*BARE)[0].z_um
    for across_um in (await scene.clear_um(*BARE), await scene.seen_um(*BARE)):
        assert across_um is not None
        assert across_um >= looked_um + FLEX_WITHIN_UM - 1e-6
