"""A station without devices: exact geometry, scripted looks, a gantry that obeys, and a record of all that was done.

The real `Station` runs on a fake gantry, fake lamps and a fake camera; only its two looks are computed instead of seen.
The camera is the inverse of one exact pose map, so that every number a procedure comes to can be checked against the
truth: where the board, its pads, the printed cross and the surface really are.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from daemon.config.model import Config, load_config
from daemon.config.sections.base import Section
from daemon.domain.board import Board, BoardPoint
from daemon.domain.results import StepKind
from daemon.domain.states import Event, Machine, State
from daemon.jobs.context import JobContext, MarkOf, Outcome, Procedure, StationContext, Touching, nothing_said
from daemon.platform.clock import utc_now
from daemon.station.allowance import Clocked
from daemon.station.board_view import BoardSearch, BoardSeen
from daemon.station.devices import Hardware
from daemon.station.kinematics import Geometry
from daemon.station.needle import Needle
from daemon.station.station import CrossSearch, LookResult, Search, Station
from daemon.storage.calibration_records import (
    Aligned,
    AlignmentRecord,
    MapRecord,
    RotationRecord,
    Seat,
    SurfaceRecord,
    Touch,
)
from daemon.storage.calibration_store import Calibrations
from daemon.wire.operations.jobs import AnyJob
from daemon.wire.operations.table import OPERATIONS
from drivers.camera import Frame
from drivers.deadline import Deadline
from drivers.errors import EnvelopeViolation, FrameLost
from drivers.gantry import Approach, ClearHeight, Position
from drivers.gantry.contract import axis_theta_deg
from drivers.lights import Light
from tests.daemon.tools.report.synthetic import rotation_record, surface_record
from vision import ControlPoint, Decided, NotFound, ProbeModel, Reason, Seen, SeenObject, TestPoint, Tip, Verdict
from vision.core.circle_fit import CircleFit, Contour
from vision.geometry import fit_plane
from vision.geometry.frames import Rigid2
from vision.geometry.pose_map import PoseMap
from vision.head.model import Head, head_to_dict
from vision.registration import Edges, LayerShifts, Registration
from vision.tip.silhouette import Silhouette
from vision.tip.strip import ProbeShape

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"
TIP_PX = (800.0, 620.0)
BELOW_PX = (4.0, 7.5)
NEEDLE_RAD = 1.2
SHAPE = ProbeShape(end_to_rim_px=60.0, marking_px=20.0, end_half_px=1.5, taper_slope=0.1, cylinder_half_px=16.0)
HOMOGRAPHY = np.array([[12.1, 0.5, -9000.0], [0.4, -11.4, 7000.0], [1e-5, 2e-5, 1.0]])
RADIUS_UM = 900.0
WORK_Z_UM, HOVER_UM, PRESS_UM = 5200.0, 200.0, 200.0

SENSE_INPUT = 4

Edit = Callable[[LookResult], LookResult]


def pose_map(**changes: Any) -> PoseMap:
    """Return the exact map of the fake camera."""
    whole: dict[str, Any] = {
        "homography": HOMOGRAPHY, "covariance": np.zeros((8, 8)), "below_tip_px": BELOW_PX, "below_sigma_px": 0.0,
        "hover_um": HOVER_UM, "radius_um": RADIUS_UM, "residual_um": 5.0, "work_z_um": WORK_Z_UM,
    }  # fmt: skip
    return PoseMap(**whole | changes)


def probe_model(tip_px: tuple[float, float] = TIP_PX) -> ProbeModel:
    """Return a probe as if it had been taught at `tip_px`."""
    rows = np.arange(-80.0, 1.0, 2.0)
    outline = Silhouette(rows, -np.full(rows.size, 4.0), np.full(rows.size, 4.0), 10)
    picture = np.zeros((220, 116), dtype=np.uint8)
    return ProbeModel(
        tip_px, NEEDLE_RAD, SHAPE, outline, np.zeros(9), picture, picture, (740, 420), (1600, 1200), 0.5, 0.1
    )


def found_tip(x_px: float, y_px: float, sigma_px: float = 0.1) -> Tip:
    """Return what TEDA says of a needle whose end is there."""
    anything = cast("Any", None)
    return Tip(
        x_px, y_px, NEEDLE_RAD, sigma_px, 0.97, anything, (x_px, y_px), (x_px, y_px), (x_px, y_px), 0.6, 32.0, 0.2,
        0.3, 0.9, SHAPE,
    )  # fmt: skip


def pad_seen(x_px: float, y_px: float, radius_px: float, visible: float = 1.0, sigma_px: float = 0.1) -> TestPoint:
    """Return a pad that TDEA took."""
    kind: Any = "site"
    return TestPoint(
        x_px, y_px, radius_px, kind, (x_px, y_px), None, sigma_px, visible, "site_filled", 1.0, 0.0
    )  # fmt: skip


def doubtful_object(x_px: float, y_px: float, radius_px: float, rule: str = "no_rule", **changes: Any) -> Decided:
    """Return a round thing of which TDEA could not say what it is."""
    whole: dict[str, Any] = {
        "x_px": x_px, "y_px": y_px, "radius_px": radius_px, "ratio": 1.0, "minor_rad": 0.0, "sigma_px": 0.1,
        "visible": 1.0, "coverage": 1.0, "squareness": 0.0, "noise": 0.0, "sectors": np.ones(8, dtype=bool),
        "contour": Contour(x_px, y_px, radius_px),
    }  # fmt: skip
    circle = CircleFit(**whole | changes)
    seen = SeenObject(
        x_px=x_px, y_px=y_px, area_px=math.pi * radius_px**2, length_px=2 * radius_px, thickness_px=2 * radius_px,
        circularity=1.0, boxed=0.79, fill=1.0, level=200.0, contrast=100.0, neck=0.5, touches_border=False,
        in_needle=0.0, ring=False, dark_middle=False, circle=circle, hole=None, distance_px=10.0,
    )  # fmt: skip
    return Decided(seen, Verdict.PASS, rule)


def registered(
    target_um: tuple[float, float], target_px: tuple[float, float], shift_um: tuple[float, float], **changes: Any
) -> Registration:
    """Return what registration says of a board that is seen clearly."""
    edges = Edges(1.0, 0.0, 200, 0.0)
    whole: dict[str, Any] = {
        "shift_um": shift_um, "turn_deg": 0.0, "target_um": target_um, "target_px": target_px,
        "covariance_um2": np.eye(2), "sigma_um": 1.0, "sigma_px": 0.1, "off_rest_um": (0.0, 0.0), "agreement": 0.95,
        "near": edges, "at_target": edges, "metal_seen": 1.0, "log_odds": 200.0, "rivals": (),
        "levels": {}, "shifts": LayerShifts(),
    }  # fmt: skip
    return Registration(**whole | changes)


def missing(reason: Reason = Reason.NO_TEST_POINT) -> NotFound:
    """Return an answer that is none."""
    return NotFound(reason, f"it is {reason.value}")


@dataclass
class FakeGantry:
    """Four axes that go where they are told, with scatter, backlash and failures as the test wants them."""

    config: Config
    reported: Position
    actual: Position
    is_homed: bool = True
    scatter_um: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0)
    backlash_um: dict[str, float] = field(default_factory=dict)
    """By how much too far an axis stops that comes from above."""
    failures: dict[int, Exception] = field(default_factory=dict)
    """Number of a move, from 1 -> what it raises."""
    moves: list[tuple[Position, frozenset[str]]] = field(default_factory=list)
    slow_z_um: list[float] = field(default_factory=list)
    """Of each move: below which height Z went down slowly."""
    clear_um: list[float | None] = field(default_factory=list)
    """Of each move: how low it may go across, None where nobody knows."""
    approaches: list[Approach | None] = field(default_factory=list)
    """Of each move: from how far it was to come, None for as far as configured."""
    sticks_at_um: float | None = None
    """Z stays there from now on, whatever it is told, and counts on: lost steps."""
    lost_z_um: float = 0.0
    """Z stands so much lower than it counts."""
    checked: list[Position] = field(default_factory=list)
    stopped: int = 0
    homings: int = 0
    asked: list[Deadline] = field(default_factory=list)
    """Deadline of each request."""
    off_um: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where a move ends, from its target."""
    first_move: Exception | None = None
    inputs: set[int] = field(default_factory=set)
    """Those of the Z drive that are high."""
    metal_z_um: float | None = None
    """Input 4 is high from this height down: what a touch sense feels."""

    @property
    def at_rest_s(self) -> float:
        """It is there as soon as it was told to go."""
        return time.monotonic()

    async def raw_input(self, axis: str, number: int, deadline: Deadline) -> bool:
        assert axis == "z"
        self.asked.append(deadline)
        felt = self.metal_z_um is not None and self.actual.z_um <= self.metal_z_um
        return number in self.inputs or (felt and number == SENSE_INPUT)

    def check(self, target: Position) -> Position:
        self.checked.append(target)
        axes = self.config.axes
        place = replace(target, theta_deg=axis_theta_deg(target.theta_deg))
        limits = ((place.x_um, axes.x), (place.y_um, axes.y), (place.z_um, axes.z), (place.theta_deg, axes.theta))
        if place.z_um < self.config.lowest_z_um:
            raise EnvelopeViolation(f"Z {place.z_um} is below the floor", device="gantry")
        for at, axis in limits:
            if not axis.minimum <= at <= axis.maximum:
                raise EnvelopeViolation(f"{at} is out of reach", device="gantry")
        return place

    async def position(self, deadline: Deadline) -> Position:
        self.asked.append(deadline)
        return self.reported

    async def homed(self, deadline: Deadline) -> bool:
        self.asked.append(deadline)
        return self.is_homed

    async def home(self, deadline: Deadline) -> None:
        self.asked.append(deadline)
        self.homings += 1
        if (trouble := self.failures.get(0)) is not None:
            raise trouble

    async def move_to(
        self,
        target: Position,
        deadline: Deadline,
        *,
        from_above: frozenset[str] = frozenset(),
        slow_z_um: float | None = None,
        clear: ClearHeight | None = None,
        approach: Approach | None = None,
    ) -> Position:
        self.asked.append(deadline)
        self.approaches.append(approach)
        self.slow_z_um.append(self.config.gantry.highest_surface_um if slow_z_um is None else slow_z_um)
        self.moves.append((target, from_above))
        self.clear_um.append(None if clear is None else clear([self.reported, target]))
        trouble = self.failures.get(len(self.moves))
        if trouble is not None:
            raise trouble
        place = replace(target, theta_deg=axis_theta_deg(target.theta_deg))
        scatter_x, scatter_y = self.scatter_um()
        play = {axis: self.backlash_um.get(axis, 0.0) if axis in from_above else 0.0 for axis in ("x", "y")}
        off_x, off_y, off_z = self.off_um
        self.reported = replace(place, x_um=place.x_um + off_x, y_um=place.y_um + off_y, z_um=place.z_um + off_z)
        self.actual = replace(
            self.reported,
            z_um=self.reported.z_um - self.lost_z_um if self.sticks_at_um is None else self.sticks_at_um,
            x_um=self.reported.x_um + scatter_x + play["x"],
            y_um=self.reported.y_um + scatter_y + play["y"],
        )
        return self.reported

    async def quick_stop(self) -> None:
        self.stopped += 1


