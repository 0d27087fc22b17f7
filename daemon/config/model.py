"""The configuration: one TOML file, one typed tree, every error at once with its path.

Nothing is repaired or dropped: a bad file is refused whole. Limits and addresses have no defaults, for a guessed limit
moves a needle into something.
"""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from daemon.config.cross_checks import CLEAR_UM, is_endpoint
from daemon.config.paths import resolved
from daemon.config.problems import ConfigError, Unlikely
from daemon.config.reading import read_checked, read_unlikely
from daemon.domain.point_test import Rung
from daemon.domain.roles import Role
from drivers.meter import DEFAULT_FUNCTIONS, WITHOUT_NPLC, WITHOUT_RANGE, Function, Method, parse_address
from vision.geometry import Rigid2
from vision.head import CircleHead

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
LOOPBACK = re.compile(r"ipc://.+|tcp://(127(\.\d{1,3}){3}|\[::1\]|localhost)(:(\d+|\*))?")

__all__ = ["Config", "ConfigError", "load_config", "unlikely"]


class Section(BaseModel):
    """Base of every table: frozen, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class StationSection(Section):
    """Who the station is and where it keeps its things."""

    name: str = Field(min_length=1, max_length=64, description="stands in every result and event")
    data_dir: Path = Field(description="journal, pictures, calibrations; relative to the configuration file")
    pictures: Literal["failed", "all", "none"] = Field(default="failed", description="of which jobs pictures are kept")
    pictures_quota_mb: Positive = Field(default=500.0, description="oldest pictures go beyond this")
    needle: str | None = Field(
        default=None,
        min_length=1,
        max_length=64,
        description="serial number of the needle in it; every record tells it",
    )

    @property
    def journal(self) -> Path:
        """Where the journal is kept."""
        return self.data_dir / "journal.sqlite"


class BusSection(Section):
    """One RS-485 line: a serial port, or a host that carries RTU frames over TCP."""

    port: str | None = Field(
        default=None, description="serial device, best a stable name from udev; or a path below this file's folder"
    )
    baudrate: int = Field(default=115200, ge=1200, le=1_000_000)
    parity: Literal["N", "E", "O"] = "E"
    stopbits: Literal[1, 2] = 1
    host: str | None = Field(default=None, description="instead of a port")
    tcp_port: int = Field(default=502, ge=1, le=65535)
    framing: Literal["rtu", "tcp"] = Field(default="rtu", description="with a host: RTU frames over TCP, or Modbus TCP")
    timeout_ms: float = Field(default=200.0, ge=10, le=5000, description="longest wait for one reply")
    gap_ms: float = Field(default=3.0, ge=0, le=100, description="silence before the next request (manual: 3 ms)")
    local_echo: bool = Field(default=False, description="the adapter hears itself: its echo is taken off each reply")


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
    homing_method: int = Field(description="6098h; 17, 18: negative, positive limit switch; 19..22: home switch")
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


class ClearanceSection(Section):
    """What lets the head go sideways lower than at safe_z_um; without this section it never does.

    The needle, its barrel and the rest of the head count from the needle's free end. Heights are above the board's
    surface. What is not told counts as free at safe_z_um only.
    """

    clear_um: float = Field(
        default=300.0, ge=150, le=5000, description="between the head and what it passes over: surface, part or nest"
    )
    needle_radius_um: Positive = Field(default=500.0, description="of the needle below its barrel, at most")
    barrel_from_um: Positive = Field(default=2000.0, description="the barrel's foot is so high above the needle's end")
    barrel_radius_um: Positive = Field(default=1500.0, description="of the barrel, at most")
    head_from_um: Positive = Field(
        default=6000.0, description="nothing else on the head, camera and lamps too, is lower above the needle's end"
    )
    head_box_um: tuple[Finite, Finite, Finite, Finite] = Field(
        default=(-60_000.0, -60_000.0, 60_000.0, 60_000.0),
        description="about the needle at head angle 0, nothing of the head is farther: x0, y0, x1, y1",
    )
    outline_um: NotNegative = Field(
        default=8000.0,
        description="a part reaches no farther beyond its outline in the board file; with courtyards 500 will do",
    )
    solder_um: NotNegative = Field(default=500.0, description="solder on a pad is no higher")
    lead_um: NotNegative = Field(default=3000.0, description="a lead that comes through the board is no longer")
    nest_um: NotNegative | None = Field(
        default=None, description="nothing beside the board, or through its large holes, is higher; none: not known"
    )
    heights_um: dict[Annotated[str, Field(pattern=r"^[A-Z]+$")], NotNegative] = Field(
        default={}, description="parts whose names begin with these letters are no higher"
    )
    bare: bool = Field(default=False, description="no parts are fitted: a board file without any is believed")


class TouchSection(Section):
    """How a touch for a measurement goes down, and how often a pad may be touched."""

    overtravel_um: float | None = Field(
        default=None,
        ge=20,
        le=1000,
        description="how far the pin is pushed in where a request says nothing; none: gantry.overtravel_um",
    )
    approach_um: float = Field(
        default=300.0, ge=50, le=2000, description="Z goes slowly from so far above the measured surface"
    )
    dwell_ms: float = Field(default=30.0, ge=0, le=1000, description="the contact has settled after this")
    placed_within_s: float = Field(
        default=60.0, gt=0, le=3600, description="a point is touched no later than this after `place` or `correct`"
    )
    touches_per_pad: int = Field(default=8, ge=1, le=1000, description="of one board in its life, named by `align`")
    presses_per_pad: int = Field(
        default=8, ge=1, le=1000, description="the same for pushes of the pin, with those of pumping"
    )


class PinSection(Section):
    """The sprung pin, from its data sheet."""

    travel_um: float = Field(default=1000.0, ge=100, le=20_000, description="its full stroke")
    preload_n: float = Field(default=0.3, ge=0, le=20, description="force at the beginning of the stroke")
    rate_n_per_mm: float = Field(default=0.6, ge=0, le=100, description="by which the force grows")

    @property
    def stroke_um(self) -> float:
        """How far it may be pushed in: two thirds of its travel, the recommended stroke of makers of spring probes."""
        return self.travel_um * 2 / 3

    def force_n(self, pressed_um: float) -> float:
        """Return its force when it is pushed in; 0 where it is free."""
        return self.preload_n + self.rate_n_per_mm * pressed_um / 1e3 if pressed_um > 0 else 0.0


class SenseSection(Section):
    """Touch sense: an input of the Z drive that closes when the needle stands on metal."""

    kind: Literal["none", "drive_input"] = Field(default="none", description="where it is wired to")
    input: int = Field(default=4, ge=1, le=16, description="drive_input: number of the Z drive's input, as on its plug")
    closed: Literal["high", "low"] = Field(default="high", description="level of the input on metal")


class LadderSection(Section):
    """What a probe does at a point that gives no pass at once, in which order, and what it believes."""

    order: tuple[Rung, ...] = Field(
        default=(Rung.LOOK, Rung.PUMP, Rung.REFERENCE, Rung.SECOND_SITE),
        description="after the first touch: look, pump, reference, second_site; what is left out is never done",
    )
    touches_per_visit: int = Field(default=3, ge=1, le=100, description="descents onto a pad in one test of it")
    pumps: int = Field(default=3, ge=1, le=10, description="strokes between half and full press")
    harder: float = Field(default=1.5, ge=1.0, le=3.0, description="press at a second site, as a share of the first's")
    proof_max_ohm: Positive = Field(default=10.0, description="contact is proved up to this between the needle's wires")
    continuity_max_ohm: Positive = Field(default=10.0, description="a net is whole up to this, where no limit is given")
    settled_share: float = Field(default=0.05, gt=0, le=1, description="three readings that agree within this count")
    settle_max_ms: float = Field(default=500.0, ge=10, le=10_000, description="longest wait for such readings")
    measure_max_ms: float = Field(
        default=6000.0, ge=100, le=60_000, description="of all that is measured in one press; then the needle goes up"
    )
    reference_good_s: float = Field(
        default=60.0,
        gt=0,
        le=3600,
        description="no open is accused unless the reference pad was good so shortly before",
    )

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        if Rung.TOUCH in self.order:
            raise ValueError("order holds what follows the first touch; leave out touch itself")
        if Rung.PATH in self.order:
            raise ValueError("order names no path: it is taken by itself, where an accusation hangs on it")
        if len(set(self.order)) < len(self.order):
            raise ValueError("order names a rung twice")
        return self


class ReferenceSection(Section):
    """The reference pad: gold beside the board, joined to the instrument's return; a good needle reads next to none."""

    x_um: Finite = Field(description="its middle, robot frame")
    y_um: Finite
    z_um: Finite | None = Field(default=None, description="Z at which the needle meets it; none: gantry.touch_z_um")
    max_ohm: Positive = Field(
        default=1.0, description="a needle that reads more is dirty, worn or broken; leads included"
    )
    tare_s: float = Field(
        default=900.0,
        gt=0,
        le=86_400,
        description="age up to which its last reading is subtracted from values; then a run measures it again",
    )

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is."""
        return self.x_um, self.y_um


class BrushSection(Section):
    """The brush beside the board, onto which a bad needle is lowered."""

    x_um: Finite = Field(description="its middle, robot frame")
    y_um: Finite
    z_um: Finite | None = Field(default=None, description="Z at which the needle meets it; none: gantry.touch_z_um")
    touches: int = Field(default=3, ge=1, le=20, description="so often it is lowered each time")

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is."""
        return self.x_um, self.y_um


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
    first_landing_um: Positive = Field(
        default=80.0, description="99 of 100 first landings end within this of their target, before any look"
    )
    landing_um: Positive = Field(default=40.0, description="the same for landings that a look has verified")
    tip_radius_um: float = Field(
        default=25.0, ge=0.0, le=1000.0, description="of the needle's end; so much more bare metal it needs about it"
    )
    calibration_days: Positive = Field(default=30.0, description="a map older than this is not used")
    job_timeout_s: Positive = Field(default=60.0, description="deadline of a job that brings none")
    calibration_timeout_s: Positive = Field(default=3600.0, description="the same for calibrations and alignments")


