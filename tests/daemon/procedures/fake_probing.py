"""A fake station that can probe: a meter that reads what is true where the needle stands, and a judge of its moves.

What lies between needle and pad are films that a number of presses breaks, and debris that the brush takes off.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from daemon.config.sections.meter import MeterSection
from daemon.config.sections.touching import BrushSection, ReferenceSection
from daemon.domain.board import Board
from daemon.domain.contact import ContactFacts
from daemon.domain.point_mark import PointMark
from daemon.domain.point_test import PadWear, PointRecord, PointTest, PointVerdict
from daemon.domain.states import Event
from daemon.jobs.context import KeptPoint, PointLooks, Touching
from daemon.jobs.held_touch import HeldTouch
from daemon.procedures.probe_point import NOTHING_DONE, probe_point
from daemon.procedures.registry import PROCEDURES
from daemon.station.board_view import BoardSearch
from daemon.station.needle_health import NeedleHealth
from daemon.storage.calibration_records import Seat, SurfaceRecord
from drivers.deadline import Deadline
from drivers.errors import DeviceError
from drivers.gantry import Position
from drivers.meter import Method, Reading
from tests.daemon.procedures.cad_board import cad_board, cad_pad
from tests.daemon.procedures.fake_station import Ran, World, begin, run
from tests.daemon.tools.report.synthetic import surface_record

TOUCH_Z_UM = 5_000.0
KELVIN, LEAD_OHM, CONTACT_OHM = 1, 0.15, 0.03
CHANNELS = {"NA": 101, "NB": 102, "NC": 103, "NS": 104}
COIN_UM, BRUSH_UM = (30_000.0, 34_000.0), (30_000.0, 40_000.0)
RADIUS_UM = 350.0
INF = math.inf


def board() -> Board:
    """Return three round pads, each of a net of its own, one of none, second pads of two nets, and a neighbour S.

    S lies so near to B that a needle which misses may stand on it.
    """
    places = {
        "A": ("NA", 12_000.0, 15_000.0), "B": ("NB", 18_000.0, 15_000.0), "C": ("NC", 24_000.0, 15_000.0),
        "N": (None, 30_000.0, 15_000.0), "A2": ("NA", 12_000.0, 21_000.0), "B2": ("NB", 18_000.0, 21_000.0),
        "S": ("NS", 18_000.0, 15_800.0),
    }  # fmt: skip
    pads = [
        cad_pad(name, x_um, y_um, 2 * RADIUS_UM, 2 * RADIUS_UM, shape="round", diameter_um=2 * RADIUS_UM,
                part=None, kind="site", net=net)
        for name, (net, x_um, y_um) in places.items()
    ]  # fmt: skip
    return cad_board(*pads)


class Book:
    """The journal's touches and points."""

    def __init__(self) -> None:
        self.touches: list[dict[str, Any]] = []
        self.points: list[tuple[str, PointRecord]] = []
        self.marks: dict[str, PointMark] = {}

    async def touches_of(self, board_id: str | None, point: str, _since: str) -> int:
        return sum((row["board_id"], row["point"]) == (board_id, point) for row in self.touches)

    async def mark_of(self, _board: str, _side: str, point: str) -> PointMark | None:
        return self.marks.get(point)

    async def wear_of(self, board_id: str | None, point: str, _since: str, visit: str) -> PadWear:
        rows = [row for row in self.touches if (row["board_id"], row["point"]) == (board_id, point)]
        here = [row for row in rows if row["visit"] == visit]
        return PadWear(len(rows), sum(r["presses"] for r in rows), len(here), sum(r["presses"] for r in here))

    async def begin_touch(
        self, job_id: str, board_id: str | None, point: str, *, visit: str | None = None, rung: str | None = None
    ) -> int:
        row = {"job": job_id, "board_id": board_id, "point": point, "visit": visit, "rung": rung, "presses": 1}
        self.touches.append(row)
        return len(self.touches)

    async def tell_touch(self, number: int, facts: Mapping[str, Any]) -> None:
        self.touches[number - 1] |= facts

    async def add_point(self, job_id: str, record: PointRecord) -> int:
        self.points.append((job_id, record))
        return len(self.points)


