"""Context of a running job: request, deadline, time, steps, and how it ended."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, TypeVar

from daemon.config.model import CameraSection, Config, GantrySection, ServoSection
from daemon.domain.board import Board
from daemon.domain.states import Event, State
from daemon.platform.clock import Stopwatch
from daemon.station.kinematics import Geometry
from daemon.station.station import LookResult, Station
from daemon.storage.calibration_store import Calibrations
from daemon.wire.operations.jobs import AnyJob
from drivers.deadline import Deadline
from vision.geometry import PoseMap


@dataclass
class Outcome:
    """How a job that did not fail ended, in the words of `JobResult`."""

    outcome: str
    test_point: str | None = None
    error_before_um: float | None = None
    error_after_um: float | None = None
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass
class StationContext:
    """Station, board and calibrations as procedures use them, the same for all jobs."""

    config: Config
    station: Station
    board: Board
    calibrations: Calibrations
    geometry: Geometry

    @property
    def servo(self) -> ServoSection:
        """When a correction is good, and when it must give up."""
        return self.config.servo

    @property
    def gantry(self) -> GantrySection:
        """Heights, approach and settling of the axes."""
        return self.config.gantry

    @property
    def camera(self) -> CameraSection:
        """The camera on the head."""
        return self.config.camera

    def require_map(self) -> PoseMap:
        """Return the pose map in force; raise `Fault` if there is none, or it is too old or of another height."""
        return self.calibrations.require_map(self.servo.calibration_days, self.gantry.work_z_um)


class JobContext:
    """One job under way: its request, its deadline, its stopwatch, and everything it saw.

    It satisfies `daemon.station.allowance.Clocked`, so the station's methods take the job itself.
    """

    def __init__(
        self,
        request: AnyJob,
        deadline: Deadline,
        fire: Callable[[Event], State],
        keep_step: Callable[[str, dict[str, Any]], Coroutine[Any, Any, None]],
        tell_progress: Callable[[int, int, str], None],
    ) -> None:
        self.request = request
        self.deadline = deadline
        self.watch = Stopwatch()
        self._fire = fire
        self.first_look: LookResult | None = None
        self.last_look: LookResult | None = None
        self.looks = 0
        self.moves = 0
        self.partial = Outcome("failed")
        """What is known even if the job fails half-way."""
        self.progress = tell_progress
        """Called with (done, total, what is being done) by jobs that take long."""
        self._keep_step = keep_step
        self._steps: set[asyncio.Task[None]] = set()

    @property
    def activity(self) -> tuple[int, int, int]:
        """What changes when the job looks, moves or waits for something."""
        return self.looks, self.moves, self.watch.bookings

    def fire(self, event: Event) -> None:
        """Take one transition; from here on time is booked under the new state."""
        self.watch.enter(self._fire(event).value)

    def saw(self, look: LookResult) -> None:
        """Count a look; of its frames only the first and the last stay in memory, for a frame is 6 MB."""
        self.looks += 1
        self.first_look = self.first_look or look
        self.last_look = look

    def note(self, kind: str, body: dict[str, Any]) -> None:
        """Write a look or a move into the journal without waiting for the disk; `settle` waits."""
        self._steps.add(asyncio.create_task(self._keep_step(kind, body)))

    async def settle(self) -> None:
        """Wait until all notes are on disk, or could not be written; the first failure is raised."""
        steps, self._steps = self._steps, set()
        ends = await asyncio.gather(*steps, return_exceptions=True)
        failed = next((end for end in ends if isinstance(end, Exception)), None)
        if failed is not None:
            raise failed


RequestT = TypeVar("RequestT", bound=AnyJob)
Procedure = Callable[[JobContext, StationContext], Awaitable[Outcome]]
"""A job's body. It fires every event but the last `on_target`, and returns how it ended."""
ProcedureFor = Callable[[JobContext, StationContext, RequestT], Awaitable[Outcome]]
"""The same for one kind of request, which it is handed: `ProcedureFor[Correct]`."""
