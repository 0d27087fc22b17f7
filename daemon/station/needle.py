"""Needle place: whether the needle is up, as far as the drives have told; the one owner of that answer.

Up means at or above the height of looks at that place; below it the pin may be pressed. The place is fed by what is
read of the drives anyway, and costs the bus nothing. It is unknown until a referenced machine has told its position,
and while the reference of Z is in doubt. A touch is counted when the needle goes below the surface, and once until it
is above it again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

from daemon.config.sections.motion import GantrySection
from daemon.domain.errors import Fault, FaultCode
from daemon.station.board_trust import BoardTrust
from daemon.station.free_pin import FreePin
from daemon.station.needle_health import NeedleHealth
from daemon.station.sight import Sight
from daemon.station.stand import Stand
from drivers.gantry import Position

HEIGHT_WINDOW_UM = 5.0
"""The head is at working height when Z agrees this well."""
SIDEWAYS_UM, TURN_DEG = 2.0, 0.1
"""What an axis at rest may report beside its place; a move farther than that goes sideways."""
HeightAt = Callable[[Position], float]


class NeedlePlace(Enum):
    """Where the needle is."""

    UP = "up"
    """At working height or above it."""
    DOWN = "down"
    """Below working height, or on a way that leads there."""
    UNKNOWN = "unknown"
    """No drive with a sure reference has told."""


class Needle:
    """Where the needle of one station is, over reloads of its configuration."""

    def __init__(
        self, in_doubt: Callable[[], bool] = lambda: False, on_touch: Callable[[], None] = lambda: None
    ) -> None:
        """Take who tells that Z may stand elsewhere than its drive believes, and who counts touches."""
        self._in_doubt, self._on_touch = in_doubt, on_touch
        self._work_um: HeightAt = lambda _at: math.inf
        self._surface_um: HeightAt = lambda _at: -math.inf
        self._known = NeedlePlace.UNKNOWN
        self._position: Position | None = None
        self._z_um: float | None = None
        self._touching = False
        self.board = BoardTrust()
        """Whether the board below it is known to lie as it was measured."""
        self.stand = Stand()
        """Over which point it was put, and by whom."""
        self.health = NeedleHealth()
        """What the reference pad said of it."""
        self.free_pin: FreePin | None = None
        """Set while the pin may be pushed in: from before it goes down until it was seen free, or was homed."""
        self.blind = False
        """Whether the last look for the tip did not show it, though its picture was good."""
        self.taught_free: Callable[[], FreePin | None] = lambda: None
        """Who tells where a free tip is seen at the safe height; None where there is no map."""
        self.sight: Sight | None = None
        """What the last look showed of target and needle; None once the head has moved."""
        self.departures = 0
        """How many moves it has heard of."""

    def adopt(self, work_um: HeightAt, surface_um: HeightAt) -> None:
        """Judge by other heights from here on: of looks, and of the surface, um, each at a position of the head."""
        self._work_um, self._surface_um = work_um, surface_um

    # --- asked -----------------------------------------------------------------------------------------------

    @property
    def place(self) -> NeedlePlace:
        """Where it is, as far as is known."""
        return NeedlePlace.UNKNOWN if self._in_doubt() else self._known

    @property
    def z_um(self) -> float | None:
        """Height that Z last reported; None where there is none to go by, and while it moves."""
        return self._z_um if self.place is not NeedlePlace.UNKNOWN else None

    def left_um(self, here: Position) -> float | None:
        """Return the height below which it was not left; None where there is none to go by.

        After a move that did not come to its end that is the height of looks, if it was up all the way.
        """
        return self._work_um(here) if self.is_up and self._z_um is None else self.z_um

    @property
    def is_up(self) -> bool:
        """Whether it is known to be up."""
        return self.place is NeedlePlace.UP

    @property
    def may_be_down(self) -> bool:
        """Whether it was not up when it was last known; a doubt that came since leaves it where it was."""
        return self._known is not NeedlePlace.UP

    @property
    def position(self) -> Position | None:
        """Where the head last reported to be; None after a move that did not come to its end."""
        return self._position

    def refuse_sideways(self, here: Position, target: Position) -> None:
        """Raise `Fault` for a target that is not straight above or below, unless the needle is known to be up."""
        away_um = math.dist((here.x_um, here.y_um), (target.x_um, target.y_um))
        turn_deg = abs((target.theta_deg - here.theta_deg + 180.0) % 360.0 - 180.0)
        if not self.is_up and not (away_um <= SIDEWAYS_UM and turn_deg <= TURN_DEG):
            raise self.fault(f"no move sideways ({away_um:.0f} um, {turn_deg:.2f} deg)")

    def fault(self, why: str) -> Fault:
        """Return the fault that says that the needle is not known to be up."""
        z_um = self.z_um
        where = f"it is {self.place.value}" if z_um is None else f"Z is at {z_um / 1e3:.3f} mm"
        return Fault(FaultCode.NEEDLE_DOWN, f"the needle is not known to be up ({where}): {why}", z_um=z_um)

    # --- told ------------------------------------------------------------------------------------------------

    def departs(self, target: Position) -> None:
        """Hear of a move that begins. It is down from here on if the move leads there; up it is when it has arrived."""
        self._position = self._z_um = self.sight = None
        self.departures += 1
        if target.z_um < self._work_um(target) - HEIGHT_WINDOW_UM:
            self._known = NeedlePlace.DOWN

    def reported(self, position: Position) -> None:
        """Hear where the head is, of drives that have their reference.

        A needle that is found pressed was pressed by somebody else, who has counted it.
        """
        found = self._known is NeedlePlace.UNKNOWN
        self._position, self._z_um = position, position.z_um
        up = position.z_um >= self._work_um(position) - HEIGHT_WINDOW_UM
        self._known = NeedlePlace.UP if up else NeedlePlace.DOWN
        touching = position.z_um < self._surface_um(position)
        if touching and not self._touching and not found:
            self._on_touch()
        self._touching = touching

    def pumped(self) -> None:
        """Hear of another push of the pin on the surface on which it stands; each wears it as a touch does."""
        if self._touching:
            self._on_touch()

    def touched(self) -> None:
        """Hear that it met a surface where none was known; it counts once, as any touch."""
        if not self._touching:
            self._on_touch()
        self._touching = True

    def forget(self) -> None:
        """Hear that the reference is given up."""
        self._known, self._position, self._z_um = NeedlePlace.UNKNOWN, None, None
        self.sight = None
        self.board.end()
        self.stand.forget()


def heights(gantry: GantrySection) -> tuple[HeightAt, HeightAt]:
    """Return the heights of looks and of the surface as the configuration has them, the same everywhere."""
    return (lambda _at: gantry.work_z_um), (lambda _at: gantry.touch_z_um)