def is_local(endpoint: str) -> bool:
    """Whether only this computer reaches an endpoint."""
    return LOOPBACK.fullmatch(endpoint) is not None


class ApiSection(Section):
    """Where testers reach the daemon."""

    control: str = Field(default="tcp://127.0.0.1:5555", description="where is asked, such as tcp://127.0.0.1:5555")
    events: str = Field(default="tcp://127.0.0.1:5556", description="where is told, such as tcp://127.0.0.1:5556")
    live: str = Field(default="", description="where live pictures are published; empty: nowhere")
    live_fps: float = Field(default=5.0, gt=0, le=5.0, description="live pictures a second, while somebody looks")
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
        for endpoint in filter(None, (self.control, self.events, self.live)):
            if is_endpoint(endpoint) and not is_local(endpoint) and not self.curve:
                raise ValueError(
                    f"{endpoint} is reachable from outside; only loopback and ipc are served without keys: "
                    "make them by `reprobe keys new`, then set curve = true"
                )
        return self


ScpiText = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[ -~]+$")]
"""One message to an instrument: ASCII in one line."""


class MeterMethodSection(Section):
    """How one method is measured."""

    function: Function | None = Field(default=None, description="of the instrument; none: the method's own")
    range: Positive | None = Field(default=None, description="largest value expected, ohm, V or F; none: automatic")
    nplc: Positive | None = Field(default=None, description="integration time in cycles of the mains")
    commands: tuple[ScpiText, ...] = Field(default=(), description="instead of CONF: for an instrument of other words")
    read: ScpiText = Field(default="READ?", description="what is asked for one reading")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.commands and not (self.range is None and self.nplc is None):
            raise ValueError("with commands of its own, range and nplc belong into them")
        return self

    def function_of(self, method: Method) -> Function:
        """Return what the instrument measures for a method."""
        return self.function or DEFAULT_FUNCTIONS[method]