@dataclass
class FakeLights:
    """Two lamps; `log` is what they were set to."""

    settle_s: float = 0.0
    log: list[Light] = field(default_factory=list)
    asked: list[Deadline] = field(default_factory=list)

    async def set(self, light: Light, deadline: Deadline) -> float:
        self.asked.append(deadline)
        self.log.append(light)
        return time.monotonic()


@dataclass
class FakeCamera:
    """A camera that gives one dark frame after the other at once; `asked` is after when, and by when."""

    asked: list[tuple[float, Deadline]] = field(default_factory=list)
    pixels: Any = None
    late_s: float = 0.0
    """How long after the asked moment a frame has come."""
    lost: set[int] = field(default_factory=set)
    """Which of the frames, counted from 1, do not arrive once they are exposed."""
    arrives: dict[int, asyncio.Event] = field(default_factory=dict)
    """What holds a frame back that is exposed."""

    async def frame_after(self, t_s: float, deadline: Deadline) -> Frame:
        self.asked.append((t_s, deadline))
        return frame(len(self.asked), t_s, self.late_s, self.pixels)

    async def exposed_after(self, t_s: float, deadline: Deadline) -> FakeExposed:
        self.asked.append((t_s, deadline))
        number = len(self.asked)
        taken = frame(number, t_s, self.late_s, self.pixels)
        return FakeExposed(None if number in self.lost else taken, taken.received_s, self.arrives.get(number))


