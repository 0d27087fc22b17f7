"""Coordinates and settings of the machine, and what it needs of each axis. No I/O."""

import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from drivers.deadline import Deadline
from drivers.errors import EnvelopeViolation, MotionError

# The head must never be between these angles (thesis, head angle 101..139 deg plus one degree each side)
THETA_LAST_DEG = 100.0
THETA_FIRST_DEG = 140.0
# A drive at an end of the range may read back this far outside: it counts whole increments
READ_BACK_DEG, READ_BACK_UM = 0.001, 0.01
_GANTRY = "gantry"


@dataclass(frozen=True, slots=True)
class Position:
    """A place of the machine: um in the robot frame, Z up, theta about +Z in degrees.

    As a target, theta may be a head angle (0..360) or the axis coordinate (-220..100); as an answer it is the
    axis coordinate.
    """

    x_um: float
    y_um: float
    z_um: float
    theta_deg: float


StopOthers = Callable[[], Awaitable[None]]
ClearHeight = Callable[[Sequence[Position]], float | None]
"""Gives the lowest Z at which a way through these places is clear, um; None where that is in doubt.

Between two of the places each axis goes by its own ramps, so that the head may pass anywhere within the box that they
span, at any angle between theirs. Theta is the axis coordinate; Z of the places says nothing.
"""


@dataclass(frozen=True, slots=True)
class Approach:
    """How far below its target each axis turns back, to come to it from below; 0: it may come from either side."""

    x_um: float
    y_um: float
    theta_deg: float


@dataclass(frozen=True, slots=True)
class GantryConfig:
    """How the four axes move as one machine."""

    safe_z_um: float = 12000.0
    """Height from which lateral and rotary moves are free, whatever stands below; a `ClearHeight` may allow less."""
    slow_z_um: float = -math.inf
    """Highest place where the needle may meet a surface: below it Z goes down at `slow_um_s` only."""
    slow_um_s: float = 2000.0
    """Speed of Z's last stretch down, um/s."""
    floor_z_um: float = -math.inf
    """Z is never sent below this: the lowest possible surface minus the most that the pin may be pushed."""
    backlash_um: float = 50.0
    """X and Y come to every target from below, from at least this far; a target without that room is refused."""
    backlash_theta_deg: float = 0.5625
    """Theta comes to every target from below, from at least this far."""
    backlash_z_um: float = 0.0
    """Z comes to every target from above, from at least this far."""
    same_place_um: float = 0.5
    """A target this near in X and Y needs no lateral move, so Z need not be retracted."""
    same_place_deg: float = 0.01
    """The same for theta."""


def axis_theta_deg(theta_deg: float) -> float:
    """Map a head angle (any turn) to the axis coordinate in -220..100 deg; raise EnvelopeViolation in the band.

    The coordinate never contains the forbidden band, so no path along it can cross it.
    """
    head_deg = theta_deg % 360.0
    if head_deg <= THETA_LAST_DEG + READ_BACK_DEG:
        return min(head_deg, THETA_LAST_DEG)
    if head_deg >= THETA_FIRST_DEG - READ_BACK_DEG:
        return max(head_deg, THETA_FIRST_DEG) - 360.0
    text = f"head angle {head_deg:.4f} deg is in the forbidden band {THETA_LAST_DEG:g}..{THETA_FIRST_DEG:g}"
    raise EnvelopeViolation(text, device=_GANTRY, advice="Turn the other way round, or use another angle.")


class AxisSettings(Protocol):
    """What is read of an axis' settings; lengths in the axis' own unit, um or deg."""

    @property
    def name(self) -> str:
        """What errors and log lines call it."""

    @property
    def min_units(self) -> float:
        """Lowest allowed coordinate."""

    @property
    def max_units(self) -> float:
        """Highest allowed coordinate."""

    @property
    def window_units(self) -> float:
        """How far from the target it may report to be after a move."""

    @property
    def poll_s(self) -> float:
        """Time between two looks at the drive while waiting for it."""


class SelfTest(Protocol):
    """What the start of an axis settled."""

    @property
    def fit(self) -> bool:
        """Whether nothing speaks against work: no error, no fault, not on a limit switch."""

    @property
    def homed(self) -> bool:
        """Whether its drive has its reference."""

    @property
    def position_units(self) -> float:
        """Where it was."""


