"""Stand-ins for the plant and the clock, so that a test says exactly what is true in front of the camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from sim_hw.board.board import Board
from sim_hw.plant.card import CardPose

DEMO = Path(__file__).parents[2] / "sim_hw" / "demo_board"
SHARED_BOARDS = Path(__file__).parents[3] / "shared" / "boards"


@dataclass(frozen=True)
class FakeHead:
    x_um: float = 0.0
    y_um: float = 0.0
    z_um: float = 5200.0
    theta_deg: float = 0.0
    tip_x_um: float = 0.0
    tip_y_um: float = 0.0
    tip_z_um: float = 200.0
    tip_height_um: float = 200.0
    pressed_um: float = 0.0
    white: float = 1.0
    red: float = 0.0
    moving: bool = False


@dataclass(frozen=True)
class FakePose:
    dx_um: float = 0.0
    dy_um: float = 0.0
    rotation_deg: float = 0.0
    dz_um: float = 0.0
    tilt_x_um_per_mm: float = 0.0
    tilt_y_um_per_mm: float = 0.0


@dataclass(frozen=True)
class FakeKnobs:
    camera_frame_period_s: float = 1.0 / 15.0
    camera_blur_px: float = 0.9
    camera_noise_grey: float = 3.0
    camera_falloff: float = 0.15
    camera_glint: float = 0.0
    camera_flex_px: float = 0.0


@dataclass
class FakePlant:
    head: FakeHead = field(default_factory=FakeHead)
    board_pose: FakePose = field(default_factory=FakePose)
    card_pose: CardPose = field(default_factory=CardPose)
    knobs: FakeKnobs = field(default_factory=FakeKnobs)
    motion: Callable[[float, FakeHead], FakeHead] | None = None

    def state_at(self, t_s: float) -> FakeHead:
        return self.head if self.motion is None else self.motion(t_s, self.head)

    def rest_s(self) -> float:
        return 0.0

    def aim(self, board: Board, name: str, dx_um: float = 0.0, dy_um: float = 0.0, **more: float) -> FakeHead:
        """Put the tip over a target of a board that lies as planned, off by (dx, dy) in the robot frame."""
        target = board.target(name)
        x_um, y_um = board.nominal_um(target.x_mm, target.y_mm)
        self.head = replace(FakeHead(), tip_x_um=x_um + dx_um, tip_y_um=y_um + dy_um, **more)
        return self.head


class HandClock:
    """A clock that stands still until told; one simulated second is one second."""

    def __init__(self) -> None:
        self.t_s = 0.0

    def now_s(self) -> float:
        return self.t_s

    def wall_of(self, t_s: float) -> float:
        return 1000.0 + t_s

    def wall_delay(self, dt_s: float) -> float:
        return 0.0 * dt_s
