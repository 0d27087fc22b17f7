"""The status line: what the daemon does, what keeps it, and how the last job ended."""

from __future__ import annotations

from typing import Any

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import ErrorBody, JobResult
from daemon.domain.states import Event
from daemon.jobs.fault_latch import FaultLatch
from daemon.platform.clock import utc_now
from daemon.platform.systemd_notify import Notifier
from daemon.telemetry.status_line import StatusLine


class Heard(Notifier):
    """A service manager that writes down what it hears."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def ready(self, status: str) -> None:
        self.lines.append(f"READY {status}")

    def status(self, status: str) -> None:
        self.lines.append(status)


def _idle() -> FaultLatch:
    latch = FaultLatch()
    latch.opened()
    return latch


def _result(**fields: Any) -> JobResult:
    facts: dict[str, Any] = {"id": "a", "op": "correct", "ok": True, "seq": 1, "station": "s", "outcome": "corrected"}
    return JobResult(finished_at=utc_now(), **{**facts, **fields})


def test_nothing_is_told_before_the_start_is_over() -> None:
    manager = Heard()
    latch = FaultLatch()
    latch.latch(Fault(FaultCode.NOT_HOMED))
    standing = StatusLine(latch, manager)
    standing.refresh()
    standing.on_result(_result(test_point="TP7", error_after_um=12.4))
    assert manager.lines == []
    standing.ready(_result(op="home", outcome="homed"))
    (line,) = manager.lines
    assert line.startswith("READY fault: not_homed, ")
    assert "send `home`" in line
    assert line.endswith("last: correct TP7 corrected, 12 um"), "what happened since is newer than the journal"


def test_a_running_job_and_a_note_are_told_beside_the_last_result() -> None:
    manager = Heard()
    latch = _idle()
    latch.begin("correct", "b17")
    latch.fire(Event.DEPARTED)
    standing = StatusLine(latch, manager)
    failed = _result(ok=False, outcome="failed", test_point="TP3", error=ErrorBody.of(Fault(FaultCode.TIP_NOT_FOUND)))
    standing.ready(failed)
    standing.note("a note")
    assert manager.lines[-1] == "move (correct b17); last: correct TP3 failed, tip_not_found; a note"
    latch.end(Event.CANCELLED)
    standing.note("")
    assert manager.lines[-1] == "idle; last: correct TP3 failed, tip_not_found"


def test_a_daemon_that_never_did_anything_says_only_its_state() -> None:
    manager = Heard()
    StatusLine(_idle(), manager).ready(None)
    assert manager.lines == ["READY idle"]