class AxisCondition(Protocol):
    """What an axis says of itself."""

    @property
    def name(self) -> str:
        """Which axis."""

    @property
    def homed(self) -> bool:
        """Whether its drive still has its reference."""

    @property
    def position_units(self) -> float:
        """Where it is."""

    @property
    def error_code(self) -> int:
        """The drive's own error code, zero when there is none."""

    @property
    def error_meaning(self) -> str:
        """The same in words."""

    @property
    def warning(self) -> bool:
        """Whether the drive warns."""

    @property
    def negative_limit(self) -> bool:
        """Whether it stands on its lower limit switch."""

    @property
    def positive_limit(self) -> bool:
        """Whether it stands on its upper limit switch."""

    @property
    def following_error_units(self) -> float | None:
        """How far it is behind its set-point; None when the drive does not tell."""

    def trouble(self) -> MotionError | None:
        """Give the error that it stands in, None when it shows none; a limit switch is not among them."""


class GantryAxis(Protocol):
    """One axis, whatever drive moves it: what `drivers.gantry.driver` asks of it.

    Targets are absolute, in the axis' own unit. The docstrings of `drivers.l4118.Axis` say what each call may raise.
    A drive of another make is a class like that one; nothing else of the gantry knows about drives.
    """

    @property
    def config(self) -> AxisSettings:
        """Its settings."""

    async def start(self, deadline: Deadline) -> SelfTest:
        """Identify the drive and set it up. Moves nothing; a drive found running is halted."""

    async def homed(self, deadline: Deadline, since_s: float = math.inf) -> bool:
        """Ask the drive whether it has its reference; raise EmergencyStop when it lost it.

        A look taken since `since_s` (monotonic) that shows it running will do; infinity: it is asked.
        """

    async def position(self, deadline: Deadline, since_s: float = math.inf) -> float:
        """Give where it is; where it stands, a look taken since `since_s` (monotonic) will do."""

    @property
    def looked_at_s(self) -> float:
        """When the drive was last looked at, monotonic; minus infinity where it was told something since."""

    @property
    def due_s(self) -> float:
        """When the move under way can be over at the earliest, monotonic."""

    async def raw_input(self, number: int, deadline: Deadline) -> bool:
        """Tell whether a digital input of its drive, from 1, is high."""

    async def health(self, deadline: Deadline) -> AxisCondition:
        """Collect what the drive says of itself."""

    def check(self, target_units: float) -> None:
        """Raise EnvelopeViolation for a target out of range."""

    async def aim(
        self,
        target_units: float,
        deadline: Deadline,
        speed_units_s: float | None = None,
        since_s: float = math.inf,
    ) -> None:
        """Make ready for a move, of which nothing begins yet. `speed_units_s`: at most; None: the axis' own.

        `since_s`: whether the drive runs is told by a look taken since then (monotonic); infinity: it is asked.
        """

    def aims_at_once(self, target_units: float, since_s: float) -> bool:
        """Tell whether a look taken since then (monotonic) allows to aim by writing alone: nothing is to be asked."""

    async def go(self, deadline: Deadline) -> None:
        """Begin the move that was aimed at; returns when the drive was told."""

    @property
    def holds_start(self) -> bool:
        """Whether a drive that has taken its target is still to be told that it may take another; see `let_go`."""

    async def let_go(self, deadline: Deadline) -> None:
        """Tell it so. Nothing moves by that; it may be left until the next aim, which does it too."""

    async def arrived(self, deadline: Deadline, stop_others: StopOthers | None = None) -> bool:
        """Look at the move begun before; raise what made it fail.

        `stop_others` is done first where the drive is seen not to run: to ask it why takes a while.
        """

    async def check_standing(self, deadline: Deadline, stop_others: StopOthers | None = None) -> None:
        """Look at an axis that stands while others move; raise what it has met. One short question to the drive.

        `stop_others`: as above.
        """

    async def home(self, deadline: Deadline, stop_others: StopOthers | None = None) -> None:
        """Find the reference, and keep in the drive that it was found.

        `stop_others` is done when the run fails: before the drive is asked why, and beside its own halt.
        """

    async def forget_homing(self, deadline: Deadline) -> None:
        """Take that mark away from the drive, and read back that it is gone."""

    async def reset_fault(self, deadline: Deadline) -> None:
        """Clear a fault; raise what it is when its cause remains. Moves nothing."""

    async def quick_stop(self) -> None:
        """Stop at once, with a deadline of its own."""

    async def halt_if_possible(self) -> None:
        """Stop as the answer to another failure: what goes wrong here is only logged."""

    @property
    def unstopped(self) -> bool:
        """Whether a stop was ordered that could not be confirmed: the motor may still run."""

    def release(self) -> None:
        """Allow moves again after a stop."""
