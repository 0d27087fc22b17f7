"""Calibration targets: a resting thing with a sharp centre, a round target or the printed cross."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import JobContext, StationContext
from daemon.procedures.aiming import refuse_unusable
from daemon.procedures.look_numbers import describe
from daemon.station.station import CrossSearch, LookResult, Search
from drivers.gantry import Position
from vision import ControlPoint, NotFound, Reason, TestPoint, Tip

MIN_VISIBLE = 0.9
"""Of a round target's contour; what the needle hides makes its centre worth less than a calibration needs."""
MAX_CROSS_SIGMA_PX = 0.3
CROSS = "control point"


@dataclass(frozen=True)
class Sighting:
    """Target and tip in one frame. `target_px` is the target as if the tip stood at the taught place.

    From stop to stop camera and needle flex together; what counts is where the target is from the tip.
    """

    tip: Tip
    target_px: tuple[float, float]
    sigma_px: float
    position: Position


@dataclass(frozen=True)
class NotSeen:
    """Why the target, or the tip, was not seen. Falsy."""

    why: str

    def __bool__(self) -> bool:
        """Say that nothing was seen."""
        return False


class CalibrationTarget(Protocol):
    """One resting thing to look at."""

    @property
    def name(self) -> str:
        """Its name, for people and records."""

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is supposed to be, robot frame."""

    @property
    def size_um(self) -> float:
        """Its width: as far to the side it is clear of the needle's taper."""

    async def see(
        self,
        job: JobContext,
        context: StationContext,
        position: Position,
        offset_px: tuple[float, float],
        reach_px: float,
    ) -> Sighting | NotSeen:
        """Look once from `position`, for the target within `reach_px` of the place `offset_px` from the tip."""


@dataclass(frozen=True)
class RoundTarget:
    """A round target of the board, seen in red light."""

    point: BoardPoint
    place_um: tuple[float, float]

    @property
    def name(self) -> str:
        """CAD's name."""
        return self.point.name

    @property
    def size_um(self) -> float:
        """CAD's diameter."""
        return self.point.round_um

    async def see(
        self,
        job: JobContext,
        context: StationContext,
        position: Position,
        offset_px: tuple[float, float],
        reach_px: float,
    ) -> Sighting | NotSeen:
        """Take a look in both lights."""
        expected_px = self.point.round_um / 2 / context.camera.pitch_um
        probe = context.calibrations.require_probe()
        search = Search(offset_px, reach_px, expected_px)
        look = await context.station.look(position, probe, search, job, measured=True)
        job.saw(look)
        target = look.seen.nearest if look.seen is not None else None
        found = target if isinstance(target, TestPoint) else None
        job.note("look", describe(look, found, None))
        if isinstance(found, TestPoint) and found.visible < MIN_VISIBLE:
            return NotSeen("the needle hides too much of it")
        return _sighting(look, target, context)


@dataclass(frozen=True)
class CrossTarget:
    """The printed control point, seen in white light together with the tip."""

    place_um: tuple[float, float]
    arm_um: float

    @property
    def name(self) -> str:
        """What it is called."""
        return CROSS

    @property
    def size_um(self) -> float:
        """Both arms of a line."""
        return 2 * self.arm_um

    async def see(
        self,
        job: JobContext,
        context: StationContext,
        position: Position,
        offset_px: tuple[float, float],
        reach_px: float,
    ) -> Sighting | NotSeen:
        """Take one white frame."""
        search = CrossSearch(offset_px, reach_px, self.arm_um / context.camera.pitch_um)
        probe = context.calibrations.require_probe()
        look = await context.station.look_white(position, probe, search, job, measured=True)
        job.saw(look)
        job.note("look", describe(look, None, None))
        if isinstance(look.cross, ControlPoint) and look.cross.sigma_px > MAX_CROSS_SIGMA_PX:
            return NotSeen(f"its centre is known to {look.cross.sigma_px:.1f} px only; is it sharp, clean and flat?")
        return _sighting(look, look.cross, context)


def choose_target(context: StationContext, point: BoardPoint | None) -> CalibrationTarget:
    """Return the round target that was named, else the control point of the configuration."""
    if point is not None:
        x_um, y_um = context.geometry.board_to_robot_um(point.place_um)
        return RoundTarget(point, (float(x_um), float(y_um)))
    cross = context.config.control_point
    if cross is None:
        raise Fault(
            FaultCode.NOT_CALIBRATED,
            "the configuration has no [control_point]",
            advice="fix the printed cross beside the board and write its place into station.toml",
        )
    return CrossTarget(cross.place_um, cross.arm_um)


def _sighting(
    look: LookResult, target: TestPoint | ControlPoint | NotFound | None, context: StationContext
) -> Sighting | NotSeen:
    """Put tip and target together; raise `Fault` if the frame itself is no good, for no other place helps then."""
    if not isinstance(look.tip, Tip) or not isinstance(target, TestPoint | ControlPoint):
        missing = target if isinstance(look.tip, Tip) else look.tip
        if not isinstance(missing, NotFound):
            return NotSeen("it was not looked for")
        # A white frame in which the tip is seen is good; where it is dark beside the tip, the print is not there.
        bare = look.red is None and missing is target
        if missing.reason is not Reason.OUT_OF_FRAME and not bare:
            refuse_unusable(missing, "red" if missing is target and look.red is not None else "white")
        return NotSeen(missing.message if missing is target else f"the tip was not found: {missing.message}")
    x, y = context.calibrations.require_probe().tip_px
    shift = x - look.tip.x_px, y - look.tip.y_px
    sigma_px = (look.tip.sigma_px**2 + target.sigma_px**2) ** 0.5
    return Sighting(look.tip, (target.x_px + shift[0], target.y_px + shift[1]), sigma_px, look.position)
