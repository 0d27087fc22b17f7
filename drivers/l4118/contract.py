"""What an axis is told and what it tells. No I/O."""

import zlib
from dataclasses import dataclass, field
from typing import Final, Literal

from drivers.bus import OdAddressing
from drivers.errors import MotionError
from drivers.l4118.diagnosis import NOTHING_SEEN, Evidence, diagnose
from drivers.l4118.image import WordOrder
from drivers.l4118.objects import (
    DI_HOME,
    DI_INTERLOCK,
    DI_NEGATIVE_LIMIT,
    DI_POSITIVE_LIMIT,
    SW_ACKNOWLEDGE,
    SW_LIMIT_EXCEEDED,
    SW_MODE_ERROR,
    SW_TARGET_REACHED,
    SW_VOLTAGE,
    VENDOR_NANOTEC,
    PowerState,
    decode_state,
)

# How many requests `Axis.health` makes
HEALTH_REQUESTS: Final = 8
# Bit of 3240h:01 that each homing method cannot do without
_HOMING_SWITCH = {
    17: DI_NEGATIVE_LIMIT,
    18: DI_POSITIVE_LIMIT,
    **dict.fromkeys((19, 20, 21, 22), DI_HOME),
}


@dataclass(frozen=True, slots=True)
class HomingConfig:
    """How the axis finds its reference; lengths in the axis' own unit (um or deg)."""

    method: int = 17
    """6098h: 17/18 negative/positive limit switch, 19..22 home switch, 33/34 index, 35/37 where it stands."""
    switch_speed_units_s: float = 5000.0
    zero_speed_units_s: float = 1000.0
    acceleration_units_s2: float = 50000.0
    home_position_units: float = 0.0
    """Coordinate of the place where homing ends. Kept here; 607Ch stays zero, its sign is not settled."""
    timeout_s: float = 60.0


@dataclass(frozen=True, slots=True)
class AxisConfig:
    """One axis. Lengths are in the axis' own unit: um for X, Y, Z and deg for theta."""

    name: str
    address: int
    increments_per_unit: float
    """Negative when the axis counts against the motor."""
    min_units: float
    max_units: float
    speed_units_s: float
    acceleration_units_s2: float
    window_units: float
    """How far from the target the axis may report to be after a move."""
    homing: HomingConfig = field(default_factory=HomingConfig)
    increments_per_rev: float = 3_276_800.0
    """Motor increments per turn: pole pairs x 65536."""
    vendor_id: int = VENDOR_NANOTEC
    addressing: OdAddressing | None = None
    """FC 43 details; None: probed at start by reads that move nothing."""
    word_order: WordOrder | Literal["auto"] = "auto"
    """Order of the words of a 32 bit value in the process image; auto: found at start."""
    poll_s: float = 0.01
    """Time between two looks at the drive while waiting for it."""
    state_timeout_s: float = 0.5
    """How long one state change, mode change or set-point acknowledge may take."""
    stall_s: float = 2.0
    """A move whose position stands still this long short of its target is a stall."""
    switch_inputs: int | None = None
    """3240h:01, which inputs act as switches: bit 0 negative limit, 1 positive limit, 2 home. Written at start; None:
    left as it is."""
    motor_mode: int | None = None
    """3202h as it has to be; None: anything that can be a motor mode."""

    def __post_init__(self) -> None:
        if not self.min_units < self.max_units:
            raise ValueError(f"{self.name}: min_units must be below max_units")
        if self.increments_per_unit == 0:
            raise ValueError(f"{self.name}: increments_per_unit must not be zero")
        if min(self.speed_units_s, self.acceleration_units_s2, self.window_units) <= 0:
            raise ValueError(f"{self.name}: speed, acceleration and window must be above zero")

    @property
    def ramp_s(self) -> float:
        """Give how long a ramp from full speed to standstill takes."""
        return max(self.speed_units_s, self.homing.switch_speed_units_s) / self.acceleration_units_s2

    @property
    def increment_units(self) -> float:
        """Give how far one increment is."""
        return 1.0 / abs(self.increments_per_unit)

    @property
    def homing_switch(self) -> int:
        """Give the bit of 3240h:01 without which the homing method finds no switch; zero when it needs none."""
        return _HOMING_SWITCH.get(self.homing.method, 0)

    def to_increments(self, position_units: float) -> int:
        """Convert a coordinate to the drive's position, rounded to whole increments."""
        return round((position_units - self.homing.home_position_units) * self.increments_per_unit)

    def to_units(self, increments: int) -> float:
        """Convert the drive's position to a coordinate."""
        return increments / self.increments_per_unit + self.homing.home_position_units

    @property
    def homed_marker(self) -> int:
        """Give the number kept in 2400h:20h after homing; other homing settings give another number."""
        text = f"{self.homing.method} {self.homing.home_position_units:.6f} {self.increments_per_unit:.9f}"
        return zlib.crc32(text.encode()) or 1


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """One look at the Tx image."""

    statusword: int
    mode: int
    position_units: float
    inputs: int

    @property
    def state(self) -> PowerState | None:
        """Give the state of the power machine."""
        return decode_state(self.statusword)

    @property
    def target_reached(self) -> bool:
        """Tell bit 10: there, or with halt standing still."""
        return bool(self.statusword & SW_TARGET_REACHED)

    @property
    def acknowledged(self) -> bool:
        """Tell bit 12: set-point taken, or homing attained."""
        return bool(self.statusword & SW_ACKNOWLEDGE)

    @property
    def mode_error(self) -> bool:
        """Tell bit 13: following error, or homing failed."""
        return bool(self.statusword & SW_MODE_ERROR)

    @property
    def limit_exceeded(self) -> bool:
        """Tell bit 11: internal limit active."""
        return bool(self.statusword & SW_LIMIT_EXCEEDED)

    @property
    def voltage(self) -> bool:
        """Tell bit 4: the power stage has voltage."""
        return bool(self.statusword & SW_VOLTAGE)

    @property
    def negative_limit(self) -> bool:
        """Tell whether the negative limit switch is active."""
        return bool(self.inputs & DI_NEGATIVE_LIMIT)

    @property
    def positive_limit(self) -> bool:
        """Tell whether the positive limit switch is active."""
        return bool(self.inputs & DI_POSITIVE_LIMIT)

    @property
    def interlock(self) -> bool:
        """Tell whether the interlock input is active."""
        return bool(self.inputs & DI_INTERLOCK)