@dataclass
class FakeExposed:
    """A frame that was exposed; None: it is lost."""

    taken: Frame | None
    over_s: float
    arrives: asyncio.Event | None

    async def frame(self, _deadline: Deadline) -> Frame:
        if self.arrives is not None:
            await self.arrives.wait()
        if self.taken is None:
            raise FrameLost("torn", device="camera")
        return self.taken


def frame(sequence: int, t_s: float = 0.0, late_s: float = 0.0, pixels: Any = None) -> Frame:
    """Return a frame without a picture."""
    dark = np.zeros((8, 8, 3), dtype=np.uint8) if pixels is None else pixels
    return Frame(dark, t_s, 0.02, sequence, t_s + late_s)


def hardware(gantry: FakeGantry, lights: FakeLights, camera: FakeCamera) -> Hardware:
    """Return the fakes as the devices of a station."""
    anything: Any = gantry, lights, camera
    return Hardware(*anything, {}, AsyncExitStack(), {})


class ScriptedStation(Station):
    """The real station, whose looks are computed from the truth and then edited by the test's script."""

    def __init__(self, world: World, needle: Needle | None = None) -> None:
        super().__init__(world.config, hardware(world.gantry, world.lights, world.camera), needle)
        self.world = world
        self.searches: list[Search | BoardSearch | CrossSearch | None] = []
        self.moves_next: list[bool] = []
        self.is_last: list[bool] = []
        self.measured: list[bool] = []
        """Of each look, whether a tip that is carried from another picture would not do."""
        self.script: dict[int, Edit] = {}
        """Number of a look, from 1 -> what is done to its result."""
        self.always: Edit = lambda seen: seen
        """Done to every result, before the script."""

    def fit(self, meter: Any) -> None:
        """Have another measuring instrument, or none."""
        self._hardware.meter = meter

    async def look(
        self, position: Position, model: ProbeModel | None, search: Search | BoardSearch, caller: Clocked,
        *, moves_next: bool = False, is_last: bool = False, measured: bool = False,
    ) -> LookResult:  # fmt: skip
        self.measured.append(measured)
        self.moves_next.append(moves_next)
        self.is_last.append(is_last)
        assert not caller.deadline.expired
        self.searches.append(search)
        number = len(self.searches)
        tip = self.world.see_tip() if model is not None else None
        expected = model.tip_px if model is not None else None
        look = LookResult(frame(2 * number - 1), frame(2 * number), position, tip, expected)
        if isinstance(tip, Tip) and isinstance(search, BoardSearch):
            look = replace(look, board=self.world.see_board(tip, search))
        elif isinstance(tip, Tip) and isinstance(search, Search):
            look = replace(look, seen=self.world.see_pads(tip, search))
        return self._edited(look)

    async def look_white(
        self, position: Position, model: ProbeModel, cross: CrossSearch | None, caller: Clocked,
        *, is_last: bool = False, measured: bool = False,
    ) -> LookResult:  # fmt: skip
        self.measured.append(measured)
        self.is_last.append(is_last)
        assert not caller.deadline.expired
        self.searches.append(cross)
        tip = self.world.see_tip()
        found = self.world.see_cross(tip, cross) if cross is not None else None
        return self._edited(LookResult(frame(len(self.searches)), None, position, tip, model.tip_px, cross=found))

    def _edited(self, seen: LookResult) -> LookResult:
        edited = self.script.get(len(self.searches), lambda same: same)(self.always(seen))
        self._searched(edited.tip)
        return edited


