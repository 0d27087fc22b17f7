"""Sections of how the head moves: the gantry, its clearance, head, board, and when a correction is good."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from daemon.config.cross_checks import CLEAR_UM
from daemon.config.sections.base import Finite, NotNegative, Positive, Section
from vision.geometry import Rigid2
from vision.head import CircleHead


class GantrySection(Section):
    """How the four axes move as one machine."""

    safe_z_um: Finite = Field(description="height at which the head may move sideways")
    work_z_um: Finite = Field(description="height of every look over a surface at touch_z_um; the map is for it")
    touch_z_um: Finite = Field(description="height at which the tip touches the board, if it lies as it should")
    press_um: float = Field(
        default=0.0,
        ge=0,
        le=500,
        description="how far the pin may be pushed in to measure a surface; 0: never",
    )
    surface_range_um: float = Field(
        default=500.0, ge=0, le=2000, description="a surface lies within this of touch_z_um, above or below"
    )
    overtravel_um: float = Field(default=300.0, ge=0, le=1000, description="most that the pin may ever be pushed in")
    descent_speed: float = Field(
        default=2000.0, gt=0, le=2000, description="of Z below the highest possible surface, um per second"
    )
    approach_um: NotNegative = Field(
        default=200.0, description="overshoot for the one-sided approach; less where the measured play asks for less"
    )
    approach_deg: NotNegative = Field(default=0.5, description="the same for the head's angle")
    settle_ms: NotNegative = Field(default=60.0, description="vibration after a move dies out within this")

    @property
    def highest_surface_um(self) -> float:
        """Z at which the needle may first meet a surface of which nothing is known."""
        return self.touch_z_um + self.surface_range_um

    @property
    def free_z_um(self) -> float:
        """Z at which the needle is free of any surface that is possible."""
        return self.highest_surface_um + CLEAR_UM

    @property
    def floor_z_um(self) -> float:
        """Z below which the needle is never sent: the lowest possible surface minus the most overtravel."""
        return self.touch_z_um - self.surface_range_um - max(self.overtravel_um, self.press_um)


class ClearanceSection(Section):
    """What lets the head go sideways lower than at safe_z_um; without this section it never does.

    The needle, its barrel and the rest of the head count from the needle's free end. Heights are above the board's
    surface. What is not told counts as free at safe_z_um only.
    """

    clear_um: float = Field(
        default=300.0, ge=150, le=5000, description="between the head and what it passes over: surface, part or nest"
    )
    needle_radius_um: Positive = Field(default=500.0, description="of the needle below its barrel, at most")
    barrel_from_um: Positive = Field(default=2000.0, description="the barrel's foot is so high above the needle's end")
    barrel_radius_um: Positive = Field(default=1500.0, description="of the barrel, at most")
    head_from_um: Positive = Field(
        default=6000.0, description="nothing else on the head, camera and lamps too, is lower above the needle's end"
    )
    head_box_um: tuple[Finite, Finite, Finite, Finite] = Field(
        default=(-60_000.0, -60_000.0, 60_000.0, 60_000.0),
        description="about the needle at head angle 0, nothing of the head is farther: x0, y0, x1, y1",
    )
    outline_um: NotNegative = Field(
        default=8000.0,
        description="a part reaches no farther beyond its outline in the board file; with courtyards 500 will do",
    )
    solder_um: NotNegative = Field(default=500.0, description="solder on a pad is no higher")
    lead_um: NotNegative = Field(default=3000.0, description="a lead that comes through the board is no longer")
    nest_um: NotNegative | None = Field(
        default=None, description="nothing beside the board, or through its large holes, is higher; none: not known"
    )
    heights_um: dict[Annotated[str, Field(pattern=r"^[A-Z]+$")], NotNegative] = Field(
        default={}, description="parts whose names begin with these letters are no higher"
    )
    bare: bool = Field(default=False, description="no parts are fitted: a board file without any is believed")


class HeadSection(Section):
    """Where the tip is from the head's position: a circle round the axis of rotation."""

    radius_um: Positive
    phase_deg: Finite

    def model(self) -> CircleHead:
        """Return it as a head without run-out."""
        return CircleHead(self.radius_um, self.phase_deg)


class ControlPointSection(Section):
    """The printed four-arm cross beside the board (thesis appendix C) on which the head's rotation is calibrated."""

    x_um: Finite = Field(description="its centre in the robot frame, within servo.max_placement_um")
    y_um: Finite
    arm_um: float = Field(default=720.0, ge=200, le=5000, description="length of an arm from the centre")

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is."""
        return self.x_um, self.y_um


class BoardSection(Section):
    """The board under test and where it nominally lies."""

    file: Path = Field(description="made by `reprobe board`; relative to the configuration file")
    origin_x_um: Finite = Field(description="robot x of the outline's lower left corner, seen from the probed side")
    origin_y_um: Finite
    rotation_deg: Finite = 0.0

    def pose(self) -> Rigid2:
        """Return board frame -> robot frame."""
        return Rigid2(self.rotation_deg, self.origin_x_um, self.origin_y_um)


class ServoSection(Section):
    """When a correction is good, and when it must give up."""

    tolerance_um: Positive = Field(default=15.0, description="on target within this")
    max_moves: int = Field(default=8, ge=1, le=20)
    max_placement_um: Positive = Field(default=700.0, description="largest placement error that can be corrected")
    scatter_um: Positive = Field(
        default=40.0, description="3 sigma of two stops' scatter: below it errors grow by chance"
    )
    match_um: Positive = Field(default=120.0, description="a pad seen and one of CAD's agree within this")
    trusted_um: Positive = Field(
        default=120.0, description="where head and board are calibrated, a pad is within this of its nominal place"
    )
    first_landing_um: Positive = Field(
        default=80.0, description="99 of 100 first landings end within this of their target, before any look"
    )
    landing_um: Positive = Field(default=40.0, description="the same for landings that a look has verified")
    tip_radius_um: float = Field(
        default=25.0, ge=0.0, le=1000.0, description="of the needle's end; so much more bare metal it needs about it"
    )
    calibration_days: Positive = Field(default=30.0, description="a map older than this is not used")
    job_timeout_s: Positive = Field(default=60.0, description="deadline of a job that brings none")
    calibration_timeout_s: Positive = Field(default=3600.0, description="the same for calibrations and alignments")
