"""X, Y, Z and theta as one machine: safe paths, coordinated waits, every axis stopped when one fails."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

import structlog

from drivers.deadline import Deadline
from drivers.errors import (
    DeadlinePassed,
    DeviceError,
    EnvelopeViolation,
    LinkError,
    MotionError,
    MotionTimeout,
    NotHomed,
    Stalled,
)
from drivers.gantry.contract import (
    READ_BACK_UM,
    Approach,
    AxisCondition,
    ClearHeight,
    GantryAxis,
    GantryConfig,
    Position,
    SelfTest,
    StopOthers,
    axis_theta_deg,
)
from drivers.gantry.course import Course
from drivers.gantry.path import Ends, Leg, plan
from drivers.shielded import finish

AXES = ("x", "y", "z", "theta")
# What was looked at so short a time ago is not asked again before a move: one after the other, four looks are as old
FRESH_S = 0.1
# While an axis homes, one of the others is asked after so many of its pauses: the line is left to the one that moves
LOOK_EVERY_POLLS = 2
_NAME = "gantry"


class Gantry:
    """The whole machine. One move at a time; a second one is refused, stops always get through.

    Every move raises Z to a clear height before anything lateral, comes to its target from one side, and is checked on
    arrival.
    A failure, an expired deadline or a cancelled caller halts all four axes before it is raised.
    """

    def __init__(self, axes: Mapping[str, GantryAxis], config: GantryConfig) -> None:
        """Take the axes by the names x, y, z and theta."""
        if set(axes) != set(AXES):
            raise ValueError(f"a gantry needs the axes {', '.join(AXES)}; got {', '.join(sorted(axes))}")
        ranges = {name: (axes[name].config.min_units, axes[name].config.max_units) for name in AXES}
        low_z_um, high_z_um = ranges["z"]
        if not low_z_um <= config.safe_z_um <= high_z_um:
            raise ValueError(f"safe_z_um {config.safe_z_um} is outside of Z {low_z_um}..{high_z_um}")
        if ranges["theta"][0] < -220.0 or ranges["theta"][1] > 100.0:
            raise ValueError(f"theta range {ranges['theta']} reaches beyond -220..100 deg")
        self.config = config
        self._axes = {name: axes[name] for name in AXES}
        self._ranges = ranges
        self._ends = Ends(ranges["x"], ranges["y"], ranges["z"], ranges["theta"])
        self._moving = False
        self._stopping = asyncio.Lock()
        self._off: dict[str, float] = {}
        self._at_rest_s = -math.inf
        self._log = structlog.get_logger().bind(device=_NAME)

    # ------------------------------------------------------------------ looks
    async def start(self, deadline: Deadline) -> Mapping[str, SelfTest]:
        """Identify and set up all drives. Moves nothing; a drive found running is halted.

        Raises the first failure, after all drives were asked: behind the one that failed another may be running.
        """
        found: dict[str, SelfTest] = {}
        failures: list[DeviceError] = []
        for name, axis in self._axes.items():
            try:
                found[name] = await axis.start(deadline)
            except DeviceError as exc:
                failures.append(exc)
        if failures:
            raise failures[0]
        return found

    async def homed(self, deadline: Deadline | None = None) -> bool:
        """Ask all drives whether they still have their reference.

        Raises EmergencyStop, by the axis, when a drive lost it though nobody took it away.
        """
        return not await self._not_homed(deadline or Deadline.after(2.0))

    async def position(self, deadline: Deadline, since_s: float | None = None) -> Position:
        """Give where the machine is; theta as the axis coordinate (-220..100 deg).

        An axis that stands and was looked at since `since_s` (monotonic; None: a moment ago) is not asked again.
        """
        since_s = time.monotonic() - FRESH_S if since_s is None else since_s
        at = {name: await axis.position(deadline, since_s) for name, axis in self._axes.items()}
        return Position(at["x"], at["y"], at["z"], at["theta"])

    async def raw_input(self, axis: str, number: int, deadline: Deadline) -> bool:
        """Tell whether a digital input of a drive, from 1, is high."""
        return await self._axes[axis].raw_input(number, deadline)

    async def health(self, deadline: Deadline) -> tuple[AxisCondition, ...]:
        """Give what each drive says of itself, in the order x, y, z, theta."""
        return tuple([await axis.health(deadline) for axis in self._axes.values()])

    def take_arrivals(self) -> Mapping[str, float]:
        """Give how far from its target each axis stopped at worst since this was last asked; none that did not move."""
        off, self._off = self._off, {}
        return off

    @property
    def at_rest_s(self) -> float:
        """When the last move that ended well was seen to be over, monotonic: what is asked after that takes a while."""
        return self._at_rest_s

    @property
    def moving(self) -> bool:
        """Tell whether a move or a homing run of this object is under way."""
        return self._moving

    def check(self, target: Position) -> Position:
        """Give the target with theta as axis coordinate; raise EnvelopeViolation when it is out of reach."""
        wanted = _by_axis(replace(target, theta_deg=axis_theta_deg(target.theta_deg)))
        if wanted["z"] < self.config.floor_z_um - READ_BACK_UM:
            text = f"Z {wanted['z']:.1f} um is below the floor at {self.config.floor_z_um:.1f} um"
            advice = "No surface lies so low: check the heights in the configuration."
            raise EnvelopeViolation(text, device=_NAME, advice=advice)
        for name, at in wanted.items():
            self._axes[name].check(at)
        # What was read back at an end of the range may lie a rounded increment outside
        x, y, z, theta = (min(max(wanted[name], low), high) for name, (low, high) in self._ranges.items())
        return Position(x, y, max(z, self.config.floor_z_um), theta)

    # ------------------------------------------------------------------ moves
    async def move_to(
        self,
        target: Position,
        deadline: Deadline,
        *,
        from_above: frozenset[str] = frozenset(),
        slow_z_um: float | None = None,
        clear: ClearHeight | None = None,
        approach: Approach | None = None,
    ) -> Position:
        """Move to an absolute place and give where the drives report to be.

        X, Y and theta come to it from below, from as far as `approach` says (None: the configuration); those in
        `from_above` from above, to measure backlash. Z goes down slowly below `slow_z_um`: the highest that the surface
        can be there, None where only the configuration says it. `clear` is asked once how low the way across may be;
        None: it goes at the safe height.

        Raises EnvelopeViolation, NotHomed or EmergencyStop before anything moves, MotionTimeout at the deadline, and
        what the axes raise. Cancellation stops all axes first.
        """
        place = self.check(target)
        async with self._motion():
            last_s = time.monotonic() - FRESH_S
            missing = await self._not_homed(deadline, last_s)
            if missing:
                raise NotHomed(f"no reference on {', '.join(missing)}", device=_NAME)
            now = await self.position(deadline, last_s)
            legs = plan(now, place, self.config, self._ends, from_above, slow_z_um, clear, approach)
            course = await self._run(legs, deadline)
            reached = await self.position(deadline, course.leg_begun_s)
            self._check_arrival(place, reached)
            self._at_rest_s = max(self._at_rest_s, course.at_rest_s)  # a move without a leg ends where it was
            return reached

    async def home(self, deadline: Deadline) -> None:
        """Find the references: Z first and up to the safe height, then theta, then X and Y."""
        async with self._motion():
            z, safe_um = self._axes["z"], self.config.safe_z_um
            await self._home(("z",), deadline)
            if await z.position(deadline) < safe_um:
                await self._run([Leg({"z": safe_um})], deadline)
            await self._home(("theta",), deadline)
            await self._home(("x", "y"), deadline)

    async def _home(self, names: tuple[str, ...], deadline: Deadline) -> None:
        """Home some axes together; one of the others that fails meanwhile ends it."""
        standing = [axis for name, axis in self._axes.items() if name not in names]
        runs = _HomingRuns()
        try:
            async with asyncio.TaskGroup() as group:
                watch = group.create_task(self._watch(standing, deadline, partial(runs.end_others, "standing")))
                for name in names:
                    run = self._axes[name].home(deadline, partial(runs.end_others, name))
                    runs.tasks[name] = group.create_task(run)
                await asyncio.wait(runs.tasks.values())
                if runs.ended_by is None:
                    watch.cancel()
        except BaseExceptionGroup as failures:
            raise failures.exceptions[0] from failures

    async def _watch(self, standing: Iterable[GantryAxis], deadline: Deadline, stop_others: StopOthers) -> None:
        """Ask axes that stand how they are, one after the other, until cancelled or one raises."""
        while True:
            for axis in standing:
                await asyncio.sleep(LOOK_EVERY_POLLS * axis.config.poll_s)
                await axis.check_standing(deadline, stop_others)

    async def _run(self, legs: Sequence[Leg], deadline: Deadline) -> Course:
        course = Course(self._axes, self._halt)
        await course.run(legs, deadline)
        return course

    def _check_arrival(self, target: Position, reached: Position) -> None:
        """Compare all four axes after the move, also those that came to rest legs ago."""
        wanted, got = _by_axis(target), _by_axis(reached)
        for name, axis in self._axes.items():
            error = got[name] - wanted[name]
            self._off[name] = max(self._off.get(name, 0.0), abs(error))
            if abs(error) > axis.config.window_units + self._slack(name):
                text = f"{name} is at {got[name]:.4f}, {error:+.4f} off its target"
                raise Stalled(text, device=axis.config.name)

    def _slack(self, name: str) -> float:
        """Give how far off an axis may have been without being moved at all."""
        if name == "z":
            return 0.0
        return self.config.same_place_deg if name == "theta" else self.config.same_place_um

    # ------------------------------------------------------------------ stops
    async def quick_stop(self) -> None:
        """Stop all axes on their quick-stop ramps, each whatever the others do; then raise the first failure.

        Gets through while a move is under way, which then ends with EmergencyStop. Finished even if the caller
        is cancelled.
        """
        await finish(self._quick_stop_all())

    async def _quick_stop_all(self) -> None:
        results = await asyncio.gather(*(axis.quick_stop() for axis in self._axes.values()), return_exceptions=True)
        failures = [result for result in results if isinstance(result, BaseException)]
        for failure in failures:
            self._log.error("gantry.quick_stop_failed", cause=str(failure))
        if failures:
            raise failures[0]

    @property
    def unstopped(self) -> tuple[str, ...]:
        """Name the axes that were to be stopped and may still run: the line or the drive did not confirm it."""
        return tuple(name for name, axis in self._axes.items() if axis.unstopped)

    async def stop_again(self) -> None:
        """Halt the axes that may still run after a stop; raises nothing: `unstopped` tells what is left."""
        async with self._stopping:
            await finish(self._halt(self.unstopped))

    async def forget_homing(self, deadline: Deadline, axes: Iterable[str] = AXES) -> None:
        """Make axes need their homing run again; what moves the machine refuses until then.

        Each is read back; the first that does not confirm is raised, and those after it were not asked.
        """
        for name in axes:
            await self._axes[name].forget_homing(deadline)

    async def reset(self, deadline: Deadline) -> None:
        """Clear the faults of all drives; raise DriveFault, or EmergencyStop, when a cause is still there.

        Moves nothing.
        """
        for axis in self._axes.values():
            await axis.reset_fault(deadline)

    @asynccontextmanager
    async def _motion(self) -> AsyncIterator[None]:
        if self._moving:
            raise MotionError("a move is under way", device=_NAME, advice="Wait for it, or stop it first.")
        self._moving = True
        try:
            await self.stop_again()
            if self.unstopped:
                text = f"may still run, and could not be stopped: {', '.join(self.unstopped)}"
                raise LinkError(text, device=_NAME)
            for axis in self._axes.values():
                axis.release()
            yield
        except BaseException as exc:
            self._log.warning("gantry.stopping", cause=f"{type(exc).__name__}: {exc}")
            await finish(self._halt(AXES))
            if isinstance(exc, DeadlinePassed):
                raise MotionTimeout("not there by the deadline", device=_NAME) from exc
            raise
        finally:
            self._moving = False

    async def _halt(self, axes: Iterable[str]) -> None:
        await asyncio.gather(*(self._axes[name].halt_if_possible() for name in axes))

    async def _not_homed(self, deadline: Deadline, since_s: float = math.inf) -> list[str]:
        return [name for name, axis in self._axes.items() if not await axis.homed(deadline, since_s)]


class _HomingRuns:
    """Homing runs that go on beside each other: the first failure ends the others, and is the one that is told."""

    def __init__(self) -> None:
        self.tasks: dict[str, asyncio.Task[None]] = {}
        self.ended_by: str | None = None

    async def end_others(self, cause: str) -> None:
        """Cancel the runs beside `cause` and wait until their axes were halted; of two failures the second does not."""
        if self.ended_by not in (None, cause):
            return
        self.ended_by = cause
        others = [task for name, task in self.tasks.items() if name != cause and not task.done()]
        for task in others:
            task.cancel()
        if others:
            await asyncio.wait(others)


def _by_axis(place: Position) -> dict[str, float]:
    return {"x": place.x_um, "y": place.y_um, "z": place.z_um, "theta": place.theta_deg}
