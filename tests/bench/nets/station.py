"""One simulated station with its daemon: boards of a series are laid in one after the other, and their points tested.

The tester speaks the daemon's wire and nothing else; what was true meanwhile, the station's log says.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from daemon.client import Client, NoAnswer, Refused
from daemon.config.model import load_config
from daemon.domain.board import BoardPoint
from daemon.domain.results import JobResult
from daemon.station.reach import in_reach_at_all_angles
from daemon.tools.demo.fixture import Fixture
from daemon.tools.demo.session import choose_fiducials
from daemon.tools.demo.truth_log import Tail, stretch
from tests.bench.landing.station import PATIENCE_S, STEPS, Interrupted, Operator, SetUpFailed
from tests.bench.landing.trials import Step
from tests.bench.nets.boards import BoardKind
from tests.bench.nets.records import Station, Visit
from tests.station.rig import Rig, started

RESTED_S = 30.0


@dataclass(frozen=True)
class Shares:
    """What is wrong with boards, ways and needle, each a share 0..1 (knobs of the simulated station)."""

    misplaced_share: float = 0.05
    oxide_share: float = 0.04
    stubborn_share: float = 0.005
    debris_share: float = 0.004
    open_share: float = 0.01
    short_share: float = 0.0


class Tester:
    """Test boards on one station."""

    def __init__(
        self, rig: Rig, client: Client, kind: BoardKind, seed: int, stop: threading.Event, speed: float
    ) -> None:
        self.speed = speed
        self.rig, self.client, self._kind, self._seed, self._stop = rig, client, kind, seed, stop
        self.operator = Operator(rig, client, kind.folder, seed, stop, strict=False)
        self._tail = Tail(rig.places.out / "truth.jsonl")
        self._random = random.Random(f"{seed}/nets")
        self._config = load_config(rig.places.out / "station.toml")
        self.board_id = ""
        self._number = -1
        self._fixture: Fixture | None = None
        self._shares = Shares(misplaced_share=0.0)

    def set_up(self, shares: Shares) -> None:
        """Set the station up, while no way is misplaced and no pad soiled; then make them as they really are."""
        self.operator.set_up(STEPS[: STEPS.index("align")], lambda _step: None)
        self._shares = shares
        self._turn(shares)

    def station(self) -> Station:
        """Return the limits by which its points are judged."""
        gantry, knobs = self._config.gantry, self.rig.truth_start()["knobs"]
        return Station(self._seed, self._kind.name, floor_z_um=gantry.floor_z_um, dent_n=float(knobs["dent_n"]))

    def next_board(self) -> None:
        """Lay the next board of the series in, and align it; the first one lies there already."""
        self._number += 1
        self.board_id = f"{self._kind.name}-{self._seed}-{self._number}"
        if self._number:
            self.rig.bench.ask("set", name="board_number", value=self._number)
            self.rig.bench.ask("board")
        self._align()
        self._fixture = Fixture(self.rig.bench)

    def points(self, at_most: int) -> list[BoardPoint]:
        """Draw points of the board that every head angle reaches, and whose net the harness does."""
        fixture, channels = self._fixture, self._config.meter.channels if self._config.meter else {}
        assert fixture is not None
        within = in_reach_at_all_angles(self._config, self.rig.board.test_points())
        known = (point for point in within if point.name not in self.operator.missing)
        there = [point for point in known if point.net in channels and fixture.net_of(point) is not None]
        return self._random.sample(there, min(at_most, len(there)))

    def test(self, points: Sequence[BoardPoint], *, kill: bool) -> Iterator[Visit]:
        """Test points of the board that lies there; in one of them the daemon is killed."""
        killed = self._random.randrange(len(points)) if kill else -1
        for number, point in enumerate(points):
            if number == killed:
                yield from self.probe_killed(point, number)
            else:
                yield self.probe(point, number)

    def probe(self, point: BoardPoint, number: int) -> Visit:
        """Test one point by a job of its own."""
        job_id = f"{self.board_id}-{number}-{point.name}"
        self.forget()
        began_s, began_wall_s = self._now_s(), time.monotonic()
        asked: dict[str, Any] = {"test_point": point.name, "board_id": self.board_id}
        try:
            result = self.operator.job(job_id, "probe", **asked)
        except Refused as refused:
            visit = self.visit(point, f"error:{refused.error['name']}", str(refused))
        else:
            visit = told_by(self.visit(point, *_verdict(result)), result.detail.get("record") or {})
        visit = replace(visit, wall_s=time.monotonic() - began_wall_s, simulated_s=self._now_s() - began_s)
        self.recover()
        return visit

    def probe_killed(self, point: BoardPoint, number: int) -> Iterator[Visit]:
        """Kill the daemon in the middle of a point's test, start it again, and test the point again.

        The second answer for the id of the first must come without a touch.
        """
        job_id = f"{self.board_id}-{number}-{point.name}"
        self.forget()
        asked: dict[str, Any] = {"test_point": point.name, "board_id": self.board_id}
        self.client.request("probe", id=job_id, **asked)
        self._until_moved()
        self._stop.wait(self._random.uniform(0.0, 0.6))
        self.rig.daemon.kill()
        self.rig.bench.ask("status")
        yield replace(self.visit(point, "killed", check=False), killed=True)
        self.restart()
        with suppress(Refused):
            self.operator.job(job_id, "probe", **asked)
        yield replace(self.visit(point, "killed"), killed=True, had_verdict=True)
        yield self.probe(point, number + 1_000_000)

    def forget(self) -> None:
        """Leave out of the next visit what the log got so far."""
        self.rig.truth()
        self._tail.take()

    def restart(self) -> None:
        """Start the daemon again and bring the station back to idle."""
        self.rig.start_daemon(started)
        self.recover()

    def visit(self, point: BoardPoint, verdict: str, reason: str = "", *, check: bool = True) -> Visit:
        """Return what happened since the log was read last, and how the needle is now."""
        needle = self.needle()
        happened, fixture = stretch(self._tail.take()), self._fixture
        assert fixture is not None
        return Visit(
            self._seed, self._kind.name, self.board_id, point.name, fixture.net_of(point) or "",
            fixture.is_sound(point, happened), verdict, reason, happened=happened,
            **(needle if check else {}),
        )  # fmt: skip

    def needle(self) -> dict[str, Any]:
        """Return how the needle is now, by the names of a visit's fields."""
        truth = self.rig.truth()
        return {"pressed_after_um": truth["pressed_um"], "height_after_um": truth["tip_um"][2]}

    def _align(self) -> None:
        """Find the board that was laid in, and measure how high it lies; no way is misplaced meanwhile."""
        self._turn(replace(self._shares, misplaced_share=0.0))
        board = self.rig.board
        fields: dict[str, Any] = {"deadline_ms": PATIENCE_S * 1e3, "board_id": self.board_id}
        if board.layers is None:
            fields["fiducials"] = [point.name for point in choose_fiducials(board)]
        self._must("align", **fields)
        self._must("calibrate", what="surface", deadline_ms=PATIENCE_S * 1e3)
        self._turn(self._shares)

    def _turn(self, shares: Shares) -> None:
        for name, value in vars(shares).items():
            self.rig.bench.ask("set", name=name, value=value)

    def _must(self, op: str, **fields: Any) -> None:
        result = self.operator.job(f"{self.board_id}-{op}", op, **fields)
        if result.error is not None:
            raise SetUpFailed([Step(op, 0.0, 0.0, error=f"{result.error.name}: {result.error.message}")])

    def recover(self) -> None:
        """Bring the station back to idle after a fault, as a person would: lift, reset, home."""
        for op in ("reset", "lift", "home"):
            if self._stop.is_set():
                raise Interrupted
            if self.client.request("status")["state"] == "idle":
                return
            with suppress(Refused, NoAnswer):
                if op == "reset":
                    self.client.request("reset", timeout_s=60.0)
                else:
                    self.client.job(op)
        if self.client.request("status")["state"] != "idle":
            raise ValueError(f"the station cannot be brought back: {self.client.request('status')['fault']}")

    def _until_moved(self) -> None:
        give_up_s = time.monotonic() + RESTED_S
        while not self.rig.truth()["moving"] and time.monotonic() < give_up_s:
            time.sleep(0.01)

    def _now_s(self) -> float:
        return float(self.rig.truth()["t_s"])


def _verdict(result: JobResult) -> tuple[str, str]:
    if result.error is not None:
        return f"error:{result.error.name}", result.error.message
    record = result.detail.get("record") or {}
    return str(record.get("verdict", result.outcome)), str(record.get("reason", ""))


def told_by(visit: Visit, record: dict[str, Any]) -> Visit:
    """Add what a point's record says."""
    readings: Sequence[dict[str, Any]] = record.get("readings") or ()
    return replace(
        visit,
        rung=record.get("recovered_by"),
        cause=record.get("cause"),
        first_value=readings[0]["value"] if readings else None,
        last_value=readings[-1]["value"] if readings else None,
        said_force_n=readings[-1]["force_n"] if readings else None,
        said_touches=int(record.get("touches", 0)),
        said_presses=int(record.get("presses", 0)),
        looks=int(record.get("looks", 0)),
    )