class MeterSection(Section):
    """The measuring instrument between needle and harness; without this section there is none."""

    kind: Literal["scpi"]
    address: str = Field(description="host:port of its SCPI socket, or a serial port")
    baudrate: int = Field(default=9600, ge=300, le=1_000_000, description="on a serial port (8N1)")
    terminator: Literal["lf", "crlf", "cr"] = Field(default="lf", description="ends commands and answers")
    answer_ms: float = Field(default=2000.0, ge=10, le=60_000, description="longest wait for one answer")
    model: str | None = Field(default=None, min_length=1, description="in its *IDN?; another one is refused")
    setup: tuple[ScpiText, ...] = Field(default=(), description="sent after opening, such as SYST:REM")
    close_channels: ScpiText = Field(default="ROUT:CLOS (@{channels})", description="of its scanner")
    open_channels: ScpiText = Field(default="ROUT:OPEN:ALL", description="of its scanner")
    channels: dict[str, Annotated[int, Field(ge=0)]] = Field(
        default={}, description="scanner channel of each net's pin of the harness"
    )
    contact_channel: int | None = Field(
        default=None, ge=0, description="scanner channel of the needle's second wire, by which contact is proved"
    )
    ground_net: str | None = Field(
        default=None, min_length=1, description="net against which voltage, diode and capacitance are measured"
    )
    methods: dict[Method, MeterMethodSection] = Field(default={}, description="what differs from the methods' own")

    @field_validator("address")
    @classmethod
    def _an_address(cls, given: str) -> str:
        parse_address(given)
        return given

    @field_validator("close_channels")
    @classmethod
    def _with_their_numbers(cls, given: str) -> str:
        if "{channels}" not in given:
            raise ValueError(
                f"{given!r} has no {{channels}}, which is where their numbers go: ROUT:CLOS (@{{channels}})"
            )
        return given

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for method, given in self.methods.items():
            function = given.function_of(method)
            if given.nplc is not None and function in WITHOUT_NPLC:
                raise ValueError(f"methods.{method.value}: {function.value} has no nplc")
            if given.range is not None and function in WITHOUT_RANGE:
                raise ValueError(f"methods.{method.value}: {function.value} has no range")
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
    clearance: ClearanceSection | None = None
    lights: LightsSection
    camera: CameraSection
    head: HeadSection
    board: BoardSection
    control_point: ControlPointSection | None = None
    meter: MeterSection | None = None
    touch: TouchSection = TouchSection()
    sense: SenseSection = SenseSection()
    ladder: LadderSection = LadderSection()
    reference: ReferenceSection | None = None
    brush: BrushSection | None = None
    pin: PinSection = PinSection()
    servo: ServoSection = ServoSection()
    api: ApiSection = ApiSection()
    metrics: MetricsSection = MetricsSection()
    maintenance: MaintenanceSection = MaintenanceSection()

    @property
    def lowest_z_um(self) -> float:
        """The lowest that Z is ever sent: the axis' own minimum, or the floor where that is higher."""
        return max(self.axes.z.minimum, self.gantry.floor_z_um)

    @property
    def press_um(self) -> float:
        """How far a touch for a measurement pushes the pin in, where its request says nothing."""
        return self.touch.overtravel_um if self.touch.overtravel_um is not None else self.gantry.overtravel_um


def load_config(path: Path) -> Config:
    """Read and check a configuration; raise `ConfigError` naming every problem."""
    config = read_checked(path, Config)
    _require_own(path, strict=config.api.curve)
    return resolved(config, path.resolve().parent)


def unlikely(path: Path) -> Unlikely:
    """Return what a configuration has that is possible and hardly meant."""
    return read_unlikely(path, Config)


def _require_own(path: Path, *, strict: bool) -> None:
    """Refuse a file that anybody could change; `strict`: also one that its group could."""
    mode = path.stat().st_mode
    if mode & (stat.S_IWOTH | (stat.S_IWGRP if strict else 0)):
        problem = f"can be changed by others (mode {stat.S_IMODE(mode):04o}); chmod go-w it"
        raise ConfigError(path, [("(file)", problem)])
