"""The configuration: one TOML file, one typed tree, every error at once with its path.

Nothing is repaired or dropped: a bad file is refused whole. Limits and addresses have no defaults, for a guessed limit
moves a needle into something.
"""

from __future__ import annotations

import re
import stat
import tomllib
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from daemon.config.watch_names import is_known
from daemon.domain.roles import Role
from daemon.platform.plain_file import read_small
from vision.geometry import Rigid2
from vision.head import CircleHead

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
CLEAR_UM = 100.0
"""Between the needle and the highest possible surface."""
LOOPBACK = re.compile(r"ipc://.+|tcp://(127(\.\d{1,3}){3}|\[::1\]|localhost):(\d+|\*)")

MOST_BYTES, LONGEST_LINE = 250_000, 1_000
"""A key of many dots costs the parser the square of their number: one of 50,000 takes minutes."""


class ConfigError(Exception):
    """Say all that is wrong with a configuration, each with its path."""

    def __init__(self, path: Path, problems: list[tuple[str, str]]) -> None:
        self.path = path
        self.problems = problems
        lines = [f"{path}: {len(problems)} problem{'s' if len(problems) > 1 else ''}"]
        super().__init__("\n".join(lines + [f"  {where}: {what}" for where, what in problems]))


class Section(BaseModel):
    """Base of every table: frozen, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class StationSection(Section):
    """Who the station is and where it keeps its things."""

    name: str = Field(min_length=1, max_length=64, description="stands in every result and event")
    data_dir: Path = Field(description="journal, pictures, calibrations; relative to the configuration file")
    pictures: Literal["failed", "all", "none"] = Field(default="failed", description="of which jobs pictures are kept")
    pictures_quota_mb: Positive = Field(default=500.0, description="oldest pictures go beyond this")


class BusSection(Section):
    """One RS-485 line: a serial port, or a host that carries RTU frames over TCP."""

    port: str | None = Field(default=None, description="serial device, best a stable name from udev")
    baudrate: int = Field(default=115200, ge=1200, le=1_000_000)
    parity: Literal["N", "E", "O"] = "E"
    stopbits: Literal[1, 2] = 1
    host: str | None = Field(default=None, description="instead of a port")
    tcp_port: int = Field(default=502, ge=1, le=65535)
    framing: Literal["rtu", "tcp"] = Field(default="rtu", description="with a host: RTU frames over TCP, or Modbus TCP")
    timeout_ms: float = Field(default=200.0, ge=10, le=5000, description="longest wait for one reply")
    gap_ms: float = Field(default=3.0, ge=0, le=100, description="silence before the next request (manual: 3 ms)")
    local_echo: bool = Field(default=False, description="the adapter hears itself: its echo is taken off each reply")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.port is None) == (self.host is None):
            raise ValueError("give either port or host")
        return self


class ObjectAccessSection(Section):
    """How a drive wants its object dictionary asked (FC 43); the manual leaves these open."""

    index_order: Literal["big", "little"]
    node: int = Field(ge=0, le=247)
    write_flag: int = Field(default=1, ge=0, le=255)


class AxisSection(Section):
    """One drive. Units: um for x, y, z and degrees for theta."""

    bus: str
    address: int = Field(ge=1, le=247)
    increments_per_unit: Finite = Field(description="drive increments per um or degree; negative turns the axis round")
    minimum: Finite = Field(description="lowest allowed coordinate")
    maximum: Finite = Field(description="highest allowed coordinate")
    speed: Positive = Field(description="units per second")
    acceleration: Positive = Field(description="units per second squared")
    homing_method: int = Field(description="6098h")
    homing_speed: Positive
    homing_position: Finite = Field(default=0.0, description="coordinate of the homing switch")
    word_order: Literal["auto", "big", "little"] = Field(
        default="auto", description="auto: found at start, nothing moves"
    )
    object_access: ObjectAccessSection | None = Field(default=None, description="none: found at start, nothing moves")
    vendor_id: int = Field(default=0x26C, ge=0, le=0xFFFF_FFFF, description="1018h:01; another one is refused at start")
    motor_mode: int | None = Field(
        default=None, ge=0, le=0xFFFF, description="3202h as it has to be; none: anything that can be a motor mode"
    )
    switch_inputs: int | None = Field(
        default=None,
        ge=0,
        le=0xFFFF_FFFF,
        description="3240h:01, written at start; bit 0 negative limit, 1 positive limit, 2 home; none: left as it is",
    )
    state_timeout_ms: float = Field(
        default=500.0, ge=50, le=10_000, description="longest wait for one change of state, mode or set-point"
    )
    stall_ms: float = Field(
        default=2000.0, ge=100, le=60_000, description="standing still this long short of the target is a stall"
    )

    @model_validator(mode="after")
    def _sane(self) -> Self:
        if self.minimum >= self.maximum:
            raise ValueError(f"minimum {self.minimum} is not below maximum {self.maximum}")
        if self.increments_per_unit == 0:
            raise ValueError("increments_per_unit is zero")
        return self


class AxesSection(Section):
    """The four axes."""

    x: AxisSection
    y: AxisSection
    z: AxisSection
    theta: AxisSection


class GantrySection(Section):
    """How the four axes move as one machine."""

    safe_z_um: Finite = Field(description="height at which the head may move sideways")
    work_z_um: Finite = Field(description="height of every look over a surface at touch_z_um; the map is for it")
    touch_z_um: Finite = Field(description="height at which the tip touches the board, if it lies as it should")
    press_um: float = Field(
        default=0.0,
        ge=0,
        le=500,
        description="how far the pin may be pushed in to measure a surface; 0: never",
    )
    surface_range_um: float = Field(
        default=500.0, ge=0, le=2000, description="a surface lies within this of touch_z_um, above or below"
    )
    overtravel_um: float = Field(default=300.0, ge=0, le=1000, description="most that the pin may ever be pushed in")
    descent_speed: float = Field(
        default=2000.0, gt=0, le=2000, description="of Z below the highest possible surface, um per second"
    )
    approach_um: NotNegative = Field(default=200.0, description="overshoot for the one-sided approach")
    approach_deg: NotNegative = Field(default=0.5, description="the same for the head's angle")
    settle_ms: NotNegative = Field(default=60.0, description="vibration after a move dies out within this")

    @model_validator(mode="after")
    def _heights(self) -> Self:
        if not self.touch_z_um <= self.work_z_um < self.safe_z_um:
            raise ValueError("heights must be touch_z_um <= work_z_um < safe_z_um")
        if self.free_z_um >= self.safe_z_um:
            raise ValueError(
                f"safe_z_um must be above touch_z_um + surface_range_um + {CLEAR_UM:.0f}: a board there is hit"
            )
        return self

    @property
    def highest_surface_um(self) -> float:
        """Z at which the needle may first meet a surface of which nothing is known."""
        return self.touch_z_um + self.surface_range_um

    @property
    def free_z_um(self) -> float:
        """Z at which the needle is free of any surface that is possible."""
        return self.highest_surface_um + CLEAR_UM

    @property
    def floor_z_um(self) -> float:
        """Z below which the needle is never sent: the lowest possible surface minus the most overtravel."""
        return self.touch_z_um - self.surface_range_um - max(self.overtravel_um, self.press_um)


class LightsSection(Section):
    """The two rings: a Modbus relay board on a bus, or a serial relay of its own."""

    kind: Literal["modbus", "serial"]
    bus: str | None = None
    address: int = Field(default=1, ge=1, le=255)
    port: str | None = None
    white: int = Field(default=0, ge=0, le=31, description="coil (modbus, from 0) or channel (serial, from 1)")
    red: int = Field(default=1, ge=0, le=31)
    settle_ms: NotNegative = Field(default=40.0, description="relay and lamp are steady after this")
    dark_level: float = Field(
        default=60.0, ge=0.0, le=255.0, description="with both lamps off nothing is brighter; 0: not looked at"
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "modbus" and self.bus is None:
            raise ValueError("kind modbus needs bus")
        if self.kind == "serial" and self.port is None:
            raise ValueError("kind serial needs port")
        if self.white == self.red:
            raise ValueError("white and red are the same switch")
        return self


class CameraSection(Section):
    """The camera on the head."""

    kind: Literal["v4l2", "stream"]
    device: str | None = Field(default=None, description="v4l2: path, best a stable name from udev")
    endpoint: str | None = Field(default=None, description="stream: ZeroMQ endpoint of the frame server")
    encoding: Literal["mjpg", "bgr8"] = "mjpg"
    width: int = Field(default=1600, ge=320, le=8192)
    height: int = Field(default=1200, ge=240, le=8192)
    exposure_us: int | None = Field(default=20_000, gt=0, le=1_000_000)
    gain: int | None = None
    focus: int | None = None
    white_balance_k: int | None = Field(default=4600, ge=1000, le=20_000)
    pitch_um: Positive = Field(
        default=12.0, description="about how much one pixel shows at the tip; only a start value"
    )
    timeout_ms: Positive = Field(default=3000.0, description="longest wait for one frame")
    frozen_ms: float = Field(
        default=1000.0, ge=50, le=60_000, description="without a new frame for this long it is opened again"
    )
    open_ms: float = Field(default=10_000.0, ge=500, le=120_000, description="longest wait for it to open")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "v4l2" and self.device is None:
            raise ValueError("kind v4l2 needs device")
        if self.kind == "stream" and self.endpoint is None:
            raise ValueError("kind stream needs endpoint")
        return self


class HeadSection(Section):
    """Where the tip is from the head's position: a circle round the axis of rotation."""

    radius_um: Positive
    phase_deg: Finite

    def model(self) -> CircleHead:
        """Return it as a head without run-out."""
        return CircleHead(self.radius_um, self.phase_deg)


