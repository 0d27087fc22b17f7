"""Station: gantry, lights and camera as one thing that looks and moves.

A look takes two frames of one resting scene: white for the tip, red for the pads (thesis 5.3, 5.4). A frame counts
only if its exposure began after the light, and the head before it, had settled. A light is switched as soon as the
frame before is exposed; while it settles, that frame is fetched and decoded, and the tip is searched in it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace

from daemon.config.model import Config
from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.station.allowance import Clocked
from daemon.station.beside import beside
from daemon.station.board_view import BoardSearch, BoardSeen, see_board
from daemon.station.devices import Hardware
from daemon.station.frames import Frames
from daemon.station.free_pin import FreePin
from daemon.station.needle import HEIGHT_WINDOW_UM, Needle, heights
from daemon.station.tip_search import UNUSABLE, TipSearch
from drivers.camera import Exposed, Frame
from drivers.deadline import Deadline
from drivers.errors import FrameLost
from drivers.gantry import Approach, ClearHeight, Position
from drivers.lights import Light
from drivers.meter import Meter
from vision import ControlPoint, NotFound, ProbeModel, Seen, Tip, find_control_point, find_test_points
from vision.annotate import Landing
from vision.geometry import PoseMap

HOMED_WITHIN_S = 2.0
SAME_PLACE_UM, SAME_PLACE_DEG = 1.0, 0.02
"""A target this near to where the head stands is no move sideways."""
LOOKS_FOR_FREE = 3
"""How often a pin that seems pushed in is looked at before it counts as pushed in."""


@dataclass(frozen=True)
class LookResult:
    """What one look brought: the frames, where the head was, the tip and what was looked for.

    `tip` is None when no probe is taught; `seen` is what the red frame showed, `board` where CAD lies in it, `cross`
    what the white one showed, `landing` where the needle would come down: each is None where it was not looked for, or
    where there is no tip to search round.
    """

    white: Frame
    red: Frame | None
    position: Position
    tip: Tip | NotFound | None
    expected_tip_px: tuple[float, float] | None
    seen: Seen | None = None
    cross: ControlPoint | NotFound | None = None
    board: BoardSeen | None = None
    landing: Landing | None = None

    @property
    def says_only_where_the_tip_is(self) -> bool:
        """Whether the tip was found where nothing else was looked for."""
        return self.red is None and self.cross is None and isinstance(self.tip, Tip)


@dataclass(frozen=True)
class Search:
    """Where and for what to look in the red frame, relative to the tip."""

    offset_px: tuple[float, float]
    reach_px: float
    expected_radius_px: float | None

    @classmethod
    def by_map(
        cls, pose_map: PoseMap, tip_px: tuple[float, float], point: BoardPoint, reach_um: float, height_um: float
    ) -> Search:
        """Look round the place below the tip for a target of CAD's size; `height_um` is the surface's there."""
        scale = pose_map.scale_px_per_um(tip_px)
        return cls(pose_map.below_px(height_um), reach_um * scale, point.round_um / 2 * scale)


@dataclass(frozen=True)
class CrossSearch:
    """Where to look for the control point in the white frame, relative to the tip, and how long its arms are."""

    offset_px: tuple[float, float]
    reach_px: float
    arm_px: float


class Station:
    """The opened hardware as one thing that looks and goes."""

    def __init__(
        self,
        config: Config,
        hardware: Hardware,
        needle: Needle | None = None,
        approach: Callable[[], Approach | None] = lambda: None,
    ) -> None:
        """Take the needle, which outlives a reload of the configuration; without one the station has its own.

        `approach`: who knows from how far the axes have to come to a target; None: as the configuration has it.
        """
        self._approach = approach
        self._gantry_section, self._sense = config.gantry, config.sense
        self._hardware = hardware
        self._frames = Frames(hardware, config.camera.timeout_ms / 1e3)
        self.needle = needle or Needle()
        """Where the needle is; told of every move and every position."""
        self.needle.adopt(*heights(config.gantry))
        self._tips = TipSearch()
        self._resting_since_s = time.monotonic()

    @property
    def exchanges(self) -> int:
        """How many requests went over the buses so far: a sign of life while something moves."""
        return sum(bus.statistics.requests for bus in self._hardware.buses.values())

    @property
    def approach(self) -> Approach | None:
        """From how far the axes come to their targets at present; None: as the configuration has it."""
        return self._approach()

    async def position(self, caller: Clocked) -> Position:
        """Read where the axes are."""
        with caller.watch.spend("bus"):
            return await self.read_position(caller.deadline)

    async def last_position(self, caller: Clocked) -> Position:
        """Return where the drives last said the axes are, or ask them: who stands needs not be asked again."""
        return self.needle.position or await self.position(caller)

    async def read_position(self, deadline: Deadline) -> Position:
        """Read where axes that have their reference are, and let the needle know; nobody's waiting is booked."""
        position = await self._hardware.gantry.position(deadline)
        self.needle.reported(position)
        return position

    async def go(
        self,
        target: Position,
        caller: Clocked,
        *,
        from_above: frozenset[str] = frozenset(),
        slow_z_um: float | None = None,
        clear: ClearHeight | None = None,
    ) -> Position:
        """Move the head and return where the drives report it to be; cancelling stops it.

        Raises `Fault` for a target that is not straight above or below while the needle is not known to be up.

        `from_above`: axes that come to the target from above, against the rule; only who measures backlash wants that.
        `slow_z_um`: Z below which it goes down slowly; None: where any possible surface may be. `clear`: who knows the
        lowest Z of the way across; None: it goes at the safe height. After a press nothing moves sideways before the
        pin was seen free, nor after a look that did not show the tip.
        """
        self._hardware.gantry.check(target)
        if not self.needle.is_up:
            self.needle.refuse_sideways(await self.last_position(caller), target)
        await self.may_go(target, caller)
        with caller.watch.spend("motion"):
            return await self._move(target, caller.deadline, from_above, slow_z_um, clear)

    async def may_go(self, target: Position, caller: Clocked) -> None:
        """See before a move sideways that the pin is free, where a press or an unseen tip has left that open.

        Asked by itself before a job tells that it moves; `go` asks too. Raises `Fault` where nothing may go there.
        """
        free = self.needle.free_pin
        if free is None and self.needle.blind:
            free = self.needle.taught_free()  # asked each time: another needle may be taught meanwhile
        if free is not None and not _straight(await self.position(caller), target):
            await self._see_lifted(free, caller)

    async def _move(
        self,
        target: Position,
        deadline: Deadline,
        from_above: frozenset[str] = frozenset(),
        slow_z_um: float | None = None,
        clear: ClearHeight | None = None,
    ) -> Position:
        """Move, and let the needle know before and after."""
        self.needle.departs(target)
        gantry = self._hardware.gantry
        try:
            reached = await gantry.move_to(
                target, deadline, from_above=from_above, slow_z_um=slow_z_um, clear=clear, approach=self.approach
            )
            self._resting_since_s = gantry.at_rest_s
        except BaseException:
            self._resting_since_s = time.monotonic()
            raise
        self.needle.board.moved()
        self.needle.reported(reached)
        return reached

    async def to_height(
        self, position: Position, z_um: float, caller: Clocked, *, slow_z_um: float | None = None
    ) -> Position:
        """Bring Z to a height, unless it is there already; return the position."""
        if abs(position.z_um - z_um) <= HEIGHT_WINDOW_UM:
            return position
        return await self.go(replace(position, z_um=z_um), caller, slow_z_um=slow_z_um)

    def pressing(self, free: FreePin) -> None:
        """Remember where the free tip is seen: from now on the pin may be pushed in."""
        self.needle.free_pin = free

    @property
    def meter(self) -> Meter | None:
        """The measuring instrument; None where the station has none."""
        return self._hardware.meter

    async def seen_at(self, position: Position, tip: Tip, caller: Clocked) -> None:
        """Take a look's word that the pin came free after a press: the tip stands where it did before.

        Nothing has moved sideways since a press that nobody has seen the end of, so that the place is the same. Where
        a touch sense is fitted it is to agree.
        """
        free = self.needle.free_pin
        if free is None or position.z_um < free.z_um - SAME_PLACE_UM or not free.shows_free(tip):
            return
        if not self.has_sense or not await self.senses_metal(caller):
            self.needle.free_pin = None

    async def see_lifted(self, caller: Clocked) -> None:
        """Lift straight up, and see that the pin is free; raise `Fault` if it is not, or is not seen.

        The drive's count is no proof: an axis that lost steps counts on. Nor is a look of a push that is small: where
        a touch sense is fitted, it is asked too.
        """
        if self.needle.free_pin is not None:
            await self._see_lifted(self.needle.free_pin, caller)

    async def _see_lifted(self, free: FreePin, caller: Clocked) -> None:
        # What the move before has reported is enough: what is proved is proved by the look.
        position = await self.last_position(caller)
        if position.z_um < free.z_um:
            with caller.watch.spend("motion"):
                position = await self._move(replace(position, z_um=free.z_um), caller.deadline)
        off_px: float | None = None
        for _ in range(LOOKS_FOR_FREE):
            tip = (await self.look_white(position, free.model, None, caller)).tip
            if not isinstance(tip, Tip):
                continue  # a glint may hide it in one picture
            off_px = free.off_px(tip)
            if free.shows_free(tip):
                await self.refuse_metal(caller)
                self.needle.free_pin = None
                return
        if off_px is None:
            raise Fault(
                FaultCode.TIP_NOT_FOUND,
                "after a press, or where it had not been seen, the tip was not found above either: nobody knows "
                "whether the needle lifted",
                advice="look at the needle, then `home`: it lifts Z to its switch before anything moves sideways; if "
                "the needle was changed or bent, `calibrate tip` after that",
            )
        self.needle.free_pin = free  # that it was seen does not make it free
        raise Fault(
            FaultCode.AXIS_STALLED,
            f"Z did not lift the needle: by its count it is at {position.z_um / 1e3:.2f} mm, but the tip stands "
            f"{off_px:.1f} px from its free place in the picture",
            advice="lift Z by hand, find what blocks it, then `reset` and `home`",
            axis="z",
            off_px=round(off_px, 2),
        )

    async def refuse_metal(self, caller: Clocked) -> None:
        """Raise `Fault` if a needle that was lifted after a press still feels metal; without a sense nothing is asked.

        Neither the drive's count nor a look tells a small rest of a push.
        """
        if self.needle.free_pin is not None and self.has_sense and await self.senses_metal(caller):
            raise Fault(
                FaultCode.AXIS_STALLED,
                "Z may not have lifted the needle: by its count it is up, and the needle still feels metal ([sense])",
                advice="lift Z by hand, see that nothing hangs on the needle or its wire, then `reset` and `home`",
                axis="z",
            )

    async def home(self, caller: Clocked) -> None:
        """Home all axes, Z first and up; where the needle is then is read back."""
        self.needle.forget()
        self._tips.forget()
        with caller.watch.spend("motion"):
            try:
                await self._hardware.gantry.home(caller.deadline)
            finally:
                self._resting_since_s = time.monotonic()
        self.needle.free_pin, self.needle.blind = None, False  # Z went up to its switch before anything else moved
        await self.position(caller)

    async def require_homed(self, caller: Clocked, *, looks_next: bool = False) -> None:
        """Raise unless every drive still knows where it is.

        looks_next: white is lit as soon as the first drive has answered, so that it settles while the others are asked;
        a line that is dead is told as one, and not as a lamp.
        """
        with caller.watch.spend("bus"):
            homed = self._hardware.gantry.homed(caller.deadline.within(HOMED_WITHIN_S))
            if not (await self._while_lighting(homed, caller) if looks_next else await homed):
                raise Fault(FaultCode.NOT_HOMED)

    async def _while_lighting(self, drives: Awaitable[bool], caller: Clocked) -> bool:
        """Ask the drives; the line takes what is asked for the lamp behind their first question."""
        async with beside(self._hardware.lights.set(Light.WHITE, caller.deadline)) as lamp:
            homed = await drives
            if homed:
                await lamp
        return homed

    @property
    def has_sense(self) -> bool:
        """Whether a touch sense is fitted."""
        return self._sense.kind != "none"

    async def senses_metal(self, caller: Clocked) -> bool:
        """Ask the touch sense whether the needle stands on metal; only where one is fitted."""
        with caller.watch.spend("bus"):
            high = await self._hardware.gantry.raw_input("z", self._sense.input, caller.deadline)
        return high == (self._sense.closed == "high")

    def check(self, target: Position) -> None:
        """Raise if the target is outside of what the machine may reach."""
        self._hardware.gantry.check(target)

    async def look(
        self,
        position: Position,
        model: ProbeModel | None,
        search: Search | BoardSearch,
        caller: Clocked,
        *,
        moves_next: bool = False,
        is_last: bool = False,
        measured: bool = False,
    ) -> LookResult:
        """Take white and red from where the head is, find the tip, and pads or the board; nothing moves.

        measured: for a calibration a tip that is carried from another picture will not do. moves_next: a move and
        another look will follow what is seen. So white is lit as soon as red is exposed, and the drives are asked while
        the search goes on: the move finds both done. is_last: hardly another look will follow; it is dark once red is
        exposed.
        """
        on_its_way = await self._frames.expose(Light.WHITE, self._still_at_s, caller)
        async with beside(self._tip_in(on_its_way, model, caller, measured=measured)) as tip_search:
            on_its_way = await self._frames.expose(Light.RED, self._still_at_s, caller)
            if moves_next:
                await self.prepare_white(caller)
            elif is_last:
                await self.lights_off(caller)
            try:
                white, tip = await tip_search
            except FrameLost:  # the light has changed meanwhile: the next picture is none of white
                white = await self.capture(Light.WHITE, caller)
                tip = await self._tips.find(white, model, measured=measured)
        try:
            red = await self._frames.arrived(on_its_way, caller)
        except FrameLost:
            red = await self.capture(Light.RED, caller)
        look = LookResult(white, red, position, tip, model.tip_px if model is not None else None)
        self._searched(tip)
        if not tip:
            return look
        async with beside(asyncio.to_thread(_search_red, red, tip, search)) as searching:
            if moves_next:
                await self.position(caller)
            found = await searching
        return replace(look, board=found) if isinstance(found, BoardSeen) else replace(look, seen=found)

    def _searched(self, tip: Tip | NotFound | None) -> None:
        """Remember whether a look has shown the tip; a picture that is no good says nothing of it."""
        if isinstance(tip, Tip):
            self.needle.blind = False
        elif tip is not None and tip.reason not in UNUSABLE:
            self.needle.blind = True

    async def _tip_in(
        self, exposed: Exposed, model: ProbeModel | None, caller: Clocked, *, measured: bool
    ) -> tuple[Frame, Tip | NotFound | None]:
        """Wait for a frame that was exposed, and find the tip in it."""
        white = await self._frames.arrived(exposed, caller)
        return white, await self._tips.find(white, model, measured=measured)

    async def look_white(
        self,
        position: Position,
        model: ProbeModel,
        cross: CrossSearch | None,
        caller: Clocked,
        *,
        is_last: bool = False,
        measured: bool = False,
    ) -> LookResult:
        """Take one white frame and find the tip in it, and the control point if it is asked for; nothing moves.

        is_last, measured: as in `look`.
        """
        white = await (self._last_white(caller) if is_last else self.capture(Light.WHITE, caller))
        tip = await self._tips.find(white, model, measured=measured)
        found = await asyncio.to_thread(_search_cross, white, tip, cross) if tip and cross is not None else None
        self._searched(tip)
        return LookResult(white, None, position, tip, model.tip_px, cross=found)

    async def _last_white(self, caller: Clocked) -> Frame:
        """Take a frame under white, and go dark while it is on its way."""
        exposed = await self._frames.expose(Light.WHITE, self._still_at_s, caller)
        await self.lights_off(caller)
        asked_s = time.monotonic()
        try:
            white = await self._frames.arrived(exposed, caller)
        except FrameLost:
            return await self.capture(Light.WHITE, caller)
        caller.watch.book("exposure", white.received_s - asked_s)
        return white

    async def capture(self, light: Light, caller: Clocked) -> Frame:
        """Take one frame that was exposed wholly after light and head had settled."""
        return await self._frames.take(light, self._still_at_s, caller)

    @property
    def _still_at_s(self) -> float:
        """When the head has come to rest after its last move."""
        return self._resting_since_s + self._gantry_section.settle_ms / 1e3

    async def prepare_white(self, caller: Clocked) -> None:
        """Switch to white ahead of a move, so that the lamp is steady when the head is."""
        with caller.watch.spend("bus"):
            await self._hardware.lights.set(Light.WHITE, caller.deadline)

    async def lights_off(self, caller: Clocked) -> None:
        """Switch both rings off."""
        with caller.watch.spend("bus"):
            await self._hardware.lights.set(Light.OFF, caller.deadline)

    @property
    def moving(self) -> bool:
        """Whether a move or a homing run is under way."""
        return self._hardware.gantry.moving

    async def stop(self) -> None:
        """Stop all motion at once, whatever else goes on."""
        await self._hardware.gantry.quick_stop()

    async def homed(self, deadline: Deadline) -> bool:
        """Ask every drive whether it has its reference."""
        return await self._hardware.gantry.homed(deadline)

    async def retract(self, deadline: Deadline) -> Position:
        """Lift the needle straight up to the safe height; return where Z is read to be, which may be higher already."""
        position = await self.read_position(deadline)
        if position.z_um < self._gantry_section.safe_z_um:
            safe = Position(position.x_um, position.y_um, self._gantry_section.safe_z_um, position.theta_deg)
            position = await self._move(safe, deadline)
        return position


def _straight(here: Position, target: Position) -> bool:
    """Whether only Z differs."""
    turn_deg = abs((here.theta_deg - target.theta_deg + 180.0) % 360.0 - 180.0)
    away_um = max(abs(here.x_um - target.x_um), abs(here.y_um - target.y_um))
    return away_um <= SAME_PLACE_UM and turn_deg <= SAME_PLACE_DEG


def _search_cross(white: Frame, tip: Tip, cross: CrossSearch) -> ControlPoint | NotFound:
    """Search round the tip for the control point (appendix C)."""
    around = (tip.x_px + cross.offset_px[0], tip.y_px + cross.offset_px[1])
    return find_control_point(white.pixels, around, cross.reach_px, cross.arm_px)


def _search_red(red: Frame, tip: Tip, search: Search | BoardSearch) -> Seen | BoardSeen:
    """Register the board, or run TDEA round the place below the tip."""
    if isinstance(search, BoardSearch):
        return see_board(red.pixels, tip, search)
    around = (tip.x_px + search.offset_px[0], tip.y_px + search.offset_px[1])
    return find_test_points(
        red.pixels,
        around_px=around,
        reach_px=search.reach_px,
        expected_radius_px=search.expected_radius_px,
        needle=tip,
    )
