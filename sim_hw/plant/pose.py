"""Pose of the board: nominal mapping of CAD to the robot frame, and the error of the fixture."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace
from typing import Literal

from sim_hw.plant.knobs import Knobs

ORIGIN_UM = (60_000.0, 40_000.0)
"""CAD origin (lower left of the outline) in the robot frame, nominal."""
TOUCH_Z_UM = 5_000.0
"""Z at which the tip touches the nominal board plane."""
NEST_DEPTH_UM = 1_600.0
"""How far the floor of the nest is below a board's surface."""


@dataclass(frozen=True)
class Placement:
    """The outline of the board in CAD mm and the side that is up: the nominal mapping."""

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float
    side: Literal["top", "bottom"] = "top"

    @property
    def centre_um(self) -> tuple[float, float]:
        """Return the nominal centre of the outline in the robot frame."""
        return (
            ORIGIN_UM[0] + 500.0 * (self.x1_mm - self.x0_mm),
            ORIGIN_UM[1] + 500.0 * (self.y1_mm - self.y0_mm),
        )

    def to_robot_um(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Map CAD mm to the robot frame as if the board lay perfectly; the bottom side is turned about its y axis."""
        across_mm = x_mm - self.x0_mm if self.side == "top" else self.x1_mm - x_mm
        return ORIGIN_UM[0] + 1000.0 * across_mm, ORIGIN_UM[1] + 1000.0 * (y_mm - self.y0_mm)

    def to_cad_mm(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Map a nominal place of the robot frame back to CAD mm."""
        across_mm = (x_um - ORIGIN_UM[0]) / 1000.0
        x_mm = self.x0_mm + across_mm if self.side == "top" else self.x1_mm - across_mm
        return x_mm, self.y0_mm + (y_um - ORIGIN_UM[1]) / 1000.0


@dataclass(frozen=True)
class BoardPose:
    """Error of the fixture: shift, rotation about the outline's nominal centre (+ is CCW), height and tilt."""

    dx_um: float = 0.0
    dy_um: float = 0.0
    rotation_deg: float = 0.0
    dz_um: float = 0.0
    tilt_x_um_per_mm: float = 0.0
    tilt_y_um_per_mm: float = 0.0

    @classmethod
    def drawn(cls, knobs: Knobs, seed: int, seat: int = 0) -> BoardPose:
        """Draw a pose from the seed, anew for each `seat`; knobs that are set replace what was drawn."""
        rng = random.Random(f"{seed}/board" if seat == 0 else f"{seed}/board/{seat}")
        shift_um = rng.uniform(0.0, knobs.board_shift_max_um)
        direction = rng.uniform(0.0, 2.0 * math.pi)
        rotation_deg = rng.uniform(-1.0, 1.0) * knobs.board_rotation_max_deg
        dz_um = rng.gauss(0.0, 1.0) * knobs.board_height_sigma_um
        tilt_x, tilt_y = (rng.gauss(0.0, 1.0) * knobs.board_tilt_sigma_um_per_mm for _ in range(2))
        return cls(
            dx_um=chosen(knobs.board_dx_um, shift_um * math.cos(direction)),
            dy_um=chosen(knobs.board_dy_um, shift_um * math.sin(direction)),
            rotation_deg=chosen(knobs.board_rotation_deg, rotation_deg),
            dz_um=chosen(knobs.board_dz_um, dz_um),
            tilt_x_um_per_mm=chosen(knobs.board_tilt_x_um_per_mm, tilt_x),
            tilt_y_um_per_mm=chosen(knobs.board_tilt_y_um_per_mm, tilt_y),
        )

    def moved(self, dx_um: float, dy_um: float, turn_deg: float) -> BoardPose:
        """Return the pose of a board that lies farther off, and turned about the outline's centre."""
        return replace(
            self, dx_um=self.dx_um + dx_um, dy_um=self.dy_um + dy_um, rotation_deg=self.rotation_deg + turn_deg
        )

    def apply(self, nominal_um: tuple[float, float], centre_um: tuple[float, float]) -> tuple[float, float]:
        """Return where a nominal place of the board really is, in the robot frame."""
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        x, y = nominal_um[0] - centre_um[0], nominal_um[1] - centre_um[1]
        return centre_um[0] + c * x - s * y + self.dx_um, centre_um[1] + s * x + c * y + self.dy_um

    def undo(self, real_um: tuple[float, float], centre_um: tuple[float, float]) -> tuple[float, float]:
        """Return which nominal place of the board is at a place of the robot frame: the inverse of `apply`."""
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        x, y = real_um[0] - centre_um[0] - self.dx_um, real_um[1] - centre_um[1] - self.dy_um
        return centre_um[0] + c * x + s * y, centre_um[1] - s * x + c * y

    def height_um(self, place_um: tuple[float, float], centre_um: tuple[float, float]) -> float:
        """Return the height of the real surface above the nominal board plane at a place of the robot frame."""
        x_mm, y_mm = (place_um[0] - centre_um[0]) / 1000.0, (place_um[1] - centre_um[1]) / 1000.0
        return self.dz_um + self.tilt_x_um_per_mm * x_mm + self.tilt_y_um_per_mm * y_mm


def chosen(knob: float | None, drawn: float) -> float:
    """Return what a knob says, or what was drawn where it says nothing."""
    return drawn if knob is None else knob