class World:
    """The truth behind a fake station: board, surface, head, camera; and the station's own idea of them."""

    def __init__(self, folder: Path, board: Board, changes: Mapping[str, dict[str, Any] | Section]) -> None:
        """Changes: of sections of the example, or whole ones that it has not."""
        config = load_config(EXAMPLE)
        for section, values in changes.items():
            whole = values if isinstance(values, Section) else getattr(config, section).model_copy(update=values)
            config = config.model_copy(update={section: whole})
        self.config, self.board = config, board
        home = Position(50_000.0, 40_000.0, WORK_Z_UM, 0.0)
        self.gantry = FakeGantry(config, home, home)
        self.lights, self.camera = FakeLights(), FakeCamera()
        self.station = ScriptedStation(self)
        self.calibrations = Calibrations(folder, config.station.name)
        self.geometry = Geometry(config, board, self.calibrations, self.station.needle.board)
        self.station.needle.adopt(self.geometry.up_z_um, self.geometry.surface_z_um)
        self.context = StationContext(config, self.station, board, self.calibrations, self.geometry)
        # --- the truth
        self.true_map = pose_map()
        self.true_pose: Rigid2 = config.board.pose()
        self.true_head: Head = config.head.model()
        self.height_um: Callable[[float, float], float] = lambda _x, _y: 0.0
        self.push_scale = 1.0
        """How far a pushed tip seems to move, beside what the map says."""
        self.pin_travel_um = math.inf
        """A pin goes in no farther: what is sent deeper crashes."""
        self.deepest_seen_um = math.inf
        """A pin that is pushed in farther is no picture of a needle."""
        self.hidden_below_um = -math.inf
        """The ground hides a tip whose Z is lower."""
        self.pads = list(board.points)
        self.strays_um: list[tuple[float, float, float]] = []
        """Round bright things CAD does not know: board x, y and diameter."""
        self.doubtful_um: list[tuple[float, float, float]] = []
        self.hidden: set[str] = set()
        """Names of pads, and of the cross, that cannot be seen."""
        self.flex_px: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0)
        """By how much camera and needle stand elsewhere at this stop; pads in the picture follow the tip."""
        self.noise_px: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0)
        """Error with which a target is seen."""
        self.cross_um = config.control_point.place_um if config.control_point else (0.0, 0.0)
        self.visible = 1.0
        self.cross_sigma_px = 0.05

    # --- what the station knows ---------------------------------------------------------------------------------

    def teach(self, tip_px: tuple[float, float] = TIP_PX) -> World:
        self.calibrations.folder.mkdir(parents=True, exist_ok=True)
        self.calibrations.store_probe(probe_model(tip_px))
        return self

    def made(self) -> dict[str, Any]:
        return {
            "station": self.config.station.name, "made_at": utc_now(), "job": "j", "seconds": 1.0, "looks": 1,
            "probe": self.calibrations.fingerprint,
        }  # fmt: skip

    def with_map(self, known: PoseMap | None = None, **changes: Any) -> World:
        raw = json.loads((known or pose_map()).to_json())
        record: dict[str, Any] = self.made() | {
            "mark": "F1", "theta_deg": 0.0, "tip_px": TIP_PX, "sightings": (), "pose_map": raw
        }  # fmt: skip
        self.calibrations.store(MapRecord(**record | changes))
        return self

    def with_head(self, head: Head) -> World:
        self.calibrations.store(self._like(rotation_record(), head=head_to_dict(head)))
        return self

    def with_surface(self, raised_um: float = 0.0, made_at: str | None = None) -> World:
        surface = surface_record(raised_um=raised_um)
        self.calibrations.store(self._like(surface, **({} if made_at is None else {"made_at": made_at})))
        return self

    def with_flat_surface(self, height_um: float = 0.0) -> World:
        """Let a level surface be in force for this board."""
        corners = [(x, y) for x in (62_000.0, 98_000.0) for y in (42_000.0, 68_000.0)]
        plane = fit_plane(np.array(corners), np.full(4, height_um))
        whole: dict[str, Any] = self.made() | {
            "residuals_um": (0.0,) * 4, "surface": plane.to_dict(), "flatness_um": 0.0,
            "rms_um": 0.0, "limit_um": 50.0, "planar": True,
            "touches": tuple(Touch(x_um=x, y_um=y, height_um=height_um) for x, y in corners),
        }  # fmt: skip
        self.calibrations.store(SurfaceRecord(**whole))
        return self

    def _like(self, record: RotationRecord | SurfaceRecord, **changes: Any) -> RotationRecord | SurfaceRecord:
        return record.model_copy(update=self.made() | changes)

    def with_alignment(
        self, pose: Rigid2, scale: float = 1.0, seat: Seat | None = None, board_id: str | None = None
    ) -> World:
        record: dict[str, Any] = self.made() | {
            "board": self.board.name, "side": self.board.side, "theta_deg": pose.theta_deg, "scale": scale,
            "tx_um": pose.tx_um, "ty_um": pose.ty_um, "rms_um": 3.0, "seat": seat, "board_id": board_id,
            "fiducials": (
                Aligned(name="F1", board_um=(0.0, 0.0), robot_um=(0.0, 0.0), residual_um=(0.0, 0.0), views=1),
            ),
        }  # fmt: skip
        self.calibrations.store(AlignmentRecord(**record))
        return self

    # --- where things really are --------------------------------------------------------------------------------

    def tip_um(self) -> Any:
        at = self.gantry.actual
        return np.array((at.x_um, at.y_um)) + self.true_head.tip_offset_um(at.theta_deg)

    def pad_um(self, name: str) -> Any:
        return self.true_pose.apply(self.board.find(name).place_um)

    def miss_um(self, name: str) -> Any:
        """Return the way from the tip to a pad, as it really is."""
        return self.pad_um(name) - self.tip_um()

    def put_tip(self, place_um: Any, theta_deg: float = 0.0, z_um: float = WORK_Z_UM) -> None:
        """Place the head so that the tip really is there."""
        x_um, y_um = np.asarray(place_um, dtype=float) - self.true_head.tip_offset_um(theta_deg)
        at = Position(float(x_um), float(y_um), z_um, axis_theta_deg(theta_deg))
        self.gantry.reported = self.gantry.actual = at

    def put_beside(self, name: str, miss_um: tuple[float, float], theta_deg: float = 0.0) -> None:
        """Place the head so that the pad is `miss_um` away from the tip."""
        self.put_tip(self.pad_um(name) - miss_um, theta_deg)

    # --- what the camera sees -----------------------------------------------------------------------------------

    def _lift_um(self, place_um: Any) -> tuple[float, float]:
        """Return the tip's height above working height, and how far the pin is pushed in, at the present place."""
        z_um, gantry = self.gantry.actual.z_um, self.config.gantry
        surface_um = gantry.touch_z_um + self.height_um(float(place_um[0]), float(place_um[1]))
        return z_um - gantry.work_z_um, min(self.pin_travel_um, max(0.0, surface_um - z_um))

    def see_tip(self) -> Tip | NotFound:
        _, push_um = self._lift_um(self.tip_um())
        if push_um > self.deepest_seen_um or self.gantry.actual.z_um < self.hidden_below_um:
            return NotFound(Reason.NO_NEEDLE, "no needle")
        flex, shift = self.flex_px(), -push_um / HOVER_UM * self.push_scale * np.array(BELOW_PX)
        return found_tip(float(TIP_PX[0] + flex[0] + shift[0]), float(TIP_PX[1] + flex[1] + shift[1]))

    def to_px(self, robot_um: Any, tip: Tip) -> tuple[float, float]:
        """Return where a place of the surface appears; the picture moves as a whole with the tip."""
        place = np.asarray(robot_um, dtype=float)
        lift_um, _ = self._lift_um(place)
        height_um = self.height_um(float(place[0]), float(place[1])) - lift_um
        at = self.gantry.actual
        px = self.true_map.to_px(place - self.tip_um(), TIP_PX, at.theta_deg, height_um=height_um)[0]
        noise = self.noise_px()
        return (
            float(px[0] + tip.x_px - TIP_PX[0] + noise[0]),
            float(px[1] + tip.y_px - TIP_PX[1] + noise[1]),
        )

    def see_pads(self, tip: Tip, search: Search) -> Seen:
        scale = self.true_map.scale_px_per_um(TIP_PX)
        around = tip.x_px + search.offset_px[0], tip.y_px + search.offset_px[1]
        things: Sequence[tuple[tuple[float, float], float]] = [
            *((p.place_um, p.diameter_um) for p in self.pads if p.name not in self.hidden),
            *(((x, y), d) for x, y, d in self.strays_um),
        ]
        taken = []
        for place, diameter in things:
            if search.expected_radius_px and abs(diameter / 2 * scale / search.expected_radius_px - 1.0) > 0.25:
                continue
            px = self.to_px(self.true_pose.apply(place), tip)
            if math.dist(px, around) <= search.reach_px:
                taken.append(pad_seen(*px, diameter / 2 * scale, self.visible))
        taken.sort(key=lambda p: math.dist((p.x_px, p.y_px), around))
        doubtful = [
            doubtful_object(*self.to_px(self.true_pose.apply((x, y)), tip), d / 2 * scale)
            for x, y, d in self.doubtful_um
        ]
        return Seen(taken[0] if taken else missing(), tuple(taken), (), tuple(doubtful), (0, 0, 1600, 1200))

    def see_board(self, tip: Tip, search: BoardSearch) -> BoardSeen:
        """Register exactly: the board is where it really is."""
        about = search.reference.about_um
        place = about if search.target is None else (search.target.x_um, search.target.y_um)
        board_to_px = search.view.board_to_px(tip, about)
        target_px = self.to_px(self.true_pose.apply(place), tip)
        back = np.linalg.inv(board_to_px) @ (*target_px, 1.0)
        there = float(back[0] / back[2]), float(back[1] / back[2])
        found = registered(there, target_px, (there[0] - place[0], there[1] - place[1]))
        moved = search.last is not None and math.dist(found.shift_um, search.last.shift_um) > 120.0
        return BoardSeen(found, board_to_px, (), search, moved=moved)

    def see_cross(self, tip: Tip | NotFound, search: CrossSearch) -> ControlPoint | NotFound | None:
        if not isinstance(tip, Tip):
            return None
        px = self.to_px(self.cross_um, tip)
        around = tip.x_px + search.offset_px[0], tip.y_px + search.offset_px[1]
        if "control point" in self.hidden or math.dist(px, around) > search.reach_px:
            return missing(Reason.NO_CONTROL_POINT)
        return ControlPoint(*px, self.cross_sigma_px, ())


