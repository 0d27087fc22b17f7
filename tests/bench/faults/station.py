"""Station of the fault campaign: a simulated station, its daemon, the watchers, and what every part does with them."""

from __future__ import annotations

import json
import random
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from daemon.client import Client, NoAnswer
from daemon.tools.demo.processes import Process
from tests.bench.faults import judge
from tests.bench.faults.records import Job, Ledger, Truth, Violation
from tests.bench.faults.watch import Watch
from tests.daemon.storage.small_disk import mounted
from tests.station.rig import PROGRAM, Rig, running_rig

REPLY_MS = 1000.0
"""Slaves get more time to answer: several stations share a computer, which then is what is slow."""
ANSWER_S, QUIET_S, READY_S = 60.0, 60.0, 60.0
LOST_S = 20.0
"""An accepted job without a result so long after the station is quiet is lost."""
DARK_S = 1.15
"""Watched at the end of an item, so that a lamp that stays on is seen."""
PITCH_UM, COLUMNS, ROWS = 400, 95, 70
CORNER_UM = 1000.0
THETA_DEG = 60.0
REFERENCE_UM = (15_000.0, 9_000.0)
TRIES = 10
PRESSED_WITHIN_S = 10.0
LOOKED_EVERY_S = 0.004
"""A moment is waited for so finely; asking without a pause would keep the simulated station from its work."""
DISK_MB = 96