class ControlPointSection(Section):
    """The printed four-arm cross beside the board (thesis appendix C) on which the head's rotation is calibrated."""

    x_um: Finite = Field(description="its centre in the robot frame, within servo.max_placement_um")
    y_um: Finite
    arm_um: float = Field(default=720.0, ge=200, le=5000, description="length of an arm from the centre")

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is."""
        return self.x_um, self.y_um


class BoardSection(Section):
    """The board under test and where it nominally lies."""

    file: Path = Field(description="made by `reprobe board`; relative to the configuration file")
    origin_x_um: Finite = Field(description="robot x of the outline's lower left corner, seen from the probed side")
    origin_y_um: Finite
    rotation_deg: Finite = 0.0

    def pose(self) -> Rigid2:
        """Return board frame -> robot frame."""
        return Rigid2(self.rotation_deg, self.origin_x_um, self.origin_y_um)


class ServoSection(Section):
    """When a correction is good, and when it must give up."""

    tolerance_um: Positive = Field(default=15.0, description="on target within this")
    max_moves: int = Field(default=8, ge=1, le=20)
    max_placement_um: Positive = Field(default=700.0, description="largest placement error that can be corrected")
    scatter_um: Positive = Field(
        default=40.0, description="3 sigma of two stops' scatter: below it errors grow by chance"
    )
    match_um: Positive = Field(default=120.0, description="a pad seen and one of CAD's agree within this")
    trusted_um: Positive = Field(
        default=120.0, description="where head and board are calibrated, a pad is within this of its nominal place"
    )
    calibration_days: Positive = Field(default=30.0, description="a map older than this is not used")
    job_timeout_s: Positive = Field(default=60.0, description="deadline of a job that brings none")
    calibration_timeout_s: Positive = Field(default=3600.0, description="the same for calibrations and alignments")


def is_local(endpoint: str) -> bool:
    """Whether only this computer reaches an endpoint."""
    return LOOPBACK.fullmatch(endpoint) is not None


class ApiSection(Section):
    """Where testers reach the daemon."""

    control: str = "tcp://127.0.0.1:5555"
    events: str = "tcp://127.0.0.1:5556"
    max_message_bytes: int = Field(default=1_000_000, ge=1024, description="more is refused before it is decoded")
    queue_length: int = Field(default=16, ge=1, le=1000, description="jobs that may wait")
    queue_per_client: int = Field(default=8, ge=1, le=1000, description="jobs of one client that may wait")
    rate_per_s: Positive = Field(default=2000.0, description="requests of one client, in the long run")
    rate_burst: int = Field(default=2000, ge=1, le=1_000_000, description="requests of one client at once")
    curve: bool = Field(default=False, description="ask every client for a key (CURVE); see `reprobe keys`")
    keys_dir: Path = Field(default=Path("keys"), description="made by `reprobe keys`; relative to this file")
    role: Role = Field(default="maintain", description="of every client, without CURVE")
    heartbeat_s: Positive = Field(default=1.0, description="pace of the heartbeat")

    @model_validator(mode="after")
    def _local(self) -> Self:
        for endpoint in (self.control, self.events):
            if not is_local(endpoint) and not self.curve:
                raise ValueError(
                    f"{endpoint} is reachable from outside; only loopback and ipc are served without keys: "
                    "make them by `reprobe keys new`, then set curve = true"
                )
        return self


class MaintenanceSection(Section):
    """What the station watches of itself; `reprobe health` shows it."""

    baseline: int = Field(default=60, ge=10, le=1000, description="numbers from which a chart learns what is usual")
    batch: int = Field(default=5, ge=2, le=50, description="numbers averaged to one point of a chart")
    probe_life_touches: int = Field(default=100_000, ge=100, description="touches after which a probe is to be changed")
    check_s: float = Field(default=300.0, ge=1.0, le=86400.0, description="devices are looked at this often at rest")
    idle_check_s: float = Field(default=2.0, gt=0, le=60.0, description="pause between two checks of drives at rest")
    idle_check_within_s: float = Field(
        default=2.0, gt=0, le=60.0, description="what one check may take beside the time of its requests on the line"
    )
    keep_rows: int = Field(default=60_000, ge=1000, le=10_000_000, description="measurements kept; the oldest go")
    off: tuple[str, ...] = Field(default=(), description="watches not wanted, by name or group")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.baseline < 5 * self.batch:
            raise ValueError(f"a baseline of {self.baseline} is too short for batches of {self.batch}: five at least")
        return self


class MetricsSection(Section):
    """Prometheus metrics, on loopback only."""

    port: int = Field(default=0, ge=0, le=65535, description="of http://127.0.0.1:PORT/metrics; 0: not served")


class Config(Section):
    """The whole configuration."""

    station: StationSection
    bus: dict[str, BusSection] = Field(min_length=1)
    axes: AxesSection
    gantry: GantrySection
    lights: LightsSection
    camera: CameraSection
    head: HeadSection
    board: BoardSection
    control_point: ControlPointSection | None = None
    servo: ServoSection = ServoSection()
    api: ApiSection = ApiSection()
    metrics: MetricsSection = MetricsSection()
    maintenance: MaintenanceSection = MaintenanceSection()

    @model_validator(mode="after")
    def _across(self) -> Self:
        for name in ("x", "y", "z", "theta"):
            bus = getattr(self.axes, name).bus
            if bus not in self.bus:
                raise ValueError(f"axes.{name}.bus names {bus!r}, which is not under [bus]")
        if self.lights.kind == "modbus" and self.lights.bus not in self.bus:
            raise ValueError(f"lights.bus names {self.lights.bus!r}, which is not under [bus]")
        for (bus, address), users in self._addresses().items():
            if len(users) > 1:
                raise ValueError(f"{' and '.join(users)} have the same address {address} on bus {bus!r}")
        for watch in self.maintenance.off:
            if not is_known(watch, self.bus):
                raise ValueError(f"maintenance.off names {watch!r}, which is no watch; `reprobe health` lists them")
        z = self.axes.z
        heights = {name: getattr(self.gantry, name) for name in ("safe_z_um", "work_z_um", "touch_z_um")}
        heights["touch_z_um - press_um"] = self.gantry.touch_z_um - self.gantry.press_um
        for name, height in heights.items():
            if not z.minimum <= height <= z.maximum:
                raise ValueError(f"gantry.{name} = {height} lies outside axes.z {z.minimum}..{z.maximum}")
        return self

    @property
    def lowest_z_um(self) -> float:
        """The lowest that Z is ever sent: the axis' own minimum, or the floor where that is higher."""
        return max(self.axes.z.minimum, self.gantry.floor_z_um)

    def _addresses(self) -> dict[tuple[str, int], list[str]]:
        """Return who has which address on which line."""
        users: dict[tuple[str, int], list[str]] = {}
        for name in ("x", "y", "z", "theta"):
            axis = getattr(self.axes, name)
            users.setdefault((axis.bus, axis.address), []).append(f"axes.{name}")
        if self.lights.kind == "modbus" and self.lights.bus is not None:
            users.setdefault((self.lights.bus, self.lights.address), []).append("lights")
        return users


