"""The view of `reprobe watch`, put together from a snapshot and the events after it."""

from __future__ import annotations

import io
from collections import deque
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table

from daemon.cli.formatting import as_commands, calibrated, result_of, sentence
from daemon.domain.results import JobResult

RESULTS, SILENT_S, LATE = 8, 3.5, 50
CLOCK = len("23:59:59")
FRAMES, MOST_ALERTS = 4, 4
"""Lines of the two frames; alerts that are spelled out."""
LEAST_RESULTS = 3
"""Lines of results for which alerts go without their cures."""
FRAME = 4
"""Columns of one frame."""
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
    cures: dict[str, str] = field(default_factory=dict)
    """What to do about each alert, by its name."""
    endpoint: str = ""
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
            self.cures = {alert["name"]: alert.get("advice", "") for alert in standing}
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
                self.cures[event["name"]] = str(event.get("advice", ""))
            case "alert":
                self.alerts.pop(event["name"], None)
            case "heartbeat":
                self.state, self.version = event["state"], event["version"]
            case _:
                pass
        # A fault whose cause did not come along, as after a reset that failed, is asked for
        return lost or silent or (self.state == "fault" and self.fault is None)

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

    def render(self, now_s: float, width: int = 80, height: int = 24) -> RenderableType:
        """Draw it for a terminal of so many columns and lines; what is wrong now stands above what was."""
        if self.heard_s is None:
            # Nothing is known: neither that all is well nor that anything is wrong
            return Panel(self._headline(now_s), title="reprobe")
        above, health = [self._wrong_now(now_s, cures=True), self._job()], self._health()
        if FRAMES + LEAST_RESULTS + sum(_height(part, width) for part in (*above, health)) > height:
            above[0] = self._wrong_now(now_s, cures=False)
        taken = FRAMES + sum(_height(part, width) for part in (*above, health))
        room = max(1, height - taken)
        newest = self._newest()
        lines = 0 if newest is None else _height(newest, width - FRAME)
        if lines > room:
            newest, lines = None, 0
        results = self._results(newest, min(RESULTS, max(1, room - lines + (newest is not None))))
        parts = [*above, results, health]
        return Panel(Group(*parts), title=f"reprobe {escape(self.station)}", subtitle=self.version)

    def _wrong_now(self, now_s: float, *, cures: bool) -> str:
        """Return the lines above all others; where there is no worse, the first alert stands in the first of them."""
        headline, alerts = self._headline(now_s), self._alerts(cures=cures)
        is_worst = bool(self.alerts) and self.state != "fault" and "\n" not in headline
        return f"{headline}, {alerts}" if is_worst else f"{headline}\n{alerts}"

    def _headline(self, now_s: float) -> str:
        start = "start it: `systemctl start reprobe`, or name its --endpoint"
        if self.heard_s is None:
            at = f" at {escape(self.endpoint)}" if self.endpoint else ""
            return f"[yellow]no daemon answers{at} yet[/] -> {start}"
        text = f"[bold {COLOUR.get(self.state, 'cyan')}]{self.state}[/]"
        if self.fault:
            cause = f"[red]{self.fault['name']}[/]: {escape(self.fault['message'])}"
            text += f" {cause} -> {escape(as_commands(self.fault['advice']))}"
        elif self.state == "fault":
            text += " [red]of a cause that is being asked for[/]"
        text += f", {self.queued} waiting" if self.queued else ""
        silent_s = now_s - self.heard_s
        if silent_s <= SILENT_S:
            return text
        why = "it has ended or hangs -> see `systemctl status reprobe`"
        return f"[yellow]nothing heard for {silent_s:.0f} s[/]: {why}\n[dim]before that:[/] {text}"

    def _job(self) -> RenderableType:
        if self.running is None:
            return "[dim]no job runs[/]"
        progress = self.running["progress"]
        if not progress:
            return f"running: [bold]{self.running['op']} {escape(self.running['id'])}[/]".strip()
        row = Table.grid(padding=(0, 1), expand=True)
        row.add_column(no_wrap=True)
        row.add_column(ratio=1)
        row.add_column(no_wrap=True)
        row.add_column(no_wrap=True, overflow="ellipsis", max_width=32)
        bar = ProgressBar(total=progress["total"], completed=progress["done"])
        done = f"{progress['done']}/{progress['total']}"
        row.add_row(f"running: [bold]{self.running['op']}[/]", bar, done, escape(progress["doing"]))
        return row

    def _newest(self) -> str | None:
        """Return the newest result in full, with what to do, if it failed."""
        result = self.results[-1] if self.results else None
        if result is None or result.error is None:
            return None
        return f"[dim]{_local(result.finished_at)}[/] {sentence(result)}\n-> {escape(as_commands(result.error.advice))}"

    def _results(self, newest: str | None, most: int) -> RenderableType:
        """Show the last results, the newest first; `newest`: that one spelt out, None: a line as the others."""
        table = Table.grid(padding=(0, 1))
        table.add_column(no_wrap=True, min_width=CLOCK)
        table.add_column(no_wrap=True, overflow="ellipsis")
        for result in list(reversed(self.results))[newest is not None : most]:
            table.add_row(f"[dim]{_local(result.finished_at)}[/]", sentence(result))
        shown = Group(newest, table) if newest is not None else table
        return Panel(shown, title="last results", title_align="left")

    def _alerts(self, *, cures: bool) -> str:
        if not self.alerts:
            # Green is for a station that works
            if self.state == "fault":
                return "[dim]no alerts beside the fault[/]"
            failed = bool(self.results) and not self.results[-1].ok
            return "[dim]no alerts; the last job failed, see below[/]" if failed else "[green]no alerts[/]"
        standing = sorted(self.alerts.items())
        lines = [f"[yellow]alert {escape(name)}[/]: {escape(as_commands(text))}{self._cure(name, wanted=cures)}"
                 for name, text in standing[:MOST_ALERTS]]  # fmt: skip
        if len(standing) > MOST_ALERTS:
            lines.append(f"[yellow]and {len(standing) - MOST_ALERTS} more: `reprobe health`[/]")
        return "\n".join(lines)

    def _cure(self, name: str, *, wanted: bool) -> str:
        cure = self.cures.get(name)
        return f" -> {escape(as_commands(cure))}" if wanted and cure else ""

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
        lines.append(f"calibrated: {calibrated(self.calibration)}")
        if self.missed and self.last_gap:
            lines.append(f"[yellow]{self.missed} events missed, last {self.last_gap[0]}..{self.last_gap[1]}[/]")
        return "\n".join(lines)


def _height(part: RenderableType, width: int) -> int:
    """Return how many lines a part takes inside the frame."""
    return len(Console(width=max(1, width - FRAME), file=io.StringIO()).render_lines(part, pad=False))


def _local(at: str) -> str:
    """Return a time of the wire as the clock on the wall shows it."""
    return datetime.fromisoformat(at).astimezone().strftime("%H:%M:%S")
