"""The status line of `systemctl status`: state, fault, last result, configuration."""

from __future__ import annotations

from daemon.domain.errors import Fault
from daemon.domain.results import JobResult
from daemon.domain.states import BUSY
from daemon.jobs.fault_latch import FaultLatch
from daemon.platform.systemd_notify import Notifier


class StatusLine:
    """Keep the service manager told."""

    def __init__(self, latch: FaultLatch, notifier: Notifier) -> None:
        self._latch, self._notifier = latch, notifier
        self._last: JobResult | None = None
        self._note = self._without = ""
        self._up = False

    def ready(self, last: JobResult | None) -> None:
        """Say that the daemon is in a known state; `last` is the result of the journal's last job."""
        self._last = self._last or last
        self._up = True
        self._notifier.ready(self.line())

    def on_result(self, result: JobResult) -> None:
        """Take a job's result."""
        self._last = result
        self.refresh()

    def note(self, text: str) -> None:
        """Keep saying something beside the state, until something else is to be said; an empty text ends it."""
        self._note = text
        self.refresh()

    def without(self, what: str | None) -> None:
        """Keep saying what the daemon works without; None: nothing is missing."""
        self._without = f"not served: {what}" if what else ""
        self.refresh()

    def refresh(self) -> None:
        """Tell the line as it is now, once the start is over."""
        if self._up:
            self._notifier.status(self.line())

    def line(self) -> str:
        """Return the line."""
        state, fault, running = self._latch.state, self._latch.fault, self._latch.running
        now = state.value
        if running is not None and state in BUSY:
            now = f"{state.value} ({' '.join(running)})"
        elif fault is not None:
            now = f"{state.value}: {fault.kind.wire_name}, {_brief(fault)}"
        parts = [now, f"last: {_of(self._last)}" if self._last is not None else "", self._note, self._without]
        return "; ".join(part for part in parts if part)


def _brief(fault: Fault) -> str:
    return f"{fault.message[:120]} ({fault.advice[:120]})"


def _of(result: JobResult) -> str:
    """Return a result in a few words."""
    where = f" {result.test_point}" if result.test_point else ""
    if result.error is not None:
        return f"{result.op}{where} failed, {result.error.name}"
    error = f", {result.error_after_um:.0f} um" if result.error_after_um is not None else ""
    return f"{result.op}{where} {result.outcome}{error}"
