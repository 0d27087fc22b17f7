"""The view of `reprobe watch`, put together from a snapshot and the events after it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table

from daemon.cli.formatting import result_of, sentence
from daemon.domain.results import JobResult

RESULTS, SILENT_S, LATE = 8, 3.5, 50
COLOUR = {"idle": "green", "fault": "red"}


@dataclass
class WatchView:
    """The daemon as far as is known here. Times are monotonic seconds."""

    station: str = "?"
    state: str = "?"
    fault: dict[str, Any] | None = None
    running: dict[str, Any] | None = None
    queued: int = 0
    calibration: dict[str, Any] = field(default_factory=dict)
    links: dict[str, Any] = field(default_factory=dict)
    alerts: dict[str, str] = field(default_factory=dict)
    results: deque[JobResult] = field(default_factory=lambda: deque(maxlen=RESULTS))
    version: str = ""
    next_seq: int | None = None
    missed: int = 0
    """Events that were published and did not get here."""
    missing: set[int] = field(default_factory=set)
    """Numbers of the latest of them; they may still come."""
    last_gap: tuple[int, int] | None = None
    """First and last number of the latest of them."""
    heard_s: float | None = None
    restarts: int = 0

    def take_snapshot(self, snapshot: dict[str, Any], now_s: float) -> None:
        """Start over from a snapshot of the daemon."""
        self.station, self.state, self.fault = snapshot["station"], snapshot["state"], snapshot["fault"]
        self.running, self.queued = snapshot["running"], snapshot["queued"]
        self.calibration, self.links = snapshot["calibration"], snapshot.get("links", {})
        self.version = snapshot.get("version", self.version)
        standing = snapshot.get("alerts")
        if standing is not None:
            self.alerts = {alert["name"]: alert["message"] for alert in standing}
        if self.next_seq is None:
            self.next_seq = snapshot["next_seq"]
        if snapshot["last_result"]:
            self.take_result(JobResult.model_validate(snapshot["last_result"]))
        self.heard_s = now_s

    def take_result(self, result: JobResult) -> None:
        """Put a result among the last ones, once, in its place."""
        known = {r.seq: r for r in self.results} | {result.seq: result}
        self.results = deque((known[seq] for seq in sorted(known)), maxlen=RESULTS)

    def take(self, event: dict[str, Any], now_s: float) -> bool:
        """Take one event; return True if something was missed and a snapshot is to be asked for."""
        silent = self.heard_s is None or now_s - self.heard_s > SILENT_S
        if not silent and self._is_old(event["seq"]):
            return False
        lost = self._count(event["seq"])
        self.restarts += silent and self.heard_s is not None
        self.heard_s = now_s
        match event["topic"]:
            case "state":
                self._take_state(event)
            case "result":
                self.take_result(result_of(event))
                self.running = None
            case "progress":
                progress = {name: event[name] for name in ("done", "total", "doing")}
                self.running = {"id": event["job"], "op": event["op"], "progress": progress}
            case "alert" if event.get("raised"):
                self.alerts[event["name"]] = str(event.get("message", ""))
            case "alert":
                self.alerts.pop(event["name"], None)
            case "heartbeat":
                self.state, self.version = event["state"], event["version"]
            case _:
                pass
        return lost or silent

    def _take_state(self, event: dict[str, Any]) -> None:
        self.state, self.fault = event["state"], event["fault"]
        if event["job"] is None:
            self.running = None
        elif self.running is None or self.running["id"] != event["job"]:
            self.running = {"id": event["job"], "op": "", "progress": None}

    def _is_old(self, seq: int) -> bool:
        """Tell whether an event was on its way when the snapshot was made, which has it."""
        return self.next_seq is not None and seq < self.next_seq and seq not in self.missing

    def _count(self, seq: int) -> bool:
        """Keep account of the numbers: every event has the next one, or one that was passed by shortly before.

        A result's number is taken before it is written down, so another event may overtake it.
        """
        if seq in self.missing:
            self.missing.discard(seq)
            self.missed -= 1
            return False
        expected, self.next_seq = self.next_seq, seq + 1
        if expected is None or seq == expected:
            return False
        if seq > expected:
            self.missed += seq - expected
            self.last_gap = expected, seq - 1
            self.missing = set(range(max(expected, seq - LATE), seq))
        else:
            self.missing = set()  # a smaller number after a silence: another journal
        return True

    # --- showing ---------------------------------------------------------------------------------------------

    def render(self, now_s: float) -> RenderableType:
        """Draw it."""
        parts = [self._headline(now_s), self._job(), self._results(), self._alerts(), self._health()]
        return Panel(Group(*parts), title=f"reprobe {escape(self.station)}", subtitle=self.version)

    def _headline(self, now_s: float) -> str:
        if self.heard_s is None:
            return "[yellow]no daemon answers yet[/]"
        text = f"[bold {COLOUR.get(self.state, 'cyan')}]{self.state}[/], {self.queued} waiting"
        if self.fault:
            text += (
                f"\n[red]{self.fault['name']}[/]: {escape(self.fault['message'])}\n-> {escape(self.fault['advice'])}"
            )
        silent_s = now_s - self.heard_s
        return text if silent_s <= SILENT_S else f"{text}\n[yellow]nothing heard for {silent_s:.0f} s[/]"

    def _job(self) -> RenderableType:
        if self.running is None:
            return "[dim]no job runs[/]"
        name = f"{self.running['op']} {escape(self.running['id'])}".strip()
        progress = self.running["progress"]
        if not progress:
            return f"running: [bold]{name}[/]"
        row = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=progress["total"], completed=progress["done"], width=40)
        row.add_row(f"running: [bold]{name}[/]", bar, f"{progress['done']}/{progress['total']}", progress["doing"])
        return row

    def _results(self) -> RenderableType:
        table = Table.grid(padding=(0, 1))
        for result in reversed(self.results):
            table.add_row(f"[dim]{result.finished_at[11:19]}[/]", sentence(result))
        return Panel(table, title="last results", title_align="left")

    def _alerts(self) -> str:
        if not self.alerts:
            return "[green]no alerts[/]"
        return "\n".join(f"[yellow]alert {escape(n)}[/]: {escape(text)}" for n, text in sorted(self.alerts.items()))

    def _health(self) -> str:
        lines = [
            f"bus {escape(name)}: {'connected' if bus['connected'] else '[red]lost[/]'}, {bus['requests']} requests,"
            f" {bus['timeouts']} timed out, {bus['garbled']} garbled, {bus['reconnects']} reconnects"
            for name, bus in self.links.get("buses", {}).items()
        ]
        if camera := self.links.get("camera"):
            trouble = (
                f"{camera['missed']} missed, {camera['timeouts']} time-outs, {camera['reopened']} times opened again"
            )
            lines.append(f"camera: {camera['grabbed']} frames, {trouble}")
        made = self.calibration.get("made_at", {})
        ages = ", ".join(f"{what} {_age(at)}" for what, at in made.items())
        lines.append(f"calibrated: {ages or 'nothing'}")
        if self.missed and self.last_gap:
            lines.append(f"[yellow]{self.missed} events missed, last {self.last_gap[0]}..{self.last_gap[1]}[/]")
        return "\n".join(lines)


def _age(made_at: str) -> str:
    """Return how long ago something was made."""
    hours = (datetime.now(UTC) - datetime.fromisoformat(made_at)).total_seconds() / 3600
    return f"{hours:.1f} h ago" if hours < 48 else f"{hours / 24:.0f} days ago"
