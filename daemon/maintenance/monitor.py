"""Monitor of maintenance: takes in what happened, judges it after the job was answered, publishes what is new.

Handing something in never waits: it goes into a queue. One task empties it: pictures are measured in a worker
thread, numbers are written to the journal, the panel is fed, and what changed is published and kept. What was learned
is kept too; at the start, rows written after that are fed again, so that a kill costs no more than touches that were
reported since the last row. Whatever is damaged of what was kept is left out: a memory must not stop a station.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import structlog

from daemon.config.current import CurrentSettings
from daemon.config.model import Config
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointRecord
from daemon.domain.results import JobResult, StepKind
from daemon.jobs.context import JobContext
from daemon.jobs.observer import JobObserver, Publisher
from daemon.maintenance.alerts import ActiveAlerts, Alert, AlertNews
from daemon.maintenance.calibration_signals import Learned
from daemon.maintenance.catalogue import chosen
from daemon.maintenance.contact_signals import Contacts
from daemon.maintenance.device_signals import Devices
from daemon.maintenance.image_metrics import measure_pictures
from daemon.maintenance.overview import is_flag, overview
from daemon.maintenance.panel import Panel, Row
from daemon.maintenance.repeated_failures import IN_A_ROW, WINDOW, RepeatedFailures
from daemon.maintenance.signals import Landings, Numbers, Step, of_ending, of_looks
from daemon.maintenance.types import Finding
from daemon.platform.clock import clock_behind, utc_now
from daemon.station.devices import Hardware
from daemon.station.station import LookResult
from daemon.storage.calibration_store import Calibrations
from daemon.storage.journal import Journal, PastWanted
from vision import Tip

QUEUE = 256
STEPS_KEPT = 64
REPLAY = 1000
STATE = "maintenance"
SAVE_EVERY_ROWS = 50
REPEATED = "repeated_failures"
ENDINGS_READ = 10 * WINDOW
"""Results that are read at the start, of all operations together."""
TOUCHES_A_ROW = 20
"""A tester that reports each touch by itself must not fill the journal with rows of one."""
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class _Ended:
    """A job that was answered: its result, its steps, and the look whose pictures may be measured."""

    result: JobResult
    steps: tuple[Step, ...]
    look: LookResult | None


@dataclass(frozen=True)
class _Reported:
    touches: int
    by_tester: bool = True


@dataclass(frozen=True)
class _Tested:
    record: PointRecord


@dataclass(frozen=True)
class _Flagged:
    name: str
    message: str | None


class Monitor(JobObserver):
    """Maintenance of one running daemon."""

    def __init__(
        self,
        settings: CurrentSettings,
        calibrations: Calibrations,
        hardware: Callable[[], Hardware | None],
        journal: Journal,
        publisher: Publisher,
    ) -> None:
        """Take the settings and calibrations in force, and what gives the open devices, None while there are none."""
        self._settings, self._calibrations, self._hardware = settings, calibrations, hardware
        self._journal, self._publisher = journal, publisher
        self._panel = _panel(settings.config)
        self.alerts = ActiveAlerts()
        self._landings = Landings(settings.config.head.phase_deg)
        self._learned = Learned(calibrations)
        self._devices = Devices()
        self._contacts = Contacts()
        self._failures = RepeatedFailures()
        self._failing: str | None = None
        """What was told of them last."""
        self._queue: asyncio.Queue[_Ended | _Reported | _Tested | _Flagged] = asyncio.Queue(QUEUE)
        self._steps: dict[str, list[Step]] = {}
        self._touches = 0
        self._corrections = self._reported = 0
        self._row = 0
        self._unsaved = 0
        self._loaded = False
        self._turn = asyncio.Lock()
        """Held while alerts are compared with findings: nobody clears one between."""

    # --- handed in (never waits) ------------------------------------------------------------------------------

    def on_step(self, job_id: str, kind: StepKind, body: Mapping[str, Any]) -> None:
        """Remember a step until its job ends."""
        self._contacts.add_step(body)
        if job_id not in self._steps:
            self._steps = {job_id: []}  # one job runs at a time: what another left behind is over
        if len(self._steps[job_id]) < STEPS_KEPT:
            self._steps[job_id].append((kind, body))

    def on_result(self, job: JobContext, result: JobResult) -> None:
        """Take an answered job in."""
        steps = tuple(self._steps.pop(result.id, ()))
        if result.op == "correct" and result.looks:
            # Pictures are large: those of a job that has to wait for its turn are not measured.
            look = job.last_look if self._queue.empty() else None
            self._hand_in(_Ended(result, steps, look))
        self._failures.add(result)
        self._tell_failures()

    def _tell_failures(self) -> None:
        """Say that an operation fails again and again, or that it no longer does."""
        if (message := self._failures.message) != self._failing:
            self._failing = message
            self.on_flag(REPEATED, message)

    def on_point(self, record: PointRecord) -> None:
        """Take in what came of a point."""
        self._hand_in(_Tested(record))
        self._failures.add_point(record)
        self._tell_failures()

    def on_touches(self, touches: int) -> None:
        """Take touches in."""
        if touches:
            self._hand_in(_Reported(touches))

    def on_own_touch(self) -> None:
        """Take in a touch of the daemon's own: it wears the probe, and is none that could have missed for a tester."""
        self._hand_in(_Reported(1, by_tester=False))

    def on_flag(self, name: str, message: str | None) -> None:
        """Take the daemon's own trouble in."""
        self._hand_in(_Flagged(name, message))

    def _hand_in(self, item: _Ended | _Reported | _Tested | _Flagged) -> None:
        try:
            self._queue.put_nowait(item)
        except asyncio.QueueFull:
            log.warning("maintenance_behind", lost=type(item).__name__)

    # --- running ----------------------------------------------------------------------------------------------

    async def load(self) -> None:
        """Take over what was learned, feed again what was measured since, and remember the alerts that stand.

        Raises `Fault` if the journal cannot be read; until it was, nothing is kept that would replace what it has.
        """
        if self._loaded:
            return
        self._touches = await self._journal.touches()
        for body in await self._journal.standing():
            try:
                alert = Alert.from_dict(body)
            except (TypeError, KeyError):
                log.warning("alert_not_understood", alert=str(body.get("name")))
                continue
            self.alerts.standing[alert.name] = alert
        kept = await self._journal.kept(STATE)
        if kept is not None:
            damaged = self._panel.restore(kept.get("panel", {}))
            self._row, self._corrections, self._reported = (
                _number(kept, key) for key in ("row", "corrections", "reported")
            )
            self._learned.restore(kept.get("probe"))
            if damaged:
                log.warning("maintenance_begins_anew", watches=damaged)
        while rows := await self._journal.measurements(self._row, REPLAY):
            await asyncio.to_thread(import_module, "scipy.special")  # slow to load, and judging needs it
            for n, at, touches, job, body in rows:
                self._feed_again(at, touches, job, body)
                self._row = n
            await asyncio.sleep(0)
        await self._recall_failures()
        self._loaded = True
        if self._journal.moved_to is not None:
            self.on_flag("journal_moved_aside", f"{self._journal.moved_because}; it lies at {self._journal.moved_to}")
        last = await self._journal.last_result()
        self.on_flag("clock_behind", clock_behind(utc_now(), last.finished_at if last is not None else ""))

    async def _recall_failures(self) -> None:
        """Take in how the last jobs and points ended, and bring what stands about them up to date, or take it away."""
        for result, _board in reversed(await self._journal.history(PastWanted(), None, ENDINGS_READ)):
            self._failures.add(result)
        for record in await self._journal.last_points(IN_A_ROW):
            self._failures.add_point(record)
        self._failing = "" if REPEATED in self.alerts.standing else None
        self._tell_failures()

    def _feed_again(self, at: str, touches: int, job: str, body: dict[str, Any]) -> None:
        """Feed a row that was measured after what was learned had been kept."""
        try:
            row = Row.from_dict(at, touches, job, body)
            self._panel.take(row)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError):
            log.warning("measurement_not_understood", at=at, job=job)
            return
        self._corrections += bool(job)
        if "correction_share" in row.numbers:
            self._corrections = self._reported = 0

    def adopt(self) -> None:
        """Take over another configuration; what was learned stays."""
        learned = self._panel.to_dict()
        self._panel = _panel(self._settings.config)
        self._panel.restore(learned)

    async def run(self) -> None:
        """Judge until cancelled; nothing that goes wrong here ends the daemon."""
        while True:
            item: _Ended | _Reported | _Tested | _Flagged | None = None
            try:
                async with asyncio.timeout(self._settings.config.maintenance.check_s):
                    item = await self._queue.get()
            except TimeoutError:
                pass  # nothing happened for a while: look at devices and calibrations by themselves
            try:
                await self._take(item)
            except Fault as exc:
                log.warning("maintenance_not_kept", error=exc.message)
            except Exception:  # what watches the station must not be what stops it
                log.exception("maintenance_failed")
            finally:
                if item is not None:
                    self._queue.task_done()

    async def _take(self, item: _Ended | _Reported | _Tested | _Flagged | None) -> None:
        match item:
            case _Flagged():
                async with self._turn:
                    await self._flag(item)
            case _Reported():
                self._touches += item.touches
                self._reported += item.touches if item.by_tester else 0
                if self._reported >= TOUCHES_A_ROW:
                    await self._judge("", self._share(), devices=False)
            case _Tested():
                self._contacts.add(item.record)
                if self._contacts.is_due:
                    await self._judge("", self._contacts.take(), devices=False)
            case _Ended():
                self._corrections += 1
                await self._judge(item.result.id, await self._numbers(item), devices=True)
            case None:
                numbers = self._contacts.take() | (self._share() if self._reported else {})
                await self._judge("", numbers, devices=True)
                await self.save()

    def _share(self) -> Numbers:
        """Return corrections among the touches reported since this was last asked.

        A touch is corrected once: what is beyond belongs to touches that nobody reported.
        """
        numbers: Numbers = {"correction_share": [float(min(self._corrections, self._reported)), float(self._reported)]}
        self._corrections = self._reported = 0
        return numbers

    async def _numbers(self, item: _Ended) -> Numbers:
        """Return what a correction says."""
        numbers = of_ending(item.result)
        if self._learned.changed_since_asked():
            self._landings.restart()
        numbers |= self._landings.numbers(item.result, item.steps)
        model = self._calibrations.probe
        if model is not None:
            numbers |= of_looks(item.steps, model.tip_px)
            look = item.look
            if look is not None and isinstance(look.tip, Tip):
                red = look.red.pixels if look.red is not None else None
                seen = await asyncio.to_thread(measure_pictures, look.white.pixels, red, look.tip, model)
                numbers |= {name: [value] for name, value in seen.items()}
        return numbers

    async def _judge(self, job: str, numbers: Numbers, *, devices: bool) -> None:
        """Write one row down, feed it, and tell what it changed."""
        words: dict[str, str] = {}
        config = self._settings.config
        if devices:
            hardware = self._hardware()
            if hardware is not None:
                more, words = self._devices.read(hardware)
                numbers = {**numbers, **more}
            await asyncio.to_thread(self._learned.read_history)
            numbers |= self._learned.numbers(
                self._touches, config.servo.calibration_days, config.maintenance.probe_life_touches
            )
        row = Row(utc_now(), self._touches, job, numbers, self._learned.bases(), words)
        number = self._row
        try:  # first written, then fed: what is cut off between is fed at the next start, and nothing twice
            number = await self._journal.add_measurement(row.at, row.touches, row.job, row.to_dict())
        except Fault as exc:
            log.warning("measurement_not_kept", error=exc.message)
        async with self._turn:
            self._panel.take(row)
            self._row = number
            await self._tell_news()
        self._unsaved += 1
        if self._unsaved >= SAVE_EVERY_ROWS:
            await self.save()

    async def save(self) -> None:
        """Keep what was learned, and hold the journal to its bounds: a busy station never rests."""
        self._unsaved = 0
        await self.load()
        await self._journal.keep(
            STATE,
            {"row": self._row, "corrections": self._corrections, "reported": self._reported,
             "probe": self._learned.to_dict(), "panel": self._panel.to_dict()},
        )  # fmt: skip
        await self._journal.trim(self._settings.config.maintenance.keep_rows)

    async def close(self) -> None:
        """Take in what still waits, without its pictures, and keep what was learned.

        What cannot be kept is learned again from the measurements.
        """
        try:
            while not self._queue.empty():
                item = self._queue.get_nowait()
                self._queue.task_done()
                await self._take(replace(item, look=None) if isinstance(item, _Ended) else item)
            if self._contacts.points:
                await self._judge("", self._contacts.take(), devices=False)
            await self.save()
        except Fault as exc:
            log.warning("maintenance_not_kept", error=exc.message)

    # --- telling ----------------------------------------------------------------------------------------------

    async def _tell_news(self) -> None:
        """Compare what the panel finds with the alerts that stand."""
        findings, at = self._panel.findings(), utc_now()
        for name, finding in findings.items():
            spec = self._panel.specs[name]
            before = self.alerts.standing.get(name)
            news = self.alerts.find(name, spec.group, spec.what, spec.unit, spec.advice, finding, at)
            after = self.alerts.standing[name]
            if after is not before:
                await self._publish(news, after)
        for name in list(self.alerts.standing):
            switched_off = name not in self._panel.specs
            if switched_off or (name not in findings and not is_flag(self._panel, name)):
                await self._publish(self.alerts.clear(name, at), None)

    async def _flag(self, item: _Flagged) -> None:
        """Raise or clear an alert that is a fact, not a figure."""
        at = utc_now()
        if item.message is None:
            await self._publish(self.alerts.clear(item.name, at), None)
            return
        spec = self._panel.specs.get(item.name)
        if spec is None:  # switched off
            return
        finding = Finding("as soon as it happens", 1.0, None, 1.0, "warning", self._touches, at, (item.message,))
        before = self.alerts.standing.get(item.name)
        if before is not None:
            finding = replace(finding, since_touches=before.since_touches, since_at=before.since_at)
        what = f"{spec.what}: {item.message}"
        news = self.alerts.find(item.name, spec.group, what, spec.unit, spec.advice, finding, at)
        after = self.alerts.standing[item.name]
        if after is not before:
            await self._publish(news, after)

    async def _publish(self, news: AlertNews | None, standing: Alert | None) -> None:
        """Write an alert down as it is now, then tell what is new about it.

        It is told even if it cannot be written: a full disk is the very moment at which an alert is wanted.
        """
        alert = standing or (news.alert if news is not None else None)
        if alert is None:
            return
        try:
            await self._journal.set_standing(alert.name, standing.to_dict() if standing is not None else None)
        except Fault as exc:
            log.warning("alert_not_kept", name=alert.name, error=exc.message)
        if news is not None:
            await self._tell(news)
            tell: Callable[..., Any] = log.info if news.change in ("cleared", "acknowledged") else log.warning
            tell("alert", name=alert.name, change=news.change, message=news.alert.message)

    async def _tell(self, news: AlertNews) -> None:
        async def write(seq: int) -> dict[str, Any]:
            await self._journal.add_alert(seq, news.body)
            return news.body

        await self._journal.reserve_seqs()
        try:
            await self._publisher.publish_written("alert", write)
        except Fault as exc:
            log.warning("alert_not_kept", name=news.alert.name, error=exc.message)
            self._publisher.publish("alert", news.body)

    # --- asked ------------------------------------------------------------------------------------------------

    @property
    def panel(self) -> Panel:
        """The watches as they are now; to be read only."""
        return self._panel

    @property
    def waiting(self) -> int:
        """How many things that happened have not been judged yet; `QUEUE` at most."""
        return self._queue.qsize()

    async def settled(self) -> None:
        """Wait until all that was handed in has been judged."""
        await self._queue.join()

    async def acknowledge(self, name: str, by: str, note: str, *, mended: bool) -> Alert:
        """Write down that a person knows of an alert; `mended` restarts its watch. Raise `Fault` for no alert."""
        at = utc_now()
        async with self._turn:
            news = self.alerts.acknowledge(name, by, note, at)
            if news is None:
                standing = sorted(self.alerts.standing)
                raise Fault(FaultCode.UNKNOWN_ALERT, f"no alert {name!r} stands"[:200], standing=standing)
            await self._publish(news, news.alert)
            if mended and name in self._panel.specs and not is_flag(self._panel, name):
                self._panel.restart(name)
            if mended and name == REPEATED:
                self._failures.forget()
                self._failing = None
            if mended or name == "journal_moved_aside":  # what happened once is over when somebody has taken note
                await self._publish(self.alerts.clear(name, at), None)
        if mended:
            await self.save()
        return news.alert

    def overview(self) -> dict[str, Any]:
        """Return the alerts that stand and how every watch stands."""
        facts = overview(self._panel, self.alerts.standing)
        return {**facts, "touches": self._touches, "off": list(self._settings.config.maintenance.off)}


def _panel(config: Config) -> Panel:
    """Return the watches that a configuration wants."""
    section = config.maintenance
    return Panel(chosen(config.bus, off=section.off, baseline=section.baseline, batch=section.batch))


def _number(kept: Mapping[str, Any], key: str) -> int:
    """Return a number that was kept, 0 if it is none."""
    value = kept.get(key)
    return value if isinstance(value, int) else 0
