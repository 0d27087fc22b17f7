"""A board's points by one run: the daemon walks them by itself, and is killed in the middle of some.

Every record comes as an event of the topic `point`; what the log got since the one before is what happened to its
point. A run that was killed is gone on with, and touches none that has a verdict.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from daemon.client import Refused, Subscription
from daemon.domain.board import BoardPoint
from tests.bench.landing.station import PATIENCE_S, Interrupted
from tests.bench.nets.records import Visit
from tests.bench.nets.station import Tester, told_by

PLAN = "nets"
HEARD_WITHIN_S = 1.0
LATEST_KILL_S = 0.5
"""After the record of the point before the one that is cut short, by the station's time."""


class RunFailed(Exception):
    """A run ended in an error, or not as its records say."""


class ByRun:
    """Tests boards of one station by runs."""

    def __init__(self, tester: Tester, seed: int, stop: threading.Event) -> None:
        self._tester, self._stop = tester, stop
        self._random = random.Random(f"{seed}/nets/runs")

    def test(self, points: Sequence[BoardPoint], *, kill: bool) -> Iterator[Visit]:
        """Test points of the board that lies there; yield each as it comes, and what a kill cut short."""
        tester, by_name = self._tester, {point.name: point for point in points}
        done: set[str] = set()
        self._store(points)
        cut_after = self._random.randrange(len(points)) if kill else None
        with Subscription(tester.rig.events, topics=("point", "result")) as heard:
            tester.forget()
            # Of a run that is killed it has to be known which point is under test.
            self._begin("begun", plan=PLAN, abandon=True, order="given" if kill else "short")
            if cut_after:
                for visit in self._heard(heard, by_name, done, "begun", at_most=cut_after):
                    yield visit
            which: str | None = "begun"
            if cut_after is not None:
                yield from self._cut(heard, by_name, done)
                which = self.go_on(done)
            if which is not None:
                for visit in self._heard(heard, by_name, done, which):
                    yield visit
        left = set(by_name) - done
        if left:
            raise RunFailed(f"the run ended without a word of {', '.join(sorted(left)[:5])}")

    def _store(self, points: Sequence[BoardPoint]) -> None:
        named = "".join(f'\n[[point]]\npoint = "{point.name}"\n' for point in points)
        head = f'[plan]\nboard = "{self._tester.rig.board.name}"\n\n[defaults]\nhigh = "5 ohm"\n'
        self._tester.client.request("plan", action="store", name=PLAN, text=head + named)

    def _begin(self, which: str, **fields: Any) -> None:
        board_id = self._tester.board_id
        asked = {"board_id": board_id, "deadline_ms": PATIENCE_S * 1e3, **fields}
        self._tester.client.request("run", id=f"{board_id}-{which}", **asked)

    def _heard(
        self,
        heard: Subscription,
        by_name: dict[str, BoardPoint],
        done: set[str],
        which: str,
        at_most: int | None = None,
    ) -> Iterator[Visit]:
        """Yield what is heard of points, until the run ends with the needle up, or so many are done."""
        last: Visit | None = None
        began_s, begun = time.monotonic(), len(done)
        for event in self._records(heard, f"{self._tester.board_id}-{which}"):
            if last is not None:
                yield last
            point, took_s = by_name[event["point"]], time.monotonic() - began_s
            visit = self._tester.visit(point, str(event["verdict"]), str(event.get("reason", "")), check=False)
            began_s = time.monotonic()
            last = replace(
                told_by(visit, event), wall_s=took_s, simulated_s=took_s * self._tester.speed,
                had_verdict=point.name in done,
            )  # fmt: skip
            done.add(point.name)
            if len(done) - begun == at_most:
                yield last
                return
        if last is not None:
            yield replace(last, **self._tester.needle())

    def _records(self, heard: Subscription, job_id: str) -> Iterator[dict[str, Any]]:
        """Yield the records of points as they are told, until the run ends."""
        while not self._stop.is_set():
            event = heard.next(HEARD_WITHIN_S)
            if event is None:
                if not self._tester.rig.daemon.alive():
                    raise RunFailed(f"the daemon ended: {self._tester.rig.daemon.last_words()}")
            elif event["topic"] == "point":
                yield event
            elif event["id"] == job_id:
                if event.get("error"):
                    raise RunFailed(f"the run ended: {event['error']['name']}: {event['error']['message']}")
                return
        raise Interrupted

    def _cut(self, heard: Subscription, by_name: dict[str, BoardPoint], done: set[str]) -> Iterator[Visit]:
        """Kill the daemon while a point is tested, and start it again; yield what happened until it was back."""
        tester = self._tester
        self._stop.wait(self._random.uniform(0.0, LATEST_KILL_S) / tester.speed)
        tester.rig.daemon.kill()
        while event := heard.next(0.0):
            done |= {event["point"]} if event["topic"] == "point" else set()
        under_test = next((name for name in by_name if name not in done), list(by_name)[-1])
        yield replace(tester.visit(by_name[under_test], "killed", check=False), killed=True)
        tester.restart()
        yield replace(tester.visit(by_name[under_test], "killed"), killed=True)

    def go_on(self, done: set[str]) -> str | None:
        """Go on with the run as it is on disk, and add to `done` what it has; return by which job, None: it is done.

        A run that was killed before it was written down has touched nothing, and is begun again.
        """
        try:
            state = self._state_on_disk(done)
        except Refused as refused:
            if refused.error["name"] != "unknown_run":
                raise
            self._begin("again", plan=PLAN, order="given")
            return "again"
        if state == "done":
            return None
        self._begin("resumed", resume=True)
        return "resumed"

    def _state_on_disk(self, done: set[str]) -> str:
        """Return how the run stands, and add to `done` the points that have a verdict in it."""
        since, run = 0, f"{self._tester.board_id}-begun"
        while True:
            told = self._tester.client.request("points", run=run, since=since, limit=1000)
            if not told["points"]:
                return str(told["run"]["state"])
            done |= {record["point"] for record in told["points"]}
            since = told["points"][-1]["n"] + 1