@dataclass(frozen=True, slots=True)
class AxisHealth:
    """What an axis says of itself, for status pages and maintenance."""

    name: str
    state: str
    homed: bool
    position_units: float
    error_code: int
    """603Fh, zero when there is none."""
    error_meaning: str
    warning: bool
    negative_limit: bool
    positive_limit: bool
    following_error_units: float | None
    """60F4h, None when the drive has no such object."""
    evidence: Evidence = NOTHING_SEEN
    """What its trouble is judged by."""

    def trouble(self) -> MotionError | None:
        """Give the error that the axis stands in, None when it shows none; a limit switch is not among them."""
        return diagnose(self.name, self.evidence)


@dataclass(frozen=True, slots=True)
class AxisIdentity:
    """1018h: which drive this is."""

    vendor_id: int
    product_code: int
    revision: int
    """Firmware: the maker's own numbering."""
    serial_number: int


@dataclass(frozen=True, slots=True)
class AxisFindings:
    """What the self-test at start settled."""

    vendor_id: int
    addressing: OdAddressing
    word_order: WordOrder | None
    """None while no value has shown it: the position reads the same in both orders."""
    position_unit: int
    speed_unit: int
    tx_mapping: tuple[int, ...]
    motor_mode: int | None
    """3202h, None when the drive has no such object."""
    switch_inputs: int | None
    """3240h:01, None when the drive has no such object."""
    homed: bool
    status: AxisStatus
    error_code: int
    """603Fh, zero when there is none."""

    @property
    def fit(self) -> bool:
        """Whether nothing speaks against work: no error, no fault, not on a limit switch."""
        on_limit = self.homed and (self.status.negative_limit or self.status.positive_limit)
        return not (
            self.error_code or on_limit or self.status.state in (None, PowerState.FAULT, PowerState.FAULT_REACTION)
        )

    @property
    def position_units(self) -> float:
        """Where the axis was."""
        return self.status.position_units