@dataclass
class FakeMeter:
    """An instrument whose leads are the needle and the harness."""

    line: Line
    failure: DeviceError | None = None
    stuck_ohm: float | None = None
    """It says this whatever is there."""
    says: Callable[[], float] | None = None
    """It says what this returns; None: what is true."""
    stuck_channels: tuple[int, ...] = ()
    """Relays of the scanner that open no more."""
    wires_short: bool = False
    """The needle's two wires touch each other."""
    failure_on: dict[str, DeviceError] = field(default_factory=dict)
    """Pads on which it fails."""
    channels: tuple[int, ...] = ()
    asked: list[str] = field(default_factory=list)

    async def connect(self, channels: Sequence[int], _deadline: Deadline) -> None:
        self._may_fail()
        self.channels = (*channels, *(one for one in self.stuck_channels if one not in channels))

    async def prepare(self, _method: Method, _deadline: Deadline) -> None:
        self._may_fail()

    async def check(self, _deadline: Deadline) -> None:
        self.asked.append("check")

    async def measure(self, method: Method, deadline: Deadline) -> Reading:
        assert not deadline.expired
        self._may_fail()
        self.asked.append(method.value)
        says = self.says or self.true_ohm
        ohm = says() if self.stuck_ohm is None else self.stuck_ohm
        unit: Any = {"voltage": "V", "diode": "V", "capacitance": "F"}.get(method.value, "ohm")
        return Reading(ohm, unit, overload=math.isinf(ohm), at_s=0.0)

    async def close(self) -> None:
        """Nothing is open."""

    def _may_fail(self) -> None:
        if self.failure is not None and self.line.is_down:
            raise self.failure
        if self.failure_on and (failure := self.failure_on.get(self.line.stands_on() or "")) is not None:
            raise failure

    def true_ohm(self) -> float:
        """Return what lies between needle and closed channels."""
        line = self.line
        if KELVIN in self.channels:
            if self.wires_short:
                return LEAD_OHM
            film = line.film_ohm()
            return INF if math.isinf(film) else LEAD_OHM + 2 * (CONTACT_OHM + film)
        if set(self.channels) & line.joined:
            return LEAD_OHM
        film, stands_on = line.film_ohm(), line.stands_on()
        if math.isinf(film) or stands_on is None:
            return INF
        if stands_on == "coin":
            return LEAD_OHM + CONTACT_OHM + film
        net = next((pad.net for pad in line.world.pads if pad.name == stands_on), None)
        channel = CHANNELS.get(net or "")
        wires = {channel} - line.harness_open
        wires |= {wire for pair in line.joined_wires if wires & pair for wire in pair}
        reached = bool(wires & set(self.channels))
        reached = reached and (net not in line.open_nets or stands_on in line.whole)
        own_ohm = line.net_ohm.get(net or "", 0.0) + line.pad_ohm.get(stands_on, 0.0)
        return LEAD_OHM + CONTACT_OHM + film + own_ohm if reached else INF


