"""Context of a running job: request, deadline, time, steps, and how it ended."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, TypeVar

from daemon.config.model import Config
from daemon.config.sections.devices import CameraSection
from daemon.config.sections.motion import GantrySection, ServoSection
from daemon.domain.board import Board
from daemon.domain.board_run import BoardRun, RunState, RunSummary
from daemon.domain.contact import ContactFacts
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PadWear, PointRecord
from daemon.domain.results import StepKind
from daemon.domain.states import Event, State
from daemon.jobs.held_touch import HeldTouch
from daemon.platform.clock import Stopwatch
from daemon.station.board_references import BoardReferences
from daemon.station.clearance import Clearance
from daemon.station.kinematics import Geometry
from daemon.station.station import LookResult, Station
from daemon.station.wide_view import WideView
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
    beside_um: float | None = None
    """So far beside the tip a look has seen the point, where that is too far to touch it from there."""


@dataclass
class StationContext:
    """Station, board and calibrations as procedures use them, the same for all jobs."""

    config: Config
    station: Station
    board: Board
    calibrations: Calibrations
    geometry: Geometry
    references: BoardReferences = field(init=False)
    wide_view: WideView = field(default_factory=WideView)

    def __post_init__(self) -> None:
        """Keep what is drawn of this board."""
        self.references = BoardReferences(self.board)

    @cached_property
    def clearance(self) -> Clearance:
        """Who knows how low the head may go sideways over this board."""
        return Clearance(self.config, self.board, self.calibrations, self.geometry, self.station.needle.board)

    @property
    def by_cad(self) -> bool:
        """Whether the board file has the layers by which a look is registered."""
        return self.board.layers is not None

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


class MarkOf(Protocol):
    """Who knows what people said of points; the journal does."""

    def __call__(self, board: str, side: str, point: str, /) -> Awaitable[PointMark | None]:
        """Return what a person said of a point of a board, whether the needle may touch it; None: nothing."""


async def nothing_said(_board: str, _side: str, _point: str) -> PointMark | None:
    """Answer where nobody ever said anything of a point."""
    return None


class TouchBook(Protocol):
    """Where touches are written down; the journal is one."""

    async def touches_of(self, board_id: str | None, point: str, since: str) -> int:
        """Return how often a pad was touched: of a named board in its life, and by any name since a time.

        `since`: UTC, ISO 8601; "" for ever.
        """

    async def wear_of(self, board_id: str | None, point: str, since: str, visit: str) -> PadWear:
        """Return how often a pad was touched and pressed, in all as `touches_of` counts, and in one visit."""

    async def mark_of(self, board: str, side: str, point: str) -> PointMark | None:
        """Return what a person said of a point of a board, whether the needle may touch it; None: nothing."""

    async def begin_touch(
        self, job_id: str, board_id: str | None, point: str, *, visit: str | None = None, rung: str | None = None
    ) -> int:
        """Write a touch down before the needle goes down; return its number."""

    async def tell_touch(self, number: int, facts: Mapping[str, Any]) -> None:
        """Write down what came of it, by the names of the table's columns."""

    async def add_point(self, job_id: str, record: PointRecord) -> int:
        """Write down what came of a point's test; return the row's number."""


class RunBook(Protocol):
    """Where runs over boards are written down; the journal's `runs` are one."""

    async def unfinished(self, board_id: str) -> BoardRun | None:
        """Return the run of a board that is not finished."""

    async def begin(self, run: BoardRun) -> None:
        """Write a run down before its first touch."""

    async def go_on(self, run: BoardRun, job_id: str) -> None:
        """Write down that another job works on a run."""

    async def tell(self, run_id: str, state: RunState, summary: RunSummary | None, stopped_by: str = "") -> None:
        """Write down how a run stands when a job is over with it."""

    async def records_of(self, run_id: str) -> list[PointRecord]:
        """Return the records of a run's points in the order in which they were tested."""


PointLooks = tuple[LookResult | None, LookResult | None]
"""The first look of a point, and its last where there was more than one."""
KeptPoint = tuple[PointRecord, Coroutine[Any, Any, None] | None]
"""A record that names the folder of its pictures, and what writes them; None where none are kept."""