class Station:
    """One station at work; everything that is asked goes through it, so that the ledger knows it."""

    def __init__(
        self, rig: Rig, client: Client, watch: Watch, ledger: Ledger, seed: int, disk: Path | None = None
    ) -> None:
        self.disk = disk
        """The small disk on which the daemon keeps its data; None where none can be mounted."""
        self._seed = seed
        self.rig, self.client, self.watch, self.ledger = rig, client, watch, ledger
        self.item = ""
        self.violations: list[Violation] = []
        self.offset_um = (0.0, 0.0)
        self._begun: list[tuple[float, str]] = []
        cells = list(range(COLUMNS * ROWS))
        random.Random(seed).shuffle(cells)
        self._cells = iter(cells * 100)

    def set_up(self, seed: int) -> None:
        """Home, teach, calibrate; learn where the robot frame has the board's."""
        self.rig.session(self.client, seed).set_up()
        assert self.client.job("place", board_um=list(REFERENCE_UM), theta_deg=THETA_DEG).ok
        truth = self.truth()
        self.offset_um = (truth.x_um - REFERENCE_UM[0], truth.y_um - REFERENCE_UM[1])

    def calibrate(self) -> None:
        """Teach the tip and calibrate the map anew."""
        self.rig.session(self.client, self._seed).set_up()

    def truth(self) -> Truth:
        return Truth.of(self.rig.head())

    # --- what is asked

    def request(self, op: str, name: str, *, undisturbed: bool = False, **fields: Any) -> dict[str, Any]:
        """Return a job's request, entered in the ledger; a `place` without a place gets one of its own."""
        job = Job(f"{self.item}:{name}", self.item, op, undisturbed=undisturbed)
        if op == "place":
            row, column = divmod(next(self._cells), COLUMNS)
            job.place_um = (CORNER_UM + PITCH_UM * column, CORNER_UM + PITCH_UM * row)
            fields = {"board_um": list(job.place_um), "theta_deg": THETA_DEG, **fields}
        self.ledger.ask(job)
        return {"op": op, "id": job.id, **fields}

    def send(self, request: dict[str, Any], client: Client | None = None) -> dict[str, Any] | None:
        """Send a request and note its answer; None if there is none."""
        try:
            reply = (client or self.client).raw(json.dumps(request).encode(), timeout_s=ANSWER_S)
        except NoAnswer:
            return None
        self.ledger.answered(reply, self.item)
        return reply

    @contextmanager
    def sending(self, request: dict[str, Any], timeout_s: float = ANSWER_S) -> Iterator[list[dict[str, Any] | None]]:
        """Send a request from another client beside the block; its answer is in the list at the end."""
        replies: list[dict[str, Any] | None] = []

        def ask() -> None:
            with self.rig.client(timeout_s) as other:
                try:
                    reply = other.raw(json.dumps(request).encode())
                    self.ledger.answered(reply, self.item)
                    replies.append(reply)
                except NoAnswer:
                    replies.append(None)

        thread = threading.Thread(target=ask, daemon=True)
        thread.start()
        try:
            yield replies
        finally:
            thread.join()

    @contextmanager
    def holding(self, name: str, **parameters: Any) -> Iterator[None]:
        """Hold a fault of the simulated station."""
        self.watch.held = (name,)
        with self.rig.fault(name, **parameters):
            yield
        self.watch.held = ()

    # --- what is waited for

    def start(self) -> None:
        """Start a daemon and wait until it has asked its devices, whatever it found."""
        self.rig.start_daemon(lambda _process, _control: None)
        self.until_ready()

    def until_ready(self) -> None:
        give_up_s = time.monotonic() + READY_S
        while time.monotonic() < give_up_s:
            _must_run(self.rig.daemon)
            reply = self._status()
            if reply is not None and reply["lifecycle"] == "ready":
                return
            time.sleep(0.02)
        raise TimeoutError(f"not ready after {READY_S:g} s")

    def quiet(self) -> dict[str, Any]:
        """Wait until nothing runs or waits; return the status."""
        give_up_s = time.monotonic() + QUIET_S
        while time.monotonic() < give_up_s:
            _must_run(self.rig.daemon)
            status = self._status()
            if status is not None and judge.at_rest(status):
                return status
            time.sleep(0.02)
        raise TimeoutError(f"something runs or waits after {QUIET_S:g} s: {status}")

    def _status(self) -> dict[str, Any] | None:
        try:
            reply = self.client.raw(b'{"op": "status"}', timeout_s=5.0)
        except NoAnswer:
            return None
        return reply if reply["ok"] else None

    def until_pressed(self) -> None:
        """Wait until the pin is pressed, not longer than a job takes to do it."""
        give_up_s = time.monotonic() + PRESSED_WITHIN_S
        while self.truth().pressed_um <= 0 and time.monotonic() < give_up_s:
            time.sleep(LOOKED_EVERY_S)

    def recover(self, *, home: bool = False) -> None:
        """Do what a person would until the station is idle: lift, reset, home."""
        for number in range(TRIES):
            status = self.quiet()
            fault = (status["fault"] or {}).get("name")
            if fault is None and not home:
                return
            if fault is None or fault == "not_homed":
                self.send(self.request("home", f"home-{number}", wait=True))
                home = False
            elif fault == "needle_down" and number % 3 < 2:
                op = ("lift", "home")[number % 3]
                self.send(self.request(op, f"up-{number}", wait=True))
            else:
                self.client.raw(b'{"op": "reset"}', timeout_s=ANSWER_S)
        raise TimeoutError(f"not idle after {TRIES} tries: {self.quiet()}")

    # --- judgement

    def begin(self, item: str) -> None:
        """Begin an item."""
        self.item = self.watch.item = item
        self._begun.append((self.truth().t_s, item))

    def item_at(self, t_s: float) -> str:
        """Return what ran at a time of the station."""
        return next((item for begun_s, item in reversed(self._begun) if begun_s <= t_s), "set-up")

    def must_have_worked(self, request: dict[str, Any], reply: dict[str, Any] | None) -> None:
        """Tell of a job of a healthy station that was not answered, or did not work."""
        if reply is None:
            self.found("lost", f"{request['id']} had no answer")
        elif not reply["ok"] or not reply["result"]["ok"]:
            error = reply.get("error") or reply["result"]["error"]
            what = f"{request['id']} ended by {error['name']} ({error['message']}): nothing is wrong"
            self.found("contradictory", what)

    def found(self, kind: str, what: str) -> None:
        self.violations.append(Violation(kind, self.item, what))

    def judge_item(self) -> None:
        """Stay dark for a while, then judge what was seen and said since the item began."""
        self.quiet()
        time.sleep(DARK_S)
        jobs = self.ledger.jobs(self.item)
        for job in jobs:
            if job.accepted:
                self._ask_result(job)
        truths, glances = self.watch.take()
        self.violations += [
            *judge.contradictory(jobs),
            *judge.sideways(truths, self.item),
            *judge.pressed_at_rest(glances, self.item),
            *judge.lights_at_rest(glances, self.item),
            *judge.incoherent(glances, self.item),
        ]

    def judge_all(self) -> None:
        """Judge the whole run by the truth log and the journal; the daemon has ended."""
        jobs, stops = self.ledger.jobs(), read_stops(self.rig.places.out / "truth.jsonl")
        journal = read_journal(self.rig.places.out / "station" / "journal.sqlite")
        for job in jobs:
            if row := journal.get(job.id):
                self.ledger.said("journal", row, job.item)
        known = {(violation.kind, violation.item) for violation in self.violations}
        late = [*judge.contradictory(jobs), *judge.lost(jobs, journal)]
        self.violations += [violation for violation in late if (violation.kind, violation.item) not in known]
        self.violations += judge.moved(jobs, stops, self.offset_um)
        self.violations += judge.sideways_stops(stops, self.item_at)
        self.violations += [Violation("other", "all", what) for what in self.watch.trouble]

    def _ask_result(self, job: Job) -> None:
        """Ask for a result until it is there; one that is not, although `status` says that nothing waits, is told."""
        message, give_up_s, told = json.dumps({"op": "result", "id": job.id}).encode(), time.monotonic() + LOST_S, False
        while time.monotonic() < give_up_s:
            status = self._status()
            reply = self.client.raw(message, timeout_s=ANSWER_S)
            if reply["ok"] and reply["done"]:
                self.ledger.said("result", reply["result"], job.item)
                return
            if not told and status is not None and judge.at_rest(status):
                self.found(
                    "contradictory", f"{job.id} ({job.op}) is not done, and status says that nothing runs or waits"
                )
                told = True
            time.sleep(0.05)
        self.found("lost", f"{job.id} ({job.op}) was accepted; `result` says {reply.get('error', reply)}")