def load_config(path: Path) -> Config:
    """Read and check a configuration; raise `ConfigError` naming every problem."""
    try:
        text = read_small(path, MOST_BYTES).decode()
        if any(len(line) > LONGEST_LINE for line in text.splitlines()):
            raise ConfigError(path, [("(file)", f"it has a line of more than {LONGEST_LINE} letters")])
        raw = tomllib.loads(text)
    except OSError as exc:
        raise ConfigError(
            path, [("(file)", f"cannot be read: {exc.strerror}; give the path of a station.toml")]
        ) from exc
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as exc:
        raise ConfigError(path, [("(file)", f"is not TOML: {exc}")]) from exc
    except RecursionError:
        # Its thousand frames say nothing; they are let go of here.
        raise ConfigError(path, [("(file)", "its tables and lists are nested too deeply")]) from None
    try:
        config = Config.model_validate(raw)
    except ValidationError as exc:
        problems = [(".".join(str(p) for p in e["loc"]) or "(cross-check)", e["msg"]) for e in exc.errors()]
        raise ConfigError(path, problems) from exc
    _require_own(path, strict=config.api.curve)
    return _resolved(config, path.resolve().parent)


def _require_own(path: Path, *, strict: bool) -> None:
    """Refuse a file that anybody could change; `strict`: also one that its group could."""
    mode = path.stat().st_mode
    if mode & (stat.S_IWOTH | (stat.S_IWGRP if strict else 0)):
        problem = f"can be changed by others (mode {stat.S_IMODE(mode):04o}); chmod go-w it"
        raise ConfigError(path, [("(file)", problem)])


def _resolved(config: Config, base: Path) -> Config:
    """Make relative paths relative to the configuration file, not to where the daemon is started."""
    station = config.station.model_copy(update={"data_dir": base / config.station.data_dir})
    board = config.board.model_copy(update={"file": base / config.board.file})
    api = config.api.model_copy(update={"keys_dir": base / config.api.keys_dir})
    return config.model_copy(update={"station": station, "board": board, "api": api})