@dataclass(frozen=True)
class Touching:
    """What a job that touches has beside other jobs: its hold, who asked for it, and where touches are kept."""

    held: HeldTouch
    key: str
    """Name of the client's key; empty where nobody comes with one."""
    book: TouchBook
    made: Callable[[ContactFacts], None]
    """Called when the needle stands."""
    lifted: Callable[[ContactFacts], None] = lambda _contact: None
    """Called when it was lifted before the job's end."""
    keep: Callable[[PointRecord, PointLooks], KeptPoint] = lambda record, _looks: (record, None)
    """Name the folder of a point's pictures in its record, and return what writes them; None where none are kept."""
    tell: Callable[[PointRecord], None] = lambda _record: None
    """Called with what came of a point, once that is written down."""
    runs: RunBook | None = None
    """Where runs are kept."""


class JobContext:
    """One job under way: its request, its deadline, its stopwatch, and everything it saw.

    It satisfies `daemon.station.allowance.Clocked`, so the station's methods take the job itself.
    """

    def __init__(
        self,
        request: AnyJob,
        deadline: Deadline,
        fire: Callable[[Event], State],
        keep_step: Callable[[StepKind, dict[str, Any]], Coroutine[Any, Any, None]],
        tell_progress: Callable[[int, int, str], None],
        touching: Touching | None = None,
        *,
        mark_of: MarkOf = nothing_said,
    ) -> None:
        self.request = request
        self.mark_of = mark_of
        self.deadline = deadline
        self.watch = Stopwatch()
        self._fire, self._fired = fire, 0
        self.pausing = False
        """Whether a person wants a run to end after the point under test."""
        self.first_look: LookResult | None = None
        self.last_look: LookResult | None = None
        self._last_pictured: LookResult | None = None
        self.looks = 0
        self.moves = 0
        self.lifts = 0
        """Of the moves those straight up and down that only asked whether the pin is free."""
        self.partial = Outcome("failed")
        """What is known even if the job fails half-way."""
        self.progress = tell_progress
        """Called with (done, total, what is being done) by jobs that take long."""
        self._touching = touching
        self._keep_step = keep_step
        self._steps: set[asyncio.Task[None]] = set()

    @property
    def touching(self) -> Touching:
        """What a job that touches has; TypeError for any other."""
        if self._touching is None:
            raise TypeError(f"{self.request.op} touches nothing")
        return self._touching

    @property
    def activity(self) -> tuple[int, int, int]:
        """What changes when the job looks, moves or waits for something."""
        return self.looks, self.moves, self.watch.bookings

    @property
    def triggered(self) -> bool:
        """Whether it was not accepted yet."""
        return self._fired == 0

    def fire(self, event: Event) -> None:
        """Take one transition; from here on time is booked under the new state."""
        self.watch.enter(self._fire(event).value)
        self._fired += 1

    @property
    def steps(self) -> int:
        """How many moves were more than a question of whether the pin is free."""
        return self.moves - self.lifts

    def saw(self, look: LookResult) -> None:
        """Count a look; only the frames that may be wanted again stay in memory, for a frame is 6 MB."""
        self.looks += 1
        self.first_look = self.first_look or look
        self.last_look = look
        before = self._last_pictured
        if before is None or before.says_only_where_the_tip_is or not look.says_only_where_the_tip_is:
            self._last_pictured = look

    def aimed(self, look: LookResult) -> None:
        """Take over the last look once it is known where the needle would come down by it."""
        if self.first_look is self.last_look:
            self.first_look = look
        self.last_look = self._last_pictured = look

    def pictured(self, *, failed: bool = False) -> PointLooks:
        """Return the looks of which pictures are kept: the first, and the last where it is another.

        One that only saw the tip once more, before a touch, says less than the look for the pad before it; but of a
        job that failed the very last look is the evidence.
        """
        last = self.last_look if failed else self._last_pictured
        return self.first_look, last if last is not self.first_look else None

    @contextmanager
    def looks_elsewhere(self) -> Iterator[None]:
        """Forget in the end what is seen inside: looks of something else than what the job is about."""
        kept = self.first_look, self.last_look, self._last_pictured
        try:
            yield
        finally:
            self.first_look, self.last_look, self._last_pictured = kept

    def forget_looks(self) -> None:
        """Let the next look be the first: what was seen before is of another point."""
        self.first_look = self.last_look = self._last_pictured = None

    def note(self, kind: StepKind, body: dict[str, Any]) -> None:
        """Write a look or a move into the journal without waiting for the disk; `settle` waits."""
        self.later(self._keep_step(kind, body))

    def later(self, write: Coroutine[Any, Any, None]) -> None:
        """Write anything into the journal without waiting for the disk, in the order of the calls; `settle` waits."""
        self._steps.add(asyncio.create_task(write))

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