@contextmanager
def running_station(out: Path, seed: int, speed: float, program: tuple[str, ...] = PROGRAM) -> Iterator[Station]:
    """Start a station and set it up; when the block ends its daemon is ended and all is judged."""
    arguments = ("--unpaced", "--speed", f"{speed:g}")
    data = out / "station"
    with (
        mounted(data, DISK_MB) as is_small,
        running_rig(
            out,
            seed=seed,
            arguments=arguments,
            waits_for_speed=speed,
            reply_ms=REPLY_MS,
            pictures="none",
            program=program,
        ) as rig,
        rig.client(ANSWER_S) as client,
    ):
        ledger = Ledger()
        watch = Watch(rig, ledger)
        station = Station(rig, client, watch, ledger, seed, data if is_small else None)
        station.set_up(seed)
        with watch.watching():
            yield station
        rig.daemon.end()
        station.judge_all()


def read_stops(path: Path) -> list[Truth]:
    """Return where the station came to rest, in order."""
    stops, slipped = [], False
    for line in map(json.loads, path.read_text().splitlines()):
        if line["event"] == "fault" and line["name"] == "slip":
            slipped = line["on"]
        elif line["event"] == "settled":
            stops.append(Truth.of(line, slipped=slipped))
    return stops


def read_journal(path: Path) -> dict[str, dict[str, Any] | None]:
    """Return id -> result of every job in the journal."""
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as journal:
        rows = journal.execute("SELECT id, result FROM jobs").fetchall()
    return {job: json.loads(result) if result else None for job, result in rows}


def _must_run(process: Process) -> None:
    if not process.alive():
        raise ChildProcessError(f"the daemon ended by itself: {process.last_words()}")
