"""Operations of the cycle bench on a simulated station at real time, each with its part of the line."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.client import Client
from daemon.config.model import Config, load_config
from daemon.config.sections.devices import AxisSection
from daemon.domain.board import BoardPoint
from daemon.domain.results import JobResult
from daemon.tools.demo.session import Session, choose_points
from drivers.bus import SerialLine
from drivers.l4118.units import decode_speed_unit
from tests.bench.cycle.budget import Budget, StationFacts, budget
from tests.bench.cycle.legs import AxisFacts, Follower
from tests.bench.cycle.line import Exchange, exchanges, without_check_at_rest
from tests.station.rig import Rig, running_rig

READOUT_S = 0.012
"""The simulated camera's; a real one's is in its data sheet."""
INCREMENTS_PER_REV = 3_276_800.0
SPEED_UNIT = 0x60A9
AWAY_UM, BESIDE_UM = 10_000.0, 35.0
"""A place comes from so far away in X, a correction from so far beside in X and in Y: some 50 um."""
ANGLES = 24
"""At which the head's rotation is calibrated: only with head and seat known a place is known to be clear."""
CLEARANCE = """
[clearance]               # of the simulated needle, a little more
needle_radius_um = 260.0
barrel_from_um = 9200.0
barrel_radius_um = 420.0
head_from_um = 15000.0
bare = true
"""
TOUCHES_OF_PAD = 1
"""Each leaves its mark, and a pad full of marks is not seen any more."""
Say = Callable[[str], None]


@dataclass(frozen=True)
class Cycle:
    """One operation as it went."""

    op: str
    """Its name; of a correction with the number of its moves, for that is what it costs."""
    budget: Budget
    part: tuple[Exchange, ...]


def axis_facts(name: str, section: AxisSection, speed_unit: int) -> AxisFacts:
    """Return what is needed of an axis to reckon its ways."""
    unit = decode_speed_unit(speed_unit, INCREMENTS_PER_REV)
    if unit is None:
        raise ValueError(f"axis {name}: speed unit {speed_unit:08X}h is none that can be reckoned with")
    count = unit.increments_s / abs(section.increments_per_unit)
    return AxisFacts(name, section.increments_per_unit, section.speed, section.acceleration, count)


def follower(config: Config, begun: Sequence[Exchange]) -> Follower:
    """Return what follows the drives; the record's begin has the units of their speeds."""
    sections = {"x": config.axes.x, "y": config.axes.y, "z": config.axes.z, "theta": config.axes.theta}
    units = {e.slave: e.object.value for e in begun if e.object is not None and e.object.index == SPEED_UNIT}
    return Follower({s.address: axis_facts(name, s, units[s.address] or 0) for name, s in sections.items()})


def station_facts(config: Config) -> StationFacts:
    """Return what the configuration says of light, camera and line."""
    bus = config.bus[config.axes.x.bus]
    line = SerialLine(bus.port or "", bus.baudrate, bus.parity)
    return StationFacts(
        head_settles_s=config.gantry.settle_ms / 1e3,
        light_settles_s=config.lights.settle_ms / 1e3,
        exposure_s=(config.camera.exposure_us or 0) / 1e6,
        readout_s=READOUT_S,
        byte_s=line.seconds(1),
        dwell_s=config.touch.dwell_ms / 1e3,
    )


class Failed(Exception):
    """An operation ended in an error; the message says in which."""


class Bench:
    """One station whose operations are measured."""

    def __init__(self, rig: Rig, client: Client, record: Path, say: Say) -> None:
        self._rig, self._client, self._record, self._say = rig, client, record, say
        config = load_config(rig.places.out / "station.toml")
        self._facts = station_facts(config)
        self._read_to = 0
        self._before: list[Exchange] = []
        begun = self._new_part()
        self._follower = follower(config, begun)
        self._follower.follow(begun)
        self._points = [point.name for point in choose_points(rig.board, 40)]

    def cycles(self, rounds: int) -> Iterator[Cycle]:
        """Place, correct and touch, one point after the other."""
        for number in range(rounds):
            point = self._rig.board.point(self._points[number // TOUCHES_OF_PAD % len(self._points)])
            self._say(f"round {number + 1} of {rounds}: {point.name}")
            try:
                yield from self._round(point)
            except Failed as failed:
                self._say(f"the round ends: {failed}")

    def _round(self, point: BoardPoint) -> Iterator[Cycle]:
        self._do("place", board_um=[point.x_um - AWAY_UM, point.y_um], theta_deg=0.0)
        yield self._measured("place", board_um=[point.x_um, point.y_um], theta_deg=0.0)
        self._do("place", board_um=[point.x_um + BESIDE_UM, point.y_um + BESIDE_UM], theta_deg=0.0)
        yield self._measured("correct", test_point=point.name)
        yield self._measured("touch", test_point=point.name, dwells=1)

    def _do(self, op: str, **fields: Any) -> JobResult:
        result = self._client.job(op, timeout_s=120.0, **fields)
        if result.error is not None:
            raise Failed(f"{op}: {result.error.message}")
        return result

    def _measured(self, op: str, *, dwells: int = 0, **fields: Any) -> Cycle:
        time.sleep(0.5)  # what the job before left to be done is done
        self._before = self._new_part()
        self._follower.follow(self._before)
        known = len(self._follower.legs)
        begun_s = time.monotonic()
        result = self._do(op, **fields)
        over_s = time.monotonic()
        new = self._new_part()
        self._follower.follow(new)
        asked = without_check_at_rest(self._before + new)
        part = tuple(exchange for exchange in asked if begun_s <= exchange.sent_s <= over_s)
        legs = [leg for leg in self._follower.legs[known:] if begun_s <= leg.begun_s <= over_s]
        told = f"{op}, {result.moves} move{'s' * (result.moves != 1)}" if op == "correct" else op
        if op == "correct":
            self._say(f"{told}: {result.error_before_um} um off before, {result.error_after_um} um after")
        return Cycle(told, budget(result.timing_ms, part, legs, self._facts, dwells=dwells), part)

    def _new_part(self) -> list[Exchange]:
        lines = self._record.read_text().splitlines()
        fresh, self._read_to = lines[self._read_to :], len(lines)
        return exchanges(fresh)


@contextmanager
def bench(out: Path, say: Say, *, clearance: bool = True, seat: bool = True) -> Iterator[Bench]:
    """Start a station at real time, calibrate it, and give what measures on it.

    clearance: it knows the figures of its head; without, all ways sideways go at the safe height. seat: head and seat
    are calibrated; without, that takes minutes less, and places go at the safe height.
    """
    record = out / "line.jsonl"
    program = ("tests.bench.cycle.listening", str(record))
    station = running_rig(out, arguments=(), pictures="none", reply_ms=1000.0, program=program,
                          more_settings=CLEARANCE if clearance else "")  # fmt: skip
    with station as rig, rig.client() as client:
        say("setting the station up")
        session = Session(client, rig.bench, rig.board, 1, say)
        session.set_up()
        if seat:
            session.calibrate_fully(ANGLES)
            say("measuring the play")  # as every station's set-up does
            play = client.job("calibrate", what="backlash", timeout_s=900.0)
            if play.error is not None:
                raise SystemExit(f"the play could not be measured: {play.error.message}")
        else:
            result = client.job("calibrate", what="surface", places=6, timeout_s=900.0)
            if result.error is not None:
                raise SystemExit(f"the surface could not be measured: {result.error.message}")
        yield Bench(rig, client, record, say)