@dataclass
class Ran:
    """What a job did: its outcome, and all it told on the way."""

    job: JobContext
    machine: Machine
    events: list[Event]
    steps: list[tuple[str, dict[str, Any]]]
    progress: list[tuple[int, int, str]]
    outcome: Outcome | None = None

    @property
    def got(self) -> Outcome:
        assert self.outcome is not None
        return self.outcome


def begin(request: dict[str, Any] | AnyJob, touching: Touching | None = None, *, mark_of: MarkOf = nothing_said) -> Ran:
    """Return a job that was just triggered, on a real state machine."""
    asked = OPERATIONS.parse({"v": 1, "id": "job-1", **request}) if isinstance(request, dict) else request
    events: list[Event] = []
    machine = Machine(lambda _before, event, _after: events.append(event))
    machine.fire(Event.CLEARED)
    machine.fire(Event.TRIGGER)
    events.clear()
    steps: list[tuple[str, dict[str, Any]]] = []
    progress: list[tuple[int, int, str]] = []

    async def keep_step(kind: StepKind, body: dict[str, Any]) -> None:
        assert kind in get_args(StepKind), "the journal keeps no such step"
        steps.append((kind, body))

    job = JobContext(
        cast("AnyJob", asked),
        Deadline.after(60.0),
        machine.fire,
        keep_step,
        lambda *told: progress.append(told),
        touching,
        mark_of=mark_of,
    )
    return Ran(job, machine, events, steps, progress)


async def run(world: World, procedure: Procedure, request: dict[str, Any], ran: Ran | None = None) -> Ran:
    """Run a job to its end; it must leave the machine where `on_target` may follow (`home` and the like included)."""
    ran = ran or begin(request)
    try:
        ran.outcome = await procedure(ran.job, world.context)
    finally:
        await ran.job.settle()
    ran.machine.fire(Event.ON_TARGET)
    assert ran.machine.state is State.IDLE
    ran.events.pop()
    return ran


def a_board(*points: tuple[str, float, float], diameter_um: float = 500.0, kind: Any = "site") -> Board:
    """Return a board of pads of one size."""
    listed = tuple(BoardPoint(name=n, kind=kind, x_um=x, y_um=y, diameter_um=diameter_um) for n, x, y in points)
    return Board(name="b", side="top", width_um=40_000.0, height_um=30_000.0, points=listed)
