"""The owner of fault, state and lifecycle: what speaks against work, and who may say that it no longer does.

Everybody may latch a fault; it stays until the one who took it for judging clears it. The faults that came first are
kept first. Which axes may not stand where their drives believe is kept apart from the faults, axis by axis: a fault
is cleared by `reset`, a doubt only by a drive that is known to have given up its reference, or by homing.

No I/O: `daemon.app.supervisor` asks the devices, `daemon.jobs.runner` walks the jobs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from daemon.domain.errors import REFERENCE_LOST, Fault, FaultCode
from daemon.domain.states import BUSY, Event, IllegalTransition, Lifecycle, Machine, State

AXES = ("x", "y", "z", "theta")


@dataclass(frozen=True)
class StateChange:
    """One transition, with what it was about."""

    before: State
    event: Event
    after: State
    job: str | None
    fault: Fault | None


class FaultLatch:
    """Fault, state and lifecycle of one daemon. Nothing else writes them."""

    def __init__(self) -> None:
        self._machine = Machine(self._changed)
        self._causes: tuple[Fault, ...] = ()
        self._set_aside: tuple[Fault, ...] = ()
        """What the running job is to cure: it comes back unless the job comes to its end."""
        self._passing: Fault | None = None
        """Why the last job failed, while its end is told: a fault that clears itself."""
        self._doubtful: frozenset[str] = frozenset()
        self._lifecycle = Lifecycle.OPENING
        self._job: tuple[str, str] | None = None
        self._listeners: list[Callable[[StateChange], None]] = []
        self.doubt_changed = asyncio.Event()
        """Set whenever an axis came into doubt; the supervisor waits for it and clears it."""

    # --- asked -----------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What the station works at."""
        return self._machine.state

    @property
    def lifecycle(self) -> Lifecycle:
        """Whether the daemon is up."""
        return self._lifecycle

    @property
    def fault(self) -> Fault | None:
        """The first cause of the present fault; refusals name it."""
        causes = self._causes  # once: a scrape asks from another thread
        return causes[0] if causes else None

    @property
    def causes(self) -> tuple[Fault, ...]:
        """All faults that are latched, the first cause first."""
        return self._causes

    @property
    def doubtful(self) -> frozenset[str]:
        """Axes whose drives may believe a reference that is none."""
        return self._doubtful

    @property
    def running(self) -> tuple[str, str] | None:
        """Operation and id of the job under way."""
        return self._job

    def against(self, op: str) -> Fault | None:
        """Return the first latched fault that speaks against an operation: one that it does not cure."""
        return next((cause for cause in self._causes if op not in cause.kind.cured_by), None)

    def subscribe(self, listener: Callable[[StateChange], None]) -> None:
        """Have every transition told, after it was made."""
        self._listeners.append(listener)

    # --- faults ----------------------------------------------------------------------------------------------

    def latch(self, fault: Fault) -> None:
        """Stay in fault; the first cause is kept, and of one kind the first."""
        self._add(fault)
        self._enter_fault()

    def _add(self, fault: Fault) -> None:
        if fault.kind in REFERENCE_LOST:
            self.doubt(AXES)
        if all(fault.kind is not known.kind for known in self._causes):
            self._causes = (*self._causes, fault)

    def clear(self, taken: Iterable[Fault]) -> None:
        """Clear the faults that were taken for judging, once their causes are known to be gone; later ones stay."""
        judged = {id(fault) for fault in taken}
        self._causes = tuple(cause for cause in self._causes if id(cause) not in judged)
        self._leave_if_clear()

    def replace(self, taken: Iterable[Fault], found: Fault) -> None:
        """Clear the faults that were taken, whose causes are gone, for another that was found instead."""
        judged = {id(fault) for fault in taken}
        if found.kind in REFERENCE_LOST:
            self.doubt(AXES)
        self._causes = (found, *(c for c in self._causes if id(c) not in judged and c.kind is not found.kind))
        self._enter_fault()

    def put_first(self, found: Fault) -> None:
        """Name what was found to speak against work now; what was latched before stays latched behind it."""
        if found.kind in REFERENCE_LOST:
            self.doubt(AXES)
        self._causes = (found, *(cause for cause in self._causes if cause.kind is not found.kind))
        self._enter_fault()

    # --- the axes' reference ---------------------------------------------------------------------------------

    def doubt(self, axes: Iterable[str]) -> None:
        """Hold the reference of some axes for lost, whatever their drives say."""
        self._doubtful |= frozenset(axes)
        self.doubt_changed.set()

    def settle(self, axis: str) -> None:
        """Doubt an axis no longer: its drive is known to have given up its reference, or has found it again."""
        self._doubtful -= {axis}

    # --- jobs ------------------------------------------------------------------------------------------------

    def begin(self, op: str, job_id: str) -> None:
        """Begin a job that nothing speaks against; the faults that it cures are left for as long as it runs."""
        if self.state is State.FAULT and self.against(op) is None and self._causes:
            self._set_aside, self._causes = self._causes, ()
            self._machine.fire(Event.CLEARED)
        self._job = (op, job_id)
        try:
            self._machine.fire(Event.TRIGGER)
        except IllegalTransition:
            self._job = None
            raise

    def fire(self, event: Event) -> State:
        """Take one transition of the running job."""
        return self._machine.fire(event)

    def end(self, event: Event, *found: Fault, passing: Fault | None = None) -> None:
        """Take a job's last transition, with the faults that it leaves latched; another, `passing`, clears itself.

        A job that came to its end has cured what it was to cure, and homing has settled every axis; one that did not
        leaves it. Raises `IllegalTransition` if the job may not end so where it stands; the station is then in fault.
        """
        if event is Event.ON_TARGET:
            self._set_aside = ()
            if self._job is not None and self._job[0] == "home":
                self._doubtful = frozenset()
        for fault in found:
            self._add(fault)
        for cause in self._set_aside:
            self._add(cause)
        self._set_aside = ()
        self._passing = passing
        try:
            if self.state in BUSY:
                self._machine.fire(event)
        except IllegalTransition as exc:
            # Else the station would look busy with nothing running, and no reset would be let in.
            self._add(Fault(FaultCode.INTERNAL, str(exc)))
            raise
        finally:
            if self._causes:
                self._enter_fault()
            self._job = self._passing = None
        self._leave_if_clear()

    def _enter_fault(self) -> None:
        if self.state is not State.FAULT:
            self._machine.fire(Event.FAILED)

    def _leave_if_clear(self) -> None:
        if self.state is State.FAULT and not self._causes and self._lifecycle is not Lifecycle.OPENING:
            self._machine.fire(Event.CLEARED)

    # --- lifecycle -------------------------------------------------------------------------------------------

    def opened(self) -> None:
        """Say that the devices were asked once: without a fault the station is idle from here on."""
        if self._lifecycle is Lifecycle.OPENING:
            self._lifecycle = Lifecycle.READY
        self._leave_if_clear()

    def closing(self) -> None:
        """Say that the daemon was told to end."""
        self._lifecycle = Lifecycle.CLOSING

    def _changed(self, before: State, event: Event, after: State) -> None:
        fault = self.fault or (self._passing if after is State.FAULT else None)
        change = StateChange(before, event, after, self._job[1] if self._job else None, fault)
        for listener in self._listeners:
            listener(change)