class Line:
    """One station that probes, and all that is true of it."""

    def __init__(self, folder: Path, changes: dict[str, dict[str, Any]] | None = None) -> None:
        self.world = world = World(folder, board(), {"gantry": {"overtravel_um": 450.0}, **(changes or {})})
        config = world.config.model_copy(
            update={
                "meter": MeterSection(kind="scpi", address="127.0.0.1:1", channels=CHANNELS, contact_channel=KELVIN),
                "reference": ReferenceSection(x_um=COIN_UM[0], y_um=COIN_UM[1]),
                "brush": BrushSection(x_um=BRUSH_UM[0], y_um=BRUSH_UM[1]),
                "touch": world.config.touch.model_copy(update={"overtravel_um": 300.0, "dwell_ms": 0.0}),
                "ladder": world.config.ladder.model_copy(update={"settle_max_ms": 10.0}),
            }
        )
        self.meter = FakeMeter(self)
        self.configure(config)
        world.teach().with_map().calibrations.store(_surface(world))
        world.height_um = lambda x, y: world.geometry.height_um((x, y))
        world.put_tip(world.pad_um("A"), z_um=world.geometry.look_z_um(world.pad_um("A")))
        world.station.needle.reported(world.gantry.reported)
        self.book, self.told = Book(), list[PointRecord]()
        self.looks: list[PointLooks] = []
        """Whose pictures would be kept."""
        self.held: HeldTouch | None = None
        # --- the truth
        self.open_nets: set[str] = set()
        """Nets that are broken: only their pads among `whole` reach the harness."""
        self.whole = {"A2", "B2"}
        self.harness_open: set[int] = set()
        """Channels whose wire of the harness is broken."""
        self.joined: set[int] = set()
        """Channels whose wire of the harness touches the needle's."""
        self.joined_wires: list[set[int]] = []
        """Channels whose wires of the harness touch each other."""
        self.net_ohm: dict[str, float] = {}
        self.pad_ohm: dict[str, float] = {}
        """Between a pad and the rest of its net."""
        self.films: dict[str, tuple[int, float]] = {}
        """Pad -> presses after which its film is broken, and its ohms until then; infinite: nothing flows."""
        self.film_at_middle: set[str] = set()
        """Pads whose film covers only their middle."""
        self.debris_ohm = 0.0
        self.brush_helps = True
        self.brush_helps_from = 1
        """The first brushing that does."""
        self.misses_um: list[tuple[float, float]] = []
        """Where the next ways of X and Y end beside their places, one after the other; then nowhere."""
        self._miss = (0.0, 0.0)
        world.gantry.scatter_um = self._way
        self.looks_at_move: list[int] = []
        self.trusted_at_move: list[bool] = []
        """Whether the board was known at each move, so that it might go across low."""

    def configure(self, config: Any) -> None:
        """Put another configuration in force."""
        self.world.context.config = config
        self.world.station.fit(self.meter if config.meter is not None else None)

    def first_press_lands_on_b(self) -> None:
        """Have the first press miss by the whole way from A to B."""
        self.misses_um = [(6_000.0, 0.0)]
        self.without(servo=self.world.context.servo.model_copy(update={"max_placement_um": 7_000.0}))
        self.world.put_tip(self.world.pad_um("C"), z_um=6_000.0)
        self.world.station.needle.reported(self.world.gantry.reported)

    def without(self, **sections: Any) -> None:
        """Change sections of the configuration."""
        self.configure(self.world.context.config.model_copy(update=sections))

    def lay_in(self, board_id: str, seat: Seat | None = None) -> None:
        """Align a board of that name, and measure its surface."""
        self.world.with_alignment(self.world.true_pose, board_id=board_id, seat=seat).calibrations.store(
            _surface(self.world)
        )

    # --- what is true ------------------------------------------------------------------------------------------

    def _way(self) -> tuple[float, float]:
        """Return where the present way ends beside its place; straight down and up it stays there."""
        moves = self.world.gantry.moves
        target, before = moves[-1][0], moves[-2][0] if len(moves) > 1 else None
        if before is None or math.dist((target.x_um, target.y_um), (before.x_um, before.y_um)) > 0.5:
            self._miss = self.misses_um.pop(0) if self.misses_um else (0.0, 0.0)
        self.looks_at_move.append(sum(isinstance(one, BoardSearch) for one in self.world.station.searches))
        self.trusted_at_move.append(self.world.station.needle.board.is_recognised)
        helps = self.brush_helps and self.world.station.needle.health.brushings >= self.brush_helps_from
        if self.is_down and self._on(BRUSH_UM) and helps:
            self.debris_ohm = 0.0
        return self._miss

    @property
    def is_down(self) -> bool:
        """Whether the needle is below the surface, by the last target."""
        return bool(self.world.gantry.moves) and self._is_down(self.world.gantry.moves[-1][0])

    def _is_down(self, target: Position) -> bool:
        tip = self.world.geometry.tip_um(target)
        on_board = all(math.dist(tip, place) > 2000.0 for place in (COIN_UM, BRUSH_UM))
        return target.z_um < TOUCH_Z_UM + (self.world.geometry.height_um(tip) if on_board else 0.0) - 1.0

    def _on(self, place_um: tuple[float, float]) -> bool:
        return math.dist(self.world.tip_um(), place_um) < 2000.0

    def stands_on(self) -> str | None:
        """Return the pad, or the coin, below the needle that is down."""
        if not self.is_down:
            return None
        if self._on(COIN_UM):
            return "coin"
        pads = {pad.name: math.hypot(*self.world.miss_um(pad.name)) for pad in self.world.pads}
        name = min(pads, key=lambda one: pads[one])
        return name if pads[name] < RADIUS_UM - 10.0 else None

    def film_ohm(self) -> float:
        """Return what lies between needle and metal; infinite: nothing flows."""
        name = self.stands_on()
        if name is None:
            return INF
        if name == "coin":
            return self.debris_ohm
        presses, ohm = self.films.get(name, (0, 0.0))
        if name in self.film_at_middle and math.hypot(*self.world.miss_um(name)) > 100.0:
            presses = 0
        return self.debris_ohm + (ohm if self.presses_on(name) < presses else 0.0)

    def presses_on(self, name: str) -> int:
        """Return how often the pin was pushed in over a pad, by the moves."""
        return sum(self._is_over(name, target) and self._is_full(target) for target, _ in self.world.gantry.moves)

    def descents_onto(self, name: str) -> int:
        """Return how often the needle came down over a pad."""
        moves = [target for target, _ in self.world.gantry.moves]
        pairs = zip([None, *moves], moves, strict=False)
        return sum(
            self._is_over(name, now) and self._is_down(now) and not (before is not None and self._is_down(before))
            for before, now in pairs
        )

    def _is_over(self, name: str, target: Position) -> bool:
        tip = self.world.geometry.tip_um(target)
        away_um = {pad.name: math.dist(tip, self.world.pad_um(pad.name)) for pad in self.world.pads}
        return away_um[name] < 2000.0 and name == min(away_um, key=lambda one: away_um[one])

    def _is_full(self, target: Position) -> bool:
        surface_um = TOUCH_Z_UM + self.world.geometry.height_um(self.world.geometry.tip_um(target))
        return target.z_um < surface_um - 250.0

    # --- what is asked -----------------------------------------------------------------------------------------

    def touching(self, key: str = "") -> Touching:
        """Return what a job that touches has."""
        self.held = HeldTouch("job-1", key, judged=True)
        self.contacts: list[str] = []
        self.stood: list[ContactFacts] = []
        self.stands = asyncio.Event()

        def made(contact: ContactFacts) -> None:
            self.contacts.append("made")
            self.stood.append(contact)
            self.stands.set()

        def lifted(_contact: ContactFacts) -> None:
            self.contacts.append("lifted")

        def keep(record: PointRecord, looks: PointLooks) -> KeptPoint:
            self.looks.append(looks)
            return record, None

        return Touching(self.held, key, self.book, made, lifted, keep, self.told.append)

    async def probe(self, point: str = "A", *, job_id: str = "job-1", **fields: Any) -> PointRecord:
        """Probe a point to its verdict, see that no rule was broken, and return the record."""
        ran = self.begin(point, job_id, **fields)
        await run(self.world, PROCEDURES["probe"], {}, ran)
        self.see_rules_kept()
        assert ran.got.outcome == self.told[-1].verdict.value
        assert ran.got.detail["record"] == self.told[-1].model_dump(mode="json")
        assert self.book.points[-1] == (job_id, self.told[-1])
        return self.told[-1]

    async def probe_in_run(
        self, point: str, health: NeedleHealth, done: Mapping[str, PointVerdict] = NOTHING_DONE
    ) -> PointRecord:
        """Probe a point as a part of a run that has gone on for a while."""
        ran = self.begin(point)
        ran.job.fire(Event.ACCEPTED)
        record = await probe_point(
            ran.job, self.world.context, PointTest(point=point), None, run="run-1", plan_hash="5d41", health=health,
            done=done,
        )  # fmt: skip
        self.see_rules_kept()
        return record

    def begin(self, point: str = "A", job_id: str = "job-1", **fields: Any) -> Ran:
        asked = {"net": None} if "net" in fields else {"test_point": point}
        return begin({"op": "probe", "id": job_id, **asked, **fields}, self.touching())

    def see_rules_kept(self) -> None:
        """See that nothing went sideways while down, nothing was pressed twice unseen, and the needle is up."""
        moves = [target for target, _ in self.world.gantry.moves]
        looks_at_press: dict[str, int] = {}
        for number, (before, now) in enumerate(pairwise(moves), start=1):
            if self._is_down(before):
                assert math.dist((before.x_um, before.y_um), (now.x_um, now.y_um)) < 0.01, "sideways while pressed"
                assert before.theta_deg == now.theta_deg
            if self._is_down(now) and not self._is_down(before):
                name = next((pad.name for pad in self.world.pads if self._is_over(pad.name, now)), None)
                if name is not None:
                    looks = self.looks_at_move[number]
                    assert name not in looks_at_press or looks > looks_at_press[name], "pressed again unseen"
                    looks_at_press[name] = looks
        assert not self.is_down, "the needle was left down"


def _surface(world: World) -> SurfaceRecord:
    """Return a surface that was touched all over the board."""
    record = surface_record(raised_um=20.0)
    origin, spread = (world.config.board.origin_x_um, world.config.board.origin_y_um), 40_000.0 / 130_000.0
    touches = [
        touch.model_copy(
            update={
                "x_um": origin[0] + (touch.x_um - 200_000.0) * spread,
                "y_um": origin[1] + (touch.y_um - 150_000.0) * spread,
            }
        )
        for touch in record.touches
    ]
    return record.model_copy(update={**world.made(), "touches": tuple(touches)})


__all__ = ["COIN_UM", "KELVIN", "RADIUS_UM", "FakeMeter", "Line", "replace"]
