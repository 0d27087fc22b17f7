"""Watchers beside the work: threads that sample the truth, the status beside it, and hear the events."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

from daemon.client import Client, NoAnswer, Refused, Subscription
from daemon.tools.demo.processes import DemoBench
from tests.bench.faults.records import Glance, Ledger, Truth
from tests.station.rig import Rig

TRUTH_EVERY_S, STATUS_EVERY_S = 0.008, 0.03
STATUS_WITHIN_S = 2.0


class Watch:
    """What was seen since it was last taken."""

    def __init__(self, rig: Rig, ledger: Ledger) -> None:
        self._rig, self._ledger = rig, ledger
        self._lock, self._end = threading.Lock(), threading.Event()
        self._truths: list[Truth] = []
        self._glances: list[Glance] = []
        self.item = ""
        self.held: tuple[str, ...] = ()
        self.trouble: list[str] = []
        """What ended a watcher; nothing may."""

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Sample until the end of the block."""
        parts = (self._sample_truth, self._sample_status, self._hear)
        threads = [threading.Thread(target=self._part, args=(part,), daemon=True) for part in parts]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            self._end.set()
            for thread in threads:
                thread.join()

    def take(self) -> tuple[list[Truth], list[Glance]]:
        """Return what was seen, and forget it but for the newest truth."""
        with self._lock:
            seen = self._truths, self._glances
            self._truths, self._glances = self._truths[-1:], []
        return seen

    def _part(self, part: Callable[[], None]) -> None:
        try:
            part()
        except Exception as exc:  # noqa: BLE001  # said in the table, whatever it is
            self.trouble.append(f"a watcher ended: {exc!r}")

    def _sample_truth(self) -> None:
        with closing(DemoBench(self._rig.places.socket("bench"))) as bench:
            while not self._end.wait(TRUTH_EVERY_S):
                slipped = "slip" in self.held
                truth = Truth.of(bench.ask("head"), slipped=slipped)
                with self._lock:
                    self._truths.append(truth)

    def _sample_status(self) -> None:
        with closing(DemoBench(self._rig.places.socket("bench"))) as bench, self._rig.client(STATUS_WITHIN_S) as client:
            while not self._end.wait(STATUS_EVERY_S):
                held = self.held
                before = Truth.of(bench.ask("head"))
                status = _status(client)
                if status is None or held != self.held:
                    continue
                glance = Glance(time.monotonic(), before, status, Truth.of(bench.ask("head")), held)
                with self._lock:
                    self._glances.append(glance)

    def _hear(self) -> None:
        with Subscription(self._rig.events, topics=("result",)) as heard:
            while not self._end.is_set():
                if event := heard.next(0.1):
                    self._ledger.said("event", event, self.item)


def _status(client: Client) -> dict[str, Any] | None:
    try:
        return client.request("status")
    except (NoAnswer, Refused):
        return None
